"""Model discrepancy: the errors of a simulator as a term of the likelihood.

A simulator differs from the robot by more than noise. The difference is not white: it scales with
the signal, lasts for many samples, and part of it has a known shape, such as the error of the time
step. The signal y of a trial, simulated as f, therefore has the covariance C about f (M. C. Kennedy
and A. O'Hagan, "Bayesian calibration of computer models", 2001)::

    C = sigma^2 I + share^2 s^2 R + D D^T

with s the rms of f, R the correlation exp(-|t - t'| / duration) within an axis, and in the columns
of D the known shapes, each as large as one standard deviation. All trials share these shapes.

The numbers that a simulator assumes are further columns of D where the trials contradict them
(:func:`doubted`).

The search minimises the white misfit, which is exact inside the model. Here the normal equations
are solved again at its optima with C instead of sigma^2 I, to first order: one step moves each
optimum and widens its covariance.

Numbers that a simulator assumes and no fit seeks: whether the trials contradict them.

Each is a direction in which the signal changes, to first order. With r the residuals of the best
fit, J their derivatives by the unknowns and S those by the assumed numbers, in standard deviations
of their priors, the numbers' own information and slope are those left when the unknowns follow::

    M = S^T S / sigma^2 - S^T J A^-1 J^T S / sigma^4,      A = J^T J / sigma^2 + prior precision
    b = S^T r / sigma^2

and b^T M^-1 b is chi-square if the assumptions hold (C. R. Rao's score test). Where it is too large
for that, the numbers become nuisances of the intervals (:func:`doubted`). Otherwise
they stay as assumed, since as nuisances they would widen every interval of what they trade off
with, and the log tells nothing against them. Whether it could have told is said in words.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtrc

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
from eea.fish.slow_errors import ACTIVE_BOUND_DISTANCE, slow_errors
from eea.infer.design import UNTOLD_SHARE
from eea.infer.laplace import Laplace
from eea.infer.misfit import FINE, Regression
from eea.infer.mixture import Mode
from eea.infer.optima import Optima
from eea.infer.statement import Values


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
        """Return the p-value of slow residuals; see :func:`eea.fish.slow_errors.slow_errors`."""
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


CONTRADICTED_P = 0.05  # the chance of as large a contradiction where the assumptions hold
LEAST_INFORMATION = 1e-6  # in 1 / prior variance: a direction of less is not tested


@dataclass(frozen=True, eq=False)
class Contradiction:
    """What a log tells of assumed numbers."""

    assumed: tuple[Assumed, ...]
    estimate: Floats  #: (K,), in the numbers' own units.
    spread: Floats  #: (K,), the standard deviations of the estimates.
    p: float  #: The chance of as large a contradiction where the assumptions hold.

    @property
    def contradicted(self) -> bool:
        """Whether the assumptions do not hold."""
        return self.p < CONTRADICTED_P

    @property
    def findings(self) -> tuple[str, ...]:
        """What was measured of the numbers where they are contradicted, and what was not."""
        said = []
        told = self.spread <= UNTOLD_SHARE * np.array([one.sd for one in self.assumed])
        numbers = zip(self.assumed, self.estimate.tolist(), self.spread.tolist(), strict=True)
        if self.contradicted:
            measured = [
                f"{one.name} is {value:.2g} {one.unit} (sd {spread:.2g}), not {one.value:g}"
                for one, value, spread in numbers
                if spread <= UNTOLD_SHARE * one.sd
            ]
            measured = measured or [f"{' or '.join(o.name for o in self.assumed)} is not"]
            allowed = f"the intervals allow for it (p = {self.p:.1g})"
            said.append(f"{' and '.join(measured)} as assumed; {allowed}")
        if not told.all():
            untold = [one for one, known in zip(self.assumed, told, strict=True) if not known]
            each = " and ".join(f"{one.name}, {one.value:g} {one.unit}" for one in untold)
            about = " and ".join(dict.fromkeys(one.about for one in untold))
            said.append(f"assumed, not measured: {each}; {about} depends on it")
        return tuple(said)


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
    inner = np.flatnonzero(
        (theta[0] > parameters.low + ACTIVE_BOUND_DISTANCE)
        & (theta[0] < parameters.high - ACTIVE_BOUND_DISTANCE)
    )
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
    means = np.array([one.value for one in discrepancy.assumed])
    return Contradiction(
        discrepancy.assumed,
        means - sds * (covariance @ left.gradient),
        sds * np.sqrt(np.diag(covariance)),
        p,
    )
