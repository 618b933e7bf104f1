"""What replicates say together: means, bootstrap intervals, and differences within pairs.

Every interval is seeded, so that the same numbers give the same interval.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Interval = list[float]  # its two ends

RESAMPLES = 10_000
FEWEST = 5  # numbers that an interval is given for
_LEVELS = (0.025, 0.975)
_NORMAL = NormalDist()


def summarize(values: Sequence[float] | Floats) -> dict[str, Any]:
    """Return how many, mean, SD (None for one number) and 95% interval (None under five).

    Raises
    ------
    ValueError
        If there are no numbers.
    """
    data = np.asarray(values, dtype=np.float64)
    if not len(data):
        raise ValueError("values must hold at least one number; got none")
    return {
        "replicates": len(data),
        "mean": float(data.mean()),
        "sd": float(data.std(ddof=1)) if len(data) > 1 else None,
        "interval": bca_interval(data),
    }


def bca_interval(data: Floats, resamples: int = RESAMPLES) -> Interval | None:
    """Return a 95% bootstrap interval of the mean, or None for under five numbers.

    Bias-corrected and accelerated (Efron and Tibshirani 1993, 14.3), with the quantiles of
    Student's t in place of the normal's, as a small sample's spread is too small (Hesterberg
    2015, 3.3). It never leaves the range of the numbers, which a studentised interval does where
    one replicate failed and the others agree.

    Parameters
    ----------
    data
        Shape (n,).
    resamples
        How many.
    """
    count = len(data)
    if count < FEWEST:
        return None
    mean = float(data.mean())
    if np.ptp(data) == 0:
        return [mean, mean]
    means = data[_draws(count, resamples)].mean(axis=1)
    # Ties with the mean count by half; they are common in samples of few different numbers.
    below = float(np.mean(means < mean) + np.mean(means <= mean)) / 2
    bias = _NORMAL.inv_cdf(min(max(below, 1 / resamples), 1 - 1 / resamples))
    deviation = data - mean
    acceleration = float((deviation**3).sum() / (6 * (deviation**2).sum() ** 1.5))
    reach = math.sqrt(count / (count - 1)) * _student_quantile(_LEVELS[1], count - 1)
    levels = []
    for end in (-reach, reach):
        shifted = bias + end
        levels.append(_NORMAL.cdf(bias + shifted / (1 - acceleration * shifted)))
    return [float(end) for end in np.quantile(means, levels)]


def studentized_interval(data: Floats) -> Interval | None:
    """Return the studentised bootstrap's 95% interval of the mean, or None for under 5 numbers.

    The percentile bootstrap of so few numbers is too narrow; studentising each resample mends
    that (Efron and Tibshirani 1993, 12.5).
    """
    if len(data) < FEWEST:
        return None
    spread = data.std(ddof=1)
    if spread == 0:
        return [float(data.mean())] * 2
    samples = data[_draws(len(data))]
    spreads = samples.std(axis=1, ddof=1)
    fair = spreads > 1e-9 * spread
    pivots = (samples.mean(axis=1)[fair] - data.mean()) / spreads[fair]
    high, low = np.quantile(pivots, _LEVELS)
    return [float(data.mean() - low * spread), float(data.mean() - high * spread)]


def ratio_interval(above: Floats, below: Floats) -> Interval | None:
    """Return the percentile interval at 95% of a ratio of paired means, or None for under 5."""
    if len(above) < FEWEST:
        return None
    draws = _draws(len(above))
    ratios = above[draws].mean(axis=1) / below[draws].mean(axis=1)
    return [float(q) for q in np.quantile(ratios, _LEVELS)]


def percentile_band(curves: Floats, resamples: int = 2000) -> tuple[Floats, Floats]:
    """Return the percentile interval at 95% of the mean of curves (n, points), for pictures.

    Returns
    -------
    low, high
        Shape (points,) each; both are the mean for under five curves.
    """
    if len(curves) < FEWEST:
        mean = curves.mean(axis=0)
        return mean, mean
    means = np.array([curves[draw].mean(axis=0) for draw in _draws(len(curves), resamples)])
    low, high = np.quantile(means, _LEVELS, axis=0)
    return low, high


def paired_difference(first: Mapping[int, float], second: Mapping[int, float]) -> dict[str, Any]:
    """Return first less second within the seeds that both have.

    Parameters
    ----------
    first, second
        Seed to outcome.

    Returns
    -------
    dict
        As ``summarize``, of the differences, and ``wins`` and ``losses`` of the first with
        ``sign_test_p``, the chance of as lopsided a count.

    Raises
    ------
    ValueError
        If no seed is in both.
    """
    seeds = sorted(first.keys() & second.keys())
    if not seeds:
        raise ValueError("first and second must have a seed in common; they have none")
    gains = [first[seed] - second[seed] for seed in seeds]
    return summarize(gains) | {
        "wins": sum(gain > 0 for gain in gains),
        "losses": sum(gain < 0 for gain in gains),
        "sign_test_p": sign_test(gains),
    }


def sign_test(gains: Sequence[float]) -> float:
    """Return the exact two-sided p of so many gains and losses by chance; ties do not count."""
    wins, losses = sum(g > 0 for g in gains), sum(g < 0 for g in gains)
    count = wins + losses
    tail = sum(math.comb(count, k) for k in range(min(wins, losses) + 1)) / 2**count
    return min(1.0, 2.0 * float(tail))


def rank_correlation(x: Floats, y: Floats) -> float | None:
    """Return Spearman's rank correlation of (n,) and (n,); None if either is constant."""
    if len(x) < 2 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return None
    return float(np.corrcoef(_ranks(x), _ranks(y))[0, 1])


def _ranks(values: Floats) -> Floats:
    """Return ranks from 0; equals share the mean of theirs."""
    _, group, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    ranks: Floats = (last - (counts + 1) / 2)[group]
    return ranks


def _draws(count: int, resamples: int = RESAMPLES) -> NDArray[np.intp]:
    # A fixed seed: the same results give the same report.
    return np.random.default_rng(0).integers(0, count, (resamples, count))


def _student_quantile(level: float, freedom: int) -> float:
    """Return a quantile of Student's t by its expansion in 1 / freedom.

    Within 0.01 from four degrees of freedom on (Abramowitz and Stegun 1964, 26.7.5).
    """
    z: float = _NORMAL.inv_cdf(level)
    terms = (
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160,
    )
    return z + sum(float(term / freedom**power) for power, term in enumerate(terms, start=1))
