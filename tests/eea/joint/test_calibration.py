from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tests.inference.calibration import coverage, rank_uniformity, ranks


@given(st.integers(0, 40), st.integers(1, 40))
def test_shares_have_the_exact_binomial_interval(hits, misses):
    truths = np.r_[np.full(hits, 0.5), np.full(misses, 2.0)][:, None]
    found = coverage(truths, np.zeros_like(truths), np.ones_like(truths))
    exact = stats.binomtest(hits, hits + misses).proportion_ci(0.95)
    assert found.share == pytest.approx([hits / (hits + misses)])
    assert (found.low[0], found.high[0]) == pytest.approx((exact.low, exact.high))
    assert found.overall == pytest.approx(found.share[0])


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
