"""The specification of an environment: true about its length, and written so that it can be read.

Gymnasium writes a specification as JSON with whatever arguments ``gym.make`` was given. What JSON
lacks is written here as what the environments take for it: damage as its text, arrays as lists, an
enumeration's member as its value, a task or an engine as the name of its class. What could not be
read again is refused when it is written.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from numbers import Integral, Real
from pkgutil import resolve_name
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec

from aquafish_gym.damage import Damage, Fault
from aquafish_gym.engines.worlds import World
from aquafish_gym.envs.task import Task
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import BodyPlan, plan_document
from aquafish_gym.utils.validation import InvalidArgumentError, brief

MAXIMUM_TASK_STEPS = 360_000  # of 0.01 s in the longest task


class FishSpec(EnvSpec):
    """A specification of an environment that ends its episodes by itself."""

    _last: int | None = None  # how many steps its episodes have at most

    @classmethod
    def of(cls, spec: EnvSpec, last: int, plan: BodyPlan) -> FishSpec:
        """Return a specification with the length of its episodes, in steps, and the plan itself.

        A plan was given as a file, perhaps, which need not be there where it is read again.
        """
        given = {one.name: getattr(spec, one.name) for one in fields(spec) if one.init}
        if "plan" in spec.kwargs:
            given["kwargs"] = {**spec.kwargs, "plan": plan}
        found = cls(**given | {"max_episode_steps": last})
        found._last = last
        return found

    def __setattr__(self, name: str, value: Any) -> None:
        # Gymnasium's TimeLimit writes its own limit here, also one that the episode never reaches.
        if name == "max_episode_steps" and None not in (value, self._last):
            value = min(value, self._last)
        super().__setattr__(name, value)

    def __eq__(self, other: object) -> bool:
        """Return whether both are written alike; else whether all in them is equal."""
        if not isinstance(other, EnvSpec):
            return NotImplemented
        try:
            return _written(self) == _written(other)
        except (TypeError, ValueError):  # an argument cannot be written
            return type(self) is type(other) and _same(vars(self), vars(other))

    def to_json(self) -> str:
        """Return it as text in JSON.

        Raises
        ------
        InvalidArgumentError
            If an environment could not be made of that text.
        """
        return json.dumps(_written(self))


def _written(spec: EnvSpec) -> dict[str, Any]:
    """Return what is written of a specification, ready for JSON."""
    plain = {name: as_json(name, value) for name, value in spec.kwargs.items()}
    written: dict[str, Any] = json.loads(EnvSpec.to_json(replace(spec, kwargs=plain)))
    return written


def check_limit(steps: int | None, last: int, task: Task, dt: float) -> None:
    """Raise InvalidArgumentError for a limit of more steps than an episode has."""
    if steps is not None and steps > last:
        hint = ""
        if steps <= MAXIMUM_TASK_STEPS:
            hint = (
                ": for longer episodes give a longer task, such as "
                f"task=SwimForward(seconds={steps * dt:g})"
            )
        raise InvalidArgumentError(
            f"max_episode_steps must be at most {last}, the steps of {dt:g} s in the "
            f"{task.seconds:g} s of the task; got {brief(steps)}{hint}"
        )


def as_json(name: str, value: Any) -> Any:
    """Return an argument as JSON has it; InvalidArgumentError if it could not be read again."""
    match value:
        case None | bool():
            return value
        case Enum():
            return as_json(name, value.value)
        case str():
            return str(value)
        case Damage():
            return str(value)
        case Morphology():
            return value.to_array().tolist()
        case BodyPlan():
            return plan_document(value)
        case Fault():
            return as_json(name, vars(value))
        case Task():
            return _task_as_json(name, value)
        case type() if issubclass(value, World):
            return _place(name, value)
        case Mapping() if all(isinstance(key, str) for key in value):
            return {str(key): as_json(f"{name}.{key}", one) for key, one in value.items()}
        case list() | tuple() | range():
            return [as_json(name, one) for one in value]
        case Integral():
            return int(value)
        case np.ndarray() | np.generic():
            return as_json(name, value.tolist())
    if isinstance(value, Real) or hasattr(value, "__float__"):
        return float(value)
    if hasattr(value, "__array__"):
        return as_json(name, np.asarray(value))
    raise InvalidArgumentError(
        f"{name} cannot be written as JSON, and so neither can the environment's spec; got "
        f"{brief(value)}"
    )


def read_class(name: str, place: object, kind: Any) -> Any:
    """Return the class at a place, ``"module:Class"``, which must be of a kind."""
    try:
        found = resolve_name(place) if isinstance(place, str) and ":" in place else None
    except (ImportError, AttributeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} {brief(place)} cannot be imported: {error}") from None
    if not isinstance(found, type) or not issubclass(found, kind):
        raise InvalidArgumentError(
            f"{name} must be the place of a {kind.__name__}, as module:Class; got {brief(place)}"
        )
    return found


def read_task(description: Mapping[str, Any]) -> Task:
    """Return the task of a specification that was read: ``{"class": place, "fields": {...}}``."""
    state = description.get("fields")
    if set(description) != {"class", "fields"} or not isinstance(state, Mapping):
        raise InvalidArgumentError(
            "task must be a Task, its name, or an object of class and fields, as a spec has it; "
            f"got {brief(description)}"
        )
    return _rebuilt(read_class("task", description["class"], Task), state)


def _rebuilt(kind: Any, state: Mapping[str, Any]) -> Task:
    """Return a task in a state; made again by its constructor if its fields are known."""
    task: Task = object.__new__(kind)
    if not is_dataclass(kind):
        vars(task).update(state)
        return task
    given = {one.name for one in fields(kind) if one.init}
    try:
        task.__init__(**{name: one for name, one in state.items() if name in given})  # type: ignore[misc]
    except TypeError as error:
        raise InvalidArgumentError(f"task cannot be made as its spec says: {error}") from None
    return task


def _state(task: Task) -> dict[str, Any]:
    names: list[str] = [one.name for one in fields(task)] if is_dataclass(task) else []
    return {name: getattr(task, name) for name in names} | dict(getattr(task, "__dict__", {}))


def _task_as_json(name: str, task: Task) -> dict[str, Any]:
    state, kind = _state(task), type(task)
    plain = {key: as_json(f"{name}.{key}", value) for key, value in state.items()}
    found = {"class": _place(name, kind), "fields": plain}
    again = _state(_rebuilt(kind, json.loads(json.dumps(plain))))
    for key in state:
        if key not in again or not _same(state[key], again[key]):
            raise InvalidArgumentError(
                f"{name}.{key} would be read from JSON as {brief(again.get(key))}, and so the "
                f"environment's spec cannot be written; got {brief(state[key])}. A dataclass may "
                "convert it in __post_init__"
            )
    return found


def _same(one: Any, two: Any) -> bool:
    if type(one) is not type(two):
        return False
    if isinstance(one, dict):
        return one.keys() == two.keys() and all(_same(one[key], two[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(two) and all(map(_same, one, two))
    if isinstance(one, np.ndarray):
        return one.dtype == two.dtype and np.array_equal(one, two)
    return bool(one == two)


def _place(name: str, kind: type) -> str:
    """Return ``"module:Class"``, by which another program can import a class."""
    place = f"{kind.__module__}:{kind.__qualname__}"
    try:
        found = kind.__module__ != "__main__" and resolve_name(place) is kind
    except (ImportError, AttributeError, ValueError):
        found = False
    if not found:
        raise InvalidArgumentError(
            f"{name} cannot be written into a spec, as no other program could import {place}: "
            "define its class at the top of a module of its own"
        )
    return place
