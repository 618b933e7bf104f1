"""Windows of a recorded swim, which joint inference compares with simulated ones.

Simulations are interpolated to the times of the gyroscope's readings. The log itself is not
interpolated: correlated noise of neighbouring samples would look like a wrong model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import gcd
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.plans import BodyPlan
from aquafish_gym.utils.validation import InvalidArgumentError, flag, instance
from eea.core.angles import Floats
from eea.fish.rows import (
    DIFFERENCE_ORDER,
    STEP_TIME_TOLERANCE,
    Changes,
    GyroReadings,
    first_step,
    held,
    readings_of,
    unknown_changes,
    wide,
)
from eea.fish.swim_log import FEWEST_SAMPLES, SwimLog, new_readings, restamped, shown
from eea.infer.trials import Observed, twice
from eea.infer.words import SHARE_SAMPLES

#: Samples of the commands before a window that its servos may still obey, for a lag of 0.2 s.
LAG_SAMPLES = 20
# samples of a window from rest, and of one in motion
MAXIMUM_WINDOW_SAMPLES = {False: 1024, True: 512}
# of command in a window, at unknown times: each is another unknown
MOST_UNKNOWN_CHANGES = 40
MOST_WINDOWS = 8  # windows of a swim; more add time and little information
CUBIC_POINTS = 4
LONGEST_READING_SECONDS = 0.2  # between the readings that early stages of a search compare
# Fourth differences of readings within it hold noise and, to 2e-4 rad/s, no swimming, while the
# command stays the same.
STEADY_SECONDS = 0.201
FEWEST_STEADY = 100  # differences that tell the noise; from fewer it is too uncertain for a test
MEDIAN_SQUARE = 2.366  # the median of the sum of three squares of normal numbers
INDEPENDENT_SHARE = 0.7  # of overlapping differences, for the variance of their median square


@dataclass(frozen=True, eq=False)
class LogWindows:
    """E windows of at most T samples of a log, to be simulated for ``steps`` steps of 0.01 s.

    Shorter windows are padded with their last sample, without weight.
    """

    steps: int
    series: Floats  #: (E, K, F) commands.
    spin: Floats  #: (E, 3) the gyroscope's reading just before, rad/s.
    gyro: Floats  #: (E, T, 3) the readings, rad/s.
    interval: int  #: Number of samples for which each command is held.
    #: Number of samples of a series before its window; above 0 the robot is in mid-swim.
    begun: int
    time: Floats  #: (E, T) times of the readings, s after each window's beginning.
    #: (E, T), factors that give all samples the noise of one reading, 0 after a window's end; None
    #: for 1.
    weight: Floats | None
    stride: int  #: Early stages of a search compare every n-th reading, about 5 a second.
    ends: Floats  #: (E,) end of each window, s of swimming since the record began, over all trials.
    remarks: tuple[str, ...]  #: Sentences on the unused parts of the log.
    plan: BodyPlan
    changes: Changes | None = None  #: Changes of command at unknown times; ``series`` has the last.

    @cached_property
    def regular(self) -> bool:
        """Whether the samples are at the ends of the steps."""
        ends = TIMESTEP * np.arange(1, self.time.shape[1] + 1)
        near = np.abs(self.time - ends) < STEP_TIME_TOLERANCE
        return bool((near if self.weight is None else near | (self.weight == 0.0)).all())

    @cached_property
    def noise(self) -> tuple[float, int] | None:
        """The sd of the gyroscope's noise, rad/s, and the number of samples that tell it.

        Differences of the fourth order, divided by those of the times, leave noise alone; their
        median ignores outliers. Readings count while the command stays the same. None: there are
        too few, or they are too far apart.
        """
        points = DIFFERENCE_ORDER + 1
        if self.gyro.shape[1] < points:
            return None
        view = np.lib.stride_tricks.sliding_window_view
        time = view(self.time, points, axis=1)
        gyro = view(self.gyro, points, axis=1)  # (E, T', 3, points)
        weight = np.ones(self.time.shape) if self.weight is None else self.weight
        weight = view(weight, points, axis=1)
        seconds = np.where((weight > 0.0).all(axis=2), time[:, :, -1] - time[:, :, 0], np.inf)
        new = (np.diff(self.series, axis=1, prepend=self.series[:, :1]) != 0.0).any(axis=2)
        changes = np.cumsum(new, axis=1)
        steps = np.ceil((time[:, :, [0, -1]] - STEP_TIME_TOLERANCE) / TIMESTEP).astype(np.intp) - 1
        places = np.clip((self.begun + steps) // self.interval, 0, changes.shape[1] - 1)
        first, last = np.moveaxis(changes[np.arange(len(changes))[:, None, None], places], 2, 0)
        used = (first == last) & (seconds < STEADY_SECONDS)
        if self.changes is not None:
            ends = self.begun + time[:, :, [0, -1]] / TIMESTEP
            window = np.broadcast_to(np.arange(len(used))[:, None], used.shape)
            used &= ~self.changes.between(window, ends[:, :, 0], ends[:, :, 1])
        count = int(used.sum())
        if count < FEWEST_STEADY:
            return None
        apart = time[used][:, :, None] - time[used][:, None, :]
        factors = 1.0 / np.where(np.eye(points, dtype=np.bool_), 1.0, apart).prod(axis=2)
        factors /= np.linalg.norm(factors / weight[used], axis=1, keepdims=True)
        left = np.einsum("np,nap->na", factors, gyro[used])
        square = float(np.median((left**2).sum(axis=1))) / MEDIAN_SQUARE
        return square**0.5, int(INDEPENDENT_SHARE * count)

    @property
    def observed(self) -> Observed:
        """The trials of an inference; their commands are the windows' numbers."""
        return Observed(np.arange(len(self.gyro)), self.gyro, self.weight, self.time)

    def unknown(self, window: int | None = None) -> int:
        """Return the number of changes at unknown times, of one window or of all."""
        if self.changes is None:
            return 0
        there = (self.changes.jump != 0.0).any(axis=2)
        return int(np.sum(there if window is None else there[window]))

    def commands(self, windows: NDArray[np.intp], shares: Sequence[Floats]) -> Floats:
        """Return the commands (B, K, F) of ``windows`` (B,).

        ``shares`` (B,) of each unknown change say when it is: 0 at the row before, 1 at its own.
        """
        if self.changes is None:
            return self.series[windows]
        return self.changes.series(self.series, windows, np.stack(shares, axis=1))

    def sampled(self, signal: NDArray[Any], windows: NDArray[np.intp]) -> NDArray[Any]:
        """Return simulated signals (B, K, axes) of ``windows`` (B,) at the times of the readings.

        Signals are interpolated, unless the times are the ends of the steps.
        """
        if self.regular:
            return signal
        seen = np.empty((len(signal), self.time.shape[1], signal.shape[2]), signal.dtype)
        for window in np.unique(windows):
            rows = np.flatnonzero(windows == window)
            first, weights = self._cubics[window]
            weights = weights.astype(signal.dtype)[:, :, None]
            one = signal[rows]
            seen[rows] = sum(weights[:, k] * one[:, first + k] for k in range(CUBIC_POINTS))
        return seen

    @cached_property
    def _cubics(self) -> list[tuple[NDArray[np.intp], Floats]]:
        """The first samples and weights that interpolate each window's signals of ``steps``."""
        return [cubic_weights(time / TIMESTEP - 1.0, self.steps) for time in self.time]


def log_windows(
    log: SwimLog,
    moving: bool = False,
    seconds: float | None = None,
    within: float = TIMESTEP,
) -> LogWindows:
    """Cut a log into windows, which joint inference compares.

    Each trial from rest is a window of at most 1024 samples. A record in
    mid-swim is cut into at most eight windows of at most 512; the first 0.2 s only determine the
    servo speeds. Readings closer than 0.01 s are averaged, rows that repeat a driver's last reading
    are left out, and rows that were stamped on arrival in packets are stamped evenly; see
    ``eea.fish.rows`` and ``eea.logs.stamps``.

    Parameters
    ----------
    log
        A recorded swim.
    moving
        Whether each trial's record begins in mid-swim, in an unknown state.
    seconds
        Length of a window. A trial has as many windows as fit. Each has at least 16 readings, so it
        may be longer. None for the lengths above.
    within
        When a command changed is unknown where rows are farther apart than this, s; otherwise it
        is taken as the time of the row.

    Raises
    ------
    InvalidArgumentError
        If an argument has the wrong type, a trial is too short or there twice, no servo or reading
        ever changes, or the times of the rows are uncertain.
    """
    instance("log", log, SwimLog)
    flag("moving", moving)
    lead = LAG_SAMPLES if moving else 0
    log, remarks = restamped(log)
    remarks += _given_twice(log)
    windows: list[tuple[int, GyroReadings]] = []
    for index in range(len(log)):
        new = new_readings(log, index)
        if repeated := len(log.time[log.blocks[index]]) - len(new):
            remarks.append(
                f"in {log.name(index)} {repeated} rows repeat the reading of the row before: they "
                "are left out"
            )
        readings = readings_of(log, new, lead * TIMESTEP - STEP_TIME_TOLERANCE)
        if len(readings) < FEWEST_SAMPLES:
            raise InvalidArgumentError(
                f"{log.name(index)} must have at least {FEWEST_SAMPLES} readings, 0.01 s or more "
                f"apart, after the first {lead * TIMESTEP:g} s; it has {len(readings)}"
            )
        most = MAXIMUM_WINDOW_SAMPLES[moving]
        unknown = unknown_changes(log, index, within)
        if unknown is None:
            remarks.append(
                f"in {log.name(index)} the commands change in most rows: each is taken to begin at "
                "its row, since the readings do not tell when between two rows"
            )
        elif seconds is None and (count := int(unknown.sum())):
            most = max(FEWEST_SAMPLES, min(most, MOST_UNKNOWN_CHANGES * len(readings) // count))
        windows += [(index, each) for each in _cut(readings, moving, seconds, most)]
    windows = windows[: MOST_WINDOWS if moving and seconds is None else None]
    trial = np.array([index for index, _ in windows])
    first = np.array([readings.base for _, readings in windows])
    # A trial at rest may have begun to move any time since the row that would have come before.
    before = np.array([0.0 if moving else _before(log, index, within) for index in trial])
    origin = log.time[first] - before
    # The simulation has no sample before its first step.
    parts = [
        one.after(begin + TIMESTEP - STEP_TIME_TOLERANCE)
        for begin, (_, one) in zip(origin, windows, strict=True)
    ]
    time = _filled([one.time - begin for begin, one in zip(origin, parts, strict=True)])
    gyro = _filled([one.gyro for one in parts])
    weight = _filled([one.weight for one in parts], 0.0)
    steps = max(CUBIC_POINTS, int(np.ceil((time.max() - STEP_TIME_TOLERANCE) / TIMESTEP)))
    performed = [
        held(log, index, begin - lead * TIMESTEP, lead + steps, rest > 0.0, within)
        for index, begin, rest in zip(trial, origin, before, strict=True)
    ]
    series = np.array([one for one, _ in performed])
    changes = Changes.of([unknown for _, unknown in performed])
    if not moving and not series.any():
        raise InvalidArgumentError("log must contain motion: no servo moves in any of its trials")
    if (gyro == gyro[:, :1]).all():
        raise InvalidArgumentError("log must contain motion: its gyroscope never changes")
    edges = np.flatnonzero((np.diff(series, axis=1) != 0.0).any(axis=(0, 2))) + 1
    interval = (gcd(*edges.tolist()) or series.shape[1]) if changes is None else 1
    used = log.time[[one.last for _, one in windows]]
    used = used - log.time[[log.blocks[index].start for index in trial]]
    earlier = np.cumsum([0.0, *log.seconds])  # s of swimming before each trial
    for i, whole in enumerate(log.seconds):
        most = used[trial == i].max(initial=0.0)
        if most < 0.9 * whole:
            remarks.append(
                f"of the {shown(whole)} s of {log.name(i)} the first {shown(most)} s are used"
            )
        if not moving and not series[i].any():
            remarks.append(f"in {log.name(i)} no servo moves: it tells little about the body")
    slowest = max(float(np.median(np.diff(one.time))) for _, one in windows)
    return LogWindows(
        steps=steps,
        series=series[:, ::interval],
        spin=log.gyro[first] if moving else np.zeros((len(first), 3)),
        gyro=gyro,
        interval=interval,
        begun=lead,
        time=time,
        weight=None if (weight == 1.0).all() else weight,
        stride=max(1, int(LONGEST_READING_SECONDS / slowest + 1e-6)),
        ends=earlier[trial] + used,
        remarks=tuple(remarks),
        plan=log.plan,
        changes=changes,
    )


def _given_twice(log: SwimLog) -> list[str]:
    """Return a sentence on two trials that share samples, if there are such; refuse equal ones."""
    before: dict[bytes, int] = {}
    for index, rows in enumerate(log.blocks):
        gyro = log.gyro[rows]
        same = before.setdefault(gyro.tobytes() + log.commands[rows].tobytes(), index)
        if same != index and twice([gyro, gyro]):  # which is none by chance
            raise InvalidArgumentError(
                f"trials must be recordings of their own, each there once; {log.name(same)} and "
                f"{log.name(index)} are the same"
            )
    shared = twice([log.gyro[rows] for rows in log.blocks])
    if shared is None:
        return []
    first, second = (log.name(number - 1) for number in shared)
    return [f"{first} and {second} {SHARE_SAMPLES}"]


def _before(log: SwimLog, trial: int, within: float) -> float:
    """Return the s in whole steps before a trial's first row in which it may have begun to move."""
    step = first_step(log, trial)
    if not wide(step, within) or unknown_changes(log, trial, within) is None:
        return 0.0
    return TIMESTEP * float(np.ceil(step / TIMESTEP - 1e-6))


def _cut(
    readings: GyroReadings, moving: bool, seconds: float | None, most: int
) -> list[GyroReadings]:
    """Return the windows of a trial's readings; without ``seconds`` of at most ``most`` each."""
    whole = len(readings)
    if seconds is None:
        count = min(most, whole)
        return [
            readings[count * i : count * (i + 1)] for i in range(whole // count if moving else 1)
        ]
    found: list[GyroReadings] = []
    first = 0
    times = readings.end_times
    while first + FEWEST_SAMPLES <= whole:
        end = readings[first:].base_time + seconds + STEP_TIME_TOLERANCE
        stop = max(int(np.searchsorted(times, end, "right")), first + FEWEST_SAMPLES)
        if found and stop == whole and 2.0 * times[-1] - times[-2] <= end:
            break  # one more reading would fit
        found.append(readings[first:stop])
        first = stop
    return found


def _filled(parts: Sequence[Floats], last: float | None = None) -> Floats:
    """Return arrays (T, ...) as rows of one array, padded with their last entries or a number."""
    longest = max(map(len, parts))
    rows = []
    for part in parts:
        more = part[-1:] if last is None else np.full_like(part[-1:], last)
        rows.append(np.concatenate([part, np.repeat(more, longest - len(part), axis=0)]))
    return np.stack(rows)


def cubic_weights(at: Floats, count: int) -> tuple[NDArray[np.intp], Floats]:
    """Return the first sample (T,) and the weights (T, 4) of Lagrange cubics at places (T,).

    Places are among ``count`` samples, the first at 0. For an oscillation at 2 Hz sampled every
    0.01 s the error is at most 1e-4 of the amplitude; linear interpolation has 2e-3.
    """
    first = np.clip(np.floor(at).astype(np.intp) - 1, 0, count - CUBIC_POINTS)
    away = (at - first)[:, None] - np.arange(CUBIC_POINTS)
    weights = np.empty((len(at), CUBIC_POINTS))
    for point in range(CUBIC_POINTS):
        others = [k for k in range(CUBIC_POINTS) if k != point]
        weights[:, point] = np.prod(away[:, others], axis=1) / np.prod([point - k for k in others])
    return first, weights
