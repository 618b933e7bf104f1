from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.integrate import quad

from eea.infer.box_normal import BoxNormal, draw_between, log_mass


def rotated(sds, seed):
    """Return the information of a normal with these sd along random axes."""
    axes = stats.ortho_group.rvs(len(sds), random_state=np.random.default_rng(seed))
    return (axes / np.square(sds)) @ axes.T


def unit_box(information, at, gradient=None):
    size = len(at)
    slope = np.zeros(size) if gradient is None else gradient
    return BoxNormal(at, information, slope, np.zeros(size), np.ones(size))


@pytest.mark.parametrize(
    ("low", "high"), [(-1.0, 2.0), (-np.inf, -9.0), (4.0, 4.001), (30.0, 31.0), (-200.0, -199.0)]
)
def test_mass_and_draws_are_exact_also_far_out(low, high):
    exact = stats.truncnorm(low, high)
    left, right = (-high, -low) if low > 0 else (low, high)
    bigger = stats.norm.logcdf(right)
    assert log_mass(low, high) == pytest.approx(
        bigger + np.log1p(-np.exp(stats.norm.logcdf(left) - bigger)), rel=1e-9
    )
    drawn = draw_between(np.full(4000, low), np.full(4000, high), np.random.default_rng(0))
    assert ((drawn >= low) & (drawn <= high)).all()
    assert stats.kstest(drawn, exact.cdf).pvalue > 1e-3


@given(st.integers(0, 10**6), st.integers(2, 4), st.floats(0.01, 1.0), st.floats(1.0, 20.0))
@settings(max_examples=25)
def test_the_volume_is_the_mass_inside_the_box(seed, size, sd, ratio):
    information = rotated(np.geomspace(sd / ratio, sd, size), seed)
    at = np.random.default_rng(seed).random(size)
    box = unit_box(information, at)
    normal = stats.multivariate_normal(at, np.linalg.inv(information))
    inside = normal.cdf(np.ones(size), lower_limit=np.zeros(size), rng=np.random.default_rng(0))
    expected = np.log(inside) - normal.logpdf(at)
    assert box.log_volume == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_samples_are_those_of_plain_rejection(seed):
    information = rotated([0.02, 1.0, 3.0], seed)
    rng = np.random.default_rng(seed)
    at = np.array([0.0, 0.5, 0.5])
    points = unit_box(information, at).sample(5000, rng)
    free = rng.multivariate_normal(at, np.linalg.inv(information), 200_000)
    kept = free[((free >= 0) & (free <= 1)).all(axis=1)]
    for way in (*np.eye(3), [1.0, 1.0, 1.0], [1.0, -1.0, 0.5]):
        assert stats.ks_2samp(points @ way, kept @ way).pvalue > 1e-3


@pytest.mark.parametrize(
    "information",
    [[[1e6, -0.9999e6], [-0.9999e6, 1e6]], [[30.0, 5.0], [5.0, 8.0]]],
    ids=["a narrow valley", "a wide one"],
)
def test_chains_agree_with_exact_samples(information):
    box = unit_box(np.array(information), np.array([0.2, 0.3]))
    rng = np.random.default_rng(5)
    exact, chained = box.sample(4000, rng), box._chains(4000, rng)
    for way in ([1.0, 0.0], [0.0, 1.0], [1.0, -1.0]):
        assert stats.ks_2samp(exact @ way, chained @ way).pvalue > 1e-3


def test_a_hard_corner_of_a_high_box_is_left_to_the_chains():
    rng = np.random.default_rng(0)
    effects = rng.normal(size=(8, 18)) * 30
    box = unit_box(effects.T @ effects, rng.random(18))
    assert box._accepted < 0.01
    points = box.sample(512, rng)
    assert points.shape == (512, 18)
    assert ((points >= 0) & (points <= 1)).all()
    # Proposals by their weights, which few dominate, agree in what they can tell: the means.
    proposed, weights = box._propose(200_000, rng)
    share = np.exp(weights - weights.max())
    share /= share.sum()
    error = np.sqrt(np.sum(share**2)) + 0.05  # in sd
    apart = (points.mean(axis=0) - share @ proposed) / points.std(axis=0)
    assert (np.abs(apart) < 4 * error).all()


def test_what_the_data_do_not_tell_is_uniform():
    # One combination is known to 1e-9, another parameter well, and the rest not at all.
    effects = np.array([[1e9, 1e9, 0.0, 0.0], [0.0, 0.0, 100.0, 0.0]])
    at = np.array([0.5, 0.5, 0.5, 0.1])
    points = unit_box(effects.T @ effects, at).sample(4000, np.random.default_rng(0))
    assert stats.kstest(points[:, 3], "uniform").pvalue > 1e-3
    assert stats.kstest(points[:, 0], "uniform").pvalue > 1e-3
    assert np.abs(points[:, 0] + points[:, 1] - 1).max() < 1e-8
    assert stats.kstest((points[:, 2] - 0.5) * 100, "norm").pvalue > 1e-3


@pytest.mark.parametrize(("slope", "bend"), [(3.0, 0.0), (200.0, 0.0), (5.0, 40.0), (1e9, 1e3)])
def test_a_slope_at_a_bound_is_an_exponential(slope, bend):
    box = unit_box(np.array([[bend]]), np.array([0.0]), np.array([slope]))
    reach = min(1.0, 40 / slope)
    density = lambda x: np.exp(-slope * x - 0.5 * bend * x * x)  # noqa: E731
    mass = quad(density, 0, reach)[0]
    mean = quad(lambda x: x * density(x), 0, reach)[0] / mass
    assert box.log_volume == pytest.approx(np.log(mass), abs=0.02)
    points = box.sample(20_000, np.random.default_rng(0))
    assert points.mean() == pytest.approx(mean, rel=0.04)


def test_the_same_seed_gives_the_same_points():
    box = unit_box(rotated([0.1, 0.5], 0), np.array([0.1, 0.9]))
    again = unit_box(rotated([0.1, 0.5], 0), np.array([0.1, 0.9]))
    first, second = (b.sample(50, np.random.default_rng(4)) for b in (box, again))
    assert first.tobytes() == second.tobytes()
    assert box.sample(0, np.random.default_rng(4)).shape == (0, 2)


def test_walls_that_are_a_rounding_apart() -> None:
    """In sd of what is known, where that lies across the axes and nothing else is known."""
    for seed in range(20):
        at = np.random.default_rng(seed).random(3)
        box = unit_box(rotated([3e-11, 1.0, 1.0], seed), at)
        drawn = box.sample(50, np.random.default_rng(1))
        assert np.isfinite(box.log_volume)
        assert ((drawn >= 0.0) & (drawn <= 1.0)).all()
