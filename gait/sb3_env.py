"""The batched environments as vector environments of stable-baselines3 (extra ``rl``).

:class:`SB3VecEnv` adapts any of them; :class:`LaneVecEnv` observes the inputs of a controller.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from aquafish_gym.command import reckon, servo_speeds
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.physics.arithmetic import TAU, Vector
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.network import Senses, observe

# Any, so that neither type checker nor reader needs torch for this one class.
_VecEnv: Any = import_module("stable_baselines3.common.vec_env").VecEnv


class SB3VecEnv(_VecEnv):  # type: ignore[misc]
    """A batched environment for stable-baselines3; ``VecMonitor`` around it logs the episodes.

    Parameters
    ----------
    envs
        Such as ``gym.make_vec("AquaFish-v0", num_envs=64, autoreset_mode="Disabled")``.
    observation_space
        Of one robot; None is that of ``envs``.

    Attributes
    ----------
    earned
        (B,) the sum of the rewards times the time step in each robot's last whole episode; NaN
        before.
    """

    def __init__(self, envs: AquaFishVectorEnv, observation_space: Box | None = None) -> None:
        if envs.autoreset_mode is not AutoresetMode.DISABLED:
            raise InvalidArgumentError(
                f'autoreset_mode of envs must be "Disabled"; got {envs.autoreset_mode.value!r}'
            )
        self.render_mode = None
        self.envs: AquaFishVectorEnv = envs.unwrapped
        self.earned = np.full(envs.num_envs, np.nan)
        self._sum = np.zeros(envs.num_envs)  # in the present episodes
        space = observation_space or envs.single_observation_space
        super().__init__(envs.num_envs, space, envs.single_action_space)

    def reset(self) -> NDArray[np.float32]:
        """Begin an episode of every robot, with the seeds given by ``seed``."""
        seed = self._seeds[0]  # the others' follow it
        self._reset_seeds()
        return self._begin(np.ones(self.num_envs, np.bool_), seed)

    def _begin(self, mask: NDArray[np.bool_], seed: int | None = None) -> NDArray[np.float32]:
        observations, info = self.envs.reset(seed=seed, options={"reset_mask": mask})
        self._sum[mask] = 0.0
        self._begun(mask, info)
        return self._observe(observations)

    def _begun(self, mask: NDArray[np.bool_], info: dict[str, Any]) -> None:
        """Note which episodes begin."""

    def _observe(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return what the learner observes."""
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, Any, Any, list[dict[str, Any]]]:
        """Return observations, rewards, whether episodes ended, and information.

        An ended episode's last observation is in its information, as stable-baselines3 expects.
        """
        raw, rewards, terminated, truncated, _ = self.envs.step(self._actions)
        self._sum += rewards * self.envs.dt
        observations, done = self._observe(raw), terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if done.any():
            for i in np.flatnonzero(done):
                infos[i]["terminal_observation"] = observations[i]
                infos[i]["TimeLimit.truncated"] = bool(truncated[i])
            self.earned[done] = self._sum[done]
            observations = self._begin(done)
        return observations, rewards.astype(np.float32), done, infos

    def close(self) -> None:
        """Do nothing: there is nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return this environment's attribute for each robot."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ARG002
        """Raise AttributeError."""
        raise AttributeError(f"{attr_name} cannot be set: the robots share one environment")

    def env_method(self, method_name: str, *_: Any, indices: Any = None, **__: Any) -> Any:  # noqa: ARG002
        """Raise AttributeError."""
        raise AttributeError(f"{method_name} cannot be called: the robots share one environment")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ARG002
        """Return False for each robot."""
        return [False for _ in self._get_indices(indices)]


class LaneVecEnv(SB3VecEnv):
    """Robots of one task, from random poses, that observe a ``Controller``'s inputs.

    The ``count`` robots have the bodies (M, 9) in turn; M is at most ``count``. The clock is in Hz,
    and an action is held for ``interval`` steps of 0.01 s.
    """

    def __init__(
        self,
        count: int,
        bodies: NDArray[np.float64],
        senses: Senses,
        clock: float,
        interval: int,
        task: object = "forward",
        damage: object = None,
    ) -> None:
        self._senses, self._clock = senses, clock
        self._steps, self._fins = np.zeros(count), np.zeros((count, 3))
        envs = AquaFishVectorEnv(
            count,
            bodies[0] if len(bodies) == 1 else np.resize(bodies, (count, 9)),
            damage=damage,
            fin_angles="random",
            frame_skip=interval,
            task=task,
            autoreset_mode=AutoresetMode.DISABLED,
        )
        super().__init__(envs, Box(-1.0, 1.0, (len(senses.names),), np.float32))

    def _begun(self, mask: NDArray[np.bool_], info: dict[str, Any]) -> None:
        self._steps[mask] = 0.0
        self._fins[mask] = info["fin_angles"][mask]

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Take the actions of the next step, and track the fins by dead reckoning."""
        super().step_async(actions)
        left, right, caudal = np.clip(actions, -1.0, 1.0, dtype=np.float64).T
        speeds, dt = servo_speeds((left, right, caudal)), self.envs.dt
        self._fins = np.stack(reckon(_columns(self._fins), speeds, TAU * dt), axis=1)
        self._steps += 1.0

    def _observe(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the inputs (B, I)."""
        seen = observations.astype(np.float64)
        up, north, gyro, way = (_columns(seen[:, i:][:, :3]) for i in (0, 3, 6, seen.shape[1] - 3))
        turns, fins = self._clock * self.envs.dt * self._steps, _columns(self._fins / TAU)
        values = np.empty((len(self._senses.names), self.num_envs))
        observe(values, self._senses.layout, turns, up, north, gyro, fins, way)
        return np.ascontiguousarray(values.T, np.float32)


def _columns(table: NDArray[np.float64]) -> Vector:
    x, y, z = table.T
    return (x, y, z)
