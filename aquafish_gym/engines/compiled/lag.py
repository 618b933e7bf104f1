"""Servos that are late, in the compiled loop: a ring of each robot's last commands.

The command of step n of 0.01 s stands in entry n % D of a ring of D. In a register each robot has
a lag of its own, so that its commands are copied from their entries one robot after another.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquafish_gym.command import lag_parts
from aquafish_gym.physics import simd
from aquafish_gym.physics.arithmetic import Number, fetch, put
from aquafish_gym.utils.array_types import Floats, Reals


class GivenCommands:
    """The last commands that B robots were given; 0 before the first one.

    Attributes
    ----------
    table
        What the kernel takes of it: (groups, D x F x width), D being 0 as long as no robot is late.
    """

    def __init__(self, batch: int, fins: int, width: int, dtype: type[np.floating]) -> None:
        self._fins = fins
        robots = np.arange(batch)
        self._group, self._lane = divmod(robots, width)
        self._width = width
        self.table: Reals = np.zeros((-(-batch // width), 0), dtype)

    @property
    def depth(self) -> int:
        """For how many steps commands are remembered, the present one included."""
        return int(self.table.shape[1]) // (self._fins * self._width)

    def extend(self, depth: int, steps_done: int) -> None:
        """Remember the commands of at least ``depth`` steps, from now on."""
        before = self._entries()
        if depth <= len(before):
            return
        self.table = np.zeros((len(self.table), depth * self._fins * self._width), self.table.dtype)
        last = steps_done - 1 - np.arange(len(before))
        self._entries()[last % depth] = before[last % max(len(before), 1)]

    def forget(self, rows: Any) -> None:
        """Let the robots that ``rows`` selects, as numpy would from (B,), start."""
        self._entries()[:, :, self._group[rows], self._lane[rows]] = 0.0

    def put(self, commands: Floats) -> None:
        """Set the commands (B, D, F) of the last D steps before step 0."""
        self._entries()[:, :, self._group, self._lane] = commands.transpose(1, 2, 0)

    def _entries(self) -> Reals:
        """View the table as (D, F, groups, width)."""
        groups = len(self.table)
        shape = (groups, self.depth, self._fins, self._width)
        view: Reals = self.table.reshape(shape).transpose(1, 2, 0, 3)
        return view


def begin_lag(conditions: Any, entry: int, lag_steps: Any, like: Number) -> Number:
    """Note the lags (width,) of a register's robots; return the shares of newer commands."""
    found, share = lag_parts(fetch(conditions, entry, like))
    put(lag_steps, 0, found)
    return share


def arrived(given: Any, lag_steps: Any, found: Any, step: int, fins: int, like: Number) -> None:
    """Find what each robot of a register was commanded its lag before a step: a number a fin."""
    width = lag_steps.size
    depth = given.size // (fins * width)
    now = step % depth
    first_lane = simd.first_lane(like)
    for lane in range(first_lane, first_lane + simd.lanes_here(like)):
        entry = now - int(lag_steps[lane])
        if entry < 0:
            entry += depth
        first = fins * entry * width + lane
        for fin in range(fins):
            found[lane + fin * width] = given[first + fin * width]
