"""The commands of a recorded swim, step by step, and their changes between two rows.

A row says which command held when it was written. The change before it lies anywhere since the row
before. Within the simulator's step of 0.01 s the time hardly matters, so a change is taken at its
row. Where rows are farther apart, a servo that changes its speed by 0.5 rev/s at an unknown time
within 0.05 s turns up to 9 degrees less or more, for good: the time is an unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW
from aquafish_gym.engines.api import TIMESTEP
from eea.core.angles import Floats
from eea.fish.readings import STEP_TIME_TOLERANCE
from eea.fish.swim_log import SwimLog

#: Rows that a log must have for each change of command: fewer do not tell the times of changes.
ROWS_PER_CHANGE = 2


@dataclass(frozen=True, eq=False)
class Changes:
    """At most C changes of command in each of E windows, each at an unknown time.

    Times are in steps of 0.01 s from the beginning of a window's series of commands.
    """

    earliest: Floats  #: (E, C)
    latest: Floats  #: (E, C)
    jump: Floats  #: (E, C, 3), what the commands change by; 0 where a window has fewer changes.

    @classmethod
    def of(cls, each: Sequence[Floats]) -> Changes | None:
        """Return the changes of windows, (C, 5) each: earliest, latest and jump; None without."""
        count = max(map(len, each))
        if not count:
            return None
        table = np.zeros((len(each), count, 5))
        for row, one in zip(table, each, strict=True):
            row[: len(one)] = one
        return cls(table[:, :, 0], table[:, :, 1], table[:, :, 2:])

    def __len__(self) -> int:
        return len(self.jump[0])

    def series(self, commands: Floats, windows: NDArray[np.intp], shares: Floats) -> Floats:
        """Return the commands (B, K, 3) of ``windows`` (B,), with changes at other times.

        ``commands`` (E, K, 3) have each change at its latest time. ``shares`` (B, C) are those of
        the times from the earliest, 0, to the latest, 1.
        """
        found = commands[windows]
        width = min(int(np.ceil((self.latest - self.earliest).max())) + 1, found.shape[1])
        rows = np.arange(len(windows))[:, None]
        for k in range(len(self)):
            earliest = self.earliest[windows, k]
            latest = self.latest[windows, k]
            first = np.clip(np.floor(earliest).astype(np.intp), 0, found.shape[1] - width)
            ends = first[:, None] + np.arange(1, width + 1)
            time = latest - (1.0 - shares[:, k]) * (latest - earliest)
            early = np.clip(ends - time[:, None], 0.0, 1.0)
            early -= np.clip(ends - latest[:, None], 0.0, 1.0)
            found[rows, ends - 1] += early[:, :, None] * self.jump[windows, k][:, None]
        return found

    def after(self, steps: int) -> Changes:
        """Return the changes of series that begin some steps earlier."""
        return Changes(self.earliest + steps, self.latest + steps, self.jump)

    def between(self, window: NDArray[np.intp], begin: Floats, end: Floats) -> NDArray[np.bool_]:
        """Return whether a change may lie between steps ``begin`` and ``end`` (...) of a window."""
        own = (self.jump[window] != 0.0).any(axis=-1)
        late = begin[..., None] < self.latest[window]
        early = self.earliest[window] < end[..., None]
        return np.asarray((own & late & early).any(axis=-1))


def unknown_changes(log: SwimLog, trial: int, within: float) -> NDArray[np.bool_] | None:
    """Return in which rows (T,) of a trial a command is new since an unknown time.

    The row before is more than ``within`` s earlier. None: the commands change in too many rows
    for the readings to tell when.
    """
    block = log.blocks[trial]
    new = np.append(False, (np.diff(log.commands[block], axis=0) != 0.0).any(axis=1))
    new[1:] &= wide(np.diff(log.time[block]), within)
    return None if ROWS_PER_CHANGE * new.sum() > len(new) else new


def held(
    log: SwimLog, trial: int, begin: float, steps: int, at_rest: bool, within: float
) -> tuple[Floats, Floats]:
    """Return the command (steps, 3) in each 0.01 s from ``begin``, in s, and unknown changes.

    A step in which the command changes has the mean, which turns the servos equally far. A change
    is taken at its row. Those whose times are unknown follow, (C, 5) as of :meth:`Changes.of`.
    ``at_rest``: the trial was at rest before its first row, and began to move since the row that
    would have come before.
    """
    block = log.blocks[trial]
    time = log.time[block]
    commands = log.commands[block]
    unknown = unknown_changes(log, trial, within)
    if unknown is None:
        unknown = np.zeros(len(time), np.bool_)
    if at_rest:
        time = np.append(time[0] - first_step(log, trial), time)
        commands = np.concatenate([np.zeros((1, 3)), commands])
        unknown = np.append(False, unknown)
        unknown[1] = commands[1].any()
    edges = begin + TIMESTEP * np.arange(steps + 1)
    at = np.clip(np.searchsorted(time, edges + STEP_TIME_TOLERANCE, "right") - 1, 0, None)
    until = np.clip(np.searchsorted(time, edges - STEP_TIME_TOLERANCE, "right") - 1, 0, None)
    turned = np.zeros(commands.shape)
    turned[1:] = np.cumsum(commands[:-1] * np.diff(time)[:, None], axis=0)
    passed = np.stack([np.interp(edges, time, axis) for axis in turned.T], axis=1)
    mean = np.clip(np.diff(passed, axis=0) / TIMESTEP, COMMAND_LOW, COMMAND_HIGH)
    jump = np.diff(commands, axis=0, prepend=commands[:1])
    changes = np.cumsum((jump != 0.0).any(axis=1))
    steady = changes[at[:-1]] == changes[until[1:]]
    series = np.where(steady[:, None], commands[at[:-1]], mean)
    before = np.append(time[0], time[:-1])
    unknown &= (time > edges[0]) & (before < edges[-1])
    ends = (np.stack([before, time], axis=1)[unknown] - begin) / TIMESTEP
    return series, np.concatenate([ends, jump[unknown]], axis=1)


def wide(seconds: ArrayLike, within: float) -> NDArray[np.bool_]:
    """Return whether rows are so far apart that the time of a change between them is unknown."""
    return np.asarray(np.asarray(seconds) > within + STEP_TIME_TOLERANCE)


def first_step(log: SwimLog, trial: int) -> float:
    """Return the usual time between the first rows of a trial, s."""
    return float(np.median(np.diff(log.time[log.blocks[trial]][:10])))
