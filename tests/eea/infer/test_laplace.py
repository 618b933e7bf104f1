"""The linearised posterior against what linear algebra says of a linear world."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eea.infer.laplace import Laplace, pseudo_inverse


def linear_world(seed, count=5):
    """Return the posterior of a linear world at a wrong vector, and where its centre is."""
    rng = np.random.default_rng(seed)
    effects = rng.normal(size=(3 * count, count)) * 10.0 ** rng.uniform(-2, 2, count)
    right = rng.normal(size=count)
    theta = rng.normal(size=count)
    information = effects.T @ effects
    return Laplace(theta, information, information @ (theta - right)), right


@given(st.integers(0, 10**6))
def test_the_centre_of_a_linear_world_is_the_truth(seed):
    near, right = linear_world(seed)
    assert near.centre == pytest.approx(right, rel=1e-6, abs=1e-6)


@given(st.integers(0, 10**6), st.integers(1, 4))
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


def test_a_well_known_number_does_not_hide_the_information_on_another():
    information = np.diag([1e30, 1e-3, 0.0])
    assert np.diag(pseudo_inverse(information)) == pytest.approx([1e-30, 1e3, 0.0])


def test_numbers_without_information_take_nothing_from_others_when_they_are_integrated_out():
    near = Laplace(np.zeros(2), np.diag([4.0, 0.0]), np.array([-4.0, 0.0]))
    assert near.marginal([0]).information.tolist() == [[4.0]]
    assert near.marginal([0]).centre.tolist() == [1.0]


def test_one_of_several_is_symmetric():
    rng = np.random.default_rng(0)
    several = Laplace(rng.normal(size=(2, 3)), rng.normal(size=(2, 3, 3)), rng.normal(size=(2, 3)))
    one = several[1]
    assert (one.information == one.information.T).all()
    assert one.theta.tolist() == several.theta[1].tolist()
