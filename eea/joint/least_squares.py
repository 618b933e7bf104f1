"""Bounded Levenberg-Marquardt least squares from many starting points, one batch an iteration.

The cost of a vector theta is -log posterior up to a constant, for white noise of standard deviation
sigma::

    cost = sum over trials, samples and axes of r^2 / (2 sigma^2) + prior cost

Derivatives are forward differences. A trial's own angles affect no other trial, so a trial needs
a column for each of its slots, not for each parameter.

With little information valleys are long, narrow and curved. In double precision a step v therefore
follows the valley by half its geodesic acceleration a, which costs one more robot a trial (M. K.
Transtrum and J. P. Sethna, "Improvements to the Levenberg-Marquardt algorithm for nonlinear
least-squares minimization", 2012)::

    A v = -gradient,    A a = -J^T r'',    r'' = 2 ((r(theta + h v) - r) / h - J v) / h
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.joint.observed import Observed
from eea.joint.parameters import FIXED_SLOT, Parameters

LEAST_DIAGONAL_SHARE = 1e-6  # least entry of Marquardt's diagonal, divided by the greatest
DAMPING_FACTORS = (0.1, 1.0, 10.0)  # all are tried in one batch
FAILURE_DAMPING_FACTOR = 30.0
FIRST_DAMPING = 1e-2
LEAST_DAMPING = 1e-12
MOST_DAMPING = 1e10
LARGEST_SHARE = 0.3  # of a range, in one step
LARGEST_TURN = 0.7  # rad, in one step
LOOK_AHEAD = 0.1  # h above, as a share of the step
MOST_BEND = 0.75  # of 2 |a| / |v|; above it the acceleration is ignored
SMALL_DECREASES = 2  # this number in a row ends a descent
MOST_ROBOTS = 2**15  # in a batch, to limit memory
LEAST_RELATIVE_SIGMA = 3e-7  # share of the signal's rms; smaller residuals are rounding errors


class Precision(NamedTuple):
    """The precision of one stage of the search."""

    fine: bool  #: Double precision.
    stride: int  #: Every ``stride``-th sample is compared.
    difference: float  #: Step of the forward differences, as a share of a range or in rad.


COARSE = Precision(fine=False, stride=2, difference=2e-3)
FINE = Precision(fine=True, stride=1, difference=1e-6)


class Fitted(NamedTuple):
    """The ends of S descents."""

    theta: Floats  #: (S, P)
    squares: Floats  #: Sum of squared residuals, (S,).
    cost: Floats  #: -log posterior (S,), up to a constant.

    def of(self, rows: Sequence[int] | NDArray[Any]) -> Fitted:
        """Return some of the descents."""
        return Fitted(*(part[rows] for part in self))


class Linear(NamedTuple):
    """The linearisation at S vectors."""

    gradient: Floats  #: Gradient of half the sum of squared residuals, (S, P).
    normal: Floats  #: Gauss and Newton's matrix J^T J, (S, P, P).
    residuals: Floats  #: (S, E, M).
    slopes: Floats  #: Derivatives of the residuals by the free slots, (S, E, F, M).


class Misfit:
    """The differences between simulated and observed trials, at one precision."""

    def __init__(
        self,
        parameters: Parameters,
        observed: Observed,
        precision: Precision,
        only_of: int | None = None,
    ) -> None:
        self.parameters = parameters
        self.precision = precision
        self._observed = observed
        sampled = observed.signal[:, :: precision.stride]
        # (E, M): one axis after the other, as simulators lay it out.
        self._wanted = sampled.swapaxes(1, 2).reshape(len(observed), -1)
        self._whitening = observed.whitening(precision.stride)
        self._trials = np.arange(len(observed))
        #: Which entries (P,) a descent may change.
        self.movable: NDArray[np.bool_] = np.ones(len(parameters), dtype=np.bool_)
        if only_of is not None:
            self._trials = self._trials[only_of : only_of + 1]
            self.movable = np.isin(np.arange(len(parameters)), parameters.own_entries(only_of))
        entries = parameters.slots[self._trials]
        #: The slots (F,) that a descent may change.
        self.free: NDArray[np.intp] = np.flatnonzero(
            ((entries != FIXED_SLOT) & self.movable[entries]).any(axis=0)
        )

    @property
    def count(self) -> int:
        """Number of compared samples in all trials and axes."""
        return self._observed.sampled(self._trials.tolist(), self.precision.stride)

    def differences(self, local: Floats, trials: NDArray[np.intp]) -> NDArray[np.floating]:
        """Return simulated minus observed (S, E, C, M) for slots (S, E, C, W) of ``trials``.

        Where samples differ in noise, the differences are those of independent ones of variance 1.
        """
        robots = local.reshape(-1, local.shape[-1])
        which = np.broadcast_to(trials[:, None], local.shape[:-1]).reshape(-1)
        parts = []
        for first in range(0, len(robots), MOST_ROBOTS):
            rows = slice(first, first + MOST_ROBOTS)
            values = self.parameters.values(robots[rows])
            signal = self._observed.simulate(
                self.parameters.robot, values, which[rows], self.precision.fine
            )
            kept = signal[:, :: self.precision.stride].swapaxes(1, 2)
            parts.append(kept.reshape(len(kept), -1))
        simulated = parts[0] if len(parts) == 1 else np.concatenate(parts)
        wanted = self._wanted[trials, None].astype(np.result_type(simulated, np.float32))
        apart: NDArray[np.floating] = simulated.reshape(*local.shape[:-1], -1) - wanted
        return apart if self._whitening is None else self._whitening(apart, trials)

    def residuals(self, theta: Floats) -> NDArray[np.floating]:
        """Return simulated minus observed (S, E, M) for vectors (S, P)."""
        local = self.parameters.local(theta)[:, self._trials]
        return self.differences(local[:, :, None], self._trials)[:, :, 0]

    def squares(self, theta: Floats) -> Floats:
        """Return the sum of squared residuals (S,), infinite where a robot diverged."""
        residuals = self.residuals(theta)
        sums = np.einsum("sem,sem->s", residuals, residuals).astype(np.float64)
        return np.where(np.isfinite(sums), sums, np.inf)

    def linearise(self, theta: Floats) -> Linear:
        """Return the misfit near vectors (S, P), by forward differences.

        The derivatives of a robot that diverged are zero.
        """
        parameters = self.parameters
        free = self.free
        local = parameters.local(theta)[:, self._trials]
        entries = parameters.slots[self._trials][:, free]  # (E, F)
        high = np.where(entries == FIXED_SLOT, np.inf, parameters.high[entries])
        step = np.where(local[:, :, free] + self.precision.difference > high, -1.0, 1.0)
        step *= self.precision.difference
        moved = np.repeat(local[:, :, None], len(free) + 1, axis=2)
        moved[:, :, np.arange(1, len(free) + 1), free] += step
        rows = self.differences(moved, self._trials)
        with np.errstate(invalid="ignore", over="ignore"):
            lost = ~np.isfinite(rows.sum(axis=-1))
            slopes = np.subtract(rows[:, :, 1:], rows[:, :, :1], dtype=np.float64)
            slopes /= step[..., None]
        if lost.any():
            slopes[lost[:, :, 1:] | lost[:, :, :1]] = 0.0
        residuals = rows[:, :, 0].astype(np.float64)
        blocks = slopes @ slopes.swapaxes(-1, -2)  # (S, E, F, F)
        normal = np.zeros((len(theta), len(parameters), len(parameters)))
        for e, one in enumerate(entries):
            used = one != FIXED_SLOT
            at = one[used]
            normal[:, at[:, None], at] += blocks[:, e][:, used][:, :, used]
        return Linear(self._pull(slopes, residuals), normal, residuals, slopes)

    def _pull(self, slopes: Floats, signal: Floats) -> Floats:
        """Return J^T times a signal (S, E, M), as (S, P), from slopes (S, E, F, M)."""
        finite = np.where(np.isfinite(signal), signal, 0.0)
        pulls = np.einsum("sefm,sem->sef", slopes, finite)
        pulled = np.zeros((len(slopes), len(self.parameters)))
        for e, entries in enumerate(self.parameters.slots[self._trials][:, self.free]):
            used = entries != FIXED_SLOT
            pulled[:, entries[used]] += pulls[:, e, used]
        return pulled

    def curvature(self, theta: Floats, linear: Linear, step: Floats) -> Floats:
        """Return J^T r'' (S, P) for steps (S, P) from vectors (S, P)."""
        entries = self.parameters.slots[self._trials][:, self.free]
        taken = np.where(entries == FIXED_SLOT, 0.0, step[:, entries])  # (S, E, F)
        straight = np.einsum("sefm,sef->sem", linear.slopes, taken)
        ahead = np.clip(theta + LOOK_AHEAD * step, self.parameters.low, self.parameters.high)
        with np.errstate(invalid="ignore", over="ignore"):
            risen = self.residuals(ahead) - linear.residuals
            bent = 2.0 * (risen / LOOK_AHEAD - straight) / LOOK_AHEAD
        return self._pull(linear.slopes, bent)


@dataclass(frozen=True, eq=False)
class Regression:
    """The regression of trials on their unknowns."""

    parameters: Parameters
    observed: Observed
    noise: float | None  #: Its standard deviation if it is known, in the signal's unit.
    usual: Floats | None = None  #: The misfits of known-good logs, by which this one is judged.

    def misfit(self, precision: Precision, only_of: int | None = None) -> Misfit:
        """Return the misfit at a precision."""
        precision = precision._replace(stride=self.stride(precision))
        return Misfit(self.parameters, self.observed, precision, only_of)

    def stride(self, precision: Precision) -> int:
        """Return every how many samples are compared: all, where they are far apart."""
        return min(precision.stride, self.parameters.robot.stride)

    @cached_property
    def rms(self) -> float:
        """The root mean square of the signal, in its unit."""
        signal = self.observed.weighted
        if self.observed.noise is not None:
            signal = signal / self.observed.noise.sd
        return max(float(np.sqrt((signal**2).sum() / self.observed.size)), 1e-12)

    @property
    def least_sigma(self) -> float:
        """The standard deviation of rounding, in the signal's unit."""
        return LEAST_RELATIVE_SIGMA * self.rms

    def sigma(self, squares: float, count: int) -> float:
        """Return the noise's standard deviation, from the sum of squares of ``count`` residuals."""
        freedom = max(count - self.parameters.unknowns, 1)
        return self.noise or max(float(np.sqrt(squares / freedom)), self.least_sigma)

    def sigma_near(self, misfit: Misfit, theta: Floats) -> float:
        """Return the noise's standard deviation: as given, or from the best vector's residuals."""
        return self.noise or self.sigma(misfit.squares(theta).min(), misfit.count)


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
    cost = per_square * squares + parameters.prior_cost(theta)
    damping = np.full(len(theta), FIRST_DAMPING)
    small = np.zeros(len(theta), dtype=np.intp)
    live = np.flatnonzero(np.isfinite(cost) & (cost > 0.0))
    for _ in range(iterations):
        if not len(live):
            break
        here = theta[live]
        linear = misfit.linearise(here)
        away = here - parameters.prior_mean
        gradient = 2 * per_square * linear.gradient + away @ parameters.prior_information
        normal = 2 * per_square * linear.normal + parameters.prior_information
        trial = np.stack(
            [
                _stepped(misfit, here, linear, gradient, normal, factor * damping[live], sigma)
                for factor in DAMPING_FACTORS
            ]
        )  # (3, L, P)
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
    theta: Floats,
    linear: Linear,
    gradient: Floats,
    normal: Floats,
    damping: Floats,
    sigma: float,
) -> Floats:
    """Return one damped step from each vector (L, P), within the bounds."""
    parameters = misfit.parameters
    diagonal = np.einsum("lpp->lp", normal)
    scale = np.maximum(diagonal, LEAST_DIAGONAL_SHARE * diagonal.max(axis=1, keepdims=True))
    scale = np.maximum(scale, np.finfo(float).tiny)
    # Parameters at a bound do not move out of the box.
    held = (theta <= parameters.low) & (gradient > 0) | (theta >= parameters.high) & (gradient < 0)
    held |= ~misfit.movable
    free = ~held
    matrix = np.where(free[:, :, None] & free[:, None, :], normal, 0.0)
    index = np.arange(len(parameters))
    matrix[:, index, index] = np.where(held, 1.0, diagonal + damping[:, None] * scale)

    def solved(slope: Floats) -> Floats:
        step: Floats = -np.linalg.solve(matrix, np.where(held, 0.0, slope)[..., None])[..., 0]
        return step

    most = np.where(parameters.circular, LARGEST_TURN, LARGEST_SHARE)
    step = np.clip(solved(gradient), -most, most)
    step = np.clip(theta + step, parameters.low, parameters.high) - theta
    if misfit.precision.fine:
        bend = 0.5 * solved(misfit.curvature(theta, linear, step) / sigma**2)
        length, bent = (np.sqrt((scale * way * way).sum(axis=1)) for way in (step, bend))
        step += np.where((4.0 * bent <= MOST_BEND * length)[:, None], bend, 0.0)
    return np.clip(theta + step, parameters.low, parameters.high)
