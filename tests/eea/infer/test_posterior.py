from __future__ import annotations

import numpy as np
import pytest

from instruments.inference.calibration import coverage, rank_uniformity, ranks
from linear_worlds import fit, mixture, mode, observe

REPLICATES = 200


@pytest.fixture(scope="module")
def looks():
    """Truths uniform in the box, as the prior has them, and their posteriors."""
    rng = np.random.default_rng(7)
    truths = rng.random((REPLICATES, 4))
    return truths, [observe(truth, rng) for truth in truths]


@pytest.mark.parametrize("mass", [0.5, 0.8, 0.9])
def test_intervals_hold_as_many_truths_as_they_say(looks, mass):
    truths, posteriors = looks
    lows, highs = zip(*(p.interval(mass) for p in posteriors), strict=True)
    found = coverage(truths, np.array(lows), np.array(highs), confidence=0.999)
    assert ((found.low <= mass) & (mass <= found.high)).all(), found.share


def test_the_ranks_of_truths_among_draws_are_uniform(looks):
    truths, posteriors = looks
    rng = np.random.default_rng(8)
    counted = np.array(
        [ranks(p.sample(99, rng), t, rng) for p, t in zip(posteriors, truths, strict=True)]
    )
    assert (rank_uniformity(counted, 99) > 1e-3).all()


def test_intervals_half_as_wide_are_found_out(looks):
    truths, posteriors = looks
    rng = np.random.default_rng(9)
    middles = np.array([p.median() for p in posteriors])
    ends = np.array([p.interval(0.9) for p in posteriors])
    narrow = middles[:, None] + 0.5 * (ends - middles[:, None])
    found = coverage(truths, narrow[:, 0], narrow[:, 1], confidence=0.999)
    assert (found.high < 0.9).all()
    drawn = [m + 0.5 * (p.sample(99, rng) - m) for m, p in zip(middles, posteriors, strict=True)]
    counted = np.array([ranks(d, t, rng) for d, t in zip(drawn, truths, strict=True)])
    assert (rank_uniformity(counted, 99) < 1e-3).all()


def test_truths_at_the_edges_are_held_too():
    """A fin of no length: equal tails would never hold it."""
    rng = np.random.default_rng(3)
    truths = np.column_stack([np.zeros(100), rng.random((100, 3))])
    ends = np.array([observe(truth, rng).interval(0.9) for truth in truths])
    found = coverage(truths, ends[:, 0], ends[:, 1])
    assert found.share[0] == np.mean(ends[:, 0, 0] == 0.0)
    assert (found.share > 0.8).all(), found.share


def test_the_summaries_of_one_mode_are_those_of_its_normal():
    information = np.array([[400.0, 150.0], [150.0, 100.0]])
    exact = np.linalg.inv(information) / 100
    found = mixture(
        ("a", "b"), [-9, -9], [9, 9], [False, False], [mode([0.3, 0.6], 100 * information, 0.0)]
    )
    assert found.median() == pytest.approx([0.3, 0.6], abs=1e-3)
    rho = exact[0, 1] / np.sqrt(exact[0, 0] * exact[1, 1])
    assert found.correlation == pytest.approx(np.array([[1, rho], [rho, 1]]), abs=0.03)
    low, high = found.interval(0.9)
    assert (high - low) == pytest.approx(2 * 1.645 * np.sqrt(np.diag(exact)), rel=0.05)


def test_modes_weigh_as_their_integrals_do():
    """Half the wider mode's mass lies outside; the narrower is better by 2 in cost."""
    modes = [mode([0.25], [[1e4]], cost=1.0), mode([1.0], [[100.0]], cost=3.0)]
    found = mixture(("length",), [0], [1], [False], modes)
    inside = np.exp(-3.0) * 0.1 / 2
    assert found.weights == pytest.approx(
        np.array([np.exp(-1.0) * 0.01, inside]) / (np.exp(-1.0) * 0.01 + inside), abs=0.002
    )
    draws = found.sample(20_000, np.random.default_rng(0))
    assert np.mean(draws < 0.5) == pytest.approx(found.weights[0], abs=0.015)


def test_evidence_prefers_the_hypothesis_with_the_less_to_tune():
    """Of two that fit as well, one has a parameter more, told to a tenth of its range."""
    few = mixture(("a",), [0], [1], [False], [mode([0.5], [[1e4]], 2.0)])
    many = mixture(
        ("a", "b"), [0, 0], [1, 1], [False, False], [mode([0.5, 0.5], np.diag([1e4, 1600.0]), 2.0)]
    )
    odds = np.exp(few.log_evidence - many.log_evidence)
    assert odds == pytest.approx(40 / np.sqrt(2 * np.pi), rel=0.01)
    assert few.log_evidence == pytest.approx(np.log(0.01 * np.sqrt(2 * np.pi)) - 2, abs=0.01)


def test_angles_are_calibrated_across_the_turn():
    rng = np.random.default_rng(4)
    effects = np.array([[4.0, 3.0], [0.0, 5.0]])
    circular = np.array([True, False])
    truths, lows, highs, counted = [], [], [], []
    for _ in range(150):
        truth = np.array([rng.uniform(-np.pi, np.pi), rng.random()])
        felt = effects @ truth + rng.normal(size=2)
        found = fit(effects, felt, np.zeros(2), np.ones(2), circular)
        low, high = found.interval(0.8)
        truths.append(truth)
        lows.append(low)
        highs.append(high)
        counted.append(ranks(found.sample(99, rng), truth, rng, circular))
    held = coverage(truths, lows, highs, circular, confidence=0.999)
    assert ((held.low < 0.8) & (held.high > 0.8)).all(), held.share
    assert (rank_uniformity(counted, 99) > 1e-3).all()


def test_one_optimum_found_from_several_starts_is_one_mode():
    sharp = np.diag([1e4, 1e4, 0.0])
    circular = [False, True, True]
    best = mode([0.5, 3.14, 0.0], sharp, 1.0)
    again = mode([0.5001, 3.14 - 2 * np.pi, 2.0], sharp, 1.001)  # a turn on; the last is not told
    other = mode([0.6, 3.14, 0.0], sharp, 1.0)
    found = mixture(("a", "b", "c"), [0] * 3, [1] * 3, circular, [again, other, best])
    assert [one.theta[0] for one in found.modes] == [0.6, 0.5]
    alone = mixture(("a", "b", "c"), [0] * 3, [1] * 3, circular, [other, best])
    assert found.weights == pytest.approx(alone.weights)
    assert found.weights == pytest.approx([0.5, 0.5], abs=0.01)
