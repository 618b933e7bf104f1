from __future__ import annotations

import numpy as np
import pytest

from eea.report import statistics
from eea.report.statistics import (
    FEWEST,
    bca_interval,
    paired_difference,
    percentile_band,
    rank_correlation,
    ratio_interval,
    sign_test,
    studentized_interval,
    summarize,
)

SKEWED = np.array([1.0, 1.1, 1.2, 1.2, 1.3, 1.5, 2.0, 3.5, 6.0, 9.0])


def test_a_summary_by_hand():
    assert summarize([1.0, 2.0, 6.0]) == {
        "replicates": 3,
        "mean": 3.0,
        "sd": pytest.approx(7**0.5),
        "interval": None,
    }
    assert summarize([2.0])["sd"] is None
    assert len(summarize(np.arange(float(FEWEST)))["interval"]) == 2
    with pytest.raises(ValueError, match="at least one number"):
        summarize([])


@pytest.mark.parametrize("interval", [bca_interval, studentized_interval])
def test_an_interval_is_of_enough_numbers_and_the_same_each_time(interval):
    assert interval(SKEWED[: FEWEST - 1]) is None
    assert interval(np.full(6, 0.3)) == [pytest.approx(0.3)] * 2
    assert interval(SKEWED) == interval(SKEWED.copy())


def test_an_interval_moves_and_stretches_with_the_numbers():
    low, high = bca_interval(SKEWED)
    assert bca_interval(10 - 2 * SKEWED) == pytest.approx([10 - 2 * high, 10 - 2 * low], rel=0.01)


def test_the_correction_leans_towards_the_longer_tail():
    low, high = bca_interval(SKEWED)
    plain_low, plain_high = percentile_band(SKEWED[:, None])
    assert low > plain_low[0]
    assert high - SKEWED.mean() > 1.2 * (plain_high[0] - SKEWED.mean())


def test_one_failure_among_equals_does_not_take_the_interval_out_of_range():
    almost = np.append(np.linspace(0.99, 0.992, 24), 0.6)
    low, high = bca_interval(almost)
    assert 0.6 <= low < almost.mean() < high <= 0.992
    assert studentized_interval(almost)[0] < 0.0, "which is why it is not used here"


@pytest.mark.parametrize(
    ("draw", "mean"),
    [
        (lambda rng, n: rng.normal(size=n), 0.0),
        (lambda rng, n: 1 - rng.beta(1, 8, size=n), 8 / 9),  # as final OBJ_FIT: a tail below
    ],
    ids=["normal", "skewed"],
)
@pytest.mark.parametrize("count", [8, 25])
def test_intervals_hold_the_mean_about_as_often_as_they_say(draw, mean, count):
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(300):
        low, high = bca_interval(draw(rng, count), 500)
        held += low <= mean <= high
    assert 0.90 <= held / 300 <= 0.985


def test_students_quantiles_are_those_of_the_tables():
    table = {4: 2.776, 9: 2.262, 24: 2.064, 1000: 1.962}
    for freedom, quantile in table.items():
        assert statistics._student_quantile(0.975, freedom) == pytest.approx(quantile, abs=1e-3)
        assert statistics._student_quantile(0.025, freedom) == pytest.approx(-quantile, abs=1e-3)


def test_differences_are_taken_within_the_seeds_that_both_have():
    first = {0: 5.0, 1: 4.0, 2: 9.0, 7: 100.0}
    second = {2: 6.0, 1: 5.0, 0: 1.0, 8: -100.0}
    found = paired_difference(first, second)
    assert found["replicates"] == 3
    assert found["mean"] == pytest.approx((4 - 1 + 3) / 3)
    assert (found["wins"], found["losses"]) == (2, 1)
    assert found["sign_test_p"] == 1.0
    with pytest.raises(ValueError, match="a seed in common"):
        paired_difference({0: 1.0}, {1: 1.0})


def test_pairing_removes_what_the_seeds_share():
    rng = np.random.default_rng(2)
    luck = rng.normal(0.0, 1.0, 20)
    first = {seed: float(luck[seed] + 0.1 + 0.01 * rng.normal()) for seed in range(20)}
    second = {seed: float(luck[seed]) for seed in range(20)}
    low, high = paired_difference(first, second)["interval"]
    assert 0.08 < low < 0.1 < high < 0.12


def test_the_sign_test_by_hand():
    assert sign_test([1.0] * 10) == pytest.approx(2 / 2**10)
    assert sign_test([1.0] * 8 + [-1.0, 0.0, 0.0]) == pytest.approx(2 * (1 + 9) / 2**9)
    assert sign_test([1.0, -1.0, 0.0]) == 1.0
    assert sign_test([0.0]) == 1.0


def test_a_band_is_the_percentile_interval_of_each_point():
    rng = np.random.default_rng(0)
    curves = rng.normal([0.0, 5.0], [1.0, 0.1], (25, 2))
    low, high = percentile_band(curves)
    means = curves.mean(axis=0)
    normal = 1.96 * curves.std(axis=0) / 5
    assert means - low == pytest.approx(normal, rel=0.15)
    assert high - means == pytest.approx(normal, rel=0.15)
    few = percentile_band(curves[:4])
    assert [side.tolist() for side in few] == [curves[:4].mean(axis=0).tolist()] * 2


def test_a_ratio_holds_the_ratio_of_the_means():
    rng = np.random.default_rng(1)
    low, high = ratio_interval(rng.normal(3, 0.1, 10), rng.normal(6, 0.1, 10))
    assert 0.47 < low < 0.5 < high < 0.53
    assert ratio_interval(SKEWED[:4], SKEWED[:4]) is None


def test_a_rank_correlation_by_hand():
    x, y = np.array([1.0, 2.0, 2.0, 3.0]), np.array([1.0, 30.0, 2.0, 400.0])
    assert rank_correlation(x, y) == pytest.approx(4.5 / 22.5**0.5)
    assert rank_correlation(x, -x) == pytest.approx(-1.0)
    assert rank_correlation(x, np.ones(4)) is None
    assert rank_correlation(x[:1], y[:1]) is None
