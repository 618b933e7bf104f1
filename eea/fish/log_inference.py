"""Any swimming is an experiment: from a recorded swim to a body."""

from __future__ import annotations

import time
from math import gcd
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.angles import Floats
from eea.core.config import FitConfig, JointConfig
from eea.core.result import RoundRecord
from eea.core.session import streams
from eea.fish.estimate import MorphologyEstimate, fish_problem
from eea.fish.joint import Swims, fish_joint
from eea.fish.sampling import NEAR, at_times, steps_for
from eea.fish.simulator import EngineSimulator, SimulatorOptions
from eea.fish.swim_log import FEWEST, SwimLog
from eea.joint.inference import fit
from eea.joint.least_squares import Observed
from eea.joint.session import round_fit

#: Samples of the commands before a window that its servos may still obey: a lag of 0.2 s.
BEFORE = 20
LONGEST = {False: 1024, True: 512}  # samples of a trial from rest, and of a window of a swim
MOST_WINDOWS = 8  # of swims: more tell little, slowly


class Windows(NamedTuple):
    """Swims cut into windows of T samples, to be simulated for K steps of 0.01 s."""

    series: Floats  #: (E, ., 3) commands.
    spin: Floats  #: (E, 3) the gyroscope just before.
    gyro: Floats  #: (E, T, 3).
    interval: int  #: Samples that each command is held.
    begun: int  #: Samples of a series before its window.
    #: (E, T) s after each window's beginning; None for a sample each 0.01 s.
    time: Floats | None = None


class LogWindows(NamedTuple):
    """What of a log is compared with simulated swims."""

    windows: Windows  #: With their ``time``.
    names: tuple[str, ...]  #: Of each window: "trial 2", or "trial 1 from 5.3 s".
    ends: Floats  #: (E,) when each ends, s after its trial's record began.
    remarks: tuple[str, ...]  #: What of the log is not used, in sentences.


def log_windows(log: SwimLog, moving: bool = False, seconds: float | None = None) -> LogWindows:
    """Cut a log into what joint inference compares: windows of equally many samples.

    Each trial from rest is one, of 1024 samples at most. What is recorded in mid-swim is cut into
    as many of 512 at most as there are, eight at most; the first 0.2 s only tell how the servos
    move. A log of more than 100 rows a second is averaged to no fewer than 100.

    Parameters
    ----------
    moving
        Whether the robot was already under way when each trial's record begins.
    seconds
        Of a window, about, and then there are as many as the log has; None for the above.

    Raises
    ------
    InvalidArgumentError
        If a trial is too short to be cut, or no servo, or no reading, ever moves.
    """
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
    # Before the simulator's first sample there is none to look at.
    early = int((np.array(time) < TIMESTEP - NEAR).sum(axis=1).max())
    samples, times = np.array(gyro)[:, early:], np.array(time)[:, early:]
    series = np.array([
        _commands(log, trial, log.time[begin] - lead * TIMESTEP, lead + steps_for(times))
        for trial, begin in cuts
    ])  # fmt: skip
    if not moving and not series.any():
        raise InvalidArgumentError(
            "the log tells nothing of the body: no servo moves in any of its trials"
        )
    if (samples == samples[:, :1]).all():
        raise InvalidArgumentError(
            "the log tells nothing of the body: its gyroscope never changes; was it read?"
        )
    names = [
        log.name(trial)
        + (f" from {log.time[begin] - log.time[log.blocks[trial].start]:.3g} s" if moving else "")
        for trial, begin in cuts
    ]
    remarks = _unused(log, {trial: begin + count * averaged for trial, begin in cuts})
    if not moving:
        remarks += [
            f"in {name} no servo moves, which tells next to nothing of the body"
            for name, told in zip(names, series, strict=True)
            if not told.any()
        ]
    interval = _held_for(series)
    spin = np.array([log.gyro[begin] if moving else np.zeros(3) for _, begin in cuts])
    cut = Windows(series[:, ::interval], spin, samples, interval, lead, times)
    ends = [
        log.time[begin + count * averaged] - log.time[log.blocks[trial].start]
        for trial, begin in cuts
    ]
    return LogWindows(cut, tuple(names), np.array(ends), tuple(remarks))


def _cuts(
    log: SwimLog, moving: bool, averaged: int, wanted: int | None
) -> tuple[list[tuple[int, int]], int]:
    """Return trial and first row of each window, and how many samples, averaged, they have.

    If any number is ``wanted``, all windows of as many.
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
            f"{log.name(int(np.argmin(lengths)))} must have at least {FEWEST} samples, of 0.01 s "
            f"or more, after the first {lead:g} s; it has {max(min(lengths), 0)}"
        )
    cuts = [
        (trial, begin + k * count * averaged)
        for trial, (begin, length) in enumerate(zip(begins, lengths, strict=True))
        for k in range(length // count if moving else 1)
    ]
    return cuts[: MOST_WINDOWS if moving and not wanted else None], count


def _commands(log: SwimLog, trial: int, begin: float, steps: int) -> Floats:
    """Return the mean command (steps, 3) in each 0.01 s from ``begin``, in s.

    Where it changes within a step, the mean takes the servos as far as they went.
    """
    rows = log.blocks[trial]
    time, told = log.time[rows], log.commands[rows]
    edges = begin + TIMESTEP * np.arange(steps + 1)
    at = np.clip(np.searchsorted(time, edges + NEAR, "right") - 1, 0, None)
    until = np.clip(np.searchsorted(time, edges - NEAR, "right") - 1, 0, None)
    turned = np.zeros(told.shape)
    turned[1:] = np.cumsum(told[:-1] * np.diff(time)[:, None], axis=0)
    passed = np.stack([np.interp(edges, time, axis) for axis in turned.T], axis=1)
    mean = np.clip(np.diff(passed, axis=0) / TIMESTEP, COMMAND_LOW, COMMAND_HIGH)
    changes = np.cumsum((np.diff(told, axis=0, prepend=told[:1]) != 0.0).any(axis=1))
    steady = changes[at[:-1]] == changes[until[1:]]
    return np.where(steady[:, None], told[at[:-1]], mean)


def _unused(log: SwimLog, ends: dict[int, int]) -> list[str]:
    """Return which trials are not compared to their end, where that is a tenth of them or more."""
    said = []
    for trial, (rows, whole) in enumerate(zip(log.blocks, log.seconds, strict=True)):
        used = log.time[ends[trial]] - log.time[rows.start] if trial in ends else 0.0
        if used < 0.9 * whole:
            said.append(
                f"of the {whole:.3g} s of {log.name(trial)} the first {used:.3g} s are used"
            )
    return said


def infer_log(
    log: SwimLog,
    joint: FitConfig | None = None,
    seed: int = 0,
    truth: Morphology | ArrayLike | None = None,
    *,
    moving: bool = False,
    **simulator: Unpack[SimulatorOptions],
) -> MorphologyEstimate:
    """Infer body, nuisances and how each trial began from a recorded swim, with intervals.

    Parameters
    ----------
    log
        Of any rate; see ``read_log``. It is not interpolated: the simulated swim is looked at when
        the robot's gyroscope was.
    joint
        Settings of the inference.
    seed
        Everything random follows from it.
    truth
        The body, if known: only for OBJ_FIT.
    moving
        Whether the robot was already under way when each trial's record begins; else each begins
        at rest.
    **simulator
        See ``EngineSimulator``.

    Returns
    -------
    MorphologyEstimate
        Of one round, whatever the number of trials; its ``belief`` has the posterior, the findings
        and the verdict.

    Raises
    ------
    ConfigurationError, InvalidArgumentError
        If a setting is wrong, or a trial too short; see ``log_windows``.

    Examples
    --------
    >>> from aquafish_gym import simulate
    >>> told = [(0.5, -0.5, 1.0), (-0.5, 0.4, 0.7)]
    >>> felt = [simulate(None, u, (0.5, 1.0, -2.0), 96, dtype="float64") for u in told]
    >>> found = infer_log(SwimLog.of_trials(told, felt), truth=Morphology.nominal())
    >>> bool(found.objective_fitness > 0.99)
    True
    """
    began = time.monotonic()
    cut = log_windows(log, moving).windows
    settings = vars(FitConfig() if joint is None else joint)
    config = JointConfig(**settings | {"steps": cut.gyro.shape[1], "rounds": 1})
    rng = streams(seed)["estimation"]
    steps = cut.gyro.shape[1] if cut.time is None else steps_for(cut.time)
    engine, problem = EngineSimulator(steps, **simulator), fish_problem()
    fish = fish_joint(problem, engine, Swims(cut.interval, cut.begun))
    swims = Swims.array(cut.series, cut.spin)
    if cut.time is not None:
        fish, swims = at_times(fish, swims, cut.time)
    body = None if truth is None else Morphology.coerce(truth).to_array()
    posterior = fit(Observed(swims, cut.gyro), fish, config, rng)
    command = cut.series[-1, cut.begun // cut.interval :].mean(axis=0)
    seconds = time.monotonic() - began
    record = RoundRecord.of(
        1, command, None, round_fit(posterior), problem.models, body, None, seconds
    )
    return MorphologyEstimate(config, seed, problem.models, body, [record], belief=posterior)


def _held_for(series: Floats) -> int:
    """Return for how many samples each command of series (E, T, 3) is held."""
    changes = np.flatnonzero((np.diff(series, axis=1) != 0.0).any(axis=(0, 2))) + 1
    return gcd(*changes.tolist()) or series.shape[1]


def log_nuisances(moving: bool) -> tuple[str, ...]:
    """Return the groups of nuisances that may be inferred of a log."""
    swims = Swims(interval=1, begun=BEFORE if moving else 0)
    return fish_joint(fish_problem(), EngineSimulator(FEWEST), swims).groups
