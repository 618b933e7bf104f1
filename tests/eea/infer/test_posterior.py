"""The posterior against what is known exactly: linear worlds, normals in boxes, medians."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.integrate import quad

from eea.core.config import JointConfig
from eea.core.experiment import RecordedLog
from eea.core.genome import action_layout, model_layout
from eea.core.problem import Problem
from eea.infer.answer import Answer
from eea.infer.box_normal import BoxNormal, draw_between, log_mass
from eea.infer.laplace import Laplace, pseudo_inverse
from eea.infer.mixture import Mixture, Mode
from eea.infer.robot import Robot
from eea.infer.session import JointInference
from eea.infer.statement import Number
from instruments.inference.calibration import coverage, rank_uniformity, ranks
from linear_worlds import fit, mixture, mode, observe
from swing import infer

REPLICATES = 100


@pytest.fixture(scope="module")
def looks():
    """Truths uniform in the box, as the prior has them, and their posteriors."""
    rng = np.random.default_rng(7)
    truths = rng.random((REPLICATES, 4))
    return truths, [observe(truth, rng) for truth in truths]


def test_intervals_and_ranks_are_those_of_the_truths(looks):
    """And those of intervals half as wide are found out."""
    truths, posteriors = looks
    rng = np.random.default_rng(8)
    for mass in (0.5, 0.8, 0.9):
        lows, highs = zip(*(p.interval(mass) for p in posteriors), strict=True)
        found = coverage(truths, np.array(lows), np.array(highs), confidence=0.999)
        assert ((found.low <= mass) & (mass <= found.high)).all(), found.share
    drawn = [p.sample(99, rng) for p in posteriors]
    counted = np.array([ranks(d, t, rng) for d, t in zip(drawn, truths, strict=True)])
    assert (rank_uniformity(counted, 99) > 1e-3).all()
    middles = np.array([p.median() for p in posteriors])
    low, high = (middles + 0.5 * (np.array(end) - middles) for end in (lows, highs))
    assert (coverage(truths, low, high, confidence=0.999).high < 0.9).all()
    narrow = [m + 0.5 * (d - m) for m, d in zip(middles, drawn, strict=True)]
    counted = np.array([ranks(d, t, rng) for d, t in zip(narrow, truths, strict=True)])
    assert (rank_uniformity(counted, 99) < 1e-3).all()


def test_truths_at_the_edges_are_held_too():
    """A fin of no length: equal tails would never hold it."""
    rng = np.random.default_rng(3)
    truths = np.column_stack([np.zeros(60), rng.random((60, 3))])
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
    for _ in range(100):
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


def linear_world(seed, count=5):
    """Return the posterior of a linear world at a wrong vector, and where its centre is."""
    rng = np.random.default_rng(seed)
    effects = rng.normal(size=(3 * count, count)) * 10.0 ** rng.uniform(-2, 2, count)
    right = rng.normal(size=count)
    theta = rng.normal(size=count)
    information = effects.T @ effects
    return Laplace(theta, information, information @ (theta - right)), right


@given(st.integers(0, 10**6), st.integers(1, 5))
def test_a_marginal_has_the_centre_and_the_covariance_of_its_entries(seed, count):
    near, right = linear_world(seed)
    entries = np.random.default_rng(seed).permutation(5)[:count]
    some = near.marginal(entries)
    assert some.centre == pytest.approx(right[entries], rel=1e-6, abs=1e-6)
    block = near.covariance()[np.ix_(entries, entries)]
    assert some.covariance() == pytest.approx(block, rel=1e-6)


@given(st.integers(0, 10**6))
def test_scaling_keeps_the_centre_and_multiplies_the_deviations(seed):
    near, right = linear_world(seed)
    factors = np.random.default_rng(seed).uniform(0.5, 2.0, 5)
    wider = near.scaled(factors)
    assert wider.centre == pytest.approx(right, rel=1e-6, abs=1e-6)
    covariance = near.covariance() * np.outer(factors, factors)
    assert wider.covariance() == pytest.approx(covariance, rel=1e-6)


def test_the_score_test_of_a_marginal_is_the_likelihood_ratio_of_a_linear_world():
    near, right = linear_world(3)
    square, freedom = near.marginal([0, 2]).score_test(1e-9)
    # Twice the fall of the cost when the two are freed, beside the three that are always free.
    others = [1, 3, 4]
    all_free = near.gradient @ (near.theta - right)
    others_free = near.given(others)
    without = others_free.gradient @ (others_free.theta - others_free.centre)
    assert freedom == 2
    assert square == pytest.approx(all_free - without)


def test_a_number_known_very_well_or_not_at_all_does_not_disturb_the_others():
    information = np.diag([1e30, 1e-3, 0.0])
    assert np.diag(pseudo_inverse(information)) == pytest.approx([1e-30, 1e3, 0.0])
    near = Laplace(np.zeros(2), np.diag([4.0, 0.0]), np.array([-4.0, 0.0]))
    assert near.marginal([0]).information.tolist() == [[4.0]]
    assert near.marginal([0]).centre.tolist() == [1.0]


def test_one_of_several_is_symmetric():
    rng = np.random.default_rng(0)
    several = Laplace(rng.normal(size=(2, 3)), rng.normal(size=(2, 3, 3)), rng.normal(size=(2, 3)))
    one = several[1]
    assert (one.information == one.information.T).all()
    assert one.theta.tolist() == several.theta[1].tolist()


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


def test_walls_that_are_a_rounding_apart():
    """In sd of what is known, where that lies across the axes and nothing else is known."""
    for seed in range(20):
        at = np.random.default_rng(seed).random(3)
        box = unit_box(rotated([3e-11, 1.0, 1.0], seed), at)
        drawn = box.sample(50, np.random.default_rng(1))
        assert np.isfinite(box.log_volume)
        assert ((drawn >= 0.0) & (drawn <= 1.0)).all()


MASSES = (0.05, 0.3, 0.5, 0.9, 0.999)


def random_posterior(rng, names=("a", "b", "c", "phase", "turn")):
    """Return a mixture of modes of any shape, some at bounds, some without information."""
    circular = np.array([False, False, False, True, True])
    size, modes = len(names), []
    for _ in range(rng.integers(1, 4)):
        theta = np.where(circular, rng.uniform(-np.pi, np.pi, size), rng.random(size))
        theta = np.where(~circular & (rng.random(size) < 0.3), rng.integers(0, 2), theta)
        root = rng.normal(size=(size, size)) * 10.0 ** rng.uniform(-1.0, 2.0, size)
        held = ~circular & ((theta == 0.0) | (theta == 1.0))
        gradient = np.where(held, (1.0 - 2.0 * theta) * rng.exponential(20.0, size), 0.0)
        cost = float(rng.exponential(2.0))
        modes.append(Mode(theta, root.T @ root, gradient, cost))
    return Mixture(names, np.zeros(size), np.ones(size), circular, modes)


def test_the_median_lies_inside_the_interval_of_any_mass():
    for seed in range(40):
        found = random_posterior(np.random.default_rng(seed))
        middle = found.median()
        for mass in MASSES:
            low, high = found.interval(mass)
            turn = (middle - low) % (2 * np.pi)
            turn[turn > 2 * np.pi - 1e-9] = 0.0
            inside = np.where(found.circular, turn <= high - low + 1e-9, low <= middle)
            assert inside.all()
            assert (found.circular | (middle <= high)).all()


def doubted_elsewhere(belief, shift):
    """Return a posterior whose intervals, if the simulator is wrong, lie elsewhere."""
    branches = []
    for branch in belief.branches:
        own = branch.parameters.circular
        modes = [
            replace(m, theta=np.where(own, m.theta + shift, np.clip(m.theta + shift, 0.0, 1.0)))
            for m in branch.posterior.modes
        ]
        branches.append(replace(branch, doubted=replace(branch.posterior, modes=modes)))
    return Answer(tuple(branches), belief.goodness, belief.sigma, belief.samples)


def test_estimates_lie_inside_intervals_of_another_posterior():
    result = infer()
    for shift in (-0.3, 0.0, 0.2):
        belief = doubted_elsewhere(result.belief, shift)
        moved = replace(result, belief=belief)
        for mass in MASSES:
            for low, high in (belief.interval(mass), moved.interval(mass)):
                assert (low <= belief.model).all()
                assert (belief.model <= high).all()
            assert all(low <= middle <= high for middle, low, high in belief.table(mass).values())
        for rows in belief.to_dict()["intervals"].values():
            assert all(low <= middle <= high for middle, low, high in rows.values())


def test_where_no_body_explains_the_trials_nothing_is_known():
    result = infer()
    goodness = replace(result.belief.goodness, good=False, verdict="no body explains the log: so")
    bad = replace(result, belief=replace(result.belief, goodness=goodness))
    low, high = bad.interval(0.5)
    assert np.array_equal(low, result.layout.low)
    assert np.array_equal(high, result.layout.high)
    assert bad.to_dict()["belief"]["intervals"] == {}
    assert bad.belief.findings == ["no body explains the log: so"]


SIGMA, NARROW, WIDE, MISSED = 0.01, 0.15, 0.8, 0.003


WHEEL = Problem(
    model_layout([("radius", 1.0, 6)]), action_layout([("speed", 0.0, 2.0)]), ("angle",), 1
)


def wheel(values, commands):
    """A wheel that fits at radius 0.15 alone, and but for a small wobble all about radius 0.8."""
    bodies = values["radius"][:, None]
    near = bodies < 0.6
    swing = 1.0 + np.where(near, 0.4 * (bodies - NARROW), 0.03 * (bodies - WIDE))
    turned = 0.1 * commands * np.arange(64) + values["angle"][:, None]
    wobble = np.where(near, 0.0, MISSED) * np.cos(3.0 * turned)
    return (swing * np.sin(turned) + wobble)[:, :, None]


class Target:
    def perform(self, command):
        values = {"radius": np.array([NARROW]), "angle": np.array([0.5])}
        felt = wheel(values, command[None])
        noise = np.random.default_rng(0).normal(0.0, SIGMA, felt.shape)
        return RecordedLog(gyro=felt + noise)


def test_what_comes_to_the_lower_valley_does_not_crowd_out_the_likelier_one():
    """Where two valleys explain the trial, and the lower one is by far the narrower."""
    config = JointConfig(steps=64, rounds=1, noise=SIGMA, bodies=24)
    robot = Robot(wheel, {"radius": Number(0.0, 1.0), "angle": Number.angle()}, {"gyro": "rad/s"})
    result = JointInference(Target(), robot, WHEEL, config).run()
    sample = result.sample(1000)
    assert 0.5 < (sample > 0.6).mean() < 1.0
    modes = result.to_dict()["belief"]["modes"]["nothing is broken"]["values"]
    assert abs(modes[0][0] - NARROW) < 0.01  # the lowest, and yet the less probable
