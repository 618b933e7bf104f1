from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from eea.core.experiment import Context, Experiment, perform_angles


def experiment(context: Context) -> Experiment:
    return Experiment(np.zeros(3), np.zeros(2), context)


POSE = np.array([1.0, -2.0, 3.0])


def test_a_known_pose_is_where_all_begin_and_costs_no_chance():
    rng = np.random.default_rng(0)
    angles = perform_angles([experiment(Context.known(POSE))] * 2, 5, rng)
    assert np.array_equal(angles, np.broadcast_to(POSE, (5, 2, 3)))
    assert rng.random() == np.random.default_rng(0).random()


def test_confidence_is_the_share_that_begin_in_the_range():
    context = Context(POSE, POSE + 0.1, 0.5)
    angles = perform_angles([experiment(context)], 20_000, np.random.default_rng(0))[:, 0]
    inside = ((angles >= POSE) & (angles <= POSE + 0.1)).all(axis=1)
    assert abs(inside.mean() - 0.5) < 0.02
    # The others are anywhere, independently of one another and of the range.
    others = angles[~inside]
    assert np.abs(np.cos(others).mean(axis=0)).max() < 0.03
    assert np.abs(np.sin(others).mean(axis=0)).max() < 0.03


@given(st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_a_locked_range_is_still_sampled(seed, width):
    context = Context(POSE, POSE + width, 1.0)
    angles = perform_angles([experiment(context)], 50, np.random.default_rng(seed))[:, 0]
    assert ((angles >= POSE) & (angles <= POSE + width)).all()
    assert width < 1e-6 or len(np.unique(angles[:, 0])) == 50


def test_only_certainty_about_one_pose_is_fixed():
    assert Context.known(POSE).fixed
    assert not Context(POSE, POSE, 0.5).fixed
    assert not Context(POSE, POSE + 0.1, 1.0).fixed
    assert not Context.unknown(3, 1.0).fixed
