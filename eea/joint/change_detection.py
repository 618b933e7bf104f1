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
from eea.joint.descent import Fitted, descend
from eea.joint.initialization import pose
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


class WindowTest(NamedTuple):
    """The test of one window."""

    p: float  #: The p-value of the fit, if the robot is the same.
    same: bool  #: Whether it is at least the probability of a false alarm.
    excess: float  #: The cost relative to its mean for the same robot.


def check_alarm(alarm: float) -> None:
    """Raise InvalidArgumentError unless ``alarm`` can be a probability of false alarms."""
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
        cost = np.inf
        for effort in START_COUNTS:
            cost = min(cost, self._explained(observed, effort))
            ratio = 2.0 * cost / freedom
            if self._samples:
                p = float(f.sf(ratio, freedom, self._samples))
            else:
                p = float(chi2.sf(ratio * freedom, freedom))
            if p >= max(EXAMINED_P_VALUE, self.alarm):
                break
        return WindowTest(p, p >= self.alarm, ratio)

    def _explained(self, observed: Observed, effort: int) -> float:
        """Return the least cost found from ``effort`` random starts."""
        window = Regression(self._one, observed, self._sigma)
        return float(fit_near_prior(window, self._sigma, effort, self._rng).cost[0])


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
