"""A batch asked about its robots one by one, as Gymnasium's SyncVectorEnv is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import seeding
from gymnasium.vector import VectorEnv

from aquafish_gym.engines.packages import AUTO
from aquafish_gym.envs.batching import of_each
from aquafish_gym.rendering import usable_modes
from aquafish_gym.utils.array_types import Rows
from aquafish_gym.utils.validation import InvalidArgumentError, brief

#: What all robots of a batch have in common, by the single environment's names.
BATCH_ATTRIBUTES = {
    "action_space": "single_action_space",
    "observation_space": "single_observation_space",
    "dt": "dt",
    "frame_skip": "frame_skip",
    "plan": "plan",
    "task": "task",
    "render_mode": "render_mode",
}
OWN_ATTRIBUTES = ("metadata", "np_random", "np_random_seed", "spec")
ATTRIBUTE_METHODS = ("has_wrapper_attr", "get_wrapper_attr", "set_wrapper_attr")
#: Arguments of a batch that are none of a robot's.
BATCH_ARGUMENTS = (
    "num_envs", "vectorization_mode", "dtype", "threads", "autoreset_mode", "max_episode_steps"
)  # fmt: skip
ROBOT_ARGUMENTS = ("morphology", "damage", "fin_angles")


class RobotAttributes(VectorEnv[Any, Any, Any]):
    """``get_attr``, ``set_attr``, ``call`` and the seeds of a batch, robot by robot."""

    _seeded: Sequence[tuple[np.random.Generator, int]] = ()
    _added: Mapping[str, list[Any]] = MappingProxyType({})  # the attributes that set_attr added
    _rngs: list[np.random.Generator]

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return what a method or attribute of each robot's environment gives.

        Methods are ``render`` and Gymnasium's ``has_wrapper_attr``, ``get_wrapper_attr`` and
        ``set_wrapper_attr``. ``reset``, ``step`` and ``close`` are of the whole batch.
        """
        if name == "render":
            return self.render() or (None,) * self.num_envs
        if name in ("reset", "step", "close"):
            raise InvalidArgumentError(
                f"call must not be of {name!r}, as robots of a batch have no {name} of their own: "
                f"use {name} of the batch, which takes a reset_mask among its options"
            )
        if name == "get_wrapper_attr":
            return self._attributes(*args, **kwargs)
        if name == "has_wrapper_attr":
            return (self._has_attribute(*args, **kwargs),) * self.num_envs
        if name == "set_wrapper_attr":
            return self._set_attributes(*args, **kwargs)
        found = self._attributes(name)
        return tuple(one(*args, **kwargs) if callable(one) else one for one in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each robot's environment; AttributeError if there is none."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of each robot's environment: a list or tuple of them, or one for all.

        InvalidArgumentError for those that the batch is made with, such as ``task``.
        """
        each = list(values) if isinstance(values, list | tuple) else [values] * self.num_envs
        if len(each) != self.num_envs:
            raise InvalidArgumentError(
                f"values must be one for all robots or {self.num_envs} of them; got {len(each)}"
            )
        if name == "np_random":
            for rng in each:
                if not isinstance(rng, np.random.Generator):
                    raise InvalidArgumentError(
                        f"np_random must be numpy Generators; got {brief(rng)}"
                    )
            self._seeded = [(rng, -1) for rng in each]  # -1 is unknown, as in Gymnasium
            self._rngs[:] = each if self._rngs else []
        elif hasattr(type(self), name) or name in (
            *BATCH_ATTRIBUTES,
            *OWN_ATTRIBUTES,
            *ATTRIBUTE_METHODS,
        ):
            raise InvalidArgumentError(
                f"{name} of robots cannot be set, as the batch is made with it: make another one"
            )
        else:
            self._added = {**self._added, name: each}

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generator of each robot."""
        return tuple(rng for rng, _ in self._generators())

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each robot; -1 where it is unknown."""
        return tuple(seed for _, seed in self._generators())

    def _seed(self, seeds: Sequence[int | None], rows: Rows) -> None:
        """Let the robots ``rows`` begin again with their ``seeds``, where they are given one."""
        found = list(self._generators())
        for i in rows.tolist():
            if seeds[i] is not None:
                found[i] = seeding.np_random(seeds[i])
        self._seeded, self._rngs = found, [rng for rng, _ in found]

    def _generators(self) -> Sequence[tuple[np.random.Generator, int]]:
        self._seeded = self._seeded or [seeding.np_random() for _ in range(self.num_envs)]
        return self._seeded

    def _has_attribute(self, name: str) -> bool:
        return name in (
            *self._added, *BATCH_ATTRIBUTES, *OWN_ATTRIBUTES, *ATTRIBUTE_METHODS, "render"
        )  # fmt: skip

    def _set_attributes(self, name: str, value: Any, force: bool = True) -> tuple[bool, ...]:  # noqa: ARG002
        """Do what Gymnasium's ``set_wrapper_attr`` does, for each robot."""
        self.set_attr(name, [value] * self.num_envs)
        return (True,) * self.num_envs

    def _attributes(self, name: str) -> tuple[Any, ...]:
        if name in self._added:
            return tuple(self._added[name])
        if name in BATCH_ATTRIBUTES:
            return (getattr(self, BATCH_ATTRIBUTES[name]),) * self.num_envs
        if name == "metadata":
            single = {"render_modes": usable_modes(), "render_fps": self.metadata["render_fps"]}
            return tuple(dict(single) for _ in range(self.num_envs))
        if name == "spec":
            return self._specs()
        if name in OWN_ATTRIBUTES:
            found: tuple[Any, ...] = getattr(self, name)
            return found
        known = ", ".join((*BATCH_ATTRIBUTES, *OWN_ATTRIBUTES, *self._added))
        raise AttributeError(f"robots of a batch have no attribute {name!r}; they have {known}")

    def _specs(self) -> tuple[EnvSpec | None, ...]:
        """Return specifications by which ``gym.make`` makes each robot by itself."""
        spec = self.spec
        if spec is None:
            return (None,) * self.num_envs
        alone = {name: one for name, one in spec.kwargs.items() if name not in BATCH_ARGUMENTS}
        if alone.get("engine", AUTO) == AUTO:  # a single robot's is PyBullet where it is installed
            alone["engine"] = "numba"
        each = {
            name: of_each(name, alone[name], self.num_envs)
            for name in ROBOT_ARGUMENTS
            if name in alone
        }
        return tuple(
            replace(spec, kwargs=alone | {name: values[i] for name, values in each.items()})
            for i in range(self.num_envs)
        )
