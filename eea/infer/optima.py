"""The best fits of some trials, each optimum once, with the noise that the best of them leaves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eea.core.angles import Floats, circular_distance
from eea.core.checks import TargetError
from eea.infer.descent import Fitted, descend
from eea.infer.goodness import (
    LEAST_RELATIVE_RMS,
    Goodness,
    against_known_good,
    effective_count,
    goodness_of_fit,
)
from eea.infer.laplace import Laplace
from eea.infer.misfit import FINE, Regression
from eea.infer.mixture import Mixture, Mode
from eea.infer.unknowns import Unknowns

CLOSE_COST = 10.0  # optima with a cost higher by this have under 1/20,000 of the best's weight
SAME_OPTIMUM_DISTANCE = 1e-3  # share of a range, or rad; closer optima are one
# Share of a range. Bodies that differ by more in a size are kept beside a better one.
VALLEY_SIZE_DIFFERENCE = 0.05


class Plateau(NamedTuple):
    """What a number that acts in steps may be: the middles of its plateaus, as shares."""

    entry: int
    best: float
    width: float  #: Of the best one.
    kept: tuple[float, ...]  #: Those that the trials allow.
    worse: Mapping[float, float]  #: How much worse, in chi-square, those beside them are.


@dataclass(frozen=True, eq=False)
class Optima:
    """The best fits of some trials."""

    regression: Regression
    fits: Fitted  #: Fits, best first.
    sigma: float  #: Standard deviation of the noise, as given or from the best fit's residuals.
    plateaus: tuple[Plateau, ...] = ()  #: Of the numbers that act in steps.
    alone: bool = False  #: Whether descents from different places all ended in one optimum.

    def laplace(self, weight: float) -> Laplace:
        """Return the posterior near the fits, of residuals of the precision ``weight``."""
        misfit = self.regression.misfit(FINE)
        theta = self.fits.theta
        return misfit.laplace(theta, misfit.linearise(theta), weight)

    def mixture(self, best: Optima) -> Mixture:
        """Return the posterior, with noise estimated from the ``best`` fit of all hypotheses."""
        weight = best.precision
        near = self.laplace(weight)
        parameters = self.regression.parameters
        cost = 0.5 * weight * self.fits.squares + parameters.prior_cost(self.fits.theta)
        modes = [Mode(**vars(near[k]), cost=float(cost[k])) for k in range(len(cost))]
        return parameters.posterior(modes)

    @cached_property
    def precision(self) -> float:
        """1 / sigma^2 of the samples, times the share of them that counts as independent.

        Where residuals are correlated, only the effective number of samples counts.
        """
        residuals = self.residuals
        return effective_count(residuals) / sum(one.size for one in residuals) / self.sigma**2

    @cached_property
    def residuals(self) -> list[Floats]:
        """Weighted residuals (T, axes) of the best fit for each trial, simulated minus observed."""
        flat = self.regression.misfit(FINE).residuals(self.fits.theta[:1])[0]
        trials, samples, axes = self.regression.observed.signal.shape
        whole = flat.reshape(trials, axes, samples).swapaxes(1, 2)
        return [one[:n] for one, n in zip(whole, self.regression.observed.counts, strict=True)]

    @cached_property
    def signal(self) -> Floats:
        """The simulated signal (E, T, axes) of the best fit; where samples are missing, theirs."""
        observed = self.regression.observed
        inside = np.arange(observed.signal.shape[1]) < np.array(observed.counts)[:, None]
        observed = replace(observed, noise=None, weight=inside.astype(np.float64))
        plain = Regression(self.regression.parameters, observed, None)
        flat = plain.misfit(FINE).residuals(self.fits.theta[:1])[0]
        trials, samples, axes = observed.signal.shape
        left = flat.reshape(trials, axes, samples).swapaxes(1, 2)
        return np.asarray(observed.signal + left, np.float64)

    @cached_property
    def goodness(self) -> Goodness:
        """Whether the best fit leaves nothing but noise."""
        regression = self.regression
        parameters = regression.parameters
        floor = LEAST_RELATIVE_RMS * regression.rms
        discrepancy = parameters.robot.discrepancy
        slow_p = None
        if discrepancy is not None:
            slow_p = discrepancy.slow_p(regression, self.fits.theta[0])
        observed = regression.observed
        robot = parameters.robot
        if regression.usual is not None:
            theta = self.fits.theta[0]
            away = 2.0 * float(parameters.prior_cost(theta))
            misfit = float(self.fits.squares[0]) / observed.size
            return against_known_good(
                misfit, regression.usual, away, parameters.informed, robot.noun
            )
        found = goodness_of_fit(
            self.residuals,
            parameters.unknowns,
            regression.noise,
            floor,
            slow_p,
            "times the noise" if observed.noise is not None else robot.unit,
            robot.loudest,
            observed.missing,
            robot.noun,
            regression.samples,
        )
        return replace(found, unexplained=found.rms / regression.rms)


def optima_of(regression: Regression, fitted: Fitted) -> Optima:
    """Return the fits close to the best, with noise from the best's residuals."""
    parameters = regression.parameters
    sigma = regression.sigma(fitted.squares.min(), regression.observed.size)
    cost = 0.5 * fitted.squares / sigma**2 + parameters.prior_cost(fitted.theta)
    found = unique(parameters, fitted._replace(cost=cost))
    near = found.cost <= found.cost[0] + CLOSE_COST
    return Optima(regression, found.of(near), sigma)


def as_they_are(regression: Regression, theta: Floats) -> Optima:
    """Return the optima that vectors (S, P) are taken for, without a search."""
    squares = regression.misfit(FINE).squares(theta)
    return optima_of(regression, Fitted(theta, squares, squares))


def improved(optima: Optima, starts: Floats) -> Optima:
    """Return optima together with those of descents from vectors (S, P)."""
    regression = optima.regression
    ended = descend(regression.misfit(FINE), starts, optima.sigma, 40, 1e-6)
    found = optima_of(regression, together(optima.fits, ended))
    alone = optima.alone and len(found.fits.theta) == 1
    return replace(found, plateaus=optima.plateaus, alone=alone)


def together(one: Fitted, other: Fitted) -> Fitted:
    return Fitted(*(np.concatenate(parts) for parts in zip(one, other, strict=True)))


def best_few(fitted: Fitted, count: int) -> Fitted:
    """Return the best few, best first."""
    return fitted.of(np.argsort(fitted.cost, kind="stable")[:count])


def different(parameters: Unknowns, fitted: Fitted, count: int) -> Fitted:
    """Return the best few whose bodies differ, best first.

    A narrow corner may be slightly lower than a wide valley that has nearly all of the probability:
    many descents into the corner must not displace those into the valley.
    """
    return best_few(
        unique(parameters, fitted, parameters.body or None, VALLEY_SIZE_DIFFERENCE), count
    )


def unique(
    parameters: Unknowns,
    fitted: Fitted,
    entries: int | None = None,
    same: float = SAME_OPTIMUM_DISTANCE,
) -> Fitted:
    """Return each optimum once, best first, compared in the first entries (None: in all)."""
    ordered = best_few(fitted, len(fitted.cost))
    kept: list[int] = []
    for i in np.flatnonzero(np.isfinite(ordered.cost)).tolist():
        theta = ordered.theta[i]
        others = ordered.theta[kept]
        apart = np.where(
            parameters.circular, circular_distance(others, theta), np.abs(others - theta)
        )[:, :entries]
        if not kept or apart.max(axis=1).min() > same:
            kept.append(i)
    if not kept:
        raise TargetError(
            "simulate must return a signal that stays finite for some values; none were found"
        )
    return ordered.of(kept)
