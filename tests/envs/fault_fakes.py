"""What the tests of broken environments share."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box


class Echo(gym.Env[Any, Any]):
    """Observes how many steps were taken modulo 13, times 1, 2 and 3, and what was done."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(self, low: float = -10.0, high: float = 10.0, length: int = 8) -> None:
        self.action_space = Box(low, high, (2,), np.float32)
        self.observation_space = Box(-40.0, 40.0, (5,), np.float32)
        self.length, self.steps = length, 0

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.options, self.steps = options, 0
        return self._see(np.zeros(2)), {}

    def _see(self, action: Any) -> Any:
        return np.array([*(np.arange(1, 4) * (self.steps % 13)), *action], np.float32)

    def step(self, action: Any) -> Any:
        self.steps += 1
        return self._see(action), 1.0, False, self.steps == self.length, {}


def play(env: gym.Env[Any, Any], steps: int = 8, seed: int = 0) -> tuple[Any, list[Any]]:
    """Take random actions; return the observations (steps + 1, ...) and infos."""
    rng, space = np.random.default_rng(seed), env.action_space
    seen, info = env.reset(seed=seed)
    found, infos = [seen], [info]
    for _ in range(steps):
        action = rng.uniform(-1.0, 1.0, space.shape).astype(space.dtype)
        seen, *_, info = env.step(action)
        assert env.observation_space.contains(seen)
        found.append(seen)
        infos.append(info)
    return np.array(found), infos


def swim(env: gym.Env[Any, Any], steps: int = 100, seed: int = 3) -> bytes:
    found, _ = play(env, steps, seed)
    return bytes(found.tobytes())
