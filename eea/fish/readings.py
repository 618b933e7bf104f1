"""The readings of one trial that joint inference compares: at most 100 a second.

Readings closer than 0.01 s, the simulator's step, are averaged. If their noise is white, averaging
n readings divides it by the root of n. But many gyroscopes filter their readings, so the noise of
means is estimated from the log. Each sample has a weight that gives it the noise of one reading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP
from eea.core.angles import Floats
from eea.fish.swim_log import SwimLog

STEP_TIME_TOLERANCE = 1e-4  # s; samples this close to the end of a step count as taken there
# differences of this order, of samples 0.01 s apart, contain noise and no swimming
DIFFERENCE_ORDER = 4
FEWEST_DIFFERENCES = 20  # least number of differences to estimate the noise


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
