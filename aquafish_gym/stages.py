"""The table of what is broken and when, and the player that moves robots from row to row.

A :class:`Scenario` is such a table of the fish's columns; the channels of another environment have
other columns. An episode begins in one row. At the step ``until`` it moves on to the next.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.array_types import Flags, Rows

NEVER = 2**31 - 1  # a step that no episode reaches


class Stages(NamedTuple):
    """The stages of P episodes: R rows, those of an episode side by side and in order."""

    first: Rows  #: (P,) the row with which each episode begins, ascending
    since: Rows  #: (R,) the step at which each row begins
    until: Rows  #: (R,) the step at which the next row begins; ``NEVER`` if none does
    columns: Mapping[str, NDArray[Any]]  #: (R, ...) what holds when a row begins
    #: (R, ...) by how much columns grow in every ``stride`` steps of a row; only those that do.
    rates: Mapping[str, NDArray[Any]]
    stride: int = 1

    @property
    def counts(self) -> Rows:
        """How many rows each episode (P,) has."""
        ends = np.empty_like(self.first)
        ends[:-1] = self.first[1:]
        ends[-1:] = len(self.until)
        return ends - self.first

    @property
    def episode(self) -> Rows:
        """The episode of each row (R,)."""
        return np.repeat(np.arange(len(self.first)), self.counts)

    @property
    def grows(self) -> Flags | None:
        """Whether anything grows in each row (R,); None if nothing ever does."""
        if not self.rates:
            return None
        grows = np.zeros(len(self.until), np.bool_)
        for rate in self.rates.values():
            grows |= rate.reshape(len(rate), -1).any(axis=1)
        return grows

    def at(self, rows: Rows, steps: Rows) -> dict[str, NDArray[Any]]:
        """Return the columns (n, ...) in rows (n,) at steps (n,) of the episodes."""
        now = {name: column[rows] for name, column in self.columns.items()}
        strides = (steps - self.since[rows]) // self.stride
        for name, rate in self.rates.items():
            now[name] += rate[rows] * strides.reshape(-1, *[1] * (rate.ndim - 1))
        return now


class Player:
    """Moves B robots through the rows of a table.

    Parameters
    ----------
    stages
        The episodes of the B robots, which all begin.

    Attributes
    ----------
    row
        (B,) the row in which each robot is.
    next_change
        (B,) the step at which each robot changes next; ``NEVER`` if it does not.
    """

    def __init__(self, stages: Stages) -> None:
        self.row = stages.first.copy()
        self.next_change = np.empty_like(self.row)
        self._replace(stages)
        self._note(np.arange(len(self.row)), 0)

    def move(self, robots: Rows) -> dict[str, NDArray[Any]]:
        """Let robots (n,), whose next change has come, change; return their columns (n, ...)."""
        step = self.next_change[robots]
        self.row[robots] += self._stages.until[self.row[robots]] == step
        self._note(robots, step)
        return self._stages.at(self.row[robots], step)

    def _replace(self, stages: Stages) -> None:
        self._stages = stages
        self._grows = stages.grows

    def _note(self, robots: Rows, step: Rows | int) -> None:
        """Note when robots (n,) change next, after a step (n,)."""
        row = self.row[robots]
        change = self._stages.until[row]
        if self._grows is not None:
            stride = self._stages.stride
            since = self._stages.since[row]
            grown = since + ((step - since) // stride + 1) * stride
            change = np.minimum(change, np.where(self._grows[row], grown, NEVER))
        self.next_change[robots] = change


class SlotTable:
    """The rows of B robots that begin episodes at any time, those of a robot in its own slot.

    A slot has room for as many rows as any robot had so far, so that nothing else moves where one
    begins another episode.

    Parameters
    ----------
    count
        B.
    neutral
        By the name of a column, what it holds in the rows of episodes without that column.

    Attributes
    ----------
    stages
        The table of B episodes; their rows are ``room`` apart, and those that are left are unused.
    room
        How many rows a slot has.
    """

    def __init__(self, count: int, neutral: Callable[[str], Any]) -> None:
        self.room = 0
        nothing = np.zeros(0, np.intp)
        self.stages = Stages(np.zeros(count, np.intp), nothing, nothing, {}, {})
        self._neutral = neutral

    def put(self, robots: Rows, stages: Stages) -> None:
        """Replace the rows of robots (n,) by those of the n episodes of a table."""
        counts = stages.counts
        most = int(counts.max(initial=0))
        if most > self.room:
            self._make_room(max(most, 2 * self.room))
        mine = self.stages
        rows = np.repeat(robots * self.room - stages.first, counts) + np.arange(len(stages.until))
        mine.since[rows] = stages.since
        mine.until[rows] = stages.until
        columns = self._filled(mine.columns, stages.columns, rows, self._neutral)
        rates = self._filled(mine.rates, stages.rates, rows, _nothing)
        # The stride of a table without growth says nothing.
        stride = stages.stride if stages.rates else mine.stride
        self.stages = mine._replace(columns=columns, rates=rates, stride=stride)

    def moved(self, rows: Rows, room: int) -> Rows:
        """Return the present numbers of rows, numbered when a slot had the ``room``."""
        robots, places = np.divmod(rows, max(room, 1))
        return robots * self.room + places

    def _filled(
        self,
        tables: Mapping[str, NDArray[Any]],
        values: Mapping[str, NDArray[Any]],
        rows: Rows,
        neutral: Callable[[str], Any],
    ) -> dict[str, NDArray[Any]]:
        """Return tables with ``values`` in some rows; what these lack is neutral."""
        found = dict(tables)
        for name in tables.keys() | values.keys():
            if name not in found:
                shape = (len(self.stages.until), *values[name].shape[1:])
                found[name] = np.full(shape, neutral(name), values[name].dtype)
            found[name][rows] = values[name] if name in values else neutral(name)
        return found

    def _make_room(self, room: int) -> None:
        """Give each robot room for more rows."""
        count = len(self.stages.first)

        def wider(table: NDArray[Any]) -> NDArray[Any]:
            shape = table.shape[1:]
            found = np.zeros((count, room, *shape), table.dtype)
            found[:, : self.room] = table.reshape(count, self.room, *shape)
            return found.reshape(count * room, *shape)

        mine = self.stages
        self.stages = mine._replace(
            first=np.arange(count) * room,
            since=wider(mine.since),
            until=wider(mine.until),
            columns={name: wider(column) for name, column in mine.columns.items()},
            rates={name: wider(rate) for name, rate in mine.rates.items()},
        )
        self.room = room


class SlotPlayer(Player):
    """Moves B robots that begin new episodes at any time.

    Parameters
    ----------
    stages
        The first episodes of the B robots.
    """

    def __init__(self, stages: Stages) -> None:
        count = len(stages.first)
        self._slots = SlotTable(count, _nothing)  # every episode has all columns
        self.row = np.zeros(count, np.intp)
        self.next_change = np.full(count, NEVER)
        self.begin(np.arange(count), stages)

    def begin(self, robots: Rows, stages: Stages, step: int = 0) -> dict[str, NDArray[Any]]:
        """Let robots (n,) play the n episodes of a table with the same columns, from a step on.

        Return their columns (n, ...) then.
        """
        room = self._slots.room
        self._slots.put(robots, stages)
        self.row = self._slots.moved(self.row, room)
        self._replace(self._slots.stages)
        passed = np.add.reduceat(stages.until <= step, stages.first)
        self.row[robots] = self._slots.stages.first[robots] + passed
        self._note(robots, step)
        return self._stages.at(self.row[robots], np.full(len(robots), step))


def _nothing(_name: str) -> int:
    return 0
