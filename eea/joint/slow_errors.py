"""Slow errors in residuals: a test for errors of the simulator.

A simulator's errors last for many samples, so they show at low frequencies, where noise is no
stronger than elsewhere. A fit takes most of its degrees of freedom from the same frequencies. So
they are counted (:mod:`eea.statistics.slow_power`).
"""

from __future__ import annotations

import numpy as np

from eea.core.angles import Floats
from eea.joint.least_squares import FINE, Regression
from eea.statistics.slow_power import slow_p

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
