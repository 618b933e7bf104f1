"""The batched environment as stable-baselines3 wants it; loaded by ``baselines`` alone."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.morphology import Morphology

# Any, so that neither type checker nor reader needs torch for this one class.
_VecEnv: Any = import_module("stable_baselines3.common.vec_env").VecEnv


class LaneVecEnv(_VecEnv):  # type: ignore[misc]
    """``count`` robots of ``AquaFish-v0`` in the lanes; ``fin_angles`` "zero" or "random"."""

    def __init__(self, count: int, morphology: Morphology, fin_angles: str) -> None:
        # stable-baselines3 expects the new episode's first observation at once, and the old
        # one's last in its information.
        self._env = AquaFishVectorEnv(
            num_envs=count,
            morphology=morphology,
            fin_angles=fin_angles,
            autoreset_mode=AutoresetMode.SAME_STEP,
        )
        self.render_mode = None
        self._actions = np.zeros((count, 3), np.float32)
        super().__init__(count, self._env.single_observation_space, self._env.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """Begin an episode of every robot, with the seeds given by ``seed``."""
        seeds = self._seeds if any(seed is not None for seed in self._seeds) else None
        observations, _ = self._env.reset(seed=seeds)
        self._reset_seeds()
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Any, Any, Any, list[dict[str, Any]]]:
        """Return observations, rewards, whether episodes ended, and information."""
        observations, rewards, terminated, truncated, info = self._env.step(self._actions)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done):
            infos[i] = {
                "terminal_observation": info["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i]),
            }
        return observations, rewards.astype(np.float32), done, infos

    def close(self) -> None:
        self._env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self._env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ARG002
        raise AttributeError(f"{attr_name} cannot be set: the robots share one environment")

    def env_method(self, method_name: str, *_: Any, indices: Any = None, **__: Any) -> Any:  # noqa: ARG002
        raise AttributeError(f"{method_name} cannot be called: the robots share one environment")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ARG002
        return [False for _ in self._get_indices(indices)]
