"""Swims: PyBullet, the compiled engine alone and in batches agree in every world."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
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
PLAIN = WorldConfig()
ODD = WorldConfig(
    current=(0.05, 0.15, -0.1), drag=(1.2, 0.8), servo_gain=(0.9, 1.0, 1.1), substeps=2
)
LATE = WorldConfig(lag=0.13)
POSES = random_poses(3, 7)


@pytest.mark.parametrize("world", [PLAIN, ODD, replace(ODD, reactive=True), LATE])
def test_pybullet_agrees_with_the_compiled_engine(world: WorldConfig) -> None:
    controller = make_controller(1, 15)
    bullet = swim(controller, HALF, POSES[0], "pybullet", 2.0, world)
    compiled = swim(controller, HALF, POSES[0], "numba", 2.0, world)
    np.testing.assert_allclose(bullet.position, compiled.position, atol=1e-9)
    np.testing.assert_allclose(bullet.fin_angles, compiled.fin_angles, atol=1e-9)
    # q and -q are one attitude.
    same = np.abs((bullet.quaternion * compiled.quaternion).sum(axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-9)


@pytest.mark.parametrize(
    "world", [PLAIN, ODD, WorldConfig(current=(0.05, 0.15, -0.1)), WorldConfig(substeps=8)]
)
def test_batch_agrees_with_single_swims(world: WorldConfig) -> None:
    controllers = [make_controller(seed, mutations=seed) for seed in range(12)]
    assert len({c.nodes for c in controllers}) > 2
    together = swim_all(controllers, HALF, POSES, 2.0, dtype="float64", world=world)
    alone = [
        [swim(c, HALF, pose, "numba", 2.0, world).distance for pose in POSES] for c in controllers
    ]
    np.testing.assert_allclose(together, alone, atol=1e-12)
    single = swim_all(controllers, HALF, POSES, 2.0, world=world)
    np.testing.assert_allclose(single, together, atol=1e-3)


def test_swim_depends_neither_on_the_batch_nor_on_threads() -> None:
    controllers = [make_controller(seed, mutations=10) for seed in range(20)]
    every = swim_all(controllers, HALF, POSES, 2.0, threads=2)
    np.testing.assert_array_equal(every, swim_all(controllers, HALF, POSES, 2.0, threads=1))
    np.testing.assert_array_equal(every[3:9], swim_all(controllers[3:9], HALF, POSES, 2.0))
    assert swim_all([], HALF, POSES).shape == (0, 3)
    assert swim_all(controllers[:1], HALF, np.zeros((0, 3))).shape == (1, 0)


def test_path_has_its_start_and_a_sample_for_every_command() -> None:
    path = swim(make_controller(), HALF, (0.1, -0.2, 0.3), engine="numba", seconds=0.98)
    assert path.time == pytest.approx([*np.arange(0.0, 0.96, 0.05), 0.98])
    assert path.position.shape == path.fin_angles.shape == (21, 3)
    np.testing.assert_array_equal(path.position[0], 0.0)
    assert path.fin_angles[0] == pytest.approx([0.1, -0.2, 0.3])
    assert path.distance == path.position[-1, 1]


def test_policy_steers_the_gymnasium_environment() -> None:
    controller, angles = make_controller(2, 15), (0.4, 2.0, -1.0)
    env = gym.make("AquaFish-v0", morphology=HALF.to_dict(), fin_angles=angles, frame_skip=5)
    observation, _ = env.reset(seed=0)
    policy = controller.policy()
    for step in range(40):
        observation, *_, info = env.step(policy(observation, time=0.05 * step))
    env.close()
    far = swim(controller, HALF, angles, seconds=2.0).distance
    assert info["y_position"] == pytest.approx(far, abs=1e-4)  # observations are float32


def test_short_evolution_finds_a_gait() -> None:
    config = EvolveConfig(seed=1000, generations=8, population=40, poses=0, paper=True)
    evolved = evolve_gait(None, config)
    far = swim(evolved.controller, None, engine="numba").distance
    assert far > 3.0
    assert far == pytest.approx(evolved.fitness, abs=0.05)


def test_distance_is_relative_to_the_water() -> None:
    world = WorldConfig(current=(0.0, 0.2, 0.0))
    path = swim(lambda _o, _t: (0.0, 0.0, -1.0), None, engine="numba", seconds=60.0, world=world)
    assert path.distance == path.position[-1, 1] - 0.2 * 60.0
    assert path.position[-1, 1] > 3.0
    assert path.distance < 0.0  # it starts at rest over ground


def test_seized_servo_does_not_move() -> None:
    world = WorldConfig(servo_gain=(1.0, 0.0, 1.0))
    path = swim(lambda _o, _t: (1.0, 1.0, 1.0), HALF, (0.1, 0.2, 0.3), "numba", 1.0, world)
    np.testing.assert_allclose(path.fin_angles[:, 1], 0.2, atol=1e-12)
    assert np.ptp(path.fin_angles[:, 0]) > 1.0


@pytest.mark.parametrize("world", [ODD, LATE])
def test_score_is_that_of_single_swims(world: WorldConfig) -> None:
    controller = make_controller(1, 15)
    scored = score(controller, HALF, POSES, "numba", 1.0, world)
    alone = [swim(controller, HALF, pose, "numba", 1.0, world).distance for pose in POSES]
    np.testing.assert_allclose(scored.random_distances, alone, atol=1e-12)
    zero = swim(controller, HALF, engine="numba", seconds=1, world=world)
    assert scored.distance == zero.distance


def test_transfer_swims_the_target_alone_in_another_world() -> None:
    controller = make_controller(1, 15)
    config = TransferConfig(poses=2, seconds=1.0, target_engine="numba")
    plain, odd = (transfer(controller, HALF, config, world=world) for world in (PLAIN, ODD))
    assert odd.native.to_dict() == plain.native.to_dict()
    assert np.abs(odd.target.random_distances - plain.target.random_distances).min() > 1e-4


def test_gait_is_evolved_for_its_world(tmp_path: Path) -> None:
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
    with pytest.raises(InvalidArgumentError, match=r"world\.lag must be 0 .*; got 0.13 s"):
        evolve_gait(HALF, config, world=LATE)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"fin_angles": (0.0, np.nan, 0.0)}, "fin_angles must be finite"),
        ({"seconds": -1.0}, "seconds must lie in"),
        ({"engine": "pybulet"}, "did you mean 'pybullet'"),
        ({"morphology": np.zeros(3)}, "morphology must have shape"),
    ],
)
def test_bad_argument_is_refused_by_name(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        swim(make_controller(), **{"morphology": HALF, **arguments})
    with pytest.raises(InvalidArgumentError, match="threads must be a whole number"):
        swim_all([make_controller()], HALF, threads=0)
