from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eea.core.angles import circular_distance, smallest_inclusive, wrap

POSES = hnp.arrays(np.float64, st.tuples(st.integers(1, 6), st.just(3)), elements=st.floats(-9, 9))


@given(POSES)
def test_every_pose_lies_in_its_smallest_range(poses):
    low, high = smallest_inclusive(poses)
    assert (high >= low).all()
    assert (high - low < 2 * np.pi).all()
    assert ((low >= -np.pi) & (low < np.pi)).all()
    beyond = (poses - low) % (2 * np.pi)
    # A pose at the low end may come out just under a whole turn.
    beyond = np.where(beyond > 2 * np.pi - 1e-9, 0.0, beyond)
    assert (beyond <= high - low + 1e-9).all()


@given(POSES)
def test_the_range_is_the_smallest_of_those_that_begin_at_a_pose(poses):
    low, high = smallest_inclusive(poses)
    begins = wrap(poses)
    ahead = (begins[None] - begins[:, None]) % (2 * np.pi)  # from each pose to every other
    ahead = np.where(ahead > 2 * np.pi - 1e-9, 0.0, ahead)
    assert np.allclose(high - low, ahead.max(axis=1).min(axis=0), atol=1e-8)


@given(POSES, st.floats(-7, 7))
def test_a_turned_robot_has_a_turned_range(poses, turn):
    low, high = smallest_inclusive(poses)
    turned_low, turned_high = smallest_inclusive(poses + turn)
    assert np.allclose(turned_high - turned_low, high - low, atol=1e-8)


def test_a_range_may_cross_the_back():
    low, high = smallest_inclusive(np.array([[3.0], [-3.0], [3.1]]))
    assert low == pytest.approx(3.0)
    assert high == pytest.approx(2 * np.pi - 3.0)


def test_one_pose_is_a_range_without_width():
    low, high = smallest_inclusive(np.array([[0.3, -2.0, 3.0]]))
    assert np.array_equal(low, high)


@given(st.floats(-50, 50), st.floats(-50, 50))
def test_distance_is_the_shorter_way(a, b):
    expected = np.arccos(np.clip(np.cos(a - b), -1, 1))
    assert circular_distance(a, b) == pytest.approx(expected, abs=1e-6)
    assert -np.pi <= wrap(a) < np.pi


def test_wrapping_a_hair_below_minus_pi_stays_in_range():
    assert wrap(np.nextafter(-np.pi, -4)) < np.pi
