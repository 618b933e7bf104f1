from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from eea.core.checks import ConfigurationError
from tests.inference.calibration import coverage, rank_uniformity, ranks


@given(st.integers(0, 40), st.integers(1, 40))
def test_shares_have_the_exact_binomial_interval(hits, misses):
    truths = np.r_[np.full(hits, 0.5), np.full(misses, 2.0)][:, None]
    found = coverage(truths, np.zeros_like(truths), np.ones_like(truths))
    exact = stats.binomtest(hits, hits + misses).proportion_ci(0.95)
    assert found.share == pytest.approx([hits / (hits + misses)])
    assert (found.low[0], found.high[0]) == pytest.approx((exact.low, exact.high))
    assert found.overall == pytest.approx(found.share[0])


def test_all_held_and_none_held_reach_the_ends():
    truths = np.array([[0.5, 2.0]] * 20)
    found = coverage(truths, np.zeros((20, 2)), np.ones((20, 2)))
    assert found.share.tolist() == [1.0, 0.0]
    assert found.high[0] == 1.0
    assert found.low[1] == 0.0
    assert found.overall_interval == (0.5, 0.5)
    assert coverage(truths[:1], [[0, 0]], [[1, 1]]).overall_interval is None


def test_parameters_that_go_together_do_not_narrow_the_overall_interval():
    rng = np.random.default_rng(0)
    held = rng.random((200, 1)) < 0.9
    one = coverage(np.where(held, 0.5, 2.0), np.zeros((200, 1)), np.ones((200, 1)))
    nine = np.repeat(np.where(held, 0.5, 2.0), 9, axis=1)
    all_nine = coverage(nine, np.zeros((200, 9)), np.ones((200, 9)))
    assert all_nine.overall_interval == pytest.approx(one.overall_interval)


def test_an_angle_is_held_by_an_arc_across_the_turn():
    truths = [[3.1], [-3.1], [0.0], [2.0]]
    found = coverage(truths, np.full((4, 1), 3.0), np.full((4, 1), 3.4), circular=[True])
    assert found.share == pytest.approx([0.5])
    assert coverage(truths, np.full((4, 1), 3.0), np.full((4, 1), 3.4)).share[0] == 0.25


def test_ranks_of_an_exact_posterior_are_uniform_and_of_others_are_not():
    rng = np.random.default_rng(0)
    exact, narrow, shifted, wide = [], [], [], []
    for _ in range(500):
        truth = rng.normal(size=1)
        drawn = rng.normal(size=(49, 1))
        for counted, samples in (
            (exact, drawn), (narrow, 0.6 * drawn), (shifted, drawn + 0.4), (wide, 1.6 * drawn),
        ):  # fmt: skip
            counted.append(ranks(samples, truth, rng))
    assert rank_uniformity(exact, 49)[0] > 1e-3
    for wrong in (narrow, shifted, wide):
        assert rank_uniformity(wrong, 49)[0] < 1e-3


def test_truths_and_samples_at_a_bound_are_ranked_at_random():
    rng = np.random.default_rng(0)
    counted = [ranks(np.zeros((9, 1)), np.zeros(1), rng) for _ in range(500)]
    assert rank_uniformity(counted, 9)[0] > 1e-3


def test_angles_are_ranked_wherever_they_begin():
    rng = np.random.default_rng(0)
    counted, wrong = [], []
    for _ in range(400):
        middle = rng.normal(np.pi, 0.2)
        truth = (rng.normal(middle, 0.3, 1) + np.pi) % (2 * np.pi) - np.pi
        drawn = (rng.normal(middle, 0.3, (19, 1)) + np.pi) % (2 * np.pi) - np.pi
        counted.append(ranks(drawn, truth, rng, circular=[True]))
        wrong.append(ranks(drawn + 0.3, truth, rng, circular=[True]))
    assert rank_uniformity(counted, 19)[0] > 1e-3
    assert rank_uniformity(wrong, 19)[0] < 1e-3


def test_chances_of_uniform_ranks_are_uniform_where_bins_are_uneven():
    rng = np.random.default_rng(0)
    chances = rank_uniformity(rng.integers(0, 101, (200, 400)), 100, bins=20)
    assert stats.kstest(chances, "uniform").pvalue > 1e-3


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: coverage([[0.5]], [[0.0, 1.0]], [[1.0]]), "lows must have shape"),
        (lambda: coverage(np.empty((0, 2)), np.empty((0, 2)), np.empty((0, 2))), "at least one"),
        (lambda: coverage([[0.5]], [[0]], [[1]], circular=[1]), "circular must be 1 truths"),
        (lambda: rank_uniformity(np.full((20, 1), 12), 10), "each 0 to 10; got 20: array"),
        (lambda: rank_uniformity(np.zeros((9, 1)), 10), "ten replicates or more"),
        (lambda: rank_uniformity(np.zeros((50, 1)), 9, bins=11), "bins must be"),
    ],
)
def test_what_does_not_fit_is_refused(call, said):
    with pytest.raises(ConfigurationError, match=said):
        call()
