"""An environment of somebody else, and random texts of faults of its channels."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box

FACTORS = ("-2", "0", "0.3", "1.5")
NUMBERS = {
    "action": {
        "weak": FACTORS,
        "scale": FACTORS,
        "reversed": (),
        "seized": ("", "-0.7", "0.4"),
        "dead": (),
    },
    "observation": {
        "scale": FACTORS,
        "bias": ("-3", "0.1", "0.7"),
        "stuck": (),
        "dropped": (),
    },
}
TIMES = {"delay": ("1", "2", "3"), "hold": ("1.5", "2", "3.7")}  # in steps
SIZES = {"action": 2, "observation": 4}
LONGEST = 7  # steps of onsets, durations and growths
MOST_FAULTS = 5


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


def random_fault(rng: np.random.Generator, growing: bool) -> str:
    """Return the text of a fault of any word but noise, of channels of two actions and four senses.

    Only if ``growing`` it may grow.
    """
    side = str(rng.choice(list(NUMBERS)))
    words = NUMBERS[side] | TIMES
    word = str(rng.choice(list(words)))
    number = str(rng.choice(words[word])) if words[word] else ""
    first, last = sorted(rng.integers(0, SIZES[side], 2).tolist())
    part = str(rng.choice([side, f"{side}_{first}", f"{side}_{first}-{last}"]))
    times = ""
    if rng.random() < 0.7:
        times = f"@{rng.integers(0, LONGEST) + rng.choice([0.0, 0.4]):g}"
        if rng.random() < 0.5:
            times += f"+{rng.integers(1, LONGEST)}"
        if growing and word in ("weak", "scale", "bias") and rng.random() < 0.6:
            times += f"~{rng.uniform(0.5, LONGEST):.2f}"
    return f"{part}:{word}" + (f"={number}" if number else "") + times


def random_damages(rng: np.random.Generator, robots: int, growing: bool = True) -> list[str]:
    """Return texts of up to five faults for each of some robots."""
    return [
        "; ".join(random_fault(rng, growing) for _ in range(rng.integers(0, MOST_FAULTS + 1)))
        for _ in range(robots)
    ]
