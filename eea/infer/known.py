"""What is known of a robot, and whether a later log is of the same one.

**A test.** A log is fitted with what is known as the prior, so that neither its unknown initial
state nor the uncertainty of what is known counts as a change. For the same robot

    2 cost = sum of r^2 / sigma^2 + the prior's squared distance  ~  chi-square,

with as many degrees of freedom as the log has samples, minus the angles, which have no prior. The
true number is slightly smaller, since initial states vary less than their priors. Where sigma was
estimated from N samples, the statistic has an F distribution.

**Logs that are known to be good.** A robot that is whole is several robots: its numbers differ a
little from log to log, and more from session to session, between which it is repaired. The numbers
x of member i in group s are ::

    x[s, i] = mean + between[s] + within[s, i]

and a new member of a new group lies about the mean of the n groups with the variance
(1 + 1/n) between + within. A new member of a group of m lies about the mean of that group with the
variance (1 + 1/m) within. Few groups, or members, tell little of their spread: it is Student's t,
for which a normal distribution of the same 90% interval stands.

What an answer tells of one log holds for another log of the same robot up to the spread of both:
twice the variance of a new member.

**Following.** Window by window of a log, what is known is a normal distribution of the shares of
all common numbers. A window's best fit, with that as its prior, and the information there are what
is known next. A window that fails the test is left out: something may have changed in its midst. If
the next one fails, too, the robot's hypotheses are weighed by it.
"""

from __future__ import annotations

import numbers
from collections import Counter
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc, ndtr, ndtri, stdtr, stdtrit

from eea.core.angles import Floats
from eea.core.checks import (
    ConfigurationError,
    all_of,
    brief,
    choice,
    finite,
    instance,
    mapping,
    real,
    whole,
)
from eea.core.config import FALSE_ALARM_RATE, FitConfig
from eea.core.floating import own_errors
from eea.core.session import MAXIMUM_SEED
from eea.infer.answer import Answer
from eea.infer.branch import LEAST_SD
from eea.infer.descent import Fitted, descend
from eea.infer.fit import (
    carried_over,
    check_enough,
    first_guess,
    fit,
    infer,
    known_noise,
    noise_left,
    recorded_config,
)
from eea.infer.misfit import COARSE, FINE, Regression, Roughness
from eea.infer.optima import Optima, improved
from eea.infer.scan import hop, pose
from eea.infer.statement import Prior, RobotModel
from eea.infer.trials import Noise, Observed, Trial, twice
from eea.infer.unknowns import UNIFORM_PRECISION, Unknowns
from eea.infer.words import (
    ALARM_FINDING,
    REPEATED_FINDING,
    at_bounds,
    at_ends,
    contradicted,
    of_shared,
    only_rounding,
    several,
)

NORMAL_95 = 1.6448536269514722


def new_member(
    values: Floats,
    uncertain: Floats,
    labels: Sequence[object],
    group: object = None,
    widened: bool = False,
) -> tuple[Floats, Floats]:
    """Return the mean (k,) and covariance (k, k) of a new member.

    It is of the ``group`` of that label, if given; else of a new group, or of the only one.
    ``values`` (n, k) are known up to the covariance ``uncertain`` (k, k), and members of a group
    have the same label. ``widened`` by Student's t, as few groups, or members of one, tell little
    of their spread.
    """
    members = len(values)
    groups = [np.array([label == other for other in labels]) for label in dict.fromkeys(labels)]
    count = len(groups)
    means = np.array([values[of].mean(axis=0) for of in groups])
    apart = values - sum(np.outer(of, mean) for of, mean in zip(groups, means, strict=True))
    seen = apart.T @ apart / max(members - count, 1)
    within = seen + uncertain
    own = np.array([label == group for label in labels]) if group is not None else groups[0]
    if group is None and count > 1:
        mean = means.mean(axis=0)
        each = np.mean([1.0 / of.sum() for of in groups])
        between = np.cov(means, rowvar=False).reshape(within.shape) - each * seen
        covariance = (1.0 + 1.0 / count) * _positive(between) + within
        freedom = count - 1
    else:
        mean = values[own].mean(axis=0)
        covariance = (1.0 + 1.0 / own.sum()) * within
        freedom = members - count
    if widened:
        covariance = covariance * widening(freedom) ** 2
    return mean, covariance


def widening(freedom: float) -> float:
    """Return the sd of a normal whose 90% interval is that of Student's t, over the t's scale."""
    return float(stdtrit(freedom, 0.95)) / NORMAL_95


def _positive(matrix: Floats) -> Floats:
    """Return the nearest matrix without negative eigenvalues."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    found: Floats = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return found


FALSE_ALARM_PROBABILITY = 1e-6  # probability of a false alarm in each window
LEAST_FALSE_ALARM_PROBABILITY = 1e-100  # 0 would never raise an alarm
START_COUNTS = (64, 512, 4096)  # random starts, tried until one explains the window
EXAMINED_P_VALUE = 1e-2  # windows with greater p-values are not examined further
POSE_SCANS = 6  # scans that share the random starts
LOUD_FACTOR = 10.0  # of the noise in the last search


class Verdict(NamedTuple):
    """Whether a log is of the same robot."""

    p: float  #: The chance that a log of the same robot fits as badly.
    same: bool  #: Whether it is at least the rate of false alarms.
    #: How badly it fits, over what is usual for the same robot: about 1 if it is the same.
    excess: float


def check_alarm(alarm: float) -> None:
    """Raise a ConfigurationError unless ``alarm`` can be a probability of false alarms."""
    real("alarm", alarm, LEAST_FALSE_ALARM_PROBABILITY, 1.0)


def window_of(
    robot: RobotModel,
    log: Trial | Observed,
    noise: Noise | None,
    sigma: float = 1.0,
    groups: Collection[str] | None = None,
    roughness: Roughness | None = None,
) -> Regression:
    """Return a log of a robot, to be fitted near its prior; ``groups`` None are all."""
    robot = replace(robot, hypotheses=())
    if not isinstance(log, Observed):
        instance("log", log, Trial)
        log = Observed.of([log], robot)
    finite("signal", log.signal, (1, None, len(robot.channels)))
    parameters = Unknowns.of(robot, 1, robot.groups if groups is None else groups)
    return Regression(parameters, replace(log, noise=noise), sigma, roughness=roughness)


def test_near_prior(
    window: Regression,
    sigma: float,
    samples: int,
    alarm: float,
    rng: np.random.Generator,
) -> Verdict:
    """Return whether a trial fits what is known, from ever more random initial states.

    ``sigma`` is the noise's standard deviation, estimated from a number of ``samples``, 0 where it
    is known.
    """
    best: Fitted | None = None
    for effort in START_COUNTS:
        found = fit_near_prior(window, sigma, effort, rng)
        best = found if best is None or found.cost[0] < best.cost[0] else best
        verdict = judged(window, float(best.cost[0]), samples, alarm)
        if verdict.p >= max(EXAMINED_P_VALUE, alarm):
            return verdict
    if verdict.same or best is None:
        return verdict
    return judged(window, _cost_elsewhere(window, best, sigma, rng), samples, alarm)


def judged(window: Regression, cost: float, samples: int, alarm: float) -> Verdict:
    """Return the verdict on a trial whose best fit has a cost."""
    angles = len(window.parameters.angle_entries(0))
    freedom = max(window.observed.size - angles, 1)
    ratio = 2.0 * cost / freedom
    p = float(fdtrc(freedom, samples, ratio) if samples else chdtrc(freedom, ratio * freedom))
    return Verdict(p, p >= alarm, ratio)


def _cost_elsewhere(
    window: Regression, best: Fitted, sigma: float, rng: np.random.Generator
) -> float:
    """Return the least cost also from other valleys of the initial state.

    The less noise, the more starts end in a wrong valley, whose misfit would count as a change.
    Louder noise leads to others.
    """
    (rng,) = rng.spawn(1)  # which leaves later windows their starts
    loud = LOUD_FACTOR * sigma
    smooth = fit_near_prior(replace(window, noise=loud), loud, START_COUNTS[1], rng)
    fine = window.misfit(FINE)
    starts = [hop(window, best.theta[0], sigma, rng), smooth.theta]
    elsewhere = descend(fine, np.concatenate(starts), sigma, 40, 1e-6)
    return float(min(best.cost[0], elsewhere.cost.min()))


def fit_near_prior(
    window: Regression, sigma: float, effort: int, rng: np.random.Generator
) -> Fitted:
    """Return the best fit of a trial from the prior's mean and ``effort`` random initial states.

    ``sigma`` is the standard deviation of the noise, of each channel's own where it is known.
    """
    one = window.parameters
    typical = one.into_bounds(one.prior_mean[None])
    each = -(-effort // POSE_SCANS)
    starts = [pose(window, typical, each, rng)[0] for _ in range(POSE_SCANS)]
    coarse = descend(window.misfit(COARSE), np.concatenate(starts), sigma, 12, 1e-2)
    near = coarse.theta[np.argsort(coarse.cost, kind="stable")[:2]]
    fits = descend(window.misfit(FINE), near, sigma, 10, 1e-3)
    return fits.of([int(fits.cost.argmin())])


def contradictions(
    robot: RobotModel, fits: Sequence[Optima], groups: Collection[str]
) -> dict[str, tuple[float, float, float]]:
    """Return the value and the 90% interval of each number that is not ``healthy`` in good logs.

    The best fit of each log descends on with these numbers free. Their shifts, averaged
    over the logs, are tested for being zero at the rate of false alarms for all numbers together
    (Bonferroni): by a normal distribution with the fits' own variances, or by Student's t where the
    logs differ by more.

    Parameters
    ----------
    robot
        The robot, with what was learned as its prior, without hypotheses.
    fits
        The best fits of the logs, one by one.
    groups
        The nuisances that were inferred.
    """
    if not robot.healthy:
        return {}
    places = [robot.sought.index(name) for name in robot.healthy]
    free = robot.without_healthy()
    parameters = Unknowns.of(free, 1, groups, free.nominal)
    flat = np.zeros(len(parameters))
    flat[places] = UNIFORM_PRECISION
    found = []
    variances = []
    for known in fits:
        regression = replace(known.regression, parameters=parameters)
        misfit = regression.misfit(FINE)
        start = carried_over(known, parameters)[:1]
        theta = descend(misfit, start, known.sigma, 40, 1e-6).theta
        near = misfit.laplace(theta, misfit.linearise(theta), known.sigma**-2)[0]
        covariance = near.covariance(flat)
        # Not held by a bound, at which healthy numbers often are.
        found.append((near.theta - covariance @ near.gradient)[places])
        variances.append(np.diag(covariance)[places])
    table = {}
    for k, (name, stated) in enumerate(robot.healthy.items()):
        low = robot.table[name].low
        high = robot.table[name].high
        shares = np.array([one[k] for one in found])
        weights = 1.0 / np.array([one[k] for one in variances])
        mean = float(weights @ shares / weights.sum())
        scatter = float(shares.var(ddof=1)) / len(shares)
        own = 1.0 / float(weights.sum())
        sd = max(own, scatter) ** 0.5
        off = abs(mean - (stated - low) / (high - low)) / sd
        p = 2.0 * float(ndtr(-off) if own >= scatter else stdtr(len(shares) - 1, -off))
        if p * len(robot.healthy) < FALSE_ALARM_RATE:
            value = low + (high - low) * mean
            reach = (high - low) * NORMAL_95 * sd
            table[name] = (value, value - reach, value + reach)
    return table


LEARNING_CONFIG = FitConfig(
    alternatives="never", bodies=32, poses=32, descents=8, polished=2, restarts=0
)
ROUNDS = 6  # of fits to all logs, each with the noise and the spread of the one before


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of a robot: from an answer, from logs that are known to be good, or stated.

    :meth:`Answer.known`, :meth:`Robot.learn` and ``Known(robot, noise)`` make one.
    """

    robot: RobotModel  #: With what is known as its prior.
    noise: Noise | None  #: Of each channel; None where all have ``sigma``.
    sigma: float = 1.0  #: Times the channels' noise, or the noise of all, in the signal's unit.
    samples: int = 0  #: Number of samples behind ``sigma``; 0 where it is known.
    #: (n,) mean squares of what the best fits of known-good logs left, over the noise's: by these
    #: later logs are judged. None: by whether a log leaves noise alone.
    misfits: Floats | None = None
    findings: tuple[str, ...] = ()  #: Sentences on what later answers depend on, their last ones.
    groups: frozenset[str] | None = None  #: The groups of numbers that are inferred; None for all.
    #: How much a log's numbers differ from those of all known-good logs; None if not learned. Its
    #: mean does not count.
    spread: Prior | None = None

    @classmethod
    def of(
        cls, answer: Answer, robot: RobotModel | None = None, gone: Collection[str] = ()
    ) -> Known:
        """Return what an answer's most probable hypothesis tells; see :meth:`Answer.known`.

        What was learned from known-good logs holds on: the later logs are judged by these, and
        their numbers differ from those of the answer's log, as these do. ``gone`` are numbers of
        the trials that later logs do not have, such as a current.
        """
        best = answer.branches[0]
        robot = answer.robot if robot is None else robot
        inferred = [one for name, one in robot.table.items() if best.parameters.has(name)]
        known = cls(
            best.known(robot, gone),
            answer.noise,
            answer.sigma,
            answer.samples,
            groups=frozenset(number.group for number in inferred if number.group),
        )
        learned = answer.learned
        if learned is None or learned.spread is None:
            return known
        spread = learned.spread.of(learned.robot, known.robot)
        return replace(
            known,
            robot=replace(known.robot, prior=_of_another_log(known.robot, spread)),
            misfits=learned.misfits,
            findings=learned.findings,
            spread=spread,
        )

    def infer(
        self,
        trials: Sequence[Trial] | Observed,
        seed: int = 0,
        config: FitConfig | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> Answer:
        """Return what has changed since; see :func:`eea.infer.fit.infer`.

        Where the robot was learned from logs, a log counts as explained if these are explained as
        badly. The findings here are the last of the answer. Numbers of a group that was not
        inferred before are inferred if ``config`` names it.
        """
        seed = _whole_seed(seed)
        config = recorded_config(config)
        if config.nuisances is None:
            config = replace(config, nuisances=self._nuisances)
        if isinstance(trials, Observed):
            check_enough(self.robot, trials, config, known_noise=True)
            found = fit(
                replace(trials, noise=self.noise),
                self.robot,
                replace(config, noise=self.sigma),
                np.random.default_rng(seed),
                progress=progress,
                usual=self.misfits,
                samples=self.samples,
            )
        else:
            found = infer(
                self.robot,
                trials,
                seed,
                config,
                self.channel_noise,
                self.misfits,
                progress,
                samples=self.samples,
            )
        caveats = (*found.caveats, *self.findings)
        learned = None if self.spread is None else self
        return replace(found, samples=self.samples, caveats=caveats, learned=learned)

    @own_errors
    def test(
        self,
        log: Trial | Observed,
        seed: int | np.random.Generator = 0,
        alarm: float = FALSE_ALARM_RATE,
    ) -> Verdict:
        """Return whether a log is of the same robot, at a rate of false alarms.

        The log's own numbers are fitted. Where the robot was learned from logs, the log is judged
        by these, else by whether it leaves noise alone (the head of this file has the statistic).

        Raises
        ------
        ConfigurationError
            If the log has other channels than the robot, or ``alarm`` is no rate.
        TargetError
            If no simulation stays finite.
        """
        check_alarm(alarm)
        if self.misfits is not None:
            whole = replace(self.robot, hypotheses=())
            instance("log", log, Trial)
            assert isinstance(log, Trial)
            noise = self.channel_noise
            config = replace(LEARNING_CONFIG, nuisances=self._nuisances)
            fitted = infer(whole, [log], _whole_seed(seed), config, noise, self.misfits)
            p = fitted.goodness.p
            usual = float(np.exp(np.log(self.misfits).mean()))
            return Verdict(p, p >= alarm, _misfit(fitted.best_fit) / usual)
        stream = isinstance(seed, np.random.Generator)
        rng = np.random.default_rng(seed if stream else _whole_seed(seed))
        window = window_of(self.robot, log, self.noise, self.sigma, self.groups)
        return test_near_prior(window, self.sigma, self.samples, alarm, rng)

    def follow(
        self,
        alarm: float = FALSE_ALARM_RATE,
        drift: Mapping[str, float] | None = None,
        seed: int = 0,
    ) -> Follower:
        """Return what follows the numbers from here through a log; see :class:`Follower`."""
        return Follower(
            self.robot, self.channel_noise, alarm, drift, seed, self.samples, self.groups
        )

    @property
    def _nuisances(self) -> tuple[str, ...] | None:
        """The groups as a configuration names them."""
        return None if self.groups is None else tuple(sorted(self.groups))

    @property
    def channel_noise(self) -> Noise:
        """The noise of each channel."""
        if self.noise is not None:
            return Noise(self.sigma * self.noise.sd, self.noise.correlation)
        channels = len(self.robot.channels)
        return Noise(np.full(channels, self.sigma), np.zeros(channels))


def _of_another_log(robot: RobotModel, spread: Prior) -> Prior:
    """Return what the numbers known of a log tell of another, which differs by two logs' spread.

    What a hypothesis has fixed does not differ.
    """
    known = robot.prior
    assert known is not None
    covariance = known.covariance.copy()
    free = set(spread.names) - set(robot.nominal.fixed)
    names = [name for name in known.names if name in free]
    into = [known.names.index(name) for name in names]
    of = [spread.names.index(name) for name in names]
    covariance[np.ix_(into, into)] += 2.0 * spread.covariance[np.ix_(of, of)]
    return replace(known, covariance=covariance)


def _whole_seed(seed: int | np.random.Generator) -> int:
    """Return a seed, or one that a generator draws."""
    if isinstance(seed, np.random.Generator):
        return int(seed.integers(2**32))
    whole("seed", seed, 0, MAXIMUM_SEED)
    return seed


@own_errors
def learn(
    robot: RobotModel,
    known_good: Sequence[Trial],
    sessions: Sequence[object] | None = None,
    seed: int = 0,
    config: FitConfig | None = None,
    ongoing: object = None,
) -> Known:
    """Return what known-good logs tell: the robot as it was, its spread, and its noise.

    Each log is fitted by itself, with the spread of all as its prior (empirical Bayes). Healthy
    values are taken as they are stated; the ``findings`` say where the logs contradict them. So are
    the priors of numbers that vary: logs that all began at rest do not forbid another start.

    Parameters
    ----------
    robot
        The robot.
    known_good
        Two logs or more, each a trial.
    sessions
        A label for each log; logs of one session have the same. None: all are of one session, and
        so is every later log.
    seed, config
        Of the fits.
    ongoing
        The label of the session that later logs are of, so that they are judged by the robot as it
        was in that session, and only the spread within is learned from the others. None: later logs
        are of a new session.

    Raises
    ------
    ConfigurationError
        If there are fewer than two logs, too few samples, not as many labels as logs, or no session
        has the label ``ongoing`` or two logs from which the spread within a session can be told;
        or if each log is explained alike by several answers.
    """
    instance("robot", robot, RobotModel)
    if len(all_of("known_good", known_good, Trial)) < 2:
        raise ConfigurationError(f"known_good must be two logs or more; got {len(known_good)}")
    labels = _labels(sessions, len(known_good))
    if ongoing is not None and (
        sessions is None or not isinstance(ongoing, Hashable) or ongoing not in labels
    ):
        raise ConfigurationError(
            f"ongoing must be one of the labels in sessions; got {brief(ongoing)}"
        )
    if ongoing is not None and len(set(labels)) == len(labels):
        raise ConfigurationError(
            "ongoing needs a session of two logs or more, which tell the spread within a session"
        )
    config = LEARNING_CONFIG if config is None else config
    instance("config", config, FitConfig)
    effort = replace(config, alternatives="never")
    robot = replace(robot, numbers=robot.table)  # as wide as with hypotheses, also without
    whole = replace(robot, hypotheses=())
    observed = Observed.of(known_good, robot)
    groups = robot.groups if config.nuisances is None else config.nuisances
    unknowns = Unknowns.of(whole, 1, groups, whole.nominal).unknowns
    if observed.size <= len(known_good) * unknowns:
        raise ConfigurationError(
            f"known_good must have more samples than the {unknowns} unknowns of each of "
            f"{len(known_good)} logs, or the noise cannot be told; got {observed.size}"
        )
    noise = first_guess(robot, observed)
    plain = whole
    before: list[LogFit | None] = [None] * len(known_good)
    for _ in range(ROUNDS):
        fits = _fit_each(whole, known_good, effort, noise, seed, before)
        before = [*fits]
        noise = noise_left([one.optima for one in fits])
        whole = replace(whole, prior=_spread(fits, labels))
    later = _spread(fits, labels, ongoing, widened=True)
    whole = replace(whole, prior=_spread(fits, labels, widened=True))
    fits = _fit_each(whole, known_good, effort, noise, seed, before)
    misfits = np.array([_misfit(one.optima) for one in fits])
    said = _of_each_alone(plain, known_good, effort, noise, seed)
    said += contradicted(whole, contradictions(whole, [one.optima for one in fits], groups))
    said += only_rounding(noise, observed, robot)
    said += of_shared(observed.shared)
    return Known(
        replace(robot, prior=later),
        noise,
        misfits=misfits,
        findings=tuple(said),
        groups=None if config.nuisances is None else frozenset(config.nuisances),
        spread=later,
    )


def _of_each_alone(
    robot: RobotModel, logs: Sequence[Trial], config: FitConfig, noise: Noise, seed: int
) -> list[str]:
    """Return a sentence on each number that most logs, each by itself, want beyond its range.

    Each by itself, because the spread of all holds every log to the answer of the first fits.

    Raises
    ------
    ConfigurationError
        If each is explained alike by several answers.
    """
    alone = [infer(robot, [log], seed, config, noise).branches[0] for log in logs]
    if all(len(one.ambiguous) for one in alone):
        raise ConfigurationError(
            "known_good must have a log that tells one answer; got the first, by which "
            f"{several(alone[0])[0]}"
        )
    ends = Counter(said for one in alone for said in at_ends(one))
    return [said for said, count in ends.items() if 2 * count > len(logs)]


def _labels(sessions: Sequence[object] | None, count: int) -> list[object]:
    """Return the sessions' labels, which can be told from one another and are not missing."""
    if sessions is None:
        return [0] * count
    labels = []
    with suppress(TypeError, ValueError):  # of no series, or of labels that cannot be compared
        for label in () if isinstance(sessions, Mapping | Set) else sessions:
            hash(label)
            if label is not None and label == label:  # NaN is a missing one
                labels.append(label)
    if len(labels) != count:
        raise ConfigurationError(
            f"sessions must be one label for each of {count} logs, such as a number or a text; "
            f"got {brief(sessions)}"
        )
    return labels


class LogFit(NamedTuple):
    """The best fit of a log, and its numbers with their covariance, as shares of ranges."""

    optima: Optima
    names: tuple[str, ...]
    theta: Floats  #: (k,)
    covariance: Floats  #: (k, k)


def _fit_each(
    robot: RobotModel,
    logs: Sequence[Trial],
    config: FitConfig,
    noise: Noise,
    seed: int,
    before: Sequence[LogFit | None],
) -> list[LogFit]:
    """Return the fit of each log, searched for and also from the fit ``before``.

    A search of few starts may end in another valley, whose numbers would pass for a spread.
    """
    return [
        _fitted(robot, log, config, noise, seed, last)
        for log, last in zip(logs, before, strict=True)
    ]


def _fitted(
    robot: RobotModel,
    log: Trial,
    config: FitConfig,
    noise: Noise,
    seed: int,
    before: LogFit | None,
) -> LogFit:
    optima = infer(robot, [log], seed, config, noise).best_fit
    if before is not None:
        optima = improved(optima, before.optima.fits.theta[:1])
    parameters = optima.regression.parameters
    mode = optima.mixture(optima).modes[0]
    entries = parameters.common_entries()
    least = np.where(parameters.circular, 0.0, UNIFORM_PRECISION)
    covariance = mode.covariance(least)[np.ix_(entries, entries)]
    names = tuple(map(parameters.base, entries.tolist()))
    return LogFit(optima, names, mode.theta[entries], covariance)


def _spread(
    fits: Sequence[LogFit],
    labels: Sequence[object],
    ongoing: object = None,
    widened: bool = False,
) -> Prior:
    """Return the distribution of a new log's numbers, of a new session if there are several.

    Or of the session with the label ``ongoing``.
    """
    theta = np.array([one.theta for one in fits])
    uncertain = np.mean([one.covariance for one in fits], axis=0)
    mean, covariance = new_member(theta, uncertain, labels, ongoing, widened)
    return Prior(fits[0].names, mean, covariance + LEAST_SD**2 * np.eye(len(covariance)))


def _misfit(optima: Optima) -> float:
    """Return the mean square of what the best fit leaves, over the noise's."""
    return float(optima.fits.squares[0]) / optima.regression.observed.size


ANGLE_STARTS = 64  # random initial states of a window, where there are hidden angles
NAMING_CONFIG = FitConfig(
    alternatives="always", bodies=16, poses=16, descents=4, polished=2, restarts=0
)


@dataclass(frozen=True, eq=False)
class Followed:
    """What is known after a window, and how well the window agreed with what was known before."""

    #: The median of each number and the ends of its 90% interval, by name, in natural units.
    table: Mapping[str, tuple[float, float, float]]
    #: Observed minus predicted by the numbers as they were known before (T, channels), in
    #: multiples of each channel's noise; NaN where a sample is missing. The window's own initial
    #: state is fitted. None of the first window, before which nothing was known.
    innovation: Floats | None
    p: float  #: The chance that a window agrees as badly, if the numbers are as they were.
    alarm: bool  #: Whether that is below the rate of false alarms.
    #: What has changed, most probable first, if ``alarm``: see ``Answer.findings``. Without an
    #: alarm, which numbers are at an end of their ranges.
    findings: tuple[str, ...] = ()
    #: Whether the window is explained, by the numbers as they were or by a hypothesis.
    explained: bool = True

    @property
    def innovation_rms(self) -> float:
        """The root mean square of the innovation: about 1 if the numbers are as they were."""
        if self.innovation is None:
            return float("nan")
        return float(np.sqrt(np.nanmean(self.innovation**2)))


class Follower:
    """Follows a robot's numbers from window to window of a log.

    A window is a :class:`~eea.infer.trials.Trial` of its own: its initial state is hidden angles
    or numbers that vary. After an alarm the next window tells what has changed, of what the
    robot's hypotheses say; if none explains it, the one after that.

    Parameters
    ----------
    robot
        The robot. No number states what is ``healthy``: the log tells the numbers. Its ``prior``,
        if it has one, is what is known before the first window.
    noise
        The standard deviation of each channel's noise, by name, or the ``noise`` of a posterior.
    alarm
        The rate of false alarms, in each window.
    drift
        By how much a number may wander from window to window: its standard deviation, by name, in
        its unit. Without it the intervals shrink forever, and a slow change raises the alarm.
    seed
        Of random starting points.
    samples
        The number of samples behind the noise, where it is an estimate.
    groups
        The groups of numbers that are followed; None for all.

    Raises
    ------
    ConfigurationError
        If the noise is not that of every channel, or a name is unknown.

    Examples
    --------
    A spring is pulled by a known force; its stiffness is followed:

    >>> from eea.infer.robot import Robot
    >>> from eea.infer.statement import Number
    >>> spring = Robot(
    ...     simulate=lambda values, force: (force / values["stiffness"][:, None])[:, :, None],
    ...     numbers={"stiffness": Number(1.0, 50.0)},
    ...     channels={"length": "m"},
    ... )
    >>> follower = spring.follow(noise={"length": 0.01})
    >>> force = np.linspace(1.0, 5.0, 40)
    >>> rng = np.random.default_rng(0)
    >>> for _ in range(3):
    ...     length = force / 20.0 + rng.normal(0.0, 0.01, 40)
    ...     followed = follower.update(Trial(length[:, None], force))
    >>> followed.alarm, [round(x, 1) for x in followed.table["stiffness"]]
    (False, [19.9, 19.7, 20.1])
    """

    @own_errors
    def __init__(
        self,
        robot: RobotModel,
        noise: Mapping[str, float] | Noise,
        alarm: float = FALSE_ALARM_RATE,
        drift: Mapping[str, float] | None = None,
        seed: int = 0,
        samples: int = 0,
        groups: Collection[str] | None = None,
    ) -> None:
        instance("robot", robot, RobotModel)
        check_alarm(alarm)
        whole("seed", seed, 0, MAXIMUM_SEED)
        if robot.healthy:
            raise ConfigurationError(
                f"healthy must be left out where numbers are followed, for the log tells them; got "
                f"{brief(dict(robot.healthy))}"
            )
        robot = replace(robot, numbers=robot.table)  # as wide as with hypotheses, also without
        self._robot = robot
        self._noise = known_noise(noise, robot)
        self._alarm = alarm
        self._samples = samples
        self._before: Floats | None = None  # the signal of the window before
        self._rng = np.random.default_rng(seed)
        self._seed = seed
        self._known: Prior | None = None
        self._doubted = False  # whether the window before raised an alarm
        self._roughness: Roughness | None = None  # of the simulator
        self._config = FitConfig(nuisances=None if groups is None else tuple(sorted(groups)))
        self._groups = robot.groups if groups is None else tuple(sorted(groups))
        for name in self._groups:
            choice("groups", name, robot.groups)
        plain = Unknowns.of(replace(robot, hypotheses=()), 1, self._groups)
        self._names = [plain.names[i] for i in plain.common_entries()]
        drift = {} if drift is None else drift
        mapping("drift", drift, numbers.Real)
        for name, sd in drift.items():
            choice("drift", name, self._names)
            real(f"drift of {name}", sd, 0.0)
        steps = [drift.get(name, 0.0) for name in self._names]
        spans = [high - low for low, high in map(self._ends, self._names)]
        self._wander = np.diag((np.array(steps) / np.array(spans)) ** 2)
        if robot.prior is not None and plain.prior_precision[self._entries(plain)].all():
            self._known = self._ignorance()

    @own_errors
    def update(self, window: Trial) -> Followed:
        """Return what is known after one more window of the log.

        Raises
        ------
        ConfigurationError
            If the window has other channels than the robot.
        TargetError
            If no simulation stays finite.
        """
        instance("window", window, Trial)
        signal = np.asarray(window.signal)
        before = self._before
        found = self._updated(window)
        self._before = signal
        if before is not None and twice([before, signal]):
            return replace(found, findings=(*found.findings, REPEATED_FINDING))
        return found

    def _updated(self, window: Trial) -> Followed:
        if self._known is None:
            return self._first(window)
        known = self._known
        known = replace(known, covariance=known.covariance + self._wander)
        robot = replace(self._robot, prior=known)
        regression = window_of(
            robot, window, self._noise, groups=self._groups, roughness=self._roughness
        )
        parameters = regression.parameters
        if self._robot.angles:
            best = fit_near_prior(regression, 1.0, ANGLE_STARTS, self._rng)
        else:
            typical = parameters.into_bounds(parameters.prior_mean[None])
            best = descend(regression.misfit(FINE), typical, 1.0, 20, 1e-4)
        p = judged(regression, float(best.cost[0]), self._samples, self._alarm).p
        innovation = self._innovation(regression, best.theta[0])
        if p >= self._alarm:
            self._doubted = False
            self._known = self._after(regression, best.theta[0], known)
            ends = at_bounds(parameters, best.theta[0], self._entries(parameters).tolist())
            return Followed(self.table(), innovation, p, False, tuple(ends))
        self._known = known
        rounding = only_rounding(self._noise, regression.observed, self._robot)
        if not self._doubted:
            self._doubted = True
            said = (ALARM_FINDING, *rounding)
            return Followed(self.table(), innovation, p, True, said, explained=False)
        changed = replace(self._robot, prior=known)
        config = replace(NAMING_CONFIG, nuisances=self._config.nuisances)
        found = infer(changed, [window], self._seed, config, self._noise)
        if found.good:
            self._doubted = False
            optima: Optima = found.best_fit
            self._known = self._after(optima.regression, optima.fits.theta[0], known)
        said = (*found.findings, *rounding)
        return Followed(self.table(), innovation, p, True, said, found.good)

    @own_errors
    def table(self, mass: float = 0.9) -> dict[str, tuple[float, float, float]]:
        """Return the median and the interval of each number now, by name, in natural units.

        Before the first window they are those of the ranges.
        """
        real("mass", mass, 0.0, 1.0)
        known = self._known if self._known is not None else self._ignorance()
        reach = float(ndtri(0.5 + 0.5 * mass)) * np.sqrt(np.diag(known.covariance))
        found = {}
        for name, middle, sd in zip(known.names, known.mean, reach, strict=True):
            low, high = self._ends(name)
            shares = np.clip([middle, middle - sd, middle + sd], 0.0, 1.0)
            median, least, most = (low + (high - low) * shares).tolist()
            found[name] = (median, least, most)
        return found

    def _ends(self, name: str) -> tuple[float, float]:
        """Return the range of a number."""
        number = self._robot.table[name]
        return number.low, number.high

    def _ignorance(self) -> Prior:
        """Return what is known before the first window: the prior, or ranges and numbers' own."""
        plain = Unknowns.of(replace(self._robot, hypotheses=()), 1, self._groups)
        entries = self._entries(plain)
        precision = plain.proper_prior[np.ix_(entries, entries)]
        covariance = np.asarray(np.linalg.inv(precision), np.float64)
        return Prior(tuple(self._names), plain.prior_mean[entries], covariance)

    def _first(self, window: Trial) -> Followed:
        """Return what is known after the first window, which is searched as any trial is.

        One that nothing explains, or that two answers explain alike, is left out, and the next one
        is the first.
        """
        plain = replace(self._robot, hypotheses=())
        found = infer(plain, [window], self._seed, self._config, self._noise)
        p = found.goodness.p
        alarm = p < self._alarm
        assert found.warm_start is not None
        self._roughness = found.warm_start.roughness
        if not alarm and not len(found.branches[0].ambiguous):
            optima = found.best_fit
            before = self._ignorance()
            self._known = self._after(optima.regression, optima.fits.theta[0], before)
        rounding = only_rounding(self._noise, found.best_fit.regression.observed, self._robot)
        said = (*found.findings, *(rounding if alarm else ()))
        return Followed(self.table(), None, p, alarm, said, not alarm)

    def _entries(self, parameters: Unknowns) -> NDArray[np.intp]:
        """Return which entries are the numbers that are followed."""
        return np.array([parameters.names.index(name) for name in self._names], dtype=np.intp)

    def _innovation(self, regression: Regression, theta: Floats) -> Floats:
        """Return what the numbers known before leave, if the window's own numbers are fitted."""
        parameters = regression.parameters
        common = self._entries(parameters)
        start = theta.copy()
        start[common] = parameters.prior_mean[common]
        misfit = regression.misfit(FINE, only_of=0)
        if misfit.movable.any():
            start = descend(misfit, start[None], 1.0, 10, 1e-3).theta[0]
        left = -misfit.residuals(start[None])[0, 0].astype(np.float64)
        channels = regression.observed.signal.shape[2]
        shaped = left.reshape(channels, -1).T
        return np.where(regression.observed.there[0], shaped, np.nan)

    def _after(self, regression: Regression, theta: Floats, known: Prior) -> Prior:
        """Return what is known after a window, of its best fit; ``known`` is what was before.

        Numbers that nothing tells stay in the middle of what they may be, not where the search for
        a best fit left them.
        """
        parameters = regression.parameters
        misfit = regression.misfit(FINE)
        linear = misfit.linearise(theta[None])
        common = self._entries(parameters)
        least = parameters.uniform_precision
        near = misfit.laplace(theta[None], linear, 1.0)[0].marginal(common, least)
        flat = np.diag(least[common])
        covariance = np.linalg.inv(near.information + flat)
        mean = theta[common] - covariance @ flat @ (theta[common] - known.mean)
        covariance = 0.5 * (covariance + covariance.T) + LEAST_SD**2 * np.eye(len(common))
        return Prior(tuple(self._names), mean, covariance)
