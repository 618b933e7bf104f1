"""Are the intervals honest? Coverage over many truths, and ranks of truths among draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import binomtest, chisquare, t

from eea.core.angles import TURN

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Coverage:
    """The share of truths that their intervals hold.

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
    #: Its interval: Student's, over the replicates' shares, since one replicate's parameters are
    #: not independent; None for one replicate.
    overall_interval: tuple[float, float] | None


def coverage(
    truths: ArrayLike,
    lows: ArrayLike,
    highs: ArrayLike,
    circular: ArrayLike = False,
    confidence: float = 0.95,
) -> Coverage:
    """Count how often intervals hold the truth: arrays (R, P) of R replicates.

    Parameters that are ``circular`` (P,) are angles in rad, whose interval goes from low on to
    high. ``confidence`` is that of the intervals of the shares.
    """
    truths, lows, highs = (np.asarray(a, dtype=np.float64) for a in (truths, lows, highs))
    around = (truths - lows) % TURN <= highs - lows
    held = np.where(circular, around, (truths >= lows) & (truths <= highs))
    count, hits, each = len(held), held.sum(axis=0), held.mean(axis=1)
    ends = [binomtest(int(k), count).proportion_ci(confidence) for k in hits]
    overall, interval = float(each.mean()), None
    if count > 1:
        quantile = float(t.ppf(0.5 + 0.5 * confidence, count - 1))
        reach = quantile * each.std(ddof=1) / count**0.5
        interval = (max(overall - reach, 0.0), min(overall + reach, 1.0))
    low, high = np.transpose([(end.low, end.high) for end in ends])
    return Coverage(hits / count, low, high, overall, interval)


def ranks(
    samples: ArrayLike, truth: ArrayLike, rng: np.random.Generator, circular: ArrayLike = False
) -> NDArray[np.int64]:
    """Return how many of ``samples`` (S, P) are less than the truth (P,): ranks from 0 to S.

    With the truth drawn from the prior, and independent samples from an exact posterior, every rank
    is as probable (S. Talts et al., "Validating Bayesian inference algorithms with simulation-based
    calibration", 2018). Equal numbers, as at a bound, are ranked at random; angles are ranked from
    a random origin.

    Examples
    --------
    >>> ranks([[0.1], [0.4], [0.7]], [0.5], np.random.default_rng(0))
    array([2])
    """
    samples, truth = np.asarray(samples), np.asarray(truth)
    origin = rng.uniform(0.0, TURN, len(truth))
    samples = np.where(circular, (samples - origin) % TURN, samples)
    truth = np.where(circular, (truth - origin) % TURN, truth)
    ties = (samples == truth).sum(axis=0)
    below: NDArray[np.int64] = (samples < truth).sum(axis=0) + rng.integers(0, ties + 1)
    return below


def rank_uniformity(ranks: ArrayLike, samples: int, bins: int | None = None) -> Floats:
    """Return the p-value (P,) of ranks (R, P), 0 to ``samples``, being uniform.

    Chi-square over bins of equally many ranks, give or take one: by default at most 20, and as many
    as leave five replicates in each.

    Examples
    --------
    >>> even = np.arange(100)[:, None] % 10
    >>> rank_uniformity(np.hstack([even, even // 2]), samples=9).round(3)
    array([1., 0.])
    """
    counted = np.asarray(ranks)
    bins = bins or min(20, samples + 1, len(counted) // 5)
    edges = np.round(np.linspace(0, samples + 1, bins + 1)) - 0.5
    expected = np.diff(edges) / (samples + 1) * len(counted)
    return np.array(
        [chisquare(np.histogram(column, edges)[0], expected).pvalue for column in counted.T]
    )
