"""Are the intervals honest? Coverage over many truths, and ranks of truths among draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import beta, chisquare, t

from eea.core.angles import TURN
from eea.core.checks import ConfigurationError, brief, finite, real, whole

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]
Truths = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Coverage:
    """The share of truths that their intervals hold, and how surely it is known.

    Examples
    --------
    >>> found = coverage([[0.1], [0.5], [0.9]], np.zeros((3, 1)), np.full((3, 1), 0.6))
    >>> found.share, np.round(found.low, 2), np.round(found.high, 2)
    (array([0.66666667]), array([0.09]), array([0.99]))
    """

    share: Floats  #: (P,)
    low: Floats  #: (P,) and ``high``: its exact binomial interval (Clopper and Pearson 1934).
    high: Floats
    overall: float  #: Over all parameters.
    #: Its interval: Student's, over the replicates' shares, as one replicate's parameters go
    #: together; None for one replicate.
    overall_interval: tuple[float, float] | None


def coverage(
    truths: ArrayLike,
    lows: ArrayLike,
    highs: ArrayLike,
    circular: ArrayLike | None = None,
    confidence: float = 0.95,
) -> Coverage:
    """Count how often intervals hold the truth.

    Parameters
    ----------
    truths, lows, highs
        (R, P), of R replicates: the truth, and its interval's ends, which belong to it.
    circular
        (P,): which are angles, rad, whose interval goes from low on to high; none if not given.
    confidence
        Of the intervals of the shares.

    Raises
    ------
    ConfigurationError
        If shapes differ or there is no replicate.
    """
    truths = finite("truths", truths, (None, None))
    lows, highs = finite("lows", lows, truths.shape), finite("highs", highs, truths.shape)
    real("confidence", confidence, 0.0, 1.0)
    turning = _circular(circular, truths.shape[1])
    if not truths.size:
        raise ConfigurationError(f"truths must hold at least one; got shape {truths.shape}")
    around = (truths - lows) % TURN <= highs - lows
    held = np.where(turning, around, (truths >= lows) & (truths <= highs))
    count, hits = len(held), held.sum(axis=0)
    rest = 0.5 * (1.0 - confidence)
    low = np.where(hits == 0, 0.0, beta.ppf(rest, np.maximum(hits, 1), count - hits + 1))
    high = np.where(hits == count, 1.0, beta.ppf(1.0 - rest, hits + 1, np.maximum(count - hits, 1)))
    each = held.mean(axis=1)
    overall, interval = float(each.mean()), None
    if count > 1:
        reach = float(t.ppf(1.0 - rest, count - 1) * each.std(ddof=1) / count**0.5)
        interval = (max(overall - reach, 0.0), min(overall + reach, 1.0))
    return Coverage(hits / count, low, high, overall, interval)


def ranks(
    samples: ArrayLike,
    truth: ArrayLike,
    rng: np.random.Generator,
    circular: ArrayLike | None = None,
) -> Whole:
    """Return how many of ``samples`` are less than the truth, (P,), each 0 to S.

    With the truth drawn from the prior, and independent samples from an exact posterior, every rank
    is as probable (S. Talts et al., "Validating Bayesian inference algorithms with simulation-based
    calibration", 2018). Equal numbers, as at a bound, are ranked at random; angles are ranked from
    a random origin.

    Parameters
    ----------
    samples
        (S, P), of one posterior.
    truth
        (P,), what it was to find.
    rng
        For ties and origins.
    circular
        (P,): which are angles, rad; none if not given.

    Examples
    --------
    >>> ranks([[0.1], [0.4], [0.7]], [0.5], np.random.default_rng(0))
    array([2])
    """
    samples = finite("samples", samples, (None, None))
    size = samples.shape[1]
    truth = finite("truth", truth, (size,))
    turning = _circular(circular, size)
    origin = rng.uniform(0.0, TURN, size)
    samples = np.where(turning, (samples - origin) % TURN, samples)
    truth = np.where(turning, (truth - origin) % TURN, truth)
    ties = (samples == truth).sum(axis=0)
    below: Whole = (samples < truth).sum(axis=0) + rng.integers(0, ties + 1)
    return below


def rank_uniformity(ranks: ArrayLike, samples: int, bins: int | None = None) -> Floats:
    """Return the chance, (P,), of ranks as uneven as these if all were as probable.

    Chi-square over bins, of equally many ranks but for one; with five replicates or more in each.

    Parameters
    ----------
    ranks
        (R, P), of R replicates, each 0 to ``samples``.
    samples
        How many draws each truth was ranked among.
    bins
        At most 20 by default, and as many as leave five replicates in each.

    Raises
    ------
    ConfigurationError
        If a rank is out of range, or there are under ten replicates.

    Examples
    --------
    >>> even = np.arange(100)[:, None] % 10
    >>> rank_uniformity(np.hstack([even, even // 2]), samples=9).round(3)
    array([1., 0.])
    """
    whole("samples", samples, 1)
    counted = finite("ranks", ranks, (None, None))
    if len(counted) < 10 or (counted < 0).any() or (counted > samples).any():
        raise ConfigurationError(
            f"ranks must be of ten replicates or more, each 0 to {samples}; "
            f"got {len(counted)}: {brief(counted)}"
        )
    most = min(samples + 1, len(counted) // 5)
    bins = min(20, most) if bins is None else bins
    whole("bins", bins, 2, most)
    edges = np.round(np.linspace(0, samples + 1, bins + 1)) - 0.5
    expected = np.diff(edges) / (samples + 1) * len(counted)
    return np.array(
        [chisquare(np.histogram(column, edges)[0], expected).pvalue for column in counted.T]
    )


def _circular(circular: ArrayLike | None, size: int) -> Truths:
    """Return which of ``size`` parameters are angles."""
    turning = np.zeros(size, dtype=np.bool_) if circular is None else np.asarray(circular)
    if turning.shape != (size,) or turning.dtype != np.bool_:
        raise ConfigurationError(f"circular must be {size} truths; got shape {turning.shape}")
    return turning
