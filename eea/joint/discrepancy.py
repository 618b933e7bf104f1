"""Model discrepancy: the errors of a simulator as a term of the likelihood.

A simulator differs from the robot by more than noise. The difference is not white: it scales with
the signal, lasts for many samples, and part of it has a known shape, such as the error of the time
step. The signal y of a trial, simulated as f, therefore has the covariance C about f (M. C. Kennedy
and A. O'Hagan, "Bayesian calibration of computer models", 2001)::

    C = sigma^2 I + share^2 s^2 R + D D^T

with s the rms of f, R the correlation exp(-|t - t'| / duration) within an axis, and in the columns
of D the known shapes, each as large as one standard deviation. All trials share these shapes.

The numbers that a simulator assumes are further columns of D where the trials contradict them
(:mod:`eea.joint.assumptions`).

The search minimises the white misfit, which is exact inside the model. Here the normal equations
are solved again at its optima with C instead of sigma^2 I, to first order: one step moves each
optimum and widens its covariance.
"""

from __future__ import annotations

import numpy as np

from eea.core.angles import Floats
from eea.joint.least_squares import FINE
from eea.joint.problem import DifferenceShapes, Discrepancy
from eea.joint.search import Optima
from eea.statistics.information import scaled
from eea.statistics.posterior import Mode


def doubted(
    optima: Optima, best: Optima, discrepancy: Discrepancy, contradicted: bool = False
) -> list[Mode]:
    """Return the modes at the optima under the likelihood with model discrepancy.

    ``best`` is the best fit of all hypotheses. ``contradicted``: the numbers that the simulator
    assumes are unknown, too.
    """
    regression = optima.regression
    misfit = regression.misfit(FINE)
    linear = misfit.linearise(optima.fits.theta)
    parameters = regression.parameters
    observed = regression.observed
    axes = observed.signal.shape[2]
    bases = [observed.slow_basis(e, discrepancy.duration) for e in range(len(observed))]
    weight: list[Floats] = []  # for each trial (T,), the weights of its coefficients
    for basis, one in zip(bases, observed.simulated(best.residuals), strict=True):
        rms = np.sqrt((one**2).mean())
        weight.append((best.sigma**2 + (discrepancy.share * rms) ** 2 * basis.variances) ** -0.5)

    def whitened(signals: Floats, trial: int) -> Floats:
        """Return signals (n, axes T) of a trial as independent numbers of variance 1."""
        waves: Floats = bases[trial].transform(signals, axes) * weight[trial]
        return waves.reshape(len(signals), -1)

    shapes = differences(optima, discrepancy.shapes, optima.fits.theta)
    if contradicted:
        assumed = differences(optima, discrepancy.assumed_shapes, optima.fits.theta)
        shapes = np.concatenate([shapes, assumed], axis=2)
    size = len(parameters)
    count = shapes.shape[2]
    level = best.sigma / float(np.sqrt((observed.weighted**2).sum()))
    # The factors were measured on good fits, of robots that are as assumed.
    ordinary = best.goodness.good and not contradicted
    calibration = discrepancy.calibration if ordinary else None
    modes = []
    for k, theta in enumerate(optima.fits.theta):
        normal = np.zeros((size + count, size + count))
        gradient = np.zeros(size + count)
        normal[:size, :size] = parameters.prior_information
        normal[size:, size:] = np.eye(count)
        away = theta - parameters.prior_mean
        gradient[:size] = parameters.prior_information @ away
        squares = 0.0
        for e, (used, entries) in enumerate(misfit.columns):
            columns = np.concatenate([linear.slopes[k, e, used], shapes[k, e]])
            at = np.concatenate([entries, size + np.arange(count)])
            columns = whitened(columns, e)
            residuals = whitened(linear.residuals[k, e][None], e)[0]
            normal[at[:, None], at] += columns @ columns.T
            gradient[at] += columns @ residuals
            squares += float(residuals @ residuals)
        # The shapes' amplitudes are integrated out.
        inner = normal[size:, size:]
        cross = normal[:size, size:]
        information = normal[:size, :size] - cross @ np.linalg.solve(inner, cross.T)
        slope = gradient[:size] - cross @ np.linalg.solve(inner, gradient[size:])
        cost = 0.5 * squares + float(parameters.prior_cost(theta))
        cost -= 0.5 * float(gradient[size:] @ np.linalg.solve(inner, gradient[size:]))
        cost += 0.5 * float(np.linalg.slogdet(inner)[1])
        if calibration is not None:
            factors = np.ones(size)
            factors[: parameters.body] = calibration.factors(level)
            information, slope = scaled(information, slope, factors)
        modes.append(Mode(theta, information, cost, slope))
    return modes


def differences(optima: Optima, shapes: DifferenceShapes | None, theta: Floats) -> Floats:
    """Return weighted differences of known shape (S, E, K, axes T) at vectors (S, P)."""
    regression = optima.regression
    parameters = regression.parameters
    observed = regression.observed
    local = parameters.local(theta)  # (S, E, W)
    if shapes is None:
        return np.empty((*local.shape[:2], 0, observed.signal[0].size))
    values = parameters.values(local.reshape(-1, local.shape[-1]))
    inputs = np.concatenate([observed.inputs] * len(local))
    found = shapes(values, inputs).swapaxes(2, 3)
    found = np.where(np.isfinite(found), found, 0.0)
    if observed.weight is not None:
        weights = np.concatenate([observed.weight] * len(local))
        found = found * weights.swapaxes(1, 2)[:, None]
    return found.reshape(*local.shape[:2], found.shape[1], -1)
