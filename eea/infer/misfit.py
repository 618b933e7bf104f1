"""The misfit of trials at vectors theta of all unknowns, and its derivatives.

Derivatives are forward differences. A trial's own angles affect no other trial, so a trial needs
a column for each of its slots, not for each parameter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.infer.laplace import Laplace
from eea.infer.trials import LARGEST_NUMBER, Observed
from eea.infer.unknowns import FIXED_SLOT, UNIFORM_PRECISION, Unknowns

LOOK_AHEAD = 0.1  # h above, as a share of the step
MOST_ROBOTS = 2**15  # in a batch, to limit memory
LEAST_RELATIVE_SIGMA = 3e-7  # share of the signal's rms; smaller residuals are rounding errors


class Precision(NamedTuple):
    """The precision of one stage of the search."""

    fine: bool  #: Double precision.
    stride: int  #: Every ``stride``-th sample is compared.
    difference: float  #: Step of the forward differences, as a share of a range or in rad.


COARSE = Precision(fine=False, stride=2, difference=2e-3)
FINE = Precision(fine=True, stride=1, difference=1e-6)


@dataclass(frozen=True, eq=False)
class Roughness:
    """The roughness of a simulator at a best fit, for each of the W slots of a trial."""

    looked: NDArray[np.bool_]  #: (W,), which slots were looked at.
    steps: Floats  #: (W,), the step that derivatives need; 0 where the usual one will do.
    widths: Floats  #: (W,), the width of a plateau, as a share of the range; 0 where there is none.
    jitter: float = 0.0  #: Standard deviation of a sample's roughness, over that of its noise.
    unrepeated: float = 0.0  #: That of two signals of the same values; 0 if they are the same.
    #: Slots that are told within a step of the usual derivatives, where the signal is not smooth.
    too_wide: frozenset[int] = frozenset()

    @property
    def smooth(self) -> bool:
        """Whether derivatives may be taken as of any smooth simulator."""
        return not (self.steps.any() or self.widths.any())

    def joined(self, other: Roughness) -> Roughness:
        """Return what two looks at different slots have found."""
        return Roughness(
            self.looked | other.looked,
            np.maximum(self.steps, other.steps),
            np.maximum(self.widths, other.widths),
            max(self.jitter, other.jitter),
            max(self.unrepeated, other.unrepeated),
            self.too_wide | other.too_wide,
        )


class Linear(NamedTuple):
    """The linearisation at S vectors."""

    gradient: Floats  #: Gradient of half the sum of squared residuals, (S, P).
    normal: Floats  #: Gauss and Newton's matrix J^T J, (S, P, P).
    residuals: Floats  #: (S, E, M).
    slopes: Floats  #: Derivatives of the residuals by the free slots, (S, E, F, M).


class Seen:
    """The best vector of a search so far, for an answer before its end."""

    theta: Floats | None = None  #: (P,)
    _squares: float = math.inf

    def note(self, theta: Floats, squares: Floats) -> None:
        """Remember the best of vectors (S, P) by their sums of squares (S,)."""
        best = int(squares.argmin())
        if squares[best] < self._squares:
            self._squares = float(squares[best])
            self.theta = theta[best].copy()


class Misfit:
    """The differences between simulated and observed trials, at one precision."""

    def __init__(
        self,
        parameters: Unknowns,
        observed: Observed,
        precision: Precision,
        only_of: int | None = None,
        roughness: Roughness | None = None,
        seen: Seen | None = None,
    ) -> None:
        self._seen = seen if only_of is None else None
        self.parameters = parameters
        self._roughness = None if roughness is None or roughness.smooth else roughness
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
        self._entries = entries[:, self.free]
        #: For each trial which of these (F,) are unknown, and the entries of theta that they are.
        self.columns = [(one != FIXED_SLOT, one[one != FIXED_SLOT]) for one in self._entries]

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
        nearest = self._nearest(simulated.reshape(*local.shape[:-1], -1), wanted)
        apart: NDArray[np.floating] = nearest - wanted
        return apart if self._whitening is None else self._whitening(apart, trials)

    def _nearest(
        self, simulated: NDArray[np.floating], wanted: NDArray[np.floating]
    ) -> NDArray[np.floating]:
        """Return signals (S, E, C, M) turned by whole turns, or with the other sign, to be near."""
        robot = self.parameters.robot
        turns = robot.turns
        if not (np.isfinite(turns).any() or robot.quaternions):
            return simulated
        shape = (*simulated.shape[:-1], len(turns), -1)
        signal = simulated.reshape(shape).copy()
        other = np.broadcast_to(wanted, simulated.shape).reshape(shape)
        for c in np.flatnonzero(np.isfinite(turns)):
            with np.errstate(invalid="ignore"):
                signal[..., c, :] -= turns[c] * np.round(
                    (signal[..., c, :] - other[..., c, :]) / turns[c]
                )
        for four in robot.quaternions:
            way = (signal[..., four, :] * other[..., four, :]).sum(axis=-2, keepdims=True)
            signal[..., four, :] *= np.where(way < 0.0, -1.0, 1.0)
        return signal.reshape(simulated.shape)

    def residuals(self, theta: Floats) -> NDArray[np.floating]:
        """Return simulated minus observed (S, E, M) for vectors (S, P)."""
        local = self.parameters.local(theta)[:, self._trials]
        return self.differences(local[:, :, None], self._trials)[:, :, 0]

    def squares(self, theta: Floats) -> Floats:
        """Return the sum of squared residuals (S,), infinite where a robot diverged."""
        residuals = self.residuals(theta)
        sums = np.einsum("sem,sem->s", residuals, residuals).astype(np.float64)
        sums = np.where(np.isfinite(sums), sums, np.inf)
        if self._seen is not None and len(sums):
            self._seen.note(theta, sums * self.precision.stride)
        return sums

    def linearise(self, theta: Floats) -> Linear:
        """Return the misfit near vectors (S, P), by forward differences.

        They are backward where only the robot ahead diverged. The derivatives of a robot that
        diverged itself are zero.
        """
        if self._roughness is not None:
            return self._linearise_rough(theta, self._roughness)
        parameters = self.parameters
        free = self.free
        local = parameters.local(theta)[:, self._trials]
        high = np.where(self._entries == FIXED_SLOT, np.inf, parameters.high[self._entries])
        step = np.where(local[:, :, free] + self.precision.difference > high, -1.0, 1.0)
        step *= self.precision.difference
        room = local[:, :, free] - self.precision.difference >= parameters.low[self._entries]
        while True:
            moved = np.repeat(local[:, :, None], len(free) + 1, axis=2)
            moved[:, :, np.arange(1, len(free) + 1), free] += step
            rows = self.differences(moved, self._trials)
            with np.errstate(invalid="ignore", over="ignore"):
                lost = ~np.isfinite(rows.sum(axis=-1))
            back = lost[:, :, 1:] & ~lost[:, :, :1] & (step > 0.0) & room
            if not back.any():
                break
            step[back] *= -1.0
        with np.errstate(invalid="ignore", over="ignore"):
            slopes = np.subtract(rows[:, :, 1:], rows[:, :, :1], dtype=np.float64)
            slopes /= step[..., None]
        if lost.any():
            slopes[lost[:, :, 1:] | lost[:, :, :1]] = 0.0
        return self._linear(rows[:, :, 0], slopes)

    def _linearise_rough(self, theta: Floats, roughness: Roughness) -> Linear:
        """Return the misfit near vectors (S, P), by central differences of each slot's own step.

        They are one-sided at a bound, and where a robot diverged.
        """
        free = self.free
        local = self.parameters.local(theta)[:, self._trials]
        known = self._entries != FIXED_SLOT
        high = np.where(known, self.parameters.high[self._entries], np.inf)
        low = np.where(known, self.parameters.low[self._entries], -np.inf)
        steps = np.where(roughness.steps > 0.0, roughness.steps, self.precision.difference)[free]
        ends = np.stack(
            [
                np.clip(local[:, :, free] + steps, low, high),
                np.clip(local[:, :, free] - steps, low, high),
            ],
            axis=2,
        )  # (S, E, 2, F)
        each = np.arange(len(free))
        moved = np.repeat(local[:, :, None], 2 * len(free) + 1, axis=2)
        moved[:, :, 1 + each, free] = ends[:, :, 0]
        moved[:, :, 1 + len(free) + each, free] = ends[:, :, 1]
        rows = self.differences(moved, self._trials)
        with np.errstate(invalid="ignore", over="ignore"):
            found = np.isfinite(rows.sum(axis=-1))
        ahead, behind = np.split(rows[:, :, 1:], 2, axis=2)
        there = found[:, :, 1:].reshape(*found.shape[:2], 2, -1)
        here = rows[:, :, :1]
        at = np.where(there, ends, local[:, :, None, free])
        ahead = np.where(there[:, :, 0, :, None], ahead, here)
        behind = np.where(there[:, :, 1, :, None], behind, here)
        apart = at[:, :, 0] - at[:, :, 1]
        with np.errstate(invalid="ignore", over="ignore"):
            slopes = np.subtract(ahead, behind, dtype=np.float64)
            slopes /= np.where(apart > 0.0, apart, np.inf)[..., None]
        slopes[~found[:, :, 0]] = 0.0
        return self._linear(rows[:, :, 0], slopes)

    def _linear(self, residuals: NDArray[np.floating], slopes: Floats) -> Linear:
        """Return what residuals (S, E, M) and slopes (S, E, F, M) are together."""
        parameters = self.parameters
        left = residuals.astype(np.float64)
        blocks = slopes @ slopes.swapaxes(-1, -2)  # (S, E, F, F)
        normal = np.zeros((len(slopes), len(parameters), len(parameters)))
        for e, (used, at) in enumerate(self.columns):
            normal[:, at[:, None], at] += blocks[:, e][:, used][:, :, used]
        return Linear(self._pull(slopes, left), normal, left, slopes)

    def laplace(self, theta: Floats, linear: Linear, weight: float) -> Laplace:
        """Return the posterior near vectors (S, P), of residuals of the precision ``weight``."""
        prior = self.parameters.prior_information
        away = theta - self.parameters.prior_mean
        gradient = weight * linear.gradient + away @ prior
        if self._roughness is not None:
            prior = prior + np.diag(self.plateau_precision)
        return Laplace(theta, weight * linear.normal + prior, gradient)

    @cached_property
    def plateau_precision(self) -> Floats:
        """The precision (P,) that plateaus give the numbers on them, elsewhere 0.

        The signal does not change on one, and by more than the noise allows at its ends: a uniform
        distribution between them.
        """
        found = np.zeros(len(self.parameters))
        if self._roughness is not None:
            for slot in np.flatnonzero(self._roughness.widths):
                entries = self.parameters.slots[:, slot]
                width = self._roughness.widths[slot]
                found[entries[entries != FIXED_SLOT]] = UNIFORM_PRECISION / width**2
        return found

    def _pull(self, slopes: Floats, signal: Floats) -> Floats:
        """Return J^T times signals (..., S, E, M), as (..., S, P), from slopes (S, E, F, M)."""
        finite = np.where(np.isfinite(signal), signal, 0.0)
        pulls = np.einsum("sefm,...sem->...sef", slopes, finite)
        pulled = np.zeros((*pulls.shape[:-2], len(self.parameters)))
        for e, (used, at) in enumerate(self.columns):
            pulled[..., at] += pulls[..., e, used]
        return pulled

    def curvature(self, theta: Floats, linear: Linear, step: Floats) -> Floats:
        """Return J^T r'' (D, S, P) for D steps (D, S, P) from each of the vectors (S, P)."""
        taken = np.where(self._entries == FIXED_SLOT, 0.0, step[..., self._entries])
        straight = np.einsum("sefm,dsef->dsem", linear.slopes, taken)
        ahead = np.clip(theta + LOOK_AHEAD * step, self.parameters.low, self.parameters.high)
        with np.errstate(invalid="ignore", over="ignore"):
            reached = self.residuals(ahead.reshape(-1, ahead.shape[-1]))
            risen = reached.reshape(straight.shape) - linear.residuals
            bent = 2.0 * (risen / LOOK_AHEAD - straight) / LOOK_AHEAD
        return self._pull(linear.slopes, bent)


@dataclass(frozen=True, eq=False)
class Regression:
    """The regression of trials on their unknowns."""

    parameters: Unknowns
    observed: Observed
    noise: float | None  #: Its standard deviation if it is known, in the signal's unit.
    usual: Floats | None = None  #: The misfits of known-good logs, by which this one is judged.
    roughness: Roughness | None = None  #: That of the simulator; None before it is looked at.
    samples: int = 0  #: The number of samples behind ``noise``; 0 where it is known.
    seen: Seen = field(default_factory=Seen)

    def misfit(self, precision: Precision, only_of: int | None = None) -> Misfit:
        """Return the misfit at a precision."""
        precision = precision._replace(stride=self.stride(precision))
        roughness = self.roughness if precision.fine else None
        return Misfit(self.parameters, self.observed, precision, only_of, roughness, self.seen)

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

    @cached_property
    def loudness(self) -> float:
        """The norm of the signal about each channel's mean, as the residuals are weighed."""
        observed = self.observed
        apart = observed.weighted - observed.weighted.mean(axis=1, keepdims=True)
        if observed.noise is not None:
            apart = apart / observed.noise.sd
        return max(float(np.linalg.norm(apart)), 1.0 / LARGEST_NUMBER)

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
