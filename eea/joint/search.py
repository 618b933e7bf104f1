"""The global search of joint inference: scan, descend, hop.

A scan of random bodies and poses gives starting points, damped least squares descends from the best
of them, and hops find other valleys. Where the residuals of the best fit do not look like noise,
the scan is repeated, since the most common reason is a wrong valley.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eea.core.angles import Floats, circular_distance
from eea.core.checks import TargetError
from eea.core.config import FitConfig
from eea.joint.descent import Fitted, descend
from eea.joint.initialization import hop, pose, relined, scan
from eea.joint.least_squares import COARSE, FINE, Regression
from eea.joint.parameters import Parameters
from eea.joint.slow_errors import slow_errors
from eea.statistics.goodness_of_fit import (
    LEAST_RELATIVE_RMS,
    Goodness,
    against_known_good,
    goodness_of_fit,
)

CLOSE_COST = 10.0  # optima with a cost higher by this have under 1/20,000 of the best's weight
MAXIMUM_HOPS = 3  # rounds of hops from the best optimum
FIRST_ITERATIONS = 8  # then the worse half of the starting points is dropped
SAME_OPTIMUM_DISTANCE = 1e-3  # share of a range, or rad; closer optima are one
# Share of a range. Bodies that differ by more in a size are kept beside a better one.
VALLEY_SIZE_DIFFERENCE = 0.05
SCAN_TOLERANCE = 1e-3  # of sigma: two scans that agree within it have found the optimum
RIVAL_SQUARES_RATIO = 1.5  # with more, relative to a rival hypothesis, a search is not completed
EXACT_FIT_SIGMA = 1e-3  # an exact fit of a signal of about 1 leaves less in single precision


@dataclass(frozen=True, eq=False)
class Optima:
    """The best fits of some trials."""

    regression: Regression
    fits: Fitted  #: Fits, best first.
    sigma: float  #: Standard deviation of the noise, as given or from the best fit's residuals.

    @cached_property
    def residuals(self) -> list[Floats]:
        """Weighted residuals (T, axes) of the best fit for each trial, simulated minus observed."""
        flat = self.regression.misfit(FINE).residuals(self.fits.theta[:1])[0]
        trials, samples, axes = self.regression.observed.signal.shape
        whole = flat.reshape(trials, axes, samples).swapaxes(1, 2)
        return [one[:n] for one, n in zip(whole, self.regression.observed.counts, strict=True)]

    @cached_property
    def goodness(self) -> Goodness:
        """Whether the best fit leaves nothing but noise."""
        regression = self.regression
        parameters = regression.parameters
        floor = LEAST_RELATIVE_RMS * regression.rms
        discrepancy = parameters.robot.discrepancy
        slow_p = None
        if discrepancy is not None:
            slow_p = slow_errors(regression, self.fits.theta[0], discrepancy.duration)
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
        )
        return replace(found, unexplained=found.rms / regression.rms)


def search(
    regression: Regression,
    rng: np.random.Generator,
    effort: FitConfig,
    known: Floats | None = None,
    once: bool = True,
    rival: float = np.inf,
) -> Optima:
    """Return the best fits, from ``known`` vectors (K, P) and random starting points.

    Without ``once``, the search is repeated up to ``effort.restarts`` times, until a fit leaves
    nothing but noise, or two scans end in the same fit (then the model fails, not the search).
    The search is not completed where its squares far exceed ``rival``, a sum of squares.
    """
    parameters = regression.parameters
    if not parameters.unknowns:
        still = parameters.prior_mean[None]
        squares = regression.misfit(FINE).squares(still)
        return _optima(regression, Fitted(still, squares, squares))
    best: Optima | None = None
    for attempt in range(effort.restarts + 1):
        starts = np.empty((0, len(parameters)))
        scanned = effort
        if known is not None:
            known = starts = _downhill(regression, known).theta
            exact = _exact(regression, starts)
            if exact is not None:
                return exact
            # Known optima need fewer descents, unless their fit has just failed.
            scanned = effort if attempt else halved(effort)
        starts = np.concatenate([starts, scan(regression, rng, scanned)])
        found = _refine(regression, starts, rng, effort, rival)
        same = best is not None and abs(found.sigma / best.sigma - 1.0) < SCAN_TOLERANCE
        best = found if best is None else _optima(regression, _together(best.fits, found.fits))
        if once or same or best.goodness.good:
            break
    assert best is not None
    return best


def improved(optima: Optima, starts: Floats) -> Optima:
    """Return optima together with those of descents from vectors (S, P)."""
    regression = optima.regression
    ended = descend(regression.misfit(FINE), starts, optima.sigma, 40, 1e-6)
    return _optima(regression, _together(optima.fits, ended))


def halved(effort: FitConfig) -> FitConfig:
    """Return settings for a search of half the effort."""
    return replace(
        effort,
        bodies=max(2, effort.bodies // 2),
        poses=max(1, effort.poses // 2),
        descents=max(1, effort.descents // 2),
        polished=max(1, effort.polished // 2),
    )


def _downhill(regression: Regression, starts: Floats, iterations: int = 25) -> Fitted:
    """Descend from vectors (S, P) in single precision."""
    coarse = regression.misfit(COARSE)
    return descend(coarse, starts, regression.sigma_near(coarse, starts), iterations, 1e-3)


def _exact(regression: Regression, theta: Floats) -> Optima | None:
    """Return the optimum near vectors (S, P) if it fits up to rounding, else None."""
    fine = regression.misfit(FINE)
    squares = fine.squares(theta)
    sigma = regression.sigma(squares.min(), fine.count)
    if regression.noise is not None or sigma > EXACT_FIT_SIGMA:
        return None
    polished = descend(fine, theta[squares.argmin()][None], sigma, 400, 1e-9)
    if regression.sigma(polished.squares.min(), fine.count) > regression.least_sigma:
        return None
    return _optima(regression, polished)


def _refine(
    regression: Regression,
    starts: Floats,
    rng: np.random.Generator,
    effort: FitConfig,
    rival: float,
) -> Optima:
    """Descend from vectors (S, P), then hop from the best unless it is far worse than a rival."""
    parameters = regression.parameters
    fine = regression.misfit(FINE)
    begun = _downhill(regression, starts, FIRST_ITERATIONS)
    some = _different(parameters, begun, -(-len(starts) // 2))
    ended = _downhill(regression, some.theta)
    first = _different(parameters, ended, 2 * effort.polished).theta
    exact = _exact(regression, first)
    if exact is not None:
        return exact
    squares = fine.squares(first)
    if squares.min() > RIVAL_SQUARES_RATIO * rival:
        return _optima(regression, Fitted(first, squares, squares))
    again = pose(regression, first, 2 * effort.poses, rng)[0]
    moved = relined(regression, first, regression.sigma_near(fine, first), 1)
    second = _downhill(regression, np.concatenate([first, again, moved]))
    chosen = _different(parameters, second, effort.polished).theta
    sigma = regression.sigma_near(fine, chosen)
    polished = _best(descend(fine, chosen, sigma, 40, 1e-6), effort.polished)
    for _ in range(MAXIMUM_HOPS):
        sigma = regression.sigma(polished.squares.min(), fine.count)
        if sigma <= regression.least_sigma:  # there is nothing better
            break
        hopped = np.concatenate(
            [
                hop(regression, polished.theta[0], sigma, rng),
                relined(regression, polished.theta[:1], sigma, 2),
            ]
        )
        if not len(hopped):
            break
        more = descend(fine, hopped, sigma, 15, 1e-6)
        before = polished.cost[0]
        polished = _unique(parameters, _together(polished, more))
        if polished.cost[0] > before - 1e-3:
            break
    return _optima(regression, polished)


def _optima(regression: Regression, fitted: Fitted) -> Optima:
    """Return the fits close to the best, with noise from the best's residuals."""
    parameters = regression.parameters
    sigma = regression.sigma(fitted.squares.min(), regression.observed.size)
    cost = 0.5 * fitted.squares / sigma**2 + parameters.prior_cost(fitted.theta)
    found = _unique(parameters, fitted._replace(cost=cost))
    near = found.cost <= found.cost[0] + CLOSE_COST
    return Optima(regression, found.of(near), sigma)


def _together(one: Fitted, other: Fitted) -> Fitted:
    return Fitted(*(np.concatenate(parts) for parts in zip(one, other, strict=True)))


def _best(fitted: Fitted, count: int) -> Fitted:
    """Return the best few, best first."""
    return fitted.of(np.argsort(fitted.cost, kind="stable")[:count])


def _different(parameters: Parameters, fitted: Fitted, count: int) -> Fitted:
    """Return the best few whose bodies differ, best first.

    A narrow corner may be slightly lower than a wide valley that has nearly all of the probability:
    many descents into the corner must not displace those into the valley.
    """
    return _best(_unique(parameters, fitted, parameters.body, VALLEY_SIZE_DIFFERENCE), count)


def _unique(
    parameters: Parameters,
    fitted: Fitted,
    entries: int | None = None,
    same: float = SAME_OPTIMUM_DISTANCE,
) -> Fitted:
    """Return each optimum once, best first, compared in the first entries (None: in all)."""
    ordered = _best(fitted, len(fitted.cost))
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
        raise TargetError("no values were found with a simulation that stays finite")
    return ordered.of(kept)
