"""The global search of joint inference: scan, descend, hop.

A scan of random bodies and poses gives starting points, damped least squares descends from the best
of them, and hops find other valleys. Where the residuals of the best fit do not look like noise,
the scan is repeated, since the most common reason is a wrong valley.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats, circular_distance
from eea.core.checks import TargetError
from eea.core.config import FitConfig
from eea.joint.initialization import hop, pose, relined, scan
from eea.joint.least_squares import COARSE, FINE, Fitted, Linear, Misfit, Observed, descend
from eea.joint.parameters import Parameters

CLOSE = 10.0  # in cost: optima farther from the best have less than 1/20,000 of its weight
HOPS = 3  # maximum number, from the best optimum
SOON = 8  # iterations after which the worse half of the starting points is dropped
SAME = 1e-3  # of a range, or rad: closer optima are one
VALLEY = 0.05  # of a range: bodies that differ by more in a size are kept beside a better one
LEAST_SIGMA = 1e-7  # rad/s: smaller residuals are rounding
PROMISING = 1e-3  # rad/s: an exact fit leaves less in single precision


@dataclass(frozen=True, eq=False)
class Optima:
    """The best fits of some trials, best first."""

    parameters: Parameters
    observed: Observed
    theta: Floats  #: Shape (K, P).
    cost: Floats  #: -log posterior (K,), up to a constant.
    squares: Floats  #: Sum of squared residuals (K,).
    sigma: float  #: Standard deviation of the noise, as given or from the best fit's residuals.

    def linear(self) -> Linear:
        """Return the misfit near each of them."""
        return Misfit(self.parameters, self.observed, FINE).linearise(self.theta)

    @cached_property
    def residuals(self) -> Floats:
        """Simulated less observed (E, T, axes) of the best."""
        flat = Misfit(self.parameters, self.observed, FINE).residuals(self.theta[:1])[0]
        trials, samples, axes = self.observed.signal.shape
        residuals: Floats = flat.reshape(trials, axes, samples).swapaxes(1, 2)
        return residuals


def search(
    parameters: Parameters,
    observed: Observed,
    rng: np.random.Generator,
    effort: FitConfig,
    known: Floats | None = None,
    explained: Callable[[Optima], bool] = lambda _: True,
) -> Optima:
    """Return the best fits of observed trials.

    Parameters
    ----------
    effort
        Numbers of starting points and restarts, and the noise if it is known.
    known
        Further starting points (K, P), from earlier fits.
    explained
        Whether a fit leaves nothing but noise; otherwise the search is repeated.
    """
    best: Optima | None = None
    for attempt in range(effort.restarts + 1):
        starts, scanned = np.empty((0, len(parameters))), effort
        if known is not None:
            starts = _downhill(parameters, observed, known, effort.noise).theta
            exact = _exact(parameters, observed, starts, effort.noise)
            if exact is not None:
                return exact
            # Known optima are nearly enough, unless they have just failed.
            scanned = effort if attempt else halved(effort)
            known = starts
        starts = np.concatenate([starts, scan(parameters, observed, rng, scanned)])
        found = _refine(parameters, observed, starts, rng, effort)
        best = found if best is None else _joined(best, found, effort.noise)
        if explained(best):
            break
    assert best is not None
    return best


def improved(optima: Optima, starts: Floats, noise: float | None) -> Optima:
    """Return optima together with those of descents from vectors (S, P)."""
    parameters, observed = optima.parameters, optima.observed
    ended = descend(Misfit(parameters, observed, FINE), starts, optima.sigma, 40, 1e-6)
    known = Fitted(optima.theta, optima.squares, optima.cost)
    return _optima(parameters, observed, _together(known, ended), noise)


def halved(effort: FitConfig) -> FitConfig:
    """Return settings for a search of half the effort."""
    return replace(
        effort,
        bodies=max(2, effort.bodies // 2),
        poses=max(1, effort.poses // 2),
        descents=max(1, effort.descents // 2),
        polished=max(1, effort.polished // 2),
    )


def _downhill(
    parameters: Parameters,
    observed: Observed,
    starts: Floats,
    noise: float | None,
    iterations: int = 25,
) -> Fitted:
    """Descend from vectors (S, P) in single precision."""
    coarse = Misfit(parameters, observed, COARSE)
    sigma = noise or _sigma(coarse.squares(starts).min(), coarse.count, parameters)
    return descend(coarse, starts, sigma, iterations, 1e-3)


def _exact(
    parameters: Parameters, observed: Observed, theta: Floats, noise: float | None
) -> Optima | None:
    """Return the optimum near vectors (S, P) if it fits up to rounding: there is no better one."""
    fine = Misfit(parameters, observed, FINE)
    squares = fine.squares(theta)
    sigma = _sigma(squares.min(), fine.count, parameters)
    if noise is not None or sigma > PROMISING:
        return None
    polished = descend(fine, theta[squares.argmin()][None], sigma, 400, 1e-9)
    if _sigma(polished.squares.min(), fine.count, parameters) > LEAST_SIGMA:
        return None
    return _optima(parameters, observed, polished, noise)


def _refine(
    parameters: Parameters,
    observed: Observed,
    starts: Floats,
    rng: np.random.Generator,
    effort: FitConfig,
) -> Optima:
    """Descend from vectors (S, P), then hop from the best."""
    noise = effort.noise
    fine = Misfit(parameters, observed, FINE)
    begun = _downhill(parameters, observed, starts, noise, SOON)
    some = _different(parameters, begun, -(-len(starts) // 2))
    ended = _downhill(parameters, observed, some.theta, noise)
    first = _different(parameters, ended, 2 * effort.polished)
    exact = _exact(parameters, observed, first.theta, noise)
    if exact is not None:
        return exact
    again = pose(parameters, observed, first.theta, 2 * effort.poses, rng)
    sigma = noise or _sigma(fine.squares(first.theta).min(), fine.count, parameters)
    moved = relined(parameters, observed, first.theta, sigma, 1)
    second = _downhill(parameters, observed, np.concatenate([first.theta, again, moved]), noise)
    chosen = _different(parameters, second, effort.polished)
    sigma = noise or _sigma(fine.squares(chosen.theta).min(), fine.count, parameters)
    polished = _best(descend(fine, chosen.theta, sigma, 40, 1e-6), effort.polished)
    for _ in range(HOPS):
        sigma = noise or _sigma(polished.squares.min(), fine.count, parameters)
        if sigma <= LEAST_SIGMA:  # there is nothing better
            break
        hopped = np.concatenate(
            [
                hop(parameters, observed, polished.theta[0], sigma, rng),
                relined(parameters, observed, polished.theta[:1], sigma, 2),
            ]
        )
        if not len(hopped):
            break
        more = descend(fine, hopped, sigma, 15, 1e-6)
        before = polished.cost[0]
        polished = _unique(parameters, _together(polished, more))
        if polished.cost[0] > before - 1e-3:
            break
    return _optima(parameters, observed, polished, noise)


def _optima(
    parameters: Parameters, observed: Observed, fitted: Fitted, noise: float | None
) -> Optima:
    """Return the fits close to the best, at the noise that the best leaves."""
    sigma = noise or _sigma(fitted.squares.min(), observed.signal.size, parameters)
    cost = 0.5 * fitted.squares / sigma**2 + parameters.prior_cost(fitted.theta)
    found = _unique(parameters, Fitted(fitted.theta, fitted.squares, cost))
    near = found.cost <= found.cost[0] + CLOSE
    return Optima(
        parameters, observed, found.theta[near], found.cost[near], found.squares[near], sigma
    )


def _joined(one: Optima, other: Optima, noise: float | None) -> Optima:
    parts = (Fitted(o.theta, o.squares, o.cost) for o in (one, other))
    return _optima(one.parameters, one.observed, _together(*parts), noise)


def _sigma(squares: float, count: int, parameters: Parameters) -> float:
    """Return the standard deviation of the noise for a sum of squares."""
    return max(float(np.sqrt(squares / max(count - len(parameters), 1))), LEAST_SIGMA)


def _together(one: Fitted, other: Fitted) -> Fitted:
    return Fitted(*(np.concatenate(parts) for parts in zip(one, other, strict=True)))


def _best(fitted: Fitted, count: int) -> Fitted:
    """Return the best few, best first."""
    order = np.argsort(fitted.cost, kind="stable")[:count]
    return Fitted(*(part[order] for part in fitted))


def _different(parameters: Parameters, fitted: Fitted, count: int) -> Fitted:
    """Return the best few whose bodies differ, best first.

    A narrow corner may be slightly lower than a wide valley that has nearly all of the probability:
    many descents into the corner must not displace those into the valley.
    """
    return _best(_unique(parameters, fitted, parameters.body, VALLEY), count)


def _unique(
    parameters: Parameters, fitted: Fitted, entries: int | None = None, same: float = SAME
) -> Fitted:
    """Return each optimum once, best first: those that differ in the first entries (None: all)."""
    ordered = _best(fitted, len(fitted.cost))
    kept: list[int] = []
    for i, theta in enumerate(ordered.theta):
        if not np.isfinite(ordered.cost[i]):
            continue
        apart = np.where(
            parameters.circular,
            circular_distance(ordered.theta[kept], theta),
            np.abs(ordered.theta[kept] - theta),
        )[:, :entries]
        if not kept or apart.max(axis=1).min() > same:
            kept.append(i)
    if not kept:
        raise TargetError("no body was found whose simulation stays finite")
    which: NDArray[np.intp] = np.array(kept, dtype=np.intp)
    return Fitted(*(part[which] for part in ordered))
