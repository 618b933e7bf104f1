"""Gaits in other worlds than the model's: currents, drag, servos that err, finer steps."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from aquafish_gym.world_config import WorldConfig
from gait.evolve import EvolveConfig, evolve_gait
from gait.fitness import distances
from gait.rollout import ZERO_POSE, random_poses, stream, swim, swim_all
from gait.transfer import TransferConfig, score, transfer
from gait_fakes import WeightScorer, make_controller

HALF = Morphology.coerce({"left_pectoral": (0.4, 0.8, 0.1)})
ODD = WorldConfig(
    current=(0.05, 0.15, -0.1), drag=(1.2, 0.8), servo_gain=(0.9, 1.0, 1.1), substeps=2
)
LATE = WorldConfig(lag=0.13)
POSES = random_poses(2, 7)


@pytest.mark.parametrize("world", [ODD, replace(ODD, reactive=True), LATE])
def test_pybullet_swims_as_the_compiled_engine_does(world: WorldConfig) -> None:
    controller = make_controller(1, 15)
    bullet = swim(controller, HALF, POSES[0], "pybullet", 2.0, world)
    compiled = swim(controller, HALF, POSES[0], "numba", 2.0, world)
    np.testing.assert_allclose(bullet.position, compiled.position, atol=1e-9)
    plain = swim(controller, HALF, POSES[0], "numba", 2.0)
    assert abs(compiled.distance - plain.distance) > 1e-3


@pytest.mark.parametrize(
    "change",
    [
        {"current": ODD.current},
        {"drag": ODD.drag},
        {"servo_gain": ODD.servo_gain},
        {"substeps": 8},
        asdict(ODD),
    ],
)
def test_the_lanes_swim_in_the_same_world(change: dict[str, Any]) -> None:
    world, controller = WorldConfig(**change), make_controller(1, 15)
    together = swim_all([controller], HALF, POSES, 2.0, "float64", world=world)[0]
    alone = [swim(controller, HALF, pose, "numba", 2.0, world).distance for pose in POSES]
    np.testing.assert_allclose(together, alone, atol=1e-12)
    plain = swim_all([controller], HALF, POSES, 2.0, "float64")[0]
    assert np.abs(together - plain).min() > 1e-5
    single = distances([controller], HALF, POSES, 2.0, world=world)
    assert single[0, 0] == pytest.approx(np.mean(alone), abs=1e-3)


def test_distance_is_through_the_water_and_the_path_over_ground() -> None:
    """A current is no progress: a robot that lies still is carried, and has swum nowhere."""
    world = WorldConfig(current=(0.0, 0.2, 0.0))
    path = swim(lambda _o, _t: (0.0, 0.0, -1.0), None, engine="numba", seconds=60.0, world=world)
    assert path.distance == path.position[-1, 1] - 0.2 * 60.0
    assert path.position[-1, 1] > 3.0
    # It starts at rest over ground, and it takes a while until the water takes it along.
    assert path.distance < 0.0


def test_a_seized_servo_does_not_move() -> None:
    world = WorldConfig(servo_gain=(1.0, 0.0, 1.0))
    path = swim(lambda _o, _t: (1.0, 1.0, 1.0), HALF, (0.1, 0.2, 0.3), "numba", 1.0, world)
    np.testing.assert_allclose(path.fin_angles[:, 1], 0.2, atol=1e-12)
    assert np.ptp(path.fin_angles[:, 0]) > 1.0


def test_a_score_is_of_the_world_that_was_asked_for() -> None:
    controller = make_controller(1, 15)
    for world in (ODD, LATE):  # all poses at once, and one after the other
        scored = score(controller, HALF, POSES, "numba", 1.0, world)
        alone = [swim(controller, HALF, pose, "numba", 1.0, world).distance for pose in POSES]
        np.testing.assert_allclose(scored.random_distances, alone, atol=1e-12)
        assert (
            scored.distance
            == swim(controller, HALF, engine="numba", seconds=1, world=world).distance
        )


def test_in_a_transfer_the_target_alone_is_in_another_world() -> None:
    controller = make_controller(1, 15)
    config = TransferConfig(poses=2, seconds=1.0, target_engine="numba")
    plain = transfer(controller, HALF, config)
    odd = transfer(controller, HALF, config, world=ODD)
    assert odd.native.to_dict() == plain.native.to_dict()
    assert np.abs(odd.target.random_distances - plain.target.random_distances).min() > 1e-4


def test_lags_are_refused_where_many_swim_at_once() -> None:
    for refused in (
        lambda: swim_all([make_controller()], HALF, world=LATE),
        lambda: distances([make_controller()], HALF, world=LATE),
        lambda: evolve_gait(HALF, world=LATE),
    ):
        with pytest.raises(InvalidArgumentError, match=r"world\.lag must be 0 .*; got 0.13 s"):
            refused()


def test_a_gait_is_evolved_for_the_world_that_was_asked_for(tmp_path: Path) -> None:
    config = EvolveConfig(seed=3, generations=2, population=12, poses=1, seconds=1.0, paper=True)
    seized = WorldConfig(servo_gain=(1.0, 0.0, 1.0))
    evolved = evolve_gait(HALF, config, out=tmp_path, world=seized)
    poses = np.vstack([ZERO_POSE, random_poses(32, stream(3, 1))])
    there = distances([evolved.controller], HALF, poses, 1.0, world=seized)
    np.testing.assert_array_equal(evolved.distances, there[0])
    assert abs(there - distances([evolved.controller], HALF, poses, 1.0)) > 1e-4
    with pytest.raises(InvalidArgumentError, match=r"with world\.current \[.*\], not None"):
        evolve_gait(HALF, config, out=tmp_path)
    with pytest.raises(InvalidArgumentError, match="no effect with a scorer"):
        evolve_gait(HALF, config, scorer=WeightScorer(), world=seized)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("current", (0.0, 21.0, 0.0), r"current\[1\] must lie in \[-20, 20\] units/s; got 21"),
        ("drag", (1.0, -0.1), r"drag\[1\] must lie in \[0, 10\]"),
        ("drag", 1.2, r"drag must have shape \(2,\)"),
        ("servo_gain", (1.0, 1.0), r"servo_gain must have shape \(3,\)"),
        ("servo_gain", (1.0, 1.0, np.nan), "servo_gain must be finite"),
        ("lag", 1.1, r"lag must lie in \[0, 1\] s"),
        ("substeps", 0, "substeps must be a whole number of at least 1"),
        ("reactive", 1, "reactive must be True or False"),
    ],
)
def test_a_bad_world_is_refused_by_name(name: str, value: Any, message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=f"^{message}"):
        WorldConfig(**{name: value})
