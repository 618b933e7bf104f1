"""The posterior of one hypothesis: a mixture of truncated normal distributions at its optima."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from eea.core.angles import TURN, Floats, wrap
from eea.core.checks import real
from eea.infer.box_normal import LEAST_PRECISION, BoxNormal
from eea.infer.laplace import Laplace

SUMMARY_DRAWS = 4096  # a 5% quantile is then between the 4.3% and the 5.7% quantile
#: Two equal normal densities have two peaks only if their centres are more than two sd apart.
PEAK_DISTANCE_SDS = 2.0
# An interval is one-sided above this ratio of the densities at a bound and at the far end.
ONE_SIDED_DENSITY_RATIO = 1.25


@dataclass(frozen=True, eq=False)
class Mode(Laplace):
    """One optimum of -log posterior and its shape there."""

    cost: float  #: -log posterior at ``theta``, up to a constant common to all modes.


def distinct(modes: Sequence[Mode], circular: NDArray[np.bool_]) -> tuple[Mode, ...]:
    """Return the modes, best first, without duplicates.

    A mode is a duplicate if a better one's quadratic puts it within two standard deviations. Along
    directions without information everything is near, so an absent fin's angles are one mode.
    """
    kept: list[Mode] = []
    for mode in sorted(modes, key=lambda m: m.cost):
        for better in kept:
            way = mode.theta - better.theta
            way = np.where(circular, wrap(way), way)
            rise = better.gradient @ way + 0.5 * way @ better.information @ way
            if rise <= 0.5 * PEAK_DISTANCE_SDS**2:
                break
        else:
            kept.append(mode)
    return tuple(kept)


LEAST_APART = 0.01  # of a range: answers that differ by less are one
LEAST_WEIGHT = 0.05  # of an answer: less probable ones are left out


def answers(posterior: Mixture, entries: NDArray[np.intp]) -> list[tuple[float, Mode]]:
    """Return the answers on some entries that are apart, with their probabilities, best first.

    Modes whose entries all differ by less than two standard deviations, or a hundredth of the
    range, are one answer.
    """
    found: list[tuple[float, Mode, Floats]] = []
    least = LEAST_APART * (posterior.high - posterior.low)[entries]
    for k in np.argsort(-posterior.weights, kind="stable"):
        mode = posterior.modes[k]
        weight = float(posterior.weights[k])
        spread = np.sqrt(np.diag(mode.covariance(LEAST_PRECISION))[entries])
        for at, (known, one, wide) in enumerate(found):
            apart = np.abs(mode.theta - one.theta)[entries]
            if (apart <= np.maximum(PEAK_DISTANCE_SDS * np.maximum(spread, wide), least)).all():
                found[at] = (known + weight, one, wide)
                break
        else:
            found.append((weight, mode, spread))
    likely = [(weight, mode) for weight, mode, _ in found if weight >= LEAST_WEIGHT]
    return sorted(likely, key=lambda pair: -pair[0])


@dataclass(frozen=True, eq=False)
class Mixture:
    """A mixture of truncated Laplace approximations, with a uniform prior inside the bounds.

    A mode's weight is its integral over the box: exp(-cost), times det(information)^(-1/2), times
    the share of the normal distribution inside (MacKay 2003, ch. 27; Bornkamp 2011 for mixtures).

    Examples
    --------
    >>> mode = Mode(np.array([0.02, 0.5]), np.diag([400.0, 0.0]), np.zeros(2), 0.0)
    >>> straight = np.zeros(2, dtype=np.bool_)
    >>> found = Mixture(("width", "thickness"), np.zeros(2), np.ones(2), straight, [mode])
    >>> low, high = found.interval(0.9)
    >>> np.round(high - low, 1)  # there is no information on the thickness
    array([0.1, 0.9])
    """

    names: tuple[str, ...]  #: Names of the P parameters.
    low: Floats  #: Lower bounds (P,); -pi where circular.
    high: Floats  #: Upper bounds (P,); pi where circular.
    circular: NDArray[np.bool_]  #: Whether a parameter is an angle (P,).
    modes: Sequence[Mode]  #: The modes without duplicates, best first.

    def __post_init__(self) -> None:
        object.__setattr__(self, "low", np.where(self.circular, -np.pi, self.low))
        object.__setattr__(self, "high", np.where(self.circular, np.pi, self.high))
        object.__setattr__(self, "modes", distinct(self.modes, self.circular))

    @cached_property
    def components(self) -> tuple[BoxNormal, ...]:
        """Each mode's distribution; an angle's box is the turn around it, not yet wrapped."""
        shapes = []
        for mode in self.modes:
            low = np.where(self.circular, mode.theta - np.pi, self.low)
            high = np.where(self.circular, mode.theta + np.pi, self.high)
            at = np.clip(mode.theta, low, high)
            shapes.append(BoxNormal(at, mode.information, mode.gradient, low, high))
        return tuple(shapes)

    @cached_property
    def weights(self) -> Floats:
        """The modes' probabilities, shape (modes,)."""
        return np.exp(self._log_masses - self.log_evidence)

    @property
    def log_evidence(self) -> float:
        """Log of the integral of exp(-cost) over the box, all modes together.

        It compares hypotheses about the same data (MacKay, ch. 28). The caller adds the prior's
        density: 1 for uniform shares, 1/2pi for angles.
        """
        return float(np.logaddexp.reduce(self._log_masses))

    @cached_property
    def _log_masses(self) -> Floats:
        return np.array(
            [p.log_volume - m.cost for p, m in zip(self.components, self.modes, strict=True)]
        )

    def sample(self, count: int, rng: np.random.Generator) -> Floats:
        """Return ``count`` independent draws, shape (count, P), angles in [-pi, pi)."""
        shares = rng.multinomial(count, self.weights)
        drawn = np.concatenate(
            [part.sample(n, rng) for part, n in zip(self.components, shares, strict=True) if n]
            or [np.empty((0, len(self.names)))]
        )
        return rng.permutation(np.where(self.circular, wrap(drawn), drawn))

    @cached_property
    def draws(self) -> Floats:
        """The (4096, P) draws that all summaries use, always the same."""
        return self.sample(SUMMARY_DRAWS, np.random.default_rng(0))

    def interval(self, mass: float = 0.9) -> tuple[Floats, Floats]:
        """Return the ends, (P,) and (P,), of each parameter's interval, which holds its median.

        See :func:`intervals`.
        """
        low, high = intervals(self.draws, self.low, self.high, self.circular, mass)
        return holding(low, high, self.median(), self.circular)[:2]

    def median(self) -> Floats:
        """Return the medians (P,), which minimise Eq. 4's error; circular means of angles."""
        middle = np.median(self.draws, axis=0)
        return np.where(self.circular, self._mean_angles, middle)

    @cached_property
    def correlation(self) -> Floats:
        """The correlations (P, P), for an angle of its deviations from the circular mean."""
        draws = self.draws
        turned = wrap(draws - self._mean_angles)
        moved = draws - draws.mean(axis=0)
        deviations = np.where(self.circular, turned, moved)
        sd = np.sqrt(np.mean(deviations**2, axis=0))
        scaled = deviations / np.maximum(sd, 1e-300)
        matrix = scaled.T @ scaled / len(scaled)
        np.fill_diagonal(matrix, 1.0)
        return np.asarray(matrix)

    @cached_property
    def _mean_angles(self) -> Floats:
        return np.asarray(np.angle(np.exp(1j * self.draws).mean(axis=0)))


def log_constant(
    mean: Floats, information: Floats, low: Floats, high: Floats, circular: NDArray[np.bool_]
) -> float:
    """Return the log of a prior's greatest density: normal, or uniform without information.

    ``mean`` (P,) and ``information`` (P, P) are of the normal, which is truncated to the bounds
    ``low`` and ``high`` (P,) of each parameter alone. Angles are uniform over the turn.
    """
    informed = np.diag(information) > 0.0
    free = ~informed & ~circular  # uniform between the bounds
    information = information[np.ix_(informed, informed)]
    mean = mean[informed]
    sd = np.sqrt(np.diag(np.linalg.inv(information)))
    above = log_ndtr((high[informed] - mean) / sd)
    below = log_ndtr((low[informed] - mean) / sd)
    mass = above + np.log1p(-np.exp(below - above))  # inside the bounds, of each alone
    mass = np.append(mass, np.log(high[free] - low[free]))
    normal = 0.5 * np.linalg.slogdet(information / (2.0 * np.pi))[1] - mass.sum()
    return float(normal - np.count_nonzero(circular) * np.log(2.0 * np.pi))


def intervals(
    draws: Floats, low: Floats, high: Floats, circular: NDArray[np.bool_], mass: float = 0.9
) -> tuple[Floats, Floats]:
    """Return the ends (P,) of intervals that each hold a share ``mass`` of the draws (S, P).

    Intervals are equal-tailed, so they do not depend on the unit. But an equal-tailed interval
    never reaches a bound, and so never holds a missing fin. Where the density is higher at a bound
    than at the far end of the 90% that begin there, the interval therefore begins at the bound. A
    wider interval includes a narrower one, and all hold the median. The interval of an angle is
    the shortest arc, from low in [-pi, pi) to high, which may exceed pi.

    Raises
    ------
    ConfigurationError
        If ``mass`` is not in [0, 1].
    """
    real("mass", mass, 0.0, 1.0)
    tail = 0.5 * (1.0 - mass)
    one, two, near, start, end, far, three, four = np.quantile(
        draws, [0.05, 0.15, 0.1, tail, 1.0 - tail, 0.9, 0.85, 0.95], axis=0
    )
    # A tenth of the draws lies between each pair, so a distance is proportional to 1/density.
    at_low = four - three > ONE_SIDED_DENSITY_RATIO * (near - low)
    at_high = two - one > ONE_SIDED_DENSITY_RATIO * (high - far)
    one_sided = (at_low != at_high) & ~circular
    to, since = np.quantile(draws, [mass, 1.0 - mass], axis=0)
    start = np.where(one_sided, np.where(at_low, low, since), start)
    end = np.where(one_sided, np.where(at_low, to, high), end)
    middle = np.median(draws, axis=0)  # one-sided intervals of under half of the draws miss it
    start = np.minimum(start, middle)
    end = np.maximum(end, middle)
    for k in np.flatnonzero(circular):
        start[k], end[k] = _shortest_arc(draws[:, k], mass)
    return start, end


def holding(
    low: Floats, high: Floats, point: Floats, circular: NDArray[np.bool_]
) -> tuple[Floats, Floats, Floats]:
    """Return intervals (P,), widened to hold an estimate ``point`` (P,), and the estimate.

    An estimate and its interval may come from different posteriors: without and with model
    discrepancy. The arc of an angle is widened on its nearer side. The returned estimate is turned
    by 2 pi if needed to lie inside, so it may exceed pi, as the end of the arc may.

    Examples
    --------
    >>> ends = np.array([0.2, 3.0]), np.array([0.4, 3.4])
    >>> low, high, point = holding(*ends, np.array([0.5, -3.0]), np.array([False, True]))
    >>> low.tolist(), high.tolist(), point.round(3).tolist()
    ([0.2, 3.0], [0.5, 3.4], [0.5, 3.283])
    """
    past_low = (point - low) % TURN  # from the low end to the point
    past_high = past_low - (high - low)
    before = circular & (past_high > 0.0) & (TURN - past_low < past_high)
    at = np.where(circular, low + past_low - TURN * before, point)
    return np.minimum(low, at), np.maximum(high, at), at


def _shortest_arc(angles: Floats, mass: float) -> tuple[float, float]:
    """Return the ends of the shortest arc with a share ``mass`` of ``angles`` in [-pi, pi)."""
    ordered = np.sort(angles)
    inside = max(int(np.ceil(mass * len(ordered))), 1)
    ends = np.concatenate([ordered, ordered + TURN])[inside - 1 :][: len(ordered)]
    first = int(np.argmin(ends - ordered))
    return float(ordered[first]), float(ends[first])
