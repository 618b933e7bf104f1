"""The table of what is broken and when, and the player that moves robots from row to row.

A :class:`Scenario` is such a table of the fish's columns; the channels of another environment have
other columns. An episode begins in one row. At the step ``until`` it moves on to the next.
"""

from __future__ import annotations

from collections.abc import Mapping
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
        return np.diff(self.first, append=len(self.until))

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


class Slots(Player):
    """Moves B robots that begin new episodes at any time.

    The rows of a robot stand in a slot of its own. A slot has room for as many rows as any robot
    had so far, so that nothing else moves where one begins another episode.

    Parameters
    ----------
    stages
        The first episodes of the B robots.
    """

    def __init__(self, stages: Stages) -> None:
        self._room = 0
        self._stages = Stages(
            np.zeros(len(stages.first), np.intp), np.zeros(0, np.intp), np.zeros(0, np.intp),
            {name: column[:0] for name, column in stages.columns.items()}, {}, stages.stride,
        )  # fmt: skip
        self.row = np.zeros(len(stages.first), np.intp)
        self.next_change = np.full(len(stages.first), NEVER)
        self.begin(np.arange(len(stages.first)), stages)

    def begin(self, robots: Rows, stages: Stages, step: int = 0) -> dict[str, NDArray[Any]]:
        """Let robots (n,) play the n episodes of a table with the same columns, from a step on.

        Return their columns (n, ...) then.
        """
        counts = stages.counts
        most = int(counts.max(initial=0))
        if most > self._room:
            self._make_room(max(most, 2 * self._room))
        mine = self._stages
        first = robots * self._room
        rows = np.repeat(first - stages.first, counts) + np.arange(len(stages.until))
        mine.since[rows] = stages.since
        mine.until[rows] = stages.until
        for name, column in stages.columns.items():
            mine.columns[name][rows] = column
        rates = dict(mine.rates)
        for name in rates.keys() | stages.rates.keys():
            if name not in rates:
                rates[name] = np.zeros_like(mine.columns[name])
            rates[name][rows] = stages.rates.get(name, 0.0)
        self._replace(mine._replace(rates=rates, stride=stages.stride))
        passed = np.add.reduceat(stages.until <= step, stages.first)
        self.row[robots] = first + passed
        self._note(robots, step)
        return self._stages.at(self.row[robots], np.full(len(robots), step))

    def _make_room(self, room: int) -> None:
        """Give each robot room for more rows."""
        before = self._room
        count = len(self.row)

        def wider(table: NDArray[Any]) -> NDArray[Any]:
            shape = table.shape[1:]
            found = np.zeros((count, room, *shape), table.dtype)
            found[:, :before] = table.reshape(count, before, *shape)
            return found.reshape(count * room, *shape)

        mine = self._stages
        self.row += np.arange(count) * (room - before)
        self._stages = mine._replace(
            first=np.arange(count) * room,
            since=wider(mine.since),
            until=wider(mine.until),
            columns={name: wider(column) for name, column in mine.columns.items()},
            rates={name: wider(rate) for name, rate in mine.rates.items()},
        )
        self._room = room
