"""The batched environments as vector environments of stable-baselines3 (extra ``rl``).

:class:`SB3VecEnv` adapts any of them; :class:`LaneVecEnv` observes the inputs of a controller.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import NDArray

from aquafish_gym.envs.autoreset import AutoresetMode
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.utils.array_types import Flags, Rows
from aquafish_gym.utils.validation import InvalidArgumentError, brief, instance
from gait.controllers.inputs import NetworkInputs
from gait.controllers.network import Senses
from gait.learning.train import load_extra

Options = dict[str, Any]

# Any, so that neither type checker nor reader needs torch for this one class.
_VecEnv: Any = load_extra("stable_baselines3.common.vec_env").VecEnv
_is_wrapped: Any = load_extra("stable_baselines3.common.env_util").is_wrapped


class SB3VecEnv(_VecEnv):  # type: ignore[misc]
    """A batched environment for stable-baselines3; ``VecMonitor`` around it logs the episodes.

    It does what stable-baselines3's ``DummyVecEnv`` does: seeds and options are those of the next
    reset, and ``reset_infos`` holds the information of the resets. But a step returns the whole
    information of the robots whose episode ended in it, which is what trainers, ``VecMonitor`` and
    ``evaluate_policy`` read; of the others only ``TimeLimit.truncated``, which is False. Filling a
    thousand dictionaries would take longer than the step. All of it is in ``info``, in arrays.

    Parameters
    ----------
    envs
        Such as ``gym.make_vec("AquaFish-v0", num_envs=64, autoreset_mode="Disabled")``, also in
        wrappers such as ``VectorFaultWrapper`` and those of ``gymnasium.wrappers.vector``.
    observation_space
        Of one robot; None is that of ``envs``.

    Attributes
    ----------
    envs
        As given: it is what is reset, stepped, rendered and closed.
    info
        The information of the last step or reset as ``envs`` gave it, such as ``info["faults"]``,
        (B,); a wrapper such as ``VecNormalize`` has it, too.
    earned
        (B,) the sum of the rewards times the time step in each robot's last whole episode; NaN
        before. An environment without ``dt`` has time steps of 1.

    Raises
    ------
    InvalidArgumentError
        If ``envs`` is no vector environment of Gymnasium, begins new episodes by itself, or
        observes anything but a ``Box``.
    """

    def __init__(
        self, envs: VectorEnv[Any, Any, Any], observation_space: Box | None = None
    ) -> None:
        mode = instance("envs", envs, VectorEnv).metadata.get("autoreset_mode")
        if mode is not AutoresetMode.DISABLED:
            raise InvalidArgumentError(
                f'autoreset_mode of envs must be "Disabled"; got {getattr(mode, "value", mode)!r}'
            )
        space = envs.single_observation_space
        if observation_space is not None:
            space = instance("observation_space", observation_space, Box)
        if not isinstance(space, Box):
            raise InvalidArgumentError(
                "envs must observe a Box; gymnasium.wrappers.vector.FlattenObservation makes one; "
                f"got {brief(space)}"
            )
        self.envs = envs
        self.info: Any = {}
        self.earned = np.full(envs.num_envs, np.nan)
        self._dt = float(getattr(envs.unwrapped, "dt", 1.0))
        self._sum = np.zeros(envs.num_envs)  # in the present episodes
        self._has_begun = False
        super().__init__(envs.num_envs, space, envs.single_action_space)
        self.metadata = envs.metadata

    def set_options(self, options: Sequence[Options] | Options | None = None) -> None:
        """Set the options of the next reset: one dictionary for all robots, or one for each."""
        several = (
            options if isinstance(options, list | tuple) else [{} if options is None else options]
        )
        for one in several:
            if "reset_mask" in instance("options", one, dict):
                raise InvalidArgumentError(
                    "options must not have reset_mask: a reset is of all robots"
                )
        if isinstance(options, list | tuple) and len(options) != self.num_envs:
            raise InvalidArgumentError(
                f"options must be one dictionary or num_envs = {self.num_envs} of them; "
                f"got {len(options)}"
            )
        super().set_options(options)

    def reset(self) -> NDArray[np.float32]:
        """Begin an episode of every robot, with the seeds and options set since the last reset."""
        groups = self._groups()
        if len(groups) > 1 and not self._has_begun:  # nor could a first reset be of some robots
            everyone = np.ones(self.num_envs, np.bool_)
            groups = [(everyone, {}), *groups]
        for mask, options in groups:
            observations = self._begin(mask, self._seed_of(mask), options)
        self._reset_seeds()
        self._reset_options()
        return observations

    def _groups(self) -> list[tuple[Flags, Options]]:
        """Return masks of the robots that share options, and these."""
        groups: dict[int, tuple[Flags, Options]] = {}
        for robot, options in enumerate(self._options):
            nobody = np.zeros(self.num_envs, np.bool_)
            mask, _ = groups.setdefault(id(options) if options else 0, (nobody, options))
            mask[robot] = True
        return list(groups.values())

    def _seed_of(self, mask: Flags) -> int | list[int | None] | None:
        """Return the seeds of the robots under ``mask``; one number if the others follow it."""
        seeds: list[int | None] = self._seeds
        own = [seed if chosen else None for seed, chosen in zip(seeds, mask, strict=True)]
        first = own[0]
        if first is not None and own == list(range(first, first + len(own))):
            return first  # which every vector environment takes
        return own if any(seed is not None for seed in own) else None

    def _begin(
        self,
        mask: Flags,
        seed: int | Sequence[int | None] | None = None,
        options: Options | None = None,
    ) -> NDArray[np.float32]:
        """Begin episodes of the robots under ``mask``; return what all observe."""
        given = (options or {}) | {"reset_mask": mask.copy()}
        observations, self.info = self.envs.reset(seed=seed, options=given)  # type: ignore[arg-type]
        self._has_begun = True
        self._sum[mask] = 0.0
        self._begun(mask, self.info)
        rows = np.flatnonzero(mask)
        for robot, info in zip(rows.tolist(), info_of_each(self.info, rows), strict=True):
            self.reset_infos[robot] = info
        return self._of_space(self._observe(observations))

    def _begun(self, mask: Flags, info: dict[str, Any]) -> None:
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
        raw, rewards, terminated, truncated, info = self.envs.step(self._actions)
        self._sum += rewards * self._dt
        observations = self._of_space(self._observe(raw))
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        if done.any():
            rows = np.flatnonzero(done)
            cut_off = (truncated & ~terminated)[rows].tolist()
            last = observations[rows]
            for i, entries in enumerate(info_of_each(info, rows)):
                ends = {"TimeLimit.truncated": cut_off[i], "terminal_observation": last[i]}
                infos[rows[i]] = entries | ends
            self.earned[done] = self._sum[done]
            observations = observations.copy()
            observations[done] = self._begin(done)[done]
        self.info = info
        return observations, rewards.astype(np.float32), done, infos

    def _of_space(self, observations: Any) -> NDArray[np.float32]:
        return np.asarray(observations, self.observation_space.dtype)

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return a frame of each robot, for ``render`` to tile, with ``"rgb_array"``."""
        if self.render_mode != "rgb_array":
            warnings.warn(
                f'render_mode of envs must be "rgb_array" for images; got {self.render_mode!r}',
                stacklevel=2,
            )
            return [None] * self.num_envs
        frames: Any = self.envs.render()
        return list(frames)

    def render(self, mode: str | None = None) -> NDArray[np.uint8] | None:
        """Return the frames of all robots as one image, or let ``envs`` show them."""
        if self.render_mode == "human" and mode in (None, "human"):
            self.envs.render()
            return None
        image: NDArray[np.uint8] | None = super().render(mode)
        return image

    def close(self) -> None:
        """Close ``envs``."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of each robot's environment."""
        own = {
            "observation_space": self.envs.single_observation_space,
            "action_space": self.envs.single_action_space,
            "render_mode": self.envs.render_mode,
        }  # of the outermost wrapper
        base: Any = self.envs.unwrapped
        if attr_name in own or not hasattr(base, "get_attr"):
            value = own[attr_name] if attr_name in own else getattr(base, attr_name)
            found = [value] * self.num_envs
        else:
            found = list(base.get_attr(attr_name))
        return [found[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of each robot's environment, or raise AttributeError."""
        base: Any = self.envs.unwrapped
        if not hasattr(base, "set_attr"):
            raise AttributeError(f"{attr_name} cannot be set: the robots share one environment")
        chosen = set(self._get_indices(indices))
        kept = self.get_attr(attr_name) if len(chosen) < self.num_envs else [None] * self.num_envs
        base.set_attr(attr_name, [value if i in chosen else kept[i] for i in range(self.num_envs)])

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Return the results of a method of each robot's environment.

        Raises AttributeError where the robots share an environment without ``call``, and
        NotImplementedError for some of the robots, as a batch calls it of all of them.
        """
        base: Any = self.envs.unwrapped
        if not hasattr(base, "call"):
            raise AttributeError(
                f"{method_name} cannot be called: the robots share one environment"
            )
        chosen = list(self._get_indices(indices))
        if set(chosen) != set(range(self.num_envs)):
            raise NotImplementedError(
                f"indices must be None, for all robots: a batch calls {method_name} of all of "
                f"them; got {indices!r}"
            )
        found = base.call(method_name, *method_args, **method_kwargs)
        return [found[i] for i in chosen]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return whether each robot's environment, or the batch, has a wrapper of this class."""
        layer: Any = self.envs
        while isinstance(layer, VectorWrapper) and not isinstance(layer, wrapper_class):
            layer = layer.env
        of_all = isinstance(layer, VectorWrapper)
        each = getattr(layer, "envs", None)  # of Gymnasium's own batch
        return [
            of_all or (each is not None and _is_wrapped(each[i], wrapper_class))
            for i in self._get_indices(indices)
        ]


def info_of_each(info: Any, rows: Rows) -> list[dict[str, Any]]:
    """Return the information of the robots ``rows`` (n,), a dictionary for each.

    ``info`` is that of a vector environment: arrays (B, ...) and such dictionaries by name, with a
    mask (B,) under "_name" of the robots that have the entry; or a list of B dictionaries.

    Examples
    --------
    >>> info = {"x": np.array([1.0, 2.0]), "late": np.array([3, 4]), "_late": np.array([0, 1])}
    >>> info_of_each(info, np.array([0, 1]))
    [{'x': 1.0}, {'x': 2.0, 'late': 4}]
    """
    if isinstance(info, list):
        return [dict(info[i]) for i in rows.tolist()]
    found: list[dict[str, Any]] = [{} for _ in range(len(rows))]
    for name, values in info.items():
        if name.startswith("_"):
            continue
        has_it = info.get(f"_{name}")
        there = [True] * len(rows) if has_it is None else np.asarray(has_it)[rows].tolist()
        for one, value, is_there in zip(found, _column(values, rows), there, strict=True):
            if is_there:
                one[name] = value
    return found


def _column(values: Any, rows: Rows) -> list[Any]:
    """Return an entry of each of the robots ``rows``."""
    if isinstance(values, dict):
        return info_of_each(values, rows)
    if not isinstance(values, np.ndarray) or not values.ndim:
        return [values] * len(rows)  # of the whole batch
    taken = values[rows]
    return taken.tolist() if taken.ndim == 1 else list(taken)


class LaneVecEnv(SB3VecEnv):
    """Robots of one task, from random poses, that observe a ``Controller``'s inputs.

    The ``count`` robots have the bodies (M, S) of a plan in turn; M is at most ``count``. The clock
    is in Hz, and an action is held for ``interval`` steps of 0.01 s.
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
        plan: BodyPlan = AQUAFISH,
        reactive: bool = False,
    ) -> None:
        fins = np.zeros((count, len(plan.fins)))
        self._inputs = NetworkInputs(senses, clock, interval, fins, plan)
        envs = AquaFishVectorEnv(
            count,
            bodies[0] if len(bodies) == 1 else np.resize(bodies, (count, bodies.shape[1])),
            plan=plan,
            reactive=reactive,
            damage=damage,
            fin_angles="random",
            frame_skip=interval,
            task=task,
            autoreset_mode=AutoresetMode.DISABLED,
        )
        super().__init__(envs, Box(-1.0, 1.0, (len(senses.names(plan)),), np.float32))

    def _begun(self, mask: Flags, info: dict[str, Any]) -> None:
        self._inputs.begin(mask, info["fin_angles"][mask])

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Take the actions of the next step, and track the fins by dead reckoning."""
        super().step_async(actions)
        self._inputs.follow(actions)

    def _observe(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the inputs (B, I)."""
        seen = self._inputs.observe(observations.astype(np.float64))
        return np.ascontiguousarray(seen, np.float32)
