"""What is known of the fish: whether a later swim is of the same one, and what has changed."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, Unpack

import numpy as np
from scipy.special import chdtrc

from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import BodyPlan, check_same_plan
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    callback,
    flag,
    instance,
    integer,
    sequence,
)
from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, choice, real
from eea.core.config import FitConfig
from eea.core.floating import own_errors
from eea.core.session import MAXIMUM_SEED
from eea.fish.hypotheses import ANYWHERE, fault_hypothesis, plan_of, servo_names
from eea.fish.joint import CURRENT, fish_robot, size_numbers
from eea.fish.log_fit import CLOSEST_ROWS_SECONDS
from eea.fish.simulator import EngineSimulator, SimulatorOptions
from eea.fish.swim_log import SwimLog, shown
from eea.fish.windows import LogWindows, log_windows
from eea.infer.answer import Answer
from eea.infer.branch import Branch
from eea.infer.file import check_posterior
from eea.infer.goodness import Goodness
from eea.infer.known import FALSE_ALARM_PROBABILITY, Known, Verdict, check_alarm
from eea.infer.mixture import Mode
from eea.infer.statement import Hypothesis
from eea.infer.trials import Observed
from eea.infer.unknowns import Unknowns

CHANGE_PROBABILITY = 0.1  # of each fin
MOST_CHANGES = 2  # fins at once
#: rad/s: a good gyroscope's, at 100 readings a second. Less noise is not counted with, since
#: simulations are not exact where readings are between their steps.
LEAST_GYRO_NOISE = 1e-3
LOUDER_P_VALUE = 0.01  # below it a log's noise is louder than the posterior's
WINDOW_SECONDS = 1.0  # s; a change shows in the first window that lies entirely after it
UNCHANGED = Hypothesis("nothing has changed")


def fin_changes(plan: BodyPlan, fin: str) -> list[Hypothesis]:
    """Return the possible changes of a fin, all equally probable."""
    moved = {d.name: ANYWHERE for d in plan.dimensions if d.fin == fin}
    word = plan.words[fin]
    weak = fault_hypothesis(plan, fin, "weak")
    changes = [
        Hypothesis(f"the {word} has other sizes", moves=moved, part=word),
        replace(weak, name=f"the {servo_names(plan)[fin]} has another speed"),
        fault_hypothesis(plan, fin, "missing"),
    ]
    odds = CHANGE_PROBABILITY / (1.0 - CHANGE_PROBABILITY) / len(changes)
    return [replace(change, odds=odds) for change in changes]


@functools.cache
def body_changes(plan: BodyPlan) -> tuple[Hypothesis, ...]:
    """Return the possible changes of all fins."""
    return tuple(change for fin in plan.names for change in fin_changes(plan, fin))


def known_body(body: Morphology, noise: float, nuisances: Sequence[str] | None = None) -> Answer:
    """Return the posterior of a body that is known without trials, such as the intact body.

    Parameters
    ----------
    body
        The body.
    noise
        Standard deviation of the gyroscope's noise, rad/s.
    nuisances
        Groups of nuisances that are unknown, with their own priors; None for all. The others are
        nominal.

    Raises
    ------
    ConfigurationError
        If the noise is not a finite number of at least 1e-9, or a nuisance is unknown.

    Examples
    --------
    >>> belief = known_body(Morphology.nominal(), noise=0.01)
    >>> np.allclose(belief.model, Morphology.nominal().to_array())
    True
    """
    real("noise", noise, 1e-9)
    instance("body", body, Morphology)
    robot = fish_robot(EngineSimulator(1, plan=body.plan))
    for name in () if nuisances is None else sequence("nuisances", nuisances):
        choice("nuisances", name, robot.groups)
    known = Hypothesis(
        "the body is known", dict(zip(size_numbers(body.plan), body.sizes, strict=True))
    )
    robot = replace(robot, nominal=known, hypotheses=())
    parameters = Unknowns.of(robot, 1, robot.groups if nuisances is None else nuisances)
    mean = parameters.prior_mean
    mode = Mode(mean, parameters.prior_information, np.zeros(len(mean)), 0.0)
    posterior = parameters.posterior([mode])
    goodness = Goodness(noise, 1.0, 1.0, 1.0, 1.0, good=True, verdict="the body is known")
    branch = Branch(known, 1.0, parameters, posterior, posterior)
    return Answer((branch,), goodness, noise, 0)


def check_belief(belief: object, plan: BodyPlan) -> None:
    """Raise an InvalidArgumentError unless ``belief`` is a sensible posterior of a plan's fish."""
    instance("belief", belief, Answer)
    assert isinstance(belief, Answer)
    try:
        check_posterior(belief)
    except ConfigurationError as error:
        raise InvalidArgumentError(f"belief must be a posterior: {error}") from None
    robot = belief.robot
    found = [(name, robot.table[name].low, robot.table[name].high) for name in robot.sought]
    stated = [(name, number.low, number.high) for name, number in size_numbers(plan).items()]
    for (name, low, high), (wanted, least, most) in zip(found, stated, strict=False):
        if (name, low, high) != (wanted, least, most):
            raise InvalidArgumentError(
                f"belief must be a posterior of this fish, with {wanted} from {least:g} to "
                f"{most:g}; it has {name} from {low:g} to {high:g}"
            )
    if len(found) != len(stated):
        raise InvalidArgumentError(
            f"belief must be a posterior of this fish, which has {len(stated)} sizes; it has "
            f"{len(found)}"
        )
    check_same_plan("belief", plan_of(robot), plan)


def _compared(
    log: SwimLog, belief: Answer, seconds: float | None
) -> tuple[LogWindows, LogWindows, Answer]:
    """Return windows of a swim, those with unknown times of changes, and what is known there.

    The noise is that of the posterior, unless the log itself is noisier: the trials of a posterior
    may have had none, as in a simulation, or another gyroscope's.

    Raises
    ------
    InvalidArgumentError
        If ``belief`` is no posterior of this fish, no servo moves, or the trials had no noise and
        the log's readings are too far apart to tell its own.
    """
    windows = log_windows(log, True, seconds)
    check_belief(belief, log.plan)
    if not windows.series.any():
        raise InvalidArgumentError("log must contain motion: no servo moves in any of its trials")
    found = windows.noise
    if found is None and belief.samples and belief.sigma < LEAST_GYRO_NOISE:
        raise InvalidArgumentError(
            f"belief must know the gyroscope's noise: its trials had none ({belief.sigma:.1g} "
            "rad/s), and the log has too few readings while a command stays the same to tell it; "
            "infer with FitConfig(noise=0.01), --noise 0.01 of infer or --joint.noise 0.01 of run"
        )
    sigma = max(belief.sigma, LEAST_GYRO_NOISE)
    samples = belief.samples
    if found is not None and chdtrc(found[1], found[1] * (found[0] / sigma) ** 2) < LOUDER_P_VALUE:
        sigma, samples = found
    finer = log_windows(log, True, seconds, within=CLOSEST_ROWS_SECONDS)
    return windows, finer, replace(belief, sigma=sigma, samples=samples)


def _known(belief: Answer, windows: LogWindows, simulator: SimulatorOptions) -> Known:
    """Return what a posterior tells of the fish in a log's windows, and what may have changed.

    There is no model discrepancy: the posterior's trials were fitted with this simulator.
    """
    robot = replace(
        fish_robot(EngineSimulator(windows.steps, plan=windows.plan, **simulator), windows),
        hypotheses=body_changes(windows.plan),
        at_once=MOST_CHANGES,
        nominal=UNCHANGED,
        discrepancy=None,
    )
    return Known.of(belief, robot, CURRENT)  # which velocities in the water stand for


@own_errors
def infer_changes(
    log: SwimLog,
    belief: Answer,
    joint: FitConfig | None = None,
    seed: int = 0,
    *,
    progress: Callable[[str], None] | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> Answer:
    """Infer what has changed since a body was inferred, or known.

    Each fin may have changed with a probability of 0.1: it has other sizes, its servo has another
    speed, or it is missing. What has not changed keeps its posterior; what has is uniform over its
    range. Changes of two fins are tried only where no change of one explains the swim. It is
    ``eea.infer.known.Known.infer`` of the fish.

    Parameters
    ----------
    log
        A swim after the change, which begins at any moment. The first 0.2 s of each trial only
        determine the servo speeds.
    belief
        What is known, as in ``watch_swim``, and the noise.
    joint
        Settings of the inference, without ``noise``.
    seed
        Seed of everything random.
    progress
        Called with the present step in words.
    **simulator
        See ``EngineSimulator``.

    Returns
    -------
    Answer
        Its ``findings`` say what has changed; ``MorphologyEstimate.of`` takes it.

    Raises
    ------
    ConfigurationError, InvalidArgumentError
        If an argument is wrong, ``belief`` is no posterior of this fish, or not one that one body
        explains, a trial is too short, no servo moves, or the noise is unknown, as in
        ``watch_swim``.

    Examples
    --------
    >>> log = read_log("swim.csv")  # doctest: +SKIP
    >>> infer_changes(log, load_posterior("posterior.npz")).findings  # doctest: +SKIP
    ['the tail is missing (100%)']
    """
    callback("progress", progress)
    integer("seed", seed, 0, MAXIMUM_SEED)
    config = FitConfig() if joint is None else joint
    instance("joint", config, FitConfig)
    if config.noise is not None:
        raise ConfigurationError(
            f"joint must have noise=None, for the noise is that of belief; got {config.noise:g}"
        )
    windows, finer, belief = _compared(log, belief, None)
    belief.known()  # raises where no body, or more than one, explains its trials
    if finer.unknown() > windows.unknown():
        quick = replace(config, alternatives="never", restarts=0)
        known = _known(belief, windows, simulator)
        found = known.infer(windows.observed, seed, quick, progress)
        if found.good:
            return found
    return _known(belief, finer, simulator).infer(finer.observed, seed, config, progress)


class Watched(NamedTuple):
    """The tests of a swim, window by window."""

    time: Floats  #: (E,) end of each window, s of swimming since the record's beginning.
    looks: tuple[Verdict, ...]
    alarm: float  #: The probability of a false alarm in each window.

    @property
    def noticed(self) -> float | None:
        """When a change was noticed: the end of the first window that differs, s."""
        changed = [not look.same for look in self.looks]
        return float(self.time[changed.index(True)]) if any(changed) else None

    def __str__(self) -> str:
        seconds = f"{shown(self.time[-1], 4)} s of swimming, {len(self.looks)} windows"
        if self.noticed is None:
            return f"{seconds}: this is still the body that was inferred"
        least = min(look.p for look in self.looks)
        p = f"p = {least:.0e}" if least > 0.0 else "p < 1e-300"
        return (
            f"{seconds}: by {shown(self.noticed, 4)} s this is no longer the body that was "
            f"inferred ({p}; one false alarm in "
            f"{1.0 / self.alarm:,.0f} windows)"
        )


@own_errors
def watch_swim(
    log: SwimLog,
    belief: Answer,
    *,
    alarm: float = FALSE_ALARM_PROBABILITY,
    seed: int = 0,
    until_noticed: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> Watched:
    """Compare a swim with the posterior of a body, one window of a second at a time.

    A window has at least 16 readings, so it is longer in a slow log.
    ``eea.infer.known`` describes the test. The noise is that of the posterior's trials,
    or of the log where it is noisier.

    Parameters
    ----------
    log
        A swim that begins at any moment; all its trials count. The first 0.2 s of each trial only
        determine the servo speeds.
    belief
        A ``result.belief`` of joint inference, or the result of ``load_posterior`` or
        ``known_body``.
    alarm
        The probability of a false alarm in each window, more than 0.
    seed
        Seed of the random starting points.
    until_noticed
        Whether to stop at the first window that another body explains.
    progress
        Called after each window with the number of finished windows and of all windows.
    **simulator
        See ``EngineSimulator``.

    Raises
    ------
    ConfigurationError, InvalidArgumentError
        If an argument is wrong, ``belief`` is no posterior of this fish, a trial is too short, no
        servo moves, or the noise is unknown: that of trials without noise, and of a sparse log.

    Examples
    --------
    >>> log = read_log("swim.csv")  # doctest: +SKIP
    >>> print(watch_swim(log, load_posterior("posterior.npz")))  # doctest: +SKIP
    60 s of swimming, 59 windows: this is still the body that was inferred
    """
    flag("until_noticed", until_noticed)
    callback("progress", progress)
    integer("seed", seed, 0, MAXIMUM_SEED)
    windows, finer, belief = _compared(log, belief, WINDOW_SECONDS)
    check_alarm(alarm)
    known = _known(belief, windows, simulator)
    doubting = _known(belief, finer, simulator)
    rng = np.random.default_rng(seed)
    again = np.random.default_rng(seed)
    looks: list[Verdict] = []
    for i, gyro in enumerate(windows.gyro):
        weight = None if windows.weight is None else windows.weight[i][None]
        window = Observed(np.array([i]), gyro[None], weight)
        looks.append(known.test(window, rng, alarm))
        if not looks[-1].same and finer.unknown(i) > windows.unknown(i):
            looks[-1] = doubting.test(window, again, alarm)
        if progress is not None:
            progress(i + 1, len(windows.gyro))
        if until_noticed and not looks[-1].same:
            break
    return Watched(windows.ends[: len(looks)], tuple(looks), alarm)
