"""Slow errors in residuals: a test for errors of the simulator.

A simulator's errors last for many samples, so they show at low frequencies, where noise is no
stronger than elsewhere. A fit takes most of its degrees of freedom from the same frequencies. To
count this, residuals of the least squares of J have the covariance sigma^2 (I - H), with
H = J (J^T J + sigma^2 Lambda)^-1 J^T and Lambda the prior's precision.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincc

from eea.core.angles import Floats
from eea.joint.least_squares import FINE, Regression
from eea.joint.parameters import FIXED_SLOT
from eea.statistics.information import scaled_inverse

ACTIVE_BOUND_DISTANCE = 1e-9  # share of a range


def slow_errors(regression: Regression, theta: Floats, duration: float) -> float:
    """Return the p-value of slow residuals at an optimum ``theta`` (P,), for white noise.

    The alternative is errors that are correlated by exp(-|t - t'| / duration), in the unit of the
    trials' times, and as large in each trial as its signal. The statistic is the residuals' power
    in the basis of such errors, weighted by their variances and divided by the whole power. Its
    null distribution is a gamma distribution with the mean and variance of white noise after the
    fit (F. E. Satterthwaite, 1946).
    """
    parameters = regression.parameters
    observed = regression.observed
    axes = observed.signal.shape[2]
    misfit = regression.misfit(FINE)
    linear = misfit.linearise(theta[None])
    entries = parameters.slots[:, misfit.free]
    # Parameters at a bound take no degrees of freedom from the residuals.
    inner = (theta > parameters.low + ACTIVE_BOUND_DISTANCE) & (
        theta < parameters.high - ACTIVE_BOUND_DISTANCE
    )
    loud = np.array(
        [(one[:n] ** 2).mean() for one, n in zip(observed.signal, observed.counts, strict=True)]
    )
    sums = np.zeros((3, len(parameters), len(parameters)))  # J^T W^n J for n = 0, 1, 2
    power = np.zeros(2)
    weight = np.zeros(3)
    for e in range(len(observed)):
        used = entries[e] != FIXED_SLOT
        used[used] = inner[entries[e, used]]
        at = entries[e, used]
        waves = np.concatenate([linear.slopes[0, e, used], linear.residuals[0, e][None]])
        basis = observed.slow_basis(e, duration)
        waves = basis.transform(waves, axes)
        each = basis.variances * loud[e] / loud.max()  # (T,)
        columns = waves[:-1]
        residuals = waves[-1]
        for n in range(3):
            moved = (columns * each**n).reshape(len(at), -1)
            sums[n][at[:, None], at] += moved @ columns.reshape(len(at), -1).T
            weight[n] += axes * float((each**n).sum())
        power += (residuals**2).sum(), (each * residuals**2).sum()
    if not power[0]:
        return 1.0
    taken, slow, slower = _taken(sums, parameters.prior_information * power[0] / weight[0])
    left = weight[0] - np.trace(taken)
    mean = weight[1] - float(np.trace(slow))
    square = weight[2] - 2.0 * float(np.trace(slower)) + float(np.sum(slow * slow.T))
    variance = 2.0 * (square - mean**2 / left)
    if not min(mean, variance) > 0.0:  # the fit has absorbed all slow errors
        return 1.0
    found = left * power[1] / power[0]
    return float(gammaincc(mean**2 / variance, found * mean / variance))


def _taken(sums: Floats, prior: Floats) -> Floats:
    """Return (J^T J + prior)^-1 J^T W^n J, (3, P, P), without uninformed directions."""
    inverse, scale = scaled_inverse(sums[0] + prior)
    found: Floats = (inverse / np.outer(scale, scale)) @ sums
    return found
