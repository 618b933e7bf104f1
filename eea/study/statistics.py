"""Means with bootstrap intervals, and paired differences.

Intervals of a mean, of each point of a curve, and of a ratio of paired means use one bootstrap. It
is seeded, so that the same numbers give the same interval.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from eea.core.angles import Floats

Ends = list[float]  # the two ends

BOOTSTRAP_RESAMPLES = 10_000
FEWEST_VALUES = 5  # least count for an interval


def interval(values: ArrayLike) -> Ends | None:
    """Return a 95% bootstrap interval of the mean of (n,) numbers, or None for under five.

    The bootstrap is bias-corrected and accelerated (Efron and Tibshirani 1993, 14.3). Its level
    replaces normal quantiles by Student's, because the spread of a small sample is too small
    (Hesterberg 2015, 3.3). The interval stays within the range of the numbers. Of 5, 10 and 25
    numbers as skewed as a final OBJ_FIT it covers the mean in 88, 92 and 93% of cases.
    """
    data = np.asarray(values, dtype=np.float64)
    return None if len(data) < FEWEST_VALUES else [float(end) for end in _bootstrap(np.mean, data)]


def ratio_interval(above: ArrayLike, below: ArrayLike) -> Ends | None:
    """Return the interval of the ratio of two means of paired (n,) numbers, None for under five."""
    pairs = [np.asarray(values, dtype=np.float64) for values in (above, below)]
    if len(pairs[0]) < FEWEST_VALUES:
        return None

    def ratio(first: Floats, second: Floats, axis: int) -> Floats:
        quotient: Floats = first.mean(axis=axis) / second.mean(axis=axis)
        return quotient

    return [float(end) for end in _bootstrap(ratio, *pairs)]


def curve_interval(curves: Floats) -> tuple[Floats, Floats]:
    """Return the interval's ends at each point of curves (n, points); the mean for under five."""
    if len(curves) < FEWEST_VALUES:
        return curves.mean(axis=0), curves.mean(axis=0)
    return _bootstrap(np.mean, curves, resamples=2000)


def _bootstrap(
    statistic: Callable[..., Any], *samples: Floats, resamples: int = BOOTSTRAP_RESAMPLES
) -> tuple[Any, Any]:
    """Return the two ends of a statistic's interval over the first axis of paired samples."""
    count = len(samples[0])
    reach = math.sqrt(count / (count - 1)) * stats.t.ppf(0.975, count - 1)
    with warnings.catch_warnings():
        # Equal numbers have a point as their interval.
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)
        warnings.simplefilter("ignore", RuntimeWarning)
        ends = stats.bootstrap(
            samples, statistic, paired=True, vectorized=True, n_resamples=resamples, batch=500,
            confidence_level=2.0 * stats.norm.cdf(reach) - 1.0, rng=np.random.default_rng(0),
        ).confidence_interval  # fmt: skip
    estimate = statistic(*samples, axis=0)
    low, high = (np.where(np.isnan(end), estimate, end) for end in (ends.low, ends.high))
    return low, high


def summary_statistics(values: ArrayLike) -> dict[str, Any]:
    """Return the count, mean, SD (None for one number) and 95% interval (None under five)."""
    data = np.asarray(values, dtype=np.float64)
    return {
        "replicates": len(data),
        "mean": float(data.mean()),
        "sd": float(data.std(ddof=1)) if len(data) > 1 else None,
        "interval": interval(data),
    }


def paired_difference(first: Mapping[int, float], second: Mapping[int, float]) -> dict[str, Any]:
    """Return a summary of first minus second over the seeds that both have.

    Each maps a seed to its outcome. ``wins`` and ``losses`` count the first's.
    """
    seeds = sorted(first.keys() & second.keys())
    gains = [first[seed] - second[seed] for seed in seeds]
    return summary_statistics(gains) | {
        "wins": sum(gain > 0 for gain in gains),
        "losses": sum(gain < 0 for gain in gains),
        "sign_test_p": sign_test(gains),
    }


def sign_test(gains: Sequence[float]) -> float:
    """Return the exact two-sided p-value of the sign test of gains; ties do not count."""
    wins = sum(g > 0 for g in gains)
    losses = sum(g < 0 for g in gains)
    return float(stats.binomtest(wins, wins + losses).pvalue) if wins + losses else 1.0
