"""The global search of joint inference: scan, descend, hop.

A scan of random bodies and poses gives starting points, damped least squares descends from the best
of them, and hops find other valleys. Where the residuals of the best fit do not look like noise,
the scan is repeated, since the most common reason is a wrong valley.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eea.core.angles import Floats
from eea.core.config import FitConfig
from eea.infer.descent import Fitted, descend
from eea.infer.misfit import COARSE, FINE, Regression
from eea.infer.optima import (
    VALLEY_SIZE_DIFFERENCE,
    Optima,
    as_they_are,
    best_few,
    different,
    improved,
    optima_of,
    together,
    unique,
)
from eea.infer.scan import hop, lined, pose, relined, scan
from eea.infer.unknowns import FIXED_PRECISION

MAXIMUM_HOPS = 3  # rounds of hops from the best optimum
FIRST_ITERATIONS = 8  # then the worse half of the starting points is dropped
MEETING_ITERATIONS = 4  # then descents that have met go on as one
FEW_DESCENTS = 6  # that tell whether there is one optimum
SCAN_TOLERANCE = 1e-3  # of sigma: two scans that agree within it have found the optimum
RIVAL_SQUARES_RATIO = 1.5  # with more, relative to a rival hypothesis, a search is not completed
EXACT_FIT_SIGMA = 1e-3  # an exact fit of a signal of about 1 leaves less in single precision


def search(
    regression: Regression,
    rng: np.random.Generator,
    effort: FitConfig,
    known: Floats | None = None,
    once: bool = True,
    rival: float = np.inf,
    before: Optima | None = None,
) -> Optima:
    """Return the best fits, from ``known`` vectors (K, P) and random starting points.

    Without ``once``, the search is repeated up to ``effort.restarts`` times, until a fit leaves
    nothing but noise, or two scans end in the same fit (then the model fails, not the search).
    ``before`` is the fit of an earlier scan, as of :func:`agreed`. The search is not completed
    where its squares far exceed ``rival``, a sum of squares.
    """
    parameters = regression.parameters
    if not parameters.unknowns:
        return as_they_are(regression, parameters.prior_mean[None])
    best = before
    alone = before is not None
    for attempt in range(effort.restarts + 1):
        starts = np.empty((0, len(parameters)))
        scanned = effort
        if known is not None:
            known = starts = downhill(regression, known).theta
            exact = exact_fit(regression, starts)
            if exact is not None:
                return exact
            # Known optima need fewer descents, unless their fit has just failed.
            scanned = effort if attempt else halved(effort)
        starts = np.concatenate([starts, scan(regression, rng, scanned)])
        found = _refine(regression, starts, rng, effort, rival)
        same = best is not None and abs(found.sigma / best.sigma - 1.0) < SCAN_TOLERANCE
        best = found if best is None else optima_of(regression, together(best.fits, found.fits))
        alone = alone and same and len(best.fits.theta) == 1
        if once or same or best.goodness.good:
            break
    assert best is not None
    return replace(best, alone=True) if alone else best


def agreed(regression: Regression, rng: np.random.Generator, effort: FitConfig) -> Optima | None:
    """Return the optimum in which descents from a few places all end; None if they differ.

    They begin at the best of a small scan, as many as there are unknowns or more, or at as many as
    the effort allows. Then hops look for other valleys of a trial's angles. None, too, if there are
    too many unknowns for that, or a number is said to have valleys, or the scan moves no number.
    """
    parameters = regression.parameters
    sought = np.concatenate([np.arange(parameters.body), parameters.freed_entries()])
    moved = parameters.prior_precision[sought] < FIXED_PRECISION
    few = effort if effort.descents <= FEW_DESCENTS else halved(halved(effort))
    if lined(parameters) or not moved.any() or parameters.unknowns > max(few.descents, 2):
        return None
    met = downhill(regression, scan(regression, rng, few), MEETING_ITERATIONS)
    met = unique(parameters, met, same=VALLEY_SIZE_DIFFERENCE)
    if len(met.theta) > 1:
        met = downhill(regression, met.theta)
        met = unique(parameters, met, same=VALLEY_SIZE_DIFFERENCE)
    if len(met.theta) > 1:
        return None
    found = replace(polished(regression, met.theta), alone=True)
    if found.sigma <= regression.least_sigma:
        return found
    hopped = hop(regression, found.fits.theta[0], found.sigma, rng)
    return improved(found, hopped) if len(hopped) else found


def polished(regression: Regression, theta: Floats) -> Optima:
    """Return the optima near vectors (S, P), which are near already."""
    exact = exact_fit(regression, theta)
    if exact is not None:
        return exact
    fine = regression.misfit(FINE)
    sigma = regression.sigma_near(fine, theta)
    return optima_of(regression, descend(fine, theta, sigma, 40, 1e-6))


def halved(effort: FitConfig) -> FitConfig:
    """Return settings for a search of half the effort."""
    return replace(
        effort,
        bodies=max(2, effort.bodies // 2),
        poses=max(1, effort.poses // 2),
        descents=max(1, effort.descents // 2),
        polished=max(1, effort.polished // 2),
    )


def downhill(regression: Regression, starts: Floats, iterations: int = 25) -> Fitted:
    """Descend from vectors (S, P) in single precision."""
    coarse = regression.misfit(COARSE)
    return descend(coarse, starts, regression.sigma_near(coarse, starts), iterations, 1e-3)


def exact_fit(regression: Regression, theta: Floats) -> Optima | None:
    """Return the optimum near vectors (S, P) if it fits up to rounding, else None."""
    fine = regression.misfit(FINE)
    squares = fine.squares(theta)
    sigma = regression.sigma(squares.min(), fine.count)
    if regression.noise is not None or sigma > EXACT_FIT_SIGMA:
        return None
    polished = descend(fine, theta[squares.argmin()][None], sigma, 400, 1e-9)
    if regression.sigma(polished.squares.min(), fine.count) > regression.least_sigma:
        return None
    return optima_of(regression, polished)


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
    begun = downhill(regression, starts, FIRST_ITERATIONS)
    some = different(parameters, begun, -(-len(starts) // 2))
    ended = downhill(regression, some.theta)
    first = different(parameters, ended, 2 * effort.polished).theta
    exact = exact_fit(regression, first)
    if exact is not None:
        return exact
    squares = fine.squares(first)
    if squares.min() > RIVAL_SQUARES_RATIO * rival:
        return as_they_are(regression, first)
    again = pose(regression, first, 2 * effort.poses, rng)[0]
    again = again[(again != first).any(axis=1)]
    moved = relined(regression, first, regression.sigma_near(fine, first), 1)
    second = downhill(regression, np.concatenate([first, again, moved]))
    chosen = different(parameters, second, effort.polished).theta
    sigma = regression.sigma_near(fine, chosen)
    best = best_few(descend(fine, chosen, sigma, 40, 1e-6), effort.polished)
    for _ in range(MAXIMUM_HOPS):
        sigma = regression.sigma(best.squares.min(), fine.count)
        if sigma <= regression.least_sigma:  # there is nothing better
            break
        hopped = np.concatenate(
            [
                hop(regression, best.theta[0], sigma, rng),
                relined(regression, best.theta[:1], sigma, 2),
            ]
        )
        if not len(hopped):
            break
        more = descend(fine, hopped, sigma, 15, 1e-6)
        before = best.cost[0]
        best = unique(parameters, together(best, more))
        if best.cost[0] > before - 1e-3:
            break
    return optima_of(regression, best)
