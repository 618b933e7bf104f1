from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from eea.study.statistics import (
    FEWEST_VALUES,
    curve_interval,
    interval,
    paired_difference,
    ratio_interval,
    sign_test,
    summary_statistics,
)

SKEWED = np.array([1.0, 1.1, 1.2, 1.2, 1.3, 1.5, 2.0, 3.5, 6.0, 9.0])


def test_a_summary_by_hand():
    assert summary_statistics([1.0, 2.0, 6.0]) == {
        "replicates": 3,
        "mean": 3.0,
        "sd": pytest.approx(7**0.5),
        "interval": None,
    }
    assert summary_statistics([2.0])["sd"] is None
    assert len(summary_statistics(np.arange(float(FEWEST_VALUES)))["interval"]) == 2


def test_an_interval_is_of_enough_numbers_and_the_same_each_time():
    assert interval(SKEWED[: FEWEST_VALUES - 1]) is None
    assert interval(np.full(6, 0.3)) == [pytest.approx(0.3)] * 2
    assert interval(SKEWED) == interval(SKEWED.copy())


def test_one_failure_among_equals_does_not_take_the_interval_out_of_range():
    almost = np.append(np.linspace(0.99, 0.992, 24), 0.6)
    low, high = interval(almost)
    assert 0.6 <= low < almost.mean() < high <= 0.992


@pytest.mark.parametrize(
    ("draw", "mean"),
    [
        (lambda rng, shape: rng.normal(size=shape), 0.0),
        (lambda rng, shape: 1 - rng.beta(1, 8, size=shape), 8 / 9),  # as OBJ_FIT: a tail below
    ],
    ids=["normal", "skewed"],
)
@pytest.mark.parametrize(("count", "least"), [(5, 0.85), (8, 0.90), (10, 0.90), (25, 0.90)])
def test_intervals_hold_the_mean_about_as_often_as_they_say(draw, mean, count, least):
    samples = draw(np.random.default_rng(5), (count, 800))

    def held(ends):
        return np.mean((ends[0] <= mean) & (mean <= ends[1]))

    ours = held(curve_interval(samples))
    assert least <= ours <= 0.985
    for method in ("percentile", "BCa"):
        plain = stats.bootstrap(
            (samples,), np.mean, method=method, n_resamples=1000, batch=200,
            rng=np.random.default_rng(0),
        ).confidence_interval  # fmt: skip
        assert held((plain.low, plain.high)) < ours - (0.03 if count <= 10 else 0.0)


def test_differences_are_taken_within_the_seeds_that_both_have():
    first = {0: 5.0, 1: 4.0, 2: 9.0, 7: 100.0}
    second = {2: 6.0, 1: 5.0, 0: 1.0, 8: -100.0}
    found = paired_difference(first, second)
    assert found["replicates"] == 3
    assert found["mean"] == pytest.approx((4 - 1 + 3) / 3)
    assert (found["wins"], found["losses"]) == (2, 1)
    assert found["sign_test_p"] == 1.0


def test_the_sign_test_by_hand():
    assert sign_test([1.0] * 10) == pytest.approx(2 / 2**10)
    assert sign_test([1.0] * 8 + [-1.0, 0.0, 0.0]) == pytest.approx(2 * (1 + 9) / 2**9)
    assert sign_test([1.0, -1.0, 0.0]) == 1.0
    assert sign_test([0.0]) == 1.0


def test_a_curves_interval_is_that_of_each_of_its_points():
    curves = np.random.default_rng(0).normal([0.0, 5.0, 1.0], [1.0, 0.1, 0.0], (25, 3))
    low, high = curve_interval(curves)
    assert (low[2], high[2]) == (1.0, 1.0)
    assert [low[1], high[1]] == pytest.approx(interval(curves[:, 1]), abs=0.003)
    few = curve_interval(curves[:4])
    assert [side.tolist() for side in few] == [curves[:4].mean(axis=0).tolist()] * 2


def test_a_ratio_holds_the_ratio_of_the_means():
    rng = np.random.default_rng(1)
    low, high = ratio_interval(rng.normal(3, 0.1, 10), rng.normal(6, 0.1, 10))
    assert 0.47 < low < 0.5 < high < 0.53
    assert ratio_interval(SKEWED[:4], SKEWED[:4]) is None
