"""The batched environment as stable-baselines3 wants it; loaded by ``learner`` alone."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from aquafish_gym.envs.vector import AquaFishVectorEnv
from gait.inputs import inputs, reckoned
from gait.network import Senses

# Any, so that neither type checker nor reader needs torch for this one class.
_VecEnv: Any = import_module("stable_baselines3.common.vec_env").VecEnv


class LaneVecEnv(_VecEnv):  # type: ignore[misc]
    """Robots of one task in the lanes, from random poses, that feel as a controller does.

    An observation is a ``Controller``'s inputs, in their order (``senses.names``). Where the fins
    are is known from where they were at first and the commands since.

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
    task, damage
        As the environment's.

    Attributes
    ----------
    earned
        (count,) what each robot's last whole episode came to, its rewards times the seconds that
        each was for: of the task "forward" units along the world's +y. NaN before.
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
        self.render_mode = None
        self.earned = np.full(count, np.nan)
        self._senses, self._clock = senses, clock
        self._steps, self._sum = np.zeros(count), np.zeros(count)  # of the present episodes
        self._fins = np.zeros((count, 3))
        self._env = AquaFishVectorEnv(
            count,
            bodies[0] if len(bodies) == 1 else np.resize(bodies, (count, 9)),
            damage=damage,
            fin_angles="random",
            frame_skip=interval,
            task=task,
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
        self._steps[mask] = self._sum[mask] = 0.0
        self._fins[mask] = info["fin_angles"][mask]
        return self._hear(felt)

    def _hear(self, felt: NDArray[np.float32]) -> NDArray[np.float32]:
        return inputs(self._senses, self._clock, felt, self._steps * self._env.dt, self._fins)

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Any, Any, Any, list[dict[str, Any]]]:
        """Return observations, rewards, whether episodes ended, and information.

        stable-baselines3 expects the new episode's first observation at once, and the old one's
        last in its information.
        """
        felt, rewards, terminated, truncated, _ = self._env.step(self._actions)
        self._steps += 1.0
        self._sum += rewards * self._env.dt
        self._fins = reckoned(self._fins, self._actions, self._env.dt)
        observations, done = self._hear(felt), terminated | truncated
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
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:  # noqa: ARG002
        raise AttributeError(f"{attr_name} cannot be set: the robots share one environment")

    def env_method(self, method_name: str, *_: Any, indices: Any = None, **__: Any) -> Any:  # noqa: ARG002
        raise AttributeError(f"{method_name} cannot be called: the robots share one environment")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ARG002
        return [False for _ in self._get_indices(indices)]
