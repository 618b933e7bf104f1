"""A target that also begins turned: what that changes in its log, and what it does not."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym import Morphology
from aquafish_gym.physics.attitude import attitude, rotations
from eea import ConfigurationError, EngineTarget
from eea.fish.target import random_orientation
from tests.verification.trials import lane_batch

COMMAND = np.array([0.4, -0.3, 0.8])
CURRENT = (0.7, -0.4, 0.2)
STEPS = 256


def target(orientation: str, seed: int = 0, current=CURRENT) -> EngineTarget:
    return EngineTarget(
        None,
        "left_pectoral:length=0.5",
        np.random.default_rng(seed),
        STEPS,
        "numba",
        current,
        orientation=orientation,
    )


def quaternion(r: np.ndarray) -> np.ndarray:
    """(x, y, z, w) of a rotation that is not half a turn."""
    w = 0.5 * np.sqrt(1.0 + np.trace(r))
    xyz = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / (4.0 * w)
    return np.append(xyz, w)


@pytest.mark.parametrize("orientation", ["heading", "attitude"])
@pytest.mark.parametrize("seed", range(3))
def test_the_turned_log_is_that_of_a_fish_that_began_turned(orientation, seed):
    fish = target(orientation, seed)
    log = fish.perform(COMMAND)
    angles = fish.start_angles
    start = random_orientation(orientation, np.random.default_rng(angles.view(np.uint64)))
    batch = lane_batch(fish.morphology.to_array()[None], angles[None], CURRENT, np.float64)
    # The engine itself, begun in that orientation, which its callers cannot ask for.
    states = batch._table(batch._states, 25)
    states[:4, 0] = quaternion(start)
    states[22:25, 0] = attitude(start.tolist())
    swum = batch.advance(COMMAND[None], STEPS, "attitude")
    assert np.abs(log.rpy - swum.rpy).max() < 1e-9
    assert np.abs(log.gyro - swum.gyro).max() < 1e-9


def test_in_still_water_a_heading_is_added_to_yaw_and_nothing_else_changes():
    upright = target("upright", current=(0.0, 0.0, 0.0))
    turned = target("heading", current=(0.0, 0.0, 0.0))
    for _ in range(3):
        a, b = upright.perform(COMMAND), turned.perform(COMMAND)
        assert np.array_equal(upright.start_angles, turned.start_angles)
        apart = b.rpy[0] - a.rpy[0]
        assert np.abs(apart - apart[0]).max() < 1e-9
        assert np.abs(apart[0, :2]).max() < 1e-9
        assert 0.01 < abs(apart[0, 2]) < np.pi
        assert np.array_equal(a.gyro, b.gyro)


def test_relative_to_its_start_the_log_is_that_of_the_upright_fish():
    upright = target("upright", current=(0.0, 0.0, 0.0))
    turned = target("attitude", current=(0.0, 0.0, 0.0))
    for _ in range(3):
        a, b = upright.perform(COMMAND), turned.perform(COMMAND)
        start = random_orientation(
            "attitude", np.random.default_rng(turned.start_angles.view(np.uint64))
        )
        assert np.abs(start.T @ rotations(b.rpy[0]) - rotations(a.rpy[0])).max() < 1e-9
        assert np.abs(np.diff(b.rpy[0], axis=0)).max() < 1.0  # continuous, as a log is
        assert np.abs(b.rpy - a.rpy).max() > 0.1
        assert np.array_equal(a.gyro, b.gyro)


@pytest.mark.parametrize("orientation", ["heading", "attitude"])
def test_orientations_are_rotations_and_spread_evenly(orientation):
    rng = np.random.default_rng(0)
    drawn = np.array([random_orientation(orientation, rng) for _ in range(2000)])
    assert np.abs(drawn @ drawn.transpose(0, 2, 1) - np.eye(3)).max() < 1e-12
    assert np.linalg.det(drawn) == pytest.approx(1.0)
    assert np.abs(drawn.mean(axis=0)[:2, :2]).max() < 0.06
    assert drawn[:, 2, 2].mean() == pytest.approx(
        1.0 if orientation == "heading" else 0.0, abs=0.06
    )


def test_an_unknown_orientation_is_refused():
    with pytest.raises(ConfigurationError, match="did you mean 'heading'"):
        EngineTarget(Morphology.nominal(), engine="numba", orientation="headed")
