"""What logs that are known to be good tell of a robot, to judge later ones by.

A robot that is whole is several robots: its numbers differ a little from log to log, and more from
session to session, between which it is repaired (:mod:`eea.statistics.random_effects`).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, all_of, brief, instance, real
from eea.core.config import FALSE_ALARM_RATE, FitConfig
from eea.core.floating import own_errors
from eea.joint.contradiction import contradictions
from eea.joint.hypothesis_posterior import LEAST_SD
from eea.joint.joint_posterior import JointPosterior
from eea.joint.observed import Observed, Trial
from eea.joint.parameters import FIXED_PRECISION, UNIFORM_PRECISION, Parameters
from eea.joint.problem import Prior
from eea.joint.recorded import first_guess, infer, noise_left, only_rounding
from eea.joint.robot_model import RobotModel
from eea.joint.search import Optima
from eea.statistics.noise import Noise
from eea.statistics.random_effects import new_member

LEARNING_CONFIG = FitConfig(
    alternatives="never", bodies=32, poses=32, descents=8, polished=2, restarts=0
)
ROUNDS = 6  # of fits to all logs, each with the noise and the spread of the one before


class Look(NamedTuple):
    """How well a log fits the robot as it was."""

    p: float  #: The chance that a known-good log fits as badly, or has numbers as far away.
    same: bool  #: Whether it is at least the rate of false alarms.
    misfit: float  #: The mean square of what the best fit leaves, over the noise's.


@dataclass(frozen=True, eq=False)
class Reference:
    """A robot as its known-good logs showed it; made by :meth:`Robot.learn`."""

    robot: RobotModel  #: With what was learned as its prior.
    noise: Noise  #: Of each channel.
    misfits: Floats  #: (n,) of the known-good logs, as in :class:`Look`.
    #: Sentences on numbers in ``whole`` that the known-good logs contradict, and on channels
    #: without noise.
    findings: tuple[str, ...] = ()

    def infer(
        self,
        trials: Sequence[Trial],
        seed: int = 0,
        config: FitConfig | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> JointPosterior:
        """Return what has changed since; see :func:`eea.joint.recorded.infer`.

        A log counts as explained if known-good logs are explained as badly. The reference's own
        findings are the last of the answer.
        """
        found = infer(self.robot, trials, seed, config, self.noise, self.misfits, progress)
        return replace(found, caveats=self.findings)

    @own_errors
    def watch(self, log: Trial, seed: int = 0, alarm: float = FALSE_ALARM_RATE) -> Look:
        """Return whether the robot as it was explains a log, at a rate of false alarms."""
        real("alarm", alarm, 0.0, 1.0)
        whole = replace(self.robot, hypotheses=())
        fitted = infer(whole, [log], seed, LEARNING_CONFIG, self.noise, self.misfits)
        p = fitted.goodness.p
        return Look(p, p >= alarm, _misfit(fitted.best_fit))


@own_errors
def learn(
    robot: RobotModel,
    known_good: Sequence[Trial],
    sessions: Sequence[object] | None = None,
    seed: int = 0,
    config: FitConfig | None = None,
    ongoing: object = None,
) -> Reference:
    """Return what known-good logs tell: the robot as it was, its spread, and its noise.

    Each log is fitted by itself, with the spread of all as its prior (empirical Bayes). Numbers in
    ``whole`` are taken as they are stated; the ``findings`` say where the logs contradict them.

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
        has the label ``ongoing`` or two logs from which the spread within a session can be told.
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
    robot = replace(robot, nuisances=robot.nuisance_list)  # whose ranges the hypotheses widen
    whole = replace(robot, hypotheses=())
    observed = Observed.of(known_good, robot)
    groups = robot.groups if config.nuisances is None else config.nuisances
    unknowns = Parameters.of(whole, 1, groups, whole.nominal).unknowns
    if observed.size <= len(known_good) * unknowns:
        raise ConfigurationError(
            f"known_good must have more samples than the {unknowns} unknowns of each of "
            f"{len(known_good)} logs, or the noise cannot be told; got {observed.size}"
        )
    noise = first_guess(robot, observed)
    for _ in range(ROUNDS):
        fits = [_fitted(whole, log, effort, noise, seed) for log in known_good]
        noise = noise_left([one.optima for one in fits])
        whole = replace(whole, prior=_spread(fits, labels))
    later = _spread(fits, labels, ongoing, widened=True)
    whole = replace(whole, prior=_spread(fits, labels, widened=True))
    fits = [_fitted(whole, log, effort, noise, seed) for log in known_good]
    misfits = np.array([_misfit(one.optima) for one in fits])
    said = contradictions(whole, [one.optima for one in fits], groups)
    said += only_rounding(noise, observed, robot)
    return Reference(replace(robot, prior=later), noise, misfits, tuple(said))


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


def _fitted(robot: RobotModel, log: Trial, config: FitConfig, noise: Noise, seed: int) -> LogFit:
    posterior = infer(robot, [log], seed, config, noise)
    optima = posterior.best_fit
    branch = posterior.branches[0]
    parameters = branch.parameters
    mode = branch.posterior.modes[0]
    bases = [name.partition("@")[0] for name in parameters.names]
    starts = {n.name for n in robot.nuisance_list if n.start}
    entries = [
        i
        for i, base in enumerate(bases)
        if not parameters.circular[i]
        and parameters.prior_precision[i] < FIXED_PRECISION
        and base not in starts
    ]
    least = np.where(parameters.circular, 0.0, UNIFORM_PRECISION)
    covariance = mode.covariance(least)[np.ix_(entries, entries)]
    names = tuple(bases[i] for i in entries)
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
