"""Slow errors in residuals: a test for errors of the simulator.

A simulator's errors last for many samples, so they show at low frequencies, where noise is no
stronger than elsewhere. A fit takes most of its degrees of freedom from the same frequencies. So
they are counted (:mod:`eea.fish.slow_errors`).

The power of residuals at low frequencies, where a wrong model's errors are.

Residuals of the least squares of J have the covariance sigma^2 (I - H), with
H = J (J^T J + sigma^2 Lambda)^-1 J^T and Lambda the prior's precision: a fit takes degrees of
freedom, and most of them from low frequencies.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincc

from eea.core.angles import Floats
from eea.infer.laplace import pseudo_inverse
from eea.infer.misfit import FINE, Regression


def slow_p(sums: Floats, prior: Floats, power: Floats, weight: Floats) -> float:
    """Return the p-value of residuals' power, weighted by W, for white noise after a fit.

    The statistic is the weighted power divided by the whole. Its null distribution is a gamma
    distribution with the mean and variance of white noise after the fit (F. E. Satterthwaite,
    1946).

    Parameters
    ----------
    sums
        J^T W^n J (3, P, P) for n = 0, 1, 2.
    prior
        The prior's precision (P, P).
    power
        The whole power and the weighted power (2,).
    weight
        The sums of W^n (3,).
    """
    if not power[0]:
        return 1.0
    taken, slow, slower = pseudo_inverse(sums[0] + prior * power[0] / weight[0]) @ sums
    left = weight[0] - np.trace(taken)
    mean = weight[1] - float(np.trace(slow))
    square = weight[2] - 2.0 * float(np.trace(slower)) + float(np.sum(slow * slow.T))
    variance = 2.0 * (square - mean**2 / left)
    if not min(mean, variance) > 0.0:  # the fit has absorbed all slow errors
        return 1.0
    found = left * power[1] / power[0]
    return float(gammaincc(mean**2 / variance, found * mean / variance))


ACTIVE_BOUND_DISTANCE = 1e-9  # share of a range


def slow_errors(regression: Regression, theta: Floats, duration: float) -> float:
    """Return the p-value of slow residuals at an optimum ``theta`` (P,), for white noise.

    The alternative is errors that are correlated by exp(-|t - t'| / duration), in the unit of the
    trials' times, and as large in each trial as its signal.
    """
    parameters = regression.parameters
    observed = regression.observed
    axes = observed.signal.shape[2]
    misfit = regression.misfit(FINE)
    linear = misfit.linearise(theta[None])
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
    for e, (unknown, entries) in enumerate(misfit.columns):
        used = unknown.copy()
        used[unknown] = inner[entries]
        at = entries[inner[entries]]
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
    return slow_p(sums, parameters.prior_information, power, weight)
