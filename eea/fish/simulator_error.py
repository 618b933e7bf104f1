"""Model discrepancy: the errors of a simulator as a term of the likelihood.

A simulator differs from the robot by more than noise. The difference is not white: it scales with
the signal, lasts for many samples, and part of it has a known shape, such as the error of the time
step. The signal y of a trial, simulated as f, therefore has the covariance C about f (M. C. Kennedy
and A. O'Hagan, "Bayesian calibration of computer models", 2001)::

    C = sigma^2 I + share^2 s^2 R + D D^T

with s the rms of f, R the correlation exp(-|t - t'| / duration) within an axis, and in the columns
of D the known shapes, each as large as one standard deviation. All trials share these shapes.

The search minimises the white misfit, which is exact inside the model. Here the normal equations
are solved again at its optima with C instead of sigma^2 I, to first order: one step moves each
optimum and widens its covariance.

**Slow errors** (:func:`slow_errors`) tell whether a simulator errs: its errors last for many
samples, so they show at low frequencies, where noise is no stronger than elsewhere. Residuals of
the least squares of J have the covariance sigma^2 (I - H), with H = J (J^T J + sigma^2
Lambda)^-1 J^T and Lambda the prior's precision: a fit takes degrees of freedom, and most of them
from low frequencies.

**Assumed numbers** (:func:`contradiction`), which no fit seeks: whether the trials contradict them.
Each is a direction in which the signal changes, to first order. With r the residuals of the best
fit, J their derivatives by the unknowns and S those by the assumed numbers, in standard deviations
of their priors, the numbers' own information and slope are those left when the unknowns follow::

    M = S^T S / sigma^2 - S^T J A^-1 J^T S / sigma^4,      A = J^T J / sigma^2 + prior precision
    b = S^T r / sigma^2

and b^T M^-1 b is chi-square if the assumptions hold (C. R. Rao's score test). Where it is too large
for that, the numbers become nuisances of the intervals, as further columns of D (:func:`doubted`).
Otherwise they stay as assumed, since as nuisances they would widen every interval of what they
trade off with, and the log tells nothing against them. Whether it could have told is said in words.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, gammaincc

from aquafish_gym.physics.hydrodynamics import NORMAL_DRAG, SKIN_FRICTION
from aquafish_gym.plans import BodyPlan
from eea.core.angles import Floats
from eea.core.checks import (
    ConfigurationError,
    all_of,
    brief,
    callback,
    finite,
    instance,
    real,
    text,
)
from eea.infer.design import UNTOLD_SHARE
from eea.infer.laplace import Laplace, pseudo_inverse
from eea.infer.misfit import FINE, Regression
from eea.infer.mixture import Mode
from eea.infer.optima import Optima
from eea.infer.statement import Values
from eea.infer.unknowns import Unknowns

ACTIVE_BOUND_DISTANCE = 1e-9  # share of a range
CONTRADICTED_P = 0.05  # the chance of as large a contradiction where the assumptions hold
LEAST_INFORMATION = 1e-6  # in 1 / prior variance: a direction of less is not tested
MATERIAL_CHANGE = 0.1  # of each, to find the difference that it makes


@dataclass(frozen=True)
class Calibration:
    """Factors of split-conformal prediction on the half widths of intervals.

    With them, 90% intervals hold 90% of each parameter in the robots that they were made with.

    Examples
    --------
    >>> calibration = Calibration((0.01, 0.1), ((0.8, 0.9), (1.0, 0.7)))
    >>> calibration.factors(0.0316).round(2)
    array([0.9, 0.8])
    """

    #: Noise divided by the signal's norm, ascending; one level for each row.
    levels: tuple[float, ...]
    rows: tuple[tuple[float, ...], ...]  #: A row for each level, a factor for each parameter.

    def __post_init__(self) -> None:
        levels = finite("levels", self.levels, (None,))
        if not len(levels) or (levels <= 0.0).any() or (np.diff(levels) <= 0.0).any():
            raise ConfigurationError(
                f"levels must be ascending and more than 0; got {brief(self.levels)}"
            )
        finite("rows", self.rows, (len(levels), None))

    def factors(self, level: float) -> Floats:
        """Return the factors (n,) at a level, constant beyond the first and the last level."""
        at = np.log(max(level, 1e-12))
        knots = np.log(self.levels)
        return np.array([np.interp(at, knots, row) for row in zip(*self.rows, strict=True)])


#: Takes the values and inputs of B trials, as a simulator does; returns (B, K, T, channels).
DifferenceShapes = Callable[[Values, Any], Floats]


@dataclass(frozen=True)
class Assumed:
    """A number that a simulator assumes and no fit seeks, unless the trials contradict it."""

    name: str  #: As in a sentence: "the density of the fins".
    value: float  #: As assumed.
    sd: float  #: How far it may be from that.
    unit: str  #: "times water's".
    about: str  #: What depends on it: "the thickness of the fins".

    def __post_init__(self) -> None:
        text("name", self.name)
        real(f"value of {self.name}", self.value, -math.inf)
        real(f"sd of {self.name}", self.sd, 1e-12)
        text(f"unit of {self.name}", self.unit)
        text(f"about of {self.name}", self.about)

    def __str__(self) -> str:
        return f"{self.name}, {self.value:g} {self.unit}"


THICKNESS = "the thickness of the fins"
# Fins of aluminium or weighted plastic are 1 to 2.7 times as dense as water; a rough or ribbed skin
# has several times the friction of a smooth one.
ASSUMED = (
    Assumed("the density of the fins", 1.0, 1.0, "times water's", THICKNESS),
    Assumed("their skin friction", 1.0, 4.0, "times a smooth plate's", THICKNESS),
)


@dataclass(frozen=True)
class Material:
    """Factors on what the engines assume of the robot's material."""

    hull: float = 1.0  #: On the hull's mass.
    density: float = 1.0  #: On the fins' mass.
    #: On the fins' skin friction, which acts as a thicker edge would that weighs nothing. Of the
    #: drag edge on it is exact for square fins, else the mean of both edges.
    friction: float = 1.0

    def fields(self, plan: BodyPlan, bodies: Floats, drag: Floats) -> dict[str, Floats]:
        """Return a scenario's fields of bodies (B, S) with the factors ``drag`` (B, 2)."""
        bodies = bodies.copy()
        density = np.full((len(bodies), len(plan.fins)), self.density)
        if self.friction != 1.0:
            for i, (width, length, thickness) in enumerate(plan.columns):
                rub = 2.0 * (self.friction - 1.0) * SKIN_FRICTION / NORMAL_DRAG
                was = bodies[:, thickness].copy()
                bodies[:, thickness] += rub * 0.5 * (bodies[:, width] + bodies[:, length])
                density[:, i] *= was / np.maximum(bodies[:, thickness], 1e-12)
        # A heavier hull moves as if all else weighed less and met less drag.
        return {"body": bodies, "drag": drag / self.hull, "fin_density": density / self.hull}


#: Materials that differ from the assumed one by ``MATERIAL_CHANGE`` in one of ``ASSUMED``.
OTHER_MATERIALS = (
    Material(density=1.0 + MATERIAL_CHANGE),
    Material(friction=1.0 + MATERIAL_CHANGE),
)


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """Size and shape of a simulator's errors: a discrepancy of ``eea.infer``."""

    share: float  #: Standard deviation of the error, as a share of the signal's rms.
    #: Time in which the error's correlation falls by a factor of e, in the unit of the trials'
    #: times, or in samples where trials have no times.
    duration: float
    #: Function that returns the differences of known shape, or None.
    shapes: DifferenceShapes | None = None
    calibration: Calibration | None = None  #: None leaves the intervals as they are.
    #: Numbers that become nuisances of the intervals where trials contradict them, and a function
    #: that returns the difference that one ``sd`` of each makes.
    assumed: tuple[Assumed, ...] = ()
    assumed_shapes: DifferenceShapes | None = None

    def __post_init__(self) -> None:
        real("share", self.share, 0.0, 1.0)
        real("duration", self.duration, 1e-12)
        callback("shapes", self.shapes)
        if self.calibration is not None:
            instance("calibration", self.calibration, Calibration)
        object.__setattr__(self, "assumed", all_of("assumed", self.assumed, Assumed))
        callback("assumed_shapes", self.assumed_shapes)
        if bool(self.assumed) != (self.assumed_shapes is not None):
            raise ConfigurationError(
                "assumed and assumed_shapes must be given together; got one without the other"
            )

    def slow_p(self, regression: Regression, theta: Floats) -> float:
        """Return the p-value of slow residuals; see :func:`slow_errors`."""
        return slow_errors(regression, theta, self.duration)

    def doubts(
        self, fits: Sequence[Optima], best: Optima
    ) -> tuple[list[list[Mode]], tuple[str, ...]]:
        """Return the modes of ``fits`` with these errors, and what is said of assumed numbers.

        A log that no hypothesis explains says nothing of what its simulator assumes.
        """
        assumed = contradiction(best) if best.goodness.good else None
        contradicted = assumed is not None and assumed.contradicted
        modes = [doubted(one, best, self, contradicted) for one in fits]
        return modes, () if assumed is None else assumed.findings


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
        near = Laplace(np.concatenate([theta, np.zeros(count)]), normal, gradient)
        shape = near.given(range(size, size + count))
        cost = 0.5 * squares + float(parameters.prior_cost(theta))
        cost += 0.5 * float(shape.gradient @ shape.centre)
        cost += 0.5 * float(np.linalg.slogdet(shape.information)[1])
        mode = Mode(**vars(near.marginal(range(size))), cost=cost)
        if calibration is not None:
            factors = np.ones(size)
            factors[: parameters.body] = calibration.factors(level)
            mode = mode.scaled(factors)
        modes.append(mode)
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
    taken, slow, slower = pseudo_inverse(sums[0] + prior * power[0] / weight[0]) @ sums
    left = weight[0] - np.trace(taken)
    mean = weight[1] - float(np.trace(slow))
    square = weight[2] - 2.0 * float(np.trace(slower)) + float(np.sum(slow * slow.T))
    variance = 2.0 * (square - mean**2 / left)
    if not min(mean, variance) > 0.0:  # the fit has absorbed all slow errors
        return 1.0
    found = left * power[1] / power[0]
    return float(gammaincc(mean**2 / variance, found * mean / variance))


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
    inner = _inner(parameters, theta)  # those at a bound take no degrees of freedom
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


def _inner(parameters: Unknowns, theta: Floats) -> NDArray[np.bool_]:
    """Return which parameters of a vector (P,) are not at a bound."""
    above = theta > parameters.low + ACTIVE_BOUND_DISTANCE
    below = theta < parameters.high - ACTIVE_BOUND_DISTANCE
    inside: NDArray[np.bool_] = above & below
    return inside


@dataclass(frozen=True, eq=False)
class Contradiction:
    """What a log tells of assumed numbers."""

    assumed: tuple[Assumed, ...]
    #: (K,), the standard deviations that the log would leave of the numbers, in their own units.
    spread: Floats
    p: float  #: The chance of as large a contradiction where the assumptions hold.

    @property
    def contradicted(self) -> bool:
        """Whether the assumptions do not hold."""
        return self.p < CONTRADICTED_P

    @property
    def findings(self) -> tuple[str, ...]:
        """What is contradicted, or else what was not measured.

        What the numbers are instead is not said: they trade off with each other and with the
        sizes, so that a first-order estimate misleads.
        """
        if self.contradicted:
            assumed = " or ".join(str(one) for one in self.assumed)
            allowed = f"the intervals allow for another value (p = {self.p:.1g})"
            return (f"the log contradicts what is assumed: {assumed}; {allowed}",)
        known = self.spread <= UNTOLD_SHARE * np.array([one.sd for one in self.assumed])
        untold = [one for one, told in zip(self.assumed, known, strict=True) if not told]
        if not untold:
            return ()
        each = " and ".join(str(one) for one in untold)
        about = " and ".join(dict.fromkeys(one.about for one in untold))
        return (f"assumed, not measured: {each}; {about} depends on it",)


def contradiction(optima: Optima) -> Contradiction | None:
    """Return what the best fit tells of the numbers that its simulator assumes, if it has any."""
    regression = optima.regression
    parameters = regression.parameters
    discrepancy = parameters.robot.discrepancy
    if not isinstance(discrepancy, Discrepancy) or discrepancy.assumed_shapes is None:
        return None
    theta = optima.fits.theta[:1]
    misfit = regression.misfit(FINE)
    linear = misfit.linearise(theta)
    directions = differences(optima, discrepancy.assumed_shapes, theta)[0]  # (E, K, M)
    weight = optima.precision
    inner = np.flatnonzero(_inner(parameters, theta[0]))
    size = len(parameters)
    tested = np.arange(size, size + directions.shape[1])
    near = misfit.laplace(theta, linear, weight)[0]
    information = np.zeros((size + len(tested), size + len(tested)))
    information[:size, :size] = near.information
    for e, (used, entries) in enumerate(misfit.columns):
        information[np.ix_(entries, tested)] += weight * linear.slopes[0, e, used] @ directions[e].T
    information[size:, :size] = information[:size, size:].T
    information[size:, size:] = np.einsum("ekm,elm->kl", directions, directions) * weight
    slope = weight * np.einsum("ekm,em->k", directions, linear.residuals[0])
    both = Laplace(
        np.concatenate([near.theta, np.zeros(len(tested))]),
        information,
        np.concatenate([near.gradient, slope]),
    )
    kept = np.concatenate([inner, tested])
    left = both.given(kept).marginal(np.arange(len(inner), len(kept)))
    square, freedom = left.score_test(LEAST_INFORMATION)
    p = float(chdtrc(freedom, square)) if freedom else 1.0
    # Where nearly nothing is left, rounding may leave less than nothing.
    values, vectors = np.linalg.eigh(left.information)
    covariance = (vectors / (np.maximum(values, 0.0) + 1.0)) @ vectors.T
    sds = np.array([one.sd for one in discrepancy.assumed])
    return Contradiction(discrepancy.assumed, sds * np.sqrt(np.diag(covariance)), p)
