"""The posterior at the optima of a hypothesis, and what its evidence needs besides."""

from __future__ import annotations

import numpy as np

from eea.core.angles import Floats
from eea.infer.goodness import effective_count
from eea.infer.misfit import FINE
from eea.infer.mixture import Mixture, Mode, log_constant
from eea.infer.search import Optima
from eea.infer.unknowns import Unknowns

LEAST_EIGENVALUE_SHARE = 1e-12  # of the largest; directions below have no information


def scaled_inverse(information: Floats) -> tuple[Floats, Floats]:
    """Return the pseudo-inverse (P, P) of the information scaled to a unit diagonal, and the scale.

    The covariance is the pseudo-inverse over the product of two scales (P,). Without the scale a
    well known number would hide the information on others.
    """
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    unit = information / np.outer(scale, scale)
    return np.linalg.pinv(unit, rcond=LEAST_EIGENVALUE_SHARE, hermitian=True), scale


def scaled(information: Floats, gradient: Floats, factors: Floats) -> tuple[Floats, Floats]:
    """Return information and gradient of the same centre, with sds times ``factors`` (P,)."""
    information = 0.5 * (information + information.T)
    inverse, scale = scaled_inverse(information)
    step = inverse @ (gradient / scale) / scale
    narrowed: Floats = information / np.outer(factors, factors)
    return narrowed, narrowed @ step


def mixture(optima: Optima, best: Optima) -> Mixture:
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


def log_prior_constant(parameters: Unknowns) -> float:
    """Return the constant of the log prior; it depends on the set of parameters."""
    return log_constant(
        parameters.prior_mean,
        parameters.prior_information,
        parameters.low,
        parameters.high,
        parameters.circular,
    )
