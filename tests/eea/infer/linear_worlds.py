"""A world whose posterior is known exactly: what is felt is linear in what is sought."""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

from eea.infer.mixture import Mixture, Mode

NAMES = ("length", "width", "thickness", "gain")
# What each parameter does to four things felt, in sd of their noise: length is told best, width and
# thickness trade off, of the gain next to nothing is told.
EFFECTS = np.array(
    [[60.0, 3.0, 0.0, 0.1], [2.0, 9.0, 8.0, 0.0], [0.0, 9.0, 6.5, 0.3], [1.0, 0.0, 2.0, 0.5]]
)


def mode(theta, information, cost, gradient=None):
    """Return a mode; without a gradient unless one is given."""
    theta = np.asarray(theta, dtype=float)
    slope = np.zeros(len(theta)) if gradient is None else gradient
    return Mode(theta, np.asarray(information, dtype=float), slope, cost)


def mixture(names, low, high, circular, modes):
    """Return a posterior; the bounds may be lists."""
    return Mixture(names, np.array(low), np.array(high), np.array(circular), modes)


def fit(effects, felt, low, high, circular=None, names=None):
    """Return the posterior of ``felt`` = ``effects`` theta + standard normal noise."""
    turning = np.zeros(len(low), dtype=bool) if circular is None else circular
    free = (np.where(turning, -50.0, low), np.where(turning, 50.0, high))
    theta = np.clip(lsq_linear(effects, felt, free, tol=1e-14).x, *free)
    misfit = effects @ theta - felt
    best = Mode(theta, effects.T @ effects, effects.T @ misfit, 0.5 * misfit @ misfit)
    return Mixture(names or tuple(f"p{k}" for k in range(len(low))), low, high, turning, [best])


def observe(truth, rng, effects=EFFECTS):
    """Return the posterior after one noisy look at a truth (P,) in the unit box."""
    felt = effects @ truth + rng.normal(size=len(effects))
    return fit(effects, felt, np.zeros(len(truth)), np.ones(len(truth)), names=NAMES)
