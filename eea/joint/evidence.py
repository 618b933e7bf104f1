"""The posterior at the optima of a hypothesis, and what its evidence needs besides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import log_ndtr

from eea.joint.discrepancy import doubted
from eea.joint.least_squares import FINE
from eea.joint.parameters import Parameters
from eea.joint.search import Optima
from eea.statistics.goodness_of_fit import effective_count
from eea.statistics.posterior import Mode, Posterior


def mixture(optima: Optima, best: Optima) -> Posterior:
    """Return the posterior of optima, with noise estimated from the ``best`` fit of all.

    Where its residuals are correlated, only the effective number of samples counts.
    """
    residuals = best.residuals
    weight = effective_count(residuals) / sum(one.size for one in residuals) / best.sigma**2
    parameters = optima.regression.parameters
    theta = optima.fits.theta
    linear = optima.regression.misfit(FINE).linearise(theta)
    away = theta - parameters.prior_mean
    modes = []
    for k in range(len(theta)):
        information = weight * linear.normal[k] + parameters.prior_information
        information = 0.5 * (information + information.T)
        gradient = weight * linear.gradient[k] + parameters.prior_information @ away[k]
        cost = 0.5 * weight * optima.fits.squares[k] + parameters.prior_cost(theta[k])
        modes.append(Mode(theta[k], information, float(cost), gradient))
    return Posterior(parameters.names, parameters.low, parameters.high, parameters.circular, modes)


def with_doubt(inside: Posterior, optima: Optima, best: Optima) -> Posterior:
    """Return the posterior if the simulator may be wrong, which a problem need not say."""
    discrepancy = optima.regression.parameters.robot.discrepancy
    if discrepancy is None:
        return inside
    return replace(inside, modes=doubted(optima, best, discrepancy))


def log_prior_constant(parameters: Parameters) -> float:
    """Return the constant of the log prior; it depends on the set of parameters."""
    informed = parameters.prior_precision > 0.0
    low = parameters.low
    high = parameters.high
    free = ~informed & ~parameters.circular  # uniform between the bounds
    information = parameters.prior_information[np.ix_(informed, informed)]
    mean = parameters.prior_mean[informed]
    sd = np.sqrt(np.diag(np.linalg.inv(information)))
    above = log_ndtr((high[informed] - mean) / sd)
    below = log_ndtr((low[informed] - mean) / sd)
    mass = above + np.log1p(-np.exp(below - above))  # inside the bounds, of each alone
    mass = np.append(mass, np.log(high[free] - low[free]))
    normal = 0.5 * np.linalg.slogdet(information / (2.0 * np.pi))[1] - mass.sum()
    return float(normal - np.count_nonzero(parameters.circular) * np.log(2.0 * np.pi))
