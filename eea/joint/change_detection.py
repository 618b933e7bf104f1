"""Change detection in a log: tests whether its windows still fit the posterior of the robot.

Each window is fitted with the posterior as the prior, so that neither its unknown initial state nor
the posterior's uncertainty counts as a change. For the same robot

    2 cost = sum of r^2 / sigma^2 + the prior's squared distance  ~  chi-square,

with as many degrees of freedom as the window has samples, minus the hidden angles, which have no
prior. The true number is slightly smaller, since initial states vary less than their priors. Where
sigma was estimated from N samples, the statistic has an F distribution.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, f

from eea.core.angles import Floats
from eea.core.checks import finite, real, whole
from eea.core.floating import own_errors
from eea.joint.descent import Fitted, descend
from eea.joint.initialization import hop, pose
from eea.joint.joint_posterior import JointPosterior
from eea.joint.least_squares import COARSE, FINE, Regression
from eea.joint.observed import Observed
from eea.joint.parameters import Parameters
from eea.joint.robot_model import RobotModel

FALSE_ALARM_PROBABILITY = 1e-6  # probability of a false alarm in each window
LEAST_FALSE_ALARM_PROBABILITY = 1e-100  # 0 would never raise an alarm
START_COUNTS = (64, 512, 4096)  # random starts, tried until one explains the window
EXAMINED_P_VALUE = 1e-2  # windows with greater p-values are not examined further
POSE_SCANS = 6  # scans that share the random starts
LOUD_FACTOR = 10.0  # of the noise in the last search


class WindowTest(NamedTuple):
    """The test of one window."""

    p: float  #: The p-value of the fit, if the robot is the same.
    same: bool  #: Whether it is at least the probability of a false alarm.
    excess: float  #: The cost relative to its mean for the same robot.


def check_alarm(alarm: float) -> None:
    """Raise a ConfigurationError unless ``alarm`` can be a probability of false alarms."""
    real("alarm", alarm, LEAST_FALSE_ALARM_PROBABILITY, 1.0)


class ChangeDetector:
    """Tests windows of a swim against a posterior, each by itself.

    Parameters
    ----------
    robot
        The robot in mid-swim, with ``start`` nuisances for the initial state. Its other nuisances
        take their posterior from ``belief``, by name.
    belief
        The posterior. Its most probable hypothesis is used.
    alarm
        Probability of a false alarm in each window.
    seed
        Seed of the starting points.
    """

    def __init__(
        self,
        robot: RobotModel,
        belief: JointPosterior,
        alarm: float = FALSE_ALARM_PROBABILITY,
        seed: int = 0,
    ) -> None:
        check_alarm(alarm)
        whole("seed", seed, 0)
        self.alarm = alarm
        self._rng = np.random.default_rng(seed)
        self._sigma = belief.sigma
        self._samples = belief.samples
        best = belief.branches[0]
        groups = {n.group for n in robot.nuisance_list if n.name in best.parameters.names}
        known = replace(robot, prior=best.prior())
        self._one = Parameters.of(known, 1, groups, best.hypothesis)

    @own_errors
    def look(
        self, inputs: NDArray[Any], signal: Floats, weight: Floats | None = None
    ) -> WindowTest:
        """Test one window with inputs (1, ...) and a finite signal (T, axes).

        ``weight`` (T,) holds the weights of its samples; see :class:`eea.joint.observed.Observed`.
        """
        signal = finite("signal", signal, (None, len(self._one.robot.channels)))
        observed = Observed(inputs, signal[None], None if weight is None else weight[None])
        angles = len(self._one.angle_entries(0))
        freedom = observed.size - angles
        window = Regression(self._one, observed, self._sigma)
        best: Fitted | None = None
        for effort in START_COUNTS:
            found = fit_near_prior(window, self._sigma, effort, self._rng)
            best = found if best is None or found.cost[0] < best.cost[0] else best
            test = self._tested(float(best.cost[0]), freedom)
            if test.p >= max(EXAMINED_P_VALUE, self.alarm):
                return test
        if test.same or best is None:
            return test
        return self._tested(self._cost_elsewhere(window, best), freedom)

    def _tested(self, cost: float, freedom: int) -> WindowTest:
        """Return the test of a window whose best fit has a cost."""
        ratio = 2.0 * cost / freedom
        if self._samples:
            p = float(f.sf(ratio, freedom, self._samples))
        else:
            p = float(chi2.sf(ratio * freedom, freedom))
        return WindowTest(p, p >= self.alarm, ratio)

    def _cost_elsewhere(self, window: Regression, best: Fitted) -> float:
        """Return the least cost also from other valleys of the initial state.

        The less noise, the more starts end in a wrong valley, whose misfit would count as a change.
        Louder noise leads to others.
        """
        (rng,) = self._rng.spawn(1)  # which leaves later windows their starts
        loud = LOUD_FACTOR * self._sigma
        smooth = fit_near_prior(replace(window, noise=loud), loud, START_COUNTS[1], rng)
        fine = window.misfit(FINE)
        starts = [hop(window, best.theta[0], self._sigma, rng), smooth.theta]
        elsewhere = descend(fine, np.concatenate(starts), self._sigma, 40, 1e-6)
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
