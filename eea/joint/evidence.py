"""The posterior at the optima of a hypothesis, and what its evidence needs besides."""

from __future__ import annotations

from dataclasses import replace

from eea.joint.discrepancy import doubted
from eea.joint.least_squares import FINE
from eea.joint.parameters import Parameters
from eea.joint.search import Optima
from eea.statistics.goodness_of_fit import effective_count
from eea.statistics.posterior import Mode, Posterior, log_constant


def mixture(optima: Optima, best: Optima) -> Posterior:
    """Return the posterior of optima, with noise estimated from the ``best`` fit of all.

    Where its residuals are correlated, only the effective number of samples counts.
    """
    weight = precision_of_samples(best)
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
    return parameters.posterior(modes)


def precision_of_samples(best: Optima) -> float:
    """Return 1 / sigma^2 of the samples, times the share of them that counts as independent."""
    residuals = best.residuals
    return effective_count(residuals) / sum(one.size for one in residuals) / best.sigma**2


def with_doubt(
    inside: Posterior, optima: Optima, best: Optima, contradicted: bool = False
) -> Posterior:
    """Return the posterior if the simulator may be wrong, which a problem need not say.

    ``contradicted``: so may the numbers that it assumes.
    """
    discrepancy = optima.regression.parameters.robot.discrepancy
    if discrepancy is None:
        return inside
    return replace(inside, modes=doubted(optima, best, discrepancy, contradicted))


def log_prior_constant(parameters: Parameters) -> float:
    """Return the constant of the log prior; it depends on the set of parameters."""
    return log_constant(
        parameters.prior_mean,
        parameters.prior_information,
        parameters.low,
        parameters.high,
        parameters.circular,
    )
