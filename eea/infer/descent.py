"""Bounded Levenberg-Marquardt least squares from many starting points, one batch an iteration.

The cost of a vector theta is -log posterior up to a constant, for white noise of standard deviation
sigma::

    cost = sum over trials, samples and axes of r^2 / (2 sigma^2) + prior cost

With little information valleys are long, narrow and curved. In double precision a step v therefore
follows the valley by half its geodesic acceleration a, which costs one more robot a trial (M. K.
Transtrum and J. P. Sethna, "Improvements to the Levenberg-Marquardt algorithm for nonlinear
least-squares minimization", 2012)::

    A v = -gradient,    A a = -J^T r'',    r'' = 2 ((r(theta + h v) - r) / h - J v) / h
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.infer.laplace import Laplace
from eea.infer.misfit import Linear, Misfit

LEAST_DIAGONAL_SHARE = 1e-6  # least entry of Marquardt's diagonal, divided by the greatest
DAMPING_FACTORS = (0.1, 1.0, 10.0)  # all are tried in one batch
FAILURE_DAMPING_FACTOR = 30.0
FIRST_DAMPING = 1e-2
LEAST_DAMPING = 1e-12
MOST_DAMPING = 1e10
LARGEST_SHARE = 0.3  # of a range, in one step
LARGEST_TURN = 0.7  # rad, in one step
MOST_BEND = 0.75  # of 2 |a| / |v|; above it the acceleration is ignored
SMALL_DECREASES = 2  # this number in a row ends a descent


class Fitted(NamedTuple):
    """The ends of S descents."""

    theta: Floats  #: (S, P)
    squares: Floats  #: Sum of squared residuals, (S,).
    cost: Floats  #: -log posterior (S,), up to a constant.

    def of(self, rows: Sequence[int] | NDArray[Any]) -> Fitted:
        """Return some of the descents."""
        return Fitted(*(part[rows] for part in self))


def descend(
    misfit: Misfit, theta: Floats, sigma: float, iterations: int, tolerance: float
) -> Fitted:
    """Descend from vectors (S, P), each until it gains less than ``tolerance`` of its cost.

    ``sigma``, the standard deviation of the noise, weighs the signal against the prior.
    """
    parameters = misfit.parameters
    per_square = 0.5 / sigma**2
    theta = parameters.into_bounds(theta)
    squares = misfit.squares(theta)
    with np.errstate(invalid="ignore"):  # sigma is infinite where no simulation stays finite
        cost = per_square * squares + parameters.prior_cost(theta)
    damping = np.full(len(theta), FIRST_DAMPING)
    small = np.zeros(len(theta), dtype=np.intp)
    live = np.flatnonzero(np.isfinite(cost) & (cost > 0.0))
    for _ in range(iterations):
        if not len(live):
            break
        here = theta[live]
        linear = misfit.linearise(here)
        near = misfit.laplace(here, linear, 2.0 * per_square)
        tried = np.multiply.outer(DAMPING_FACTORS, damping[live])
        trial = _stepped(misfit, near, linear, tried, sigma)  # (3, L, P)
        flat = trial.reshape(-1, len(parameters))
        sums = misfit.squares(flat)
        costs = (per_square * sums + parameters.prior_cost(flat)).reshape(trial.shape[:2])
        best = costs.argmin(axis=0)
        pick = np.arange(len(live))
        new = costs[best, pick]
        better = new < cost[live]
        gain = np.where(better, 1.0 - new / cost[live], 0.0)
        moved = live[better]
        theta[moved] = trial[best, pick][better]
        squares[moved] = sums.reshape(trial.shape[:2])[best, pick][better]
        cost[moved] = new[better]
        factor = np.where(better, np.array(DAMPING_FACTORS)[best], FAILURE_DAMPING_FACTOR)
        damping[live] = np.maximum(damping[live] * factor, LEAST_DAMPING)
        small[live] = np.where(better & (gain >= tolerance), 0, small[live] + 1)
        # Failures with too little damping are no sign of convergence.
        small[live] = np.where(better | (damping[live] > 1.0), small[live], small[live] - 1)
        going = (
            (small[live] < SMALL_DECREASES) & (damping[live] < MOST_DAMPING) & (cost[live] > 0.0)
        )
        live = live[going]
    return Fitted(parameters.into_bounds(theta), squares, cost)


def _stepped(
    misfit: Misfit,
    near: Laplace,
    linear: Linear,
    damping: Floats,
    sigma: float,
) -> Floats:
    """Return where a step of each damping (D, L) ends (D, L, P), within the bounds."""
    parameters = misfit.parameters
    theta = near.theta
    gradient = near.gradient
    normal = near.information
    diagonal = np.einsum("lpp->lp", normal)
    scale = np.maximum(diagonal, LEAST_DIAGONAL_SHARE * diagonal.max(axis=1, keepdims=True))
    scale = np.maximum(scale, np.finfo(float).tiny)
    # Parameters at a bound do not move out of the box.
    held = (theta <= parameters.low) & (gradient > 0) | (theta >= parameters.high) & (gradient < 0)
    held |= ~misfit.movable
    free = ~held
    undamped = np.where(free[:, :, None] & free[:, None, :], normal, 0.0)
    matrix = np.repeat(undamped[None], len(damping), axis=0)
    index = np.arange(len(parameters))
    matrix[..., index, index] = np.where(held, 1.0, diagonal + damping[..., None] * scale)

    def solved(slope: Floats) -> Floats:
        step: Floats = -np.linalg.solve(matrix, np.where(held, 0.0, slope)[..., None])[..., 0]
        return step

    most = np.where(parameters.circular, LARGEST_TURN, LARGEST_SHARE)
    step = np.clip(solved(gradient), -most, most)
    step = np.clip(theta + step, parameters.low, parameters.high) - theta
    if misfit.precision.fine:
        bend = 0.5 * solved(misfit.curvature(theta, linear, step) / sigma**2)
        length, bent = (np.sqrt((scale * way * way).sum(axis=-1)) for way in (step, bend))
        step += np.where((4.0 * bent <= MOST_BEND * length)[..., None], bend, 0.0)
    return np.clip(theta + step, parameters.low, parameters.high)
