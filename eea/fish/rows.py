"""What a trial's rows say: its readings, at most 100 a second, and the command in each 0.01 s.

**Readings** closer than 0.01 s, the simulator's step, are averaged. If their noise is white,
averaging n readings divides it by the root of n. But many gyroscopes filter their readings, so the
noise of means is estimated from the log. Each sample has a weight that gives it the noise of one
reading.

**Commands**: a row says which one held when it was written. The change before it lies anywhere
since the row before. Within the simulator's step the time hardly matters, so a change is taken at
its row. Where rows are farther apart, a servo that changes its speed by 0.5 rev/s at an unknown
time within 0.05 s turns up to 9 degrees less or more, for good: the time is an unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.api import TIMESTEP
from eea.core.angles import Floats
from eea.fish.swim_log import SwimLog

STEP_TIME_TOLERANCE = 1e-4  # s; samples this close to the end of a step count as taken there
# differences of this order, of samples 0.01 s apart, contain noise and no swimming
DIFFERENCE_ORDER = 4
FEWEST_DIFFERENCES = 20  # least number of differences to estimate the noise
#: Rows that a log must have for each change of command: fewer do not tell the times of changes.
ROWS_PER_CHANGE = 2


@dataclass(frozen=True, eq=False)
class GyroReadings:
    """T readings of a trial, or of a window of it."""

    base: int  #: The log's row before the first reading.
    base_time: float  #: Time of that row, s.
    time: Floats  #: (T,) mean times, s.
    gyro: Floats  #: (T, 3) mean rates, rad/s.
    weight: Floats  #: (T,), factors that give each the noise of one reading.
    ends: NDArray[np.intp]  #: (T,) the last row of each mean.
    end_times: Floats  #: (T,) times of these rows, s.

    def __len__(self) -> int:
        return len(self.time)

    @property
    def last(self) -> int:
        """The log's row of the last reading."""
        return int(self.ends[-1])

    def __getitem__(self, rows: slice) -> GyroReadings:
        start = rows.start or 0
        base = self.base if start == 0 else int(self.ends[start - 1])
        base_time = self.base_time if start == 0 else float(self.end_times[start - 1])
        return self._some(rows, base, base_time)

    def after(self, time: float) -> GyroReadings:
        """Return the readings from a time on, with the same row before."""
        return self._some(self.time >= time, self.base, self.base_time)

    def _some(self, rows: slice | NDArray[np.bool_], base: int, base_time: float) -> GyroReadings:
        return GyroReadings(
            base, base_time, self.time[rows], self.gyro[rows], self.weight[rows], self.ends[rows],
            self.end_times[rows],
        )  # fmt: skip


def readings_of(log: SwimLog, rows: NDArray[np.intp], since: float) -> GyroReadings:
    """Return the readings of some rows of a trial, from ``since`` s after its first row on.

    A group of averaged readings is at most 0.01 s long, from the reading before it on.
    """
    time = log.time[rows]
    base = int(np.searchsorted(time, time[0] + since))
    starts = _groups(time[base + 1 :].tolist(), float(time[base])) if base < len(rows) else []
    if not starts:
        return GyroReadings(int(rows[-1]), float(time[-1]), *_nothing())
    at = base + 1 + np.array(starts)
    counts = np.diff(np.append(at, len(rows)))
    gyro = np.add.reduceat(log.gyro[rows], at, axis=0) / counts[:, None]
    ends = at + counts - 1
    mean = np.add.reduceat(time - time[0], at) / counts + time[0]
    mean = np.where(counts == 1, time[at], mean)
    weight = counts ** (0.5 * _whiteness(log.gyro[rows[ends]], gyro, counts))
    return GyroReadings(
        int(rows[base]), float(time[base]), mean, gyro, weight, rows[ends], time[ends]
    )


def _nothing() -> tuple[Floats, Floats, Floats, NDArray[np.intp], Floats]:
    none = np.empty(0)
    return none, np.empty((0, 3)), none, np.empty(0, dtype=np.intp), none


def _groups(time: list[float], before: float) -> list[int]:
    """Return the first place of each group of readings at increasing times."""
    starts: list[int] = []
    until = -np.inf
    for i, now in enumerate(time):
        if now > until:
            starts.append(i)
            own = now - before
            if i + 1 < len(time):  # after a gap, the step to the next row
                own = min(own, time[i + 1] - now)
            until = now + TIMESTEP - own + min(STEP_TIME_TOLERANCE, 0.5 * own)
        before = now
    return starts


def _whiteness(single: Floats, mean: Floats, counts: NDArray[np.intp]) -> float:
    """Return how white the noise is: 1 if n averaged readings have 1/n of the variance, 0 if all.

    ``single`` (T, 3) is one reading of each group. Where the samples are 0.01 s apart, differences
    of the fourth order leave noise alone.
    """
    if len(counts) <= DIFFERENCE_ORDER:
        return 0.0
    several = np.lib.stride_tricks.sliding_window_view(counts > 1, DIFFERENCE_ORDER + 1).all(axis=1)
    if several.sum() < FEWEST_DIFFERENCES:
        return 0.0
    one, less = (
        float(np.median((np.diff(each, DIFFERENCE_ORDER, axis=0) ** 2).sum(axis=1)[several]))
        for each in (single, mean)
    )
    if not min(one, less) > 0.0:
        return 0.0
    return float(np.clip(np.log(one / less) / np.log(np.median(counts[counts > 1])), 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Changes:
    """At most C changes of command in each of E windows, each at an unknown time.

    Times are in steps of 0.01 s from the beginning of a window's series of commands.
    """

    earliest: Floats  #: (E, C)
    latest: Floats  #: (E, C)
    jump: Floats  #: (E, C, F), what the commands change by; 0 where a window has fewer changes.

    @classmethod
    def of(cls, each: Sequence[Floats]) -> Changes | None:
        """Return the changes of windows, (C, 2 + F) each: earliest, latest, jump; None without."""
        count = max(map(len, each))
        if not count:
            return None
        table = np.zeros((len(each), count, each[0].shape[1]))
        for row, one in zip(table, each, strict=True):
            row[: len(one)] = one
        return cls(table[:, :, 0], table[:, :, 1], table[:, :, 2:])

    def __len__(self) -> int:
        return len(self.jump[0])

    def series(self, commands: Floats, windows: NDArray[np.intp], shares: Floats) -> Floats:
        """Return the commands (B, K, F) of ``windows`` (B,), with changes at other times.

        ``commands`` (E, K, F) have each change at its latest time. ``shares`` (B, C) are those of
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
    """Return the command (steps, F) in each 0.01 s from ``begin``, in s, and unknown changes.

    A step in which the command changes has the mean, which turns the servos equally far. A change
    is taken at its row. Those whose times are unknown follow, (C, 2 + F) as of :meth:`Changes.of`.
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
        commands = np.concatenate([np.zeros_like(commands[:1]), commands])
        unknown = np.append(False, unknown)
        unknown[1] = commands[1].any()
    edges = begin + TIMESTEP * np.arange(steps + 1)
    at = np.clip(np.searchsorted(time, edges + STEP_TIME_TOLERANCE, "right") - 1, 0, None)
    until = np.clip(np.searchsorted(time, edges - STEP_TIME_TOLERANCE, "right") - 1, 0, None)
    turned = np.zeros(commands.shape)
    turned[1:] = np.cumsum(commands[:-1] * np.diff(time)[:, None], axis=0)
    passed = np.stack([np.interp(edges, time, axis) for axis in turned.T], axis=1)
    mean = np.diff(passed, axis=0) / TIMESTEP
    mean = np.clip(mean, log.plan.command_low, log.plan.command_high)
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
