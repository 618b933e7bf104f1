"""Pairs of bodies and poses, and the distances of controllers on them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from aquafish_gym.morphology import MAXIMA, Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.swims.poses import random_poses, stream
from gait.swims.scores import (
    DIVERGED_SPEED,
    distances,
    draw_swims,
    every_pair,
    penalize_diverged,
    scores,
)
from gait_fakes import make_controller

BODIES = np.random.default_rng(5).uniform(0.2, 0.9, (5, 9)) * MAXIMA
POSES = random_poses(9, 3)


@pytest.mark.parametrize("count", [1, 2, 9, 50])
def test_bodies_are_dealt_equally(count: int) -> None:
    bodies = np.arange(count * 9.0).reshape(count, 9)
    dealt, poses = draw_swims(bodies, POSES, stream(0, 3, 7))
    drawn, times = np.unique(dealt[:, 0], return_counts=True)
    assert len(drawn) == min(count, len(POSES))
    assert times.max() - times.min() <= 1
    np.testing.assert_array_equal(poses, POSES)


def test_batch_of_bodies_agrees_with_each_alone() -> None:
    controllers = [make_controller(seed, mutations=8) for seed in range(3)]
    together = scores(controllers, BODIES, POSES[:5], 1.0)
    assert together.shape == (3, 5)
    for i, body in enumerate(BODIES):
        alone = scores(controllers, body, POSES[i : i + 1], 1.0)
        np.testing.assert_array_equal(together[:, i : i + 1], alone)
    listed = [Morphology.from_array(body) for body in BODIES]
    np.testing.assert_array_equal(scores(controllers, listed, POSES[:5], 1.0), together)
    one_pose = scores(controllers, BODIES, POSES[:1], 1.0)
    np.testing.assert_array_equal(one_pose[:, 0], together[:, 0])
    assert one_pose.shape == (3, 5)


def test_unequal_bodies_and_poses_are_refused() -> None:
    with pytest.raises(InvalidArgumentError, match=r"equally many, or one for all; got 5 and 4"):
        scores([make_controller()], BODIES, POSES[:4])
    with pytest.raises(InvalidArgumentError, match=r"morphologies\[1, 2\] must lie in"):
        scores([make_controller()], np.vstack([BODIES[0], BODIES[1] + [0, 0, 9, *[0] * 6]]))


def test_distances_are_means_over_the_poses_on_every_body() -> None:
    controllers = [make_controller(seed, mutations=8) for seed in range(2)]
    found = distances(controllers, BODIES, POSES[:3], seconds=1.0, threads=1)
    assert found.shape == (2, 5)
    for i, body in enumerate(BODIES):
        swims = scores(controllers, body, POSES[:3], 1.0)
        np.testing.assert_array_equal(found[:, i], swims.mean(axis=1))
    assert np.ptp(found, axis=1).min() > 0.01  # the bodies differ
    one = distances(controllers, Morphology.from_array(BODIES[0]), POSES[:3], seconds=1.0)
    np.testing.assert_array_equal(one, found[:, :1])


def test_diverged_robot_counts_as_swimming_backwards(monkeypatch: pytest.MonkeyPatch) -> None:
    def sick(*_: object, **__: object) -> object:
        end = np.array([[0.0, y, 0.0] for y in (1.0, np.nan, 2.0, 4.0)])
        return SimpleNamespace(end=end)

    monkeypatch.setattr("gait.swims.scores.rollout", sick)
    found = distances([make_controller()], BODIES[:2], POSES[:2], seconds=3.0)
    np.testing.assert_array_equal(found, [[(1.0 + 3 * DIVERGED_SPEED) / 2, 3.0]])
    bodies, poses = every_pair(BODIES[:2], POSES[:2])
    plain = scores([make_controller()], bodies, poses, 3.0, penalize=False)
    np.testing.assert_array_equal(plain, [[1.0, np.nan, 2.0, 4.0]])
    assert penalize_diverged(np.array([np.inf]), 2.0) == 2 * DIVERGED_SPEED


def test_bad_arguments_are_refused_by_name() -> None:
    controllers = [make_controller()]
    with pytest.raises(InvalidArgumentError, match="poses must be one or more"):
        distances(controllers, BODIES, np.zeros((0, 3)))
    with pytest.raises(InvalidArgumentError, match=r"poses must have shape \(any, 3\)"):
        distances(controllers, BODIES, np.zeros(3))
    with pytest.raises(InvalidArgumentError, match=r"bodies must have shape \(any, 9\)"):
        distances(controllers, np.zeros((2, 8)))
