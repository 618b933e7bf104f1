"""The power of residuals at low frequencies, where a wrong model's errors are.

Residuals of the least squares of J have the covariance sigma^2 (I - H), with
H = J (J^T J + sigma^2 Lambda)^-1 J^T and Lambda the prior's precision: a fit takes degrees of
freedom, and most of them from low frequencies.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincc

from eea.core.angles import Floats
from eea.statistics.information import scaled_inverse


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
    inverse, scale = scaled_inverse(sums[0] + prior * power[0] / weight[0])
    taken, slow, slower = (inverse / np.outer(scale, scale)) @ sums
    left = weight[0] - np.trace(taken)
    mean = weight[1] - float(np.trace(slow))
    square = weight[2] - 2.0 * float(np.trace(slower)) + float(np.sum(slow * slow.T))
    variance = 2.0 * (square - mean**2 / left)
    if not min(mean, variance) > 0.0:  # the fit has absorbed all slow errors
        return 1.0
    found = left * power[1] / power[0]
    return float(gammaincc(mean**2 / variance, found * mean / variance))
