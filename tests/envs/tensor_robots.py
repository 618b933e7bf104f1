"""A small batched robot whose steps are arrays of any library, and its twin in NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space

from aquafish_gym.envs.autoreset import AutoresetMode


def array_of(library: str, dtype: str) -> Any:
    """Return an array of a library, as Arms takes it, or skip the test."""
    if library == "torch":
        torch = pytest.importorskip("torch")
        return torch.zeros(1, dtype=getattr(torch, dtype))
    return pytest.importorskip("jax").numpy.zeros(1, dtype)


class Arms(VectorEnv[Any, Any, Any]):
    """B arms of two joints: the actions are accelerations, and both angles and rates are observed.

    ``like`` is an array of the library to step. Episodes last 5 steps or, every other one, 6.
    """

    def __init__(
        self, like: Any, mode: AutoresetMode, count: int = 3, bounded: bool = True
    ) -> None:
        self.metadata = {"autoreset_mode": mode}
        self.num_envs, self._like = count, like
        dtype = np.dtype(str(like.dtype).rpartition(".")[2])
        action, observation = (1.0, 2.0) if bounded else (np.inf, np.inf)
        self.single_action_space = Box(-action, action, (2,), dtype)
        self.single_observation_space = Box(-observation, observation, (4,), dtype)
        self.action_space = batch_space(self.single_action_space, count)
        self.observation_space = batch_space(self.single_observation_space, count)
        self._dtype = dtype

    def array(self, values: Any) -> Any:
        """Return NumPy's numbers as an array of the library."""
        if isinstance(self._like, np.ndarray):
            return values.copy()
        module = type(self._like).__module__.partition(".")[0]
        if module == "torch":
            import torch

            return torch.from_numpy(values.copy())
        import jax.numpy

        return jax.numpy.asarray(values)

    def _seen(self) -> Any:
        return np.concatenate([self._angles, self._rates], axis=1).astype(self._dtype)

    def _start(self, rows: Any) -> None:
        self._angles[rows] = self.np_random.uniform(-0.5, 0.5, (len(rows), 2))
        self._rates[rows] = 0.0
        self._steps[rows] = 0

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        count = self.num_envs
        mask = (options or {}).get("reset_mask")
        if mask is None:
            self._angles, self._rates = np.zeros((2, count, 2))
            self._steps, self._over = np.zeros(count, int), np.zeros(count, bool)
            mask = np.ones(count, bool)
        mask = np.asarray(mask)
        self._start(np.flatnonzero(mask))
        self._over &= ~mask
        return self.array(self._seen()), {}

    def step(self, actions: Any) -> Any:
        mode = self.metadata["autoreset_mode"]
        self.acted = np.asarray(actions)
        begins = self._over & (mode is AutoresetMode.NEXT_STEP)
        self._rates = self._rates + 0.1 * self.acted.astype(np.float64)
        self._angles = self._angles + 0.1 * self._rates
        self._steps += 1
        self._start(np.flatnonzero(begins))
        ended = self._steps >= 5 + np.arange(self.num_envs) % 2
        info: dict[str, Any] = {}
        if mode is AutoresetMode.SAME_STEP and ended.any():
            last = self._seen()
            info["final_obs"] = self.array(last)
            info["_final_obs"] = self.array(ended)
            if isinstance(self._like, np.ndarray):
                info["final_obs"] = np.array([*last, None], object)[:-1]
            self._start(np.flatnonzero(ended))
        self._over = ended
        rewards = self.array(-np.abs(self._angles).sum(axis=1))
        return self.array(self._seen()), rewards, self.array(ended), self.array(ended & False), info
