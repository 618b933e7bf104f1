"""Follows a robot's numbers through a log, window by window, and tells when one has changed.

What is known is a normal distribution of the shares of all common numbers. At first it has the mean
and the spread of their ranges. A window's best fit, with that as its prior, and the information
there are what is known next. The test of a window is that of :mod:`eea.joint.change_detection`::

    2 cost = sum of r^2 / sigma^2 + the prior's squared distance  ~  chi-square

if the numbers are as they were and the noise is white and as loud as stated. A window that fails
the test is left out: something may have changed in its midst. If the next one fails, too, the
robot's hypotheses are weighed by it.
"""

from __future__ import annotations

import numbers
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtri

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, brief, choice, instance, mapping, real, whole
from eea.core.config import FALSE_ALARM_RATE, FitConfig
from eea.core.floating import own_errors
from eea.core.session import MAXIMUM_SEED
from eea.joint.change_detection import check_alarm, fit_near_prior
from eea.joint.descent import descend
from eea.joint.hypothesis_posterior import LEAST_SD
from eea.joint.identifiability import proper_prior, without_own
from eea.joint.least_squares import FINE, Regression
from eea.joint.observed import Observed, Trial
from eea.joint.parameters import UNIFORM_PRECISION, Parameters
from eea.joint.problem import Prior
from eea.joint.recorded import infer, known_noise, only_rounding
from eea.joint.robot_model import RobotModel
from eea.joint.search import Optima
from eea.statistics.noise import Noise

ANGLE_STARTS = 64  # random initial states of a window, where there are hidden angles
ALARM_FINDING = "something has changed; the next window tells what"
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
    #: What has changed, most probable first, if ``alarm``: see ``JointPosterior.findings``.
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

    A window is a :class:`~eea.joint.observed.Trial` of its own: its initial state is hidden angles
    or nuisances with ``start``. After an alarm the next window tells what has changed, of what the
    robot's hypotheses say; if none explains it, the one after that.

    Parameters
    ----------
    robot
        The robot. Its ``whole`` is empty: the log tells the numbers.
    noise
        The standard deviation of each channel's noise, by name, or the ``noise`` of a posterior.
    alarm
        The rate of false alarms, in each window.
    drift
        By how much a number may wander from window to window: its standard deviation, by name, in
        its unit. Without it the intervals shrink forever, and a slow change raises the alarm.
    seed
        Of random starting points.

    Raises
    ------
    ConfigurationError
        If the noise is not that of every channel, or a name is unknown.

    Examples
    --------
    A spring is pulled by a known force; its stiffness is followed:

    >>> from eea.joint.robot import Robot
    >>> spring = Robot(
    ...     parameters={"stiffness": (1.0, 50.0)},
    ...     simulate=lambda values, force: (force / values["stiffness"][:, None])[:, :, None],
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
    ) -> None:
        instance("robot", robot, RobotModel)
        check_alarm(alarm)
        whole("seed", seed, 0, MAXIMUM_SEED)
        if robot.whole:
            raise ConfigurationError(
                f"whole must be empty where numbers are followed, for the log tells them; got "
                f"{brief(dict(robot.whole))}"
            )
        self._robot = robot
        self._noise = known_noise(noise, robot)
        self._alarm = alarm
        self._rng = np.random.default_rng(seed)
        self._seed = seed
        self._known: Prior | None = None
        self._doubted = False  # whether the window before raised an alarm
        plain = Parameters.of(replace(robot, hypotheses=(), prior=None), 1, robot.groups)
        self._names = [plain.names[i] for i in plain.common_entries()]
        drift = {} if drift is None else drift
        mapping("drift", drift, numbers.Real)
        for name, sd in drift.items():
            choice("drift", name, self._names)
            real(f"drift of {name}", sd, 0.0)
        steps = [drift.get(name, 0.0) for name in self._names]
        spans = [high - low for low, high in (robot.ranges[name] for name in self._names)]
        self._wander = np.diag((np.array(steps) / np.array(spans)) ** 2)

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
        if self._known is None:
            return self._first(window)
        known = self._known
        known = replace(known, covariance=known.covariance + self._wander)
        regression = self._regression(window, known)
        parameters = regression.parameters
        if self._robot.hidden:
            best = fit_near_prior(regression, 1.0, ANGLE_STARTS, self._rng)
        else:
            typical = parameters.into_bounds(parameters.prior_mean[None])
            best = descend(regression.misfit(FINE), typical, 1.0, 20, 1e-4)
        angles = int((parameters.prior_precision == 0.0).sum())
        freedom = max(regression.observed.size - angles, 1)
        p = float(chdtrc(freedom, 2.0 * float(best.cost[0])))
        innovation = self._innovation(regression, best.theta[0])
        if p >= self._alarm:
            self._doubted = False
            self._known = self._after(regression, best.theta[0], known)
            return Followed(self.table(), innovation, p, alarm=False)
        self._known = known
        rounding = only_rounding(self._noise, regression.observed, self._robot)
        if not self._doubted:
            self._doubted = True
            said = (ALARM_FINDING, *rounding)
            return Followed(self.table(), innovation, p, True, said, explained=False)
        changed = replace(self._robot, prior=known)
        found = infer(changed, [window], self._seed, NAMING_CONFIG, self._noise)
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
            low, high = self._robot.ranges[name]
            shares = np.clip([middle, middle - sd, middle + sd], 0.0, 1.0)
            median, least, most = (low + (high - low) * shares).tolist()
            found[name] = (median, least, most)
        return found

    def _ignorance(self) -> Prior:
        """Return what is known before the first window: the ranges, and nuisances' own priors."""
        plain = Parameters.of(replace(self._robot, hypotheses=()), 1, self._robot.groups)
        entries = self._entries(plain)
        precision = proper_prior(plain)[np.ix_(entries, entries)]
        covariance = np.asarray(np.linalg.inv(precision), np.float64)
        return Prior(tuple(self._names), plain.prior_mean[entries], covariance)

    def _first(self, window: Trial) -> Followed:
        """Return what is known after the first window, which is searched as any trial is.

        One that nothing explains is left out, and the next one is the first.
        """
        plain = replace(self._robot, hypotheses=())
        found = infer(plain, [window], self._seed, noise=self._noise)
        p = found.goodness.p
        alarm = p < self._alarm
        if not alarm:
            optima = found.best_fit
            before = self._ignorance()
            self._known = self._after(optima.regression, optima.fits.theta[0], before)
        rounding = only_rounding(self._noise, found.best_fit.regression.observed, self._robot)
        said = (*found.findings, *(rounding if alarm else ()))
        return Followed(self.table(), None, p, alarm, said, not alarm)

    def _regression(self, window: Trial, known: Prior) -> Regression:
        robot = replace(self._robot, hypotheses=(), prior=known)
        parameters = Parameters.of(robot, 1, robot.groups)
        observed = replace(Observed.of([window], robot), noise=self._noise)
        return Regression(parameters, observed, 1.0)

    def _entries(self, parameters: Parameters) -> NDArray[np.intp]:
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
        normal = regression.misfit(FINE).linearise(theta[None]).normal[0]
        common = self._entries(parameters)
        told = without_own(normal, proper_prior(parameters), common)
        stated = parameters.prior_information[np.ix_(common, common)]
        flat = np.diag(np.where(np.diag(stated) > 0.0, 0.0, UNIFORM_PRECISION))
        covariance = np.linalg.inv(told + stated + flat)
        mean = theta[common] - covariance @ flat @ (theta[common] - known.mean)
        covariance = 0.5 * (covariance + covariance.T) + LEAST_SD**2 * np.eye(len(common))
        return Prior(tuple(self._names), mean, covariance)
