"""Windows of a recorded swim, which joint inference compares with simulated ones."""

from __future__ import annotations

from math import gcd
from typing import NamedTuple

import numpy as np

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.utils.validation import InvalidArgumentError, flag, instance
from eea.core.angles import Floats
from eea.fish.interpolation import NEAR, steps_for
from eea.fish.swim_log import FEWEST, SwimLog

#: Samples of the commands before a window that its servos may still obey: a lag of 0.2 s.
BEFORE = 20
LONGEST = {False: 1024, True: 512}  # samples of a trial from rest, and of a window of a swim
MOST_WINDOWS = 8  # of swims: more tell little, slowly


class LogWindows(NamedTuple):
    """E windows of T samples of a log, to be simulated for K steps of 0.01 s."""

    series: Floats  #: (E, K, 3) commands.
    spin: Floats  #: (E, 3) the gyroscope's reading just before, rad/s.
    gyro: Floats  #: (E, T, 3) the readings, rad/s.
    interval: int  #: Samples that each command is held.
    begun: int  #: Samples of a series before its window.
    time: Floats  #: (E, T) of the readings, s after each window's beginning.
    names: tuple[str, ...]  #: Of each window: "trial 2", or "trial 1 from 5.3 s".
    ends: Floats  #: (E,) when each ends, s of swimming since the record began, over all trials.
    remarks: tuple[str, ...]  #: The parts that are not used, in sentences.


def log_windows(log: SwimLog, moving: bool = False, seconds: float | None = None) -> LogWindows:
    """Cut a log into windows of equally many samples, which joint inference compares.

    Each trial from rest is a window of at most 1024 samples. A record in mid-swim is cut into at
    most eight windows of at most 512; the first 0.2 s only show how the servos move. More than 100
    rows a second are averaged.

    Parameters
    ----------
    log
        A recorded swim.
    moving
        Whether each trial's record begins in mid-swim.
    seconds
        Approximate length of a window, of which there are then as many as fit; None for the above.

    Raises
    ------
    InvalidArgumentError
        If an argument has the wrong type, a trial is too short, or no servo or reading ever moves.
    """
    instance("log", log, SwimLog)
    flag("moving", moving)
    lead = BEFORE if moving else 0
    typical = float(np.median([np.median(np.diff(log.time[rows])) for rows in log.blocks]))
    averaged = max(1, int(TIMESTEP / typical + 1e-6))
    wanted = None if seconds is None else round(seconds / (typical * averaged))
    cuts, count = _cuts(log, moving, averaged, wanted)
    time, gyro = [], []
    for _, begin in cuts:
        rows = slice(begin + 1, begin + 1 + count * averaged)
        time.append((log.time[rows] - log.time[begin]).reshape(count, averaged).mean(axis=1))
        gyro.append(log.gyro[rows].reshape(count, averaged, 3).mean(axis=1))
    # The simulation has no sample before its first step.
    early = int((np.array(time) < TIMESTEP - NEAR).sum(axis=1).max())
    samples, times = np.array(gyro)[:, early:], np.array(time)[:, early:]
    series = np.array([
        _commands(log, trial, log.time[begin] - lead * TIMESTEP, lead + steps_for(times))
        for trial, begin in cuts
    ])  # fmt: skip
    if not moving and not series.any():
        raise InvalidArgumentError("log must contain motion: no servo moves in any of its trials")
    if (samples == samples[:, :1]).all():
        raise InvalidArgumentError("log must contain motion: its gyroscope never changes")
    names = [
        log.name(trial)
        + (f" from {log.time[begin] - log.time[log.blocks[trial].start]:.3g} s" if moving else "")
        for trial, begin in cuts
    ]
    remarks = _unused(log, {trial: begin + count * averaged for trial, begin in cuts})
    if not moving:
        remarks += [
            f"in {name} no servo moves, so it contains little information about the body"
            for name, commands in zip(names, series, strict=True)
            if not commands.any()
        ]
    interval = _held_for(series)
    spin = np.array([log.gyro[begin] if moving else np.zeros(3) for _, begin in cuts])
    before = np.cumsum([0.0, *log.seconds])  # s of swimming before each trial
    ends = [
        before[trial] + log.time[begin + count * averaged] - log.time[log.blocks[trial].start]
        for trial, begin in cuts
    ]
    return LogWindows(
        series=series[:, ::interval],
        spin=spin,
        gyro=samples,
        interval=interval,
        begun=lead,
        time=times,
        names=tuple(names),
        ends=np.array(ends),
        remarks=tuple(remarks),
    )


def _cuts(
    log: SwimLog, moving: bool, averaged: int, wanted: int | None
) -> tuple[list[tuple[int, int]], int]:
    """Return the trial and first row of each window, and their number of averaged samples.

    ``wanted`` is that number, if given, and then all windows count.
    """
    lead = BEFORE * TIMESTEP if moving else 0.0
    begins = [
        rows.start + int(np.searchsorted(log.time[rows], log.time[rows.start] + lead - NEAR))
        for rows in log.blocks
    ]
    lengths = [
        (rows.stop - 1 - begin) // averaged for rows, begin in zip(log.blocks, begins, strict=True)
    ]
    count = min(wanted or LONGEST[moving], *lengths)
    if count < FEWEST:
        raise InvalidArgumentError(
            f"{log.name(int(np.argmin(lengths)))} must have at least {FEWEST} samples of 0.01 s "
            f"after the first {lead:g} s; it has {max(min(lengths), 0)}"
        )
    cuts = [
        (trial, begin + k * count * averaged)
        for trial, (begin, length) in enumerate(zip(begins, lengths, strict=True))
        for k in range(length // count if moving else 1)
    ]
    return cuts[: MOST_WINDOWS if moving and not wanted else None], count


def _commands(log: SwimLog, trial: int, begin: float, steps: int) -> Floats:
    """Return the command (steps, 3) in each 0.01 s from ``begin``, in s.

    Where it changes within a step, it is the mean, which turns the servos equally far.
    """
    rows = log.blocks[trial]
    time, commands = log.time[rows], log.commands[rows]
    edges = begin + TIMESTEP * np.arange(steps + 1)
    at = np.clip(np.searchsorted(time, edges + NEAR, "right") - 1, 0, None)
    until = np.clip(np.searchsorted(time, edges - NEAR, "right") - 1, 0, None)
    turned = np.zeros(commands.shape)
    turned[1:] = np.cumsum(commands[:-1] * np.diff(time)[:, None], axis=0)
    passed = np.stack([np.interp(edges, time, axis) for axis in turned.T], axis=1)
    mean = np.clip(np.diff(passed, axis=0) / TIMESTEP, COMMAND_LOW, COMMAND_HIGH)
    changes = np.cumsum((np.diff(commands, axis=0, prepend=commands[:1]) != 0.0).any(axis=1))
    steady = changes[at[:-1]] == changes[until[1:]]
    return np.where(steady[:, None], commands[at[:-1]], mean)


def _unused(log: SwimLog, ends: dict[int, int]) -> list[str]:
    """Return which trials are used for less than nine tenths, in sentences."""
    remarks = []
    for trial, (rows, whole) in enumerate(zip(log.blocks, log.seconds, strict=True)):
        used = log.time[ends[trial]] - log.time[rows.start] if trial in ends else 0.0
        if used < 0.9 * whole:
            remarks.append(
                f"of the {whole:.3g} s of {log.name(trial)} the first {used:.3g} s are used"
            )
    return remarks


def _held_for(series: Floats) -> int:
    """Return the number of samples that each command of series (E, T, 3) is held."""
    changes = np.flatnonzero((np.diff(series, axis=1) != 0.0).any(axis=(0, 2))) + 1
    return gcd(*changes.tolist()) or series.shape[1]
