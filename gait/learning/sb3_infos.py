"""The information of a batch of robots as stable-baselines3 has it: a dictionary for each robot.

A step of a thousand robots takes less time than filling their dictionaries, and few of them are
read. So each is filled from the batch's table when it is first read.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

Getter = Callable[[int], Any]


class Table:
    """The information of B robots, in numbers, arrays and dictionaries of each.

    Parameters
    ----------
    entries
        Arrays (B, ...), or such dictionaries, by name; under "_name" may be a mask (B,) of the
        robots that have the entry, as Gymnasium's vector environments give it.

    Examples
    --------
    >>> table = Table({"x": np.array([1.0, 2.0]), "late": np.array([3, 4]), "_late": [0, 1]})
    >>> table.row(0), table.row(1)
    ({'x': 1.0}, {'x': 2.0, 'late': 4})
    """

    def __init__(self, entries: dict[str, Any]) -> None:
        self.entries = entries

    def row(self, robot: int) -> dict[str, Any]:
        """Return the entries of one robot."""
        return {name: get(robot) for name, get, has in self._columns if has is None or has(robot)}

    def entry(self, name: str, robot: int) -> Any:
        """Return one entry of one robot."""
        return _getter(self.entries[name])(robot)

    @cached_property
    def _columns(self) -> list[tuple[str, Getter, Getter | None]]:
        """The names with what gets a robot's entry, and what says whether it has one."""
        found: list[tuple[str, Getter, Getter | None]] = []
        for name, values in self.entries.items():
            if not name.startswith("_"):
                mask = self.entries.get(f"_{name}")
                found.append(
                    (name, _getter(values), None if mask is None else np.asarray(mask).item)
                )
        return found


def _getter(values: Any) -> Getter:
    if isinstance(values, dict):
        return Table(values).row
    if not isinstance(values, np.ndarray) or not values.ndim:
        return lambda _: values  # of the whole batch
    if values.ndim == 1:
        return values.item
    return lambda robot: values[robot].copy()


def copied(info: dict[str, Any]) -> dict[str, Any]:
    """Return a batch's information with arrays of its own."""
    found = {}
    for name, values in info.items():
        array = isinstance(values, np.ndarray)
        found[name] = values.copy() if array else copied(values) if type(values) is dict else values
    return found


def joined(infos: list[dict[str, Any]]) -> dict[str, Any]:
    """Return a batch's information from that of each robot, which ``DictInfoToList`` gives."""
    found: dict[str, Any] = {}
    for i, info in enumerate(infos):
        for name, value in info.items():
            if name not in found:
                found[name] = np.full(len(infos), None, object)
                found[f"_{name}"] = np.zeros(len(infos), np.bool_)
            found[name][i], found[f"_{name}"][i] = value, True
    return found


class RobotInfo(dict[str, Any]):
    """A row of a table, as a dictionary that is filled when it is first read.

    Examples
    --------
    >>> info = RobotInfo(Table({"x": np.array([1.0, 2.0])}), 1)
    >>> info == {"x": 2.0}, dict(info), "y" in info
    (True, {'x': 2.0}, False)
    """

    __slots__ = ("_robot", "_table")

    def __init__(self, table: Table, robot: int) -> None:
        self._table: Table | None = table  # None once filled: it may be kept for long
        self._robot = robot

    def get(self, key: str, default: Any = None) -> Any:
        """Return the entry, or the default; trainers ask each robot for what is rarely there."""
        table = self._table
        if table is not None:
            if key not in table.entries:
                return default
            _fill(self)
        return super().get(key, default)

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)  # pickled and copied as what it holds


def _fill(info: RobotInfo) -> None:
    table = info._table
    if table is not None:
        info._table = None
        dict.update(info, table.row(info._robot))


def _filling(method: Any) -> Callable[..., Any]:
    def filled(self: RobotInfo, *args: Any, **kwargs: Any) -> Any:
        _fill(self)
        return method(self, *args, **kwargs)

    return filled


# Whatever else a dictionary can do begins with filling it. With __iter__ and keys among these,
# dict(info) and {**info} call them rather than look at what is stored.
_OF_THE_TYPE = {"__new__", "__getattribute__", "__class_getitem__", "fromkeys"}
for _name, _method in vars(dict).items():
    if callable(_method) and _name not in _OF_THE_TYPE | set(vars(RobotInfo)):
        setattr(RobotInfo, _name, _filling(_method))
