"""The batched environment as stable-baselines3 wants it; loaded by ``learner`` alone."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from aquafish_gym.engines.base import TIMESTEP
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.physics.arithmetic import TAU
from gait.network import GYRO_SCALE, Senses

# Any, so that neither type checker nor reader needs torch for this one class.
_VecEnv: Any = import_module("stable_baselines3.common.vec_env").VecEnv


class LaneVecEnv(_VecEnv):  # type: ignore[misc]
    """Robots of ``AquaFish-v0`` in the lanes, from random poses, that feel as a controller does.

    An observation is a ``Controller``'s inputs, in their order (``senses.names``).

    Parameters
    ----------
    count
        Robots.
    bodies
        (M, 9) sizes of the bodies that robots have, in turn; M at most ``count``.
    senses, clock
        What they feel, and the frequency of their clock in Hz.
    interval
        For how many steps of 0.01 s an action is held.

    Attributes
    ----------
    fin_angles
        (count, 3) where the fins are, in rad. Who knows where they were at first and has added
        the commands since knows it, too, to rounding.
    distances
        (count,) how far each robot came in its last whole episode, in units; NaN before.
    """

    def __init__(
        self, count: int, bodies: NDArray[np.float64], senses: Senses, clock: float, interval: int
    ) -> None:
        self.render_mode = None
        self.distances = np.full(count, np.nan)
        self._senses = senses
        self._turn = TAU * clock * interval * TIMESTEP  # of the clock in a step, rad
        self._steps = np.zeros(count)  # of the present episodes
        self._env = AquaFishVectorEnv(
            count,
            bodies[0] if len(bodies) == 1 else np.resize(bodies, (count, 9)),
            fin_angles="random",
            frame_skip=interval,
            autoreset_mode=AutoresetMode.DISABLED,
        )
        space = Box(-1.0, 1.0, (len(senses.names),), np.float32)
        super().__init__(count, space, self._env.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """Begin an episode of every robot, with the seeds given by ``seed``."""
        seed = self._seeds[0]  # the others' follow it
        self._reset_seeds()
        return self._begin(np.ones(self.num_envs, np.bool_), seed)

    def _begin(self, mask: NDArray[np.bool_], seed: int | None = None) -> NDArray[np.float32]:
        felt, info = self._env.reset(seed=seed, options={"reset_mask": mask})
        self._steps[mask] = 0.0
        return self._observe(felt, info)

    def _observe(self, felt: NDArray[np.float32], info: dict[str, Any]) -> NDArray[np.float32]:
        """Return what a controller would have as its inputs (see ``network.respond``)."""
        self.fin_angles = info["fin_angles"]
        senses = self._senses
        angles = np.outer(self._steps, self._turn * np.arange(1, senses.clock + 1))
        if senses.fins:
            angles = np.hstack([angles, self.fin_angles])
        waves = np.stack([np.sin(angles), np.cos(angles)], axis=2).reshape(self.num_envs, -1)
        imu = [felt[:, :6], np.clip(felt[:, 6:] / GYRO_SCALE, -1.0, 1.0)] if senses.imu else []
        return np.hstack([*imu, waves], dtype=np.float32, casting="same_kind")

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Any, Any, Any, list[dict[str, Any]]]:
        """Return observations, rewards, whether episodes ended, and information.

        stable-baselines3 expects the new episode's first observation at once, and the old one's
        last in its information.
        """
        felt, rewards, terminated, truncated, info = self._env.step(self._actions)
        self._steps += 1.0
        observations, done = self._observe(felt, info), terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if done.any():
            for i in np.flatnonzero(done):
                infos[i]["terminal_observation"] = observations[i]
                infos[i]["TimeLimit.truncated"] = bool(truncated[i])
            self.distances[done] = info["y_position"][done]
            observations = self._begin(done)
        return observations, rewards.astype(np.float32), done, infos

    def close(self) -> None:
        """Do nothing: there is nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ARG002
        raise AttributeError(f"{attr_name} cannot be set: the robots share one environment")

    def env_method(self, method_name: str, *_: Any, indices: Any = None, **__: Any) -> Any:  # noqa: ARG002
        raise AttributeError(f"{method_name} cannot be called: the robots share one environment")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ARG002
        return [False for _ in self._get_indices(indices)]
