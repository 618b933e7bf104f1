"""Whether logs that are known to be good contradict what a robot states as whole."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import ndtr, stdtr

from eea.core.config import FALSE_ALARM_RATE
from eea.joint.descent import descend
from eea.joint.inference import carried_over
from eea.joint.least_squares import FINE
from eea.joint.parameters import Parameters
from eea.joint.robot_model import RobotModel
from eea.joint.search import Optima
from eea.statistics.random_effects import NORMAL_95

FLAT_PRECISION = 12.0  # in 1/range^2, of a uniform distribution over the range


def contradictions(robot: RobotModel, fits: Sequence[Optima], groups: Collection[str]) -> list[str]:
    """Return a sentence on each number in ``whole`` that known-good logs do not have.

    The best fit of each log descends on with the numbers in ``whole`` free. Their shifts, averaged
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
    if not robot.whole:
        return []
    places = [list(robot.parameters).index(name) for name in robot.whole]
    free = replace(robot, whole={})
    parameters = Parameters.of(free, 1, groups, free.nominal)
    flat = np.zeros(len(parameters))
    flat[places] = FLAT_PRECISION
    found = []
    variances = []
    for fit in fits:
        regression = replace(fit.regression, parameters=parameters)
        misfit = regression.misfit(FINE)
        start = carried_over(fit, parameters)[:1]
        theta = descend(misfit, start, fit.sigma, 40, 1e-6).theta
        linear = misfit.linearise(theta)
        information = linear.normal[0] / fit.sigma**2 + parameters.prior_information
        covariance = np.linalg.pinv(information + np.diag(flat), hermitian=True)
        # Not held by a bound, at which numbers in ``whole`` often are.
        away = parameters.prior_information @ (theta[0] - parameters.prior_mean)
        gradient = linear.gradient[0] / fit.sigma**2 + away
        found.append((theta[0] - covariance @ gradient)[places])
        variances.append(np.diag(covariance)[places])
    said = []
    for k, (name, stated) in enumerate(robot.whole.items()):
        low, high = robot.parameters[name]
        shares = np.array([one[k] for one in found])
        weights = 1.0 / np.array([one[k] for one in variances])
        mean = float(weights @ shares / weights.sum())
        scatter = float(shares.var(ddof=1)) / len(shares)
        own = 1.0 / float(weights.sum())
        sd = max(own, scatter) ** 0.5
        off = abs(mean - (stated - low) / (high - low)) / sd
        p = 2.0 * float(ndtr(-off) if own >= scatter else stdtr(len(shares) - 1, -off))
        if p * len(robot.whole) < FALSE_ALARM_RATE:
            value = low + (high - low) * mean
            reach = (high - low) * NORMAL_95 * sd
            said.append(
                f"the known-good logs contradict whole: {name} is "
                f"{robot.with_unit(name, value)} in them, {value - reach:.3g} to "
                f"{value + reach:.3g}, and not {stated:g}"
            )
    return said
