"""Swims of controllers in all worlds, alone or many, on every engine; pairs of bodies and poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from aquafish_gym import Morphology, simulate
from aquafish_gym.command import scale_action
from aquafish_gym.damage import Damage
from aquafish_gym.plans import AQUAFISH, FOUR_FINS, BodyPlan
from aquafish_gym.utils.validation import InvalidArgumentError
from aquafish_gym.world_config import WorldConfig
from gait.controllers.controller import Controller
from gait.controllers.network import Senses
from gait.search.evolve import EvolveConfig, evolve_gait
from gait.search.templates import Template
from gait.swims.poses import golden_ratio, random_poses, spread_poses, stream, zero_pose
from gait.swims.scores import (
    DIVERGED_SPEED,
    distances,
    draw_swims,
    every_pair,
    penalize_diverged,
    scores,
)
from gait.swims.swim import swim
from gait.swims.transfer import TransferConfig, swims_on, transfer
from gait_fakes import make_controller

BODY = Morphology.nominal()
HALF = Damage.parse("left_pectoral:length=0.5").apply(BODY)
POSES = random_poses(3, 7)
BODIES = np.random.default_rng(5).uniform(0.2, 0.9, (5, 9)) * AQUAFISH.maxima
NINE = random_poses(9, 3)
ODD = WorldConfig(
    current=(0.05, 0.15, -0.1), drag=(1.2, 0.8), servo_gain=(0.9, 1.0, 1.1), substeps=2
)
LATE = WorldConfig(lag=0.13)
NAMES = ("clock alone", "linear", "mlp", "recurrent")


def make(name: str, seed: int = 0, **changes: Any) -> Controller:
    """Return a random controller of a class."""
    senses = Senses(fins=seed % 2 == 1)
    if name == "clock alone":
        name, senses = "linear", Senses(imu=False, clock=3)
    template = Template.of_class(name, senses, 5)
    vector = 0.25 * np.random.default_rng(seed).standard_normal(template.size)
    controller = template.controller(vector, 0.7, BODY, seed).to_dict() | changes
    return Controller.from_dict(controller)


@pytest.mark.pybullet
@pytest.mark.parametrize("world", [WorldConfig(), ODD, replace(ODD, reactive=True), LATE])
def test_engines_swim_alike(world: WorldConfig) -> None:
    controller = make_controller(1, 15)
    bullet, compiled = (
        swim(controller, HALF, POSES[0], engine, 2.0, world) for engine in ("pybullet", "numba")
    )
    np.testing.assert_allclose(bullet.position, compiled.position, atol=1e-9)
    np.testing.assert_allclose(bullet.fin_angles, compiled.fin_angles, atol=1e-9)
    # q and -q are one attitude.
    same = np.abs((bullet.quaternion * compiled.quaternion).sum(axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("changes", [{}, {"output": "clip"}, {"interval": 20}])
def test_population_swims_as_each_would_alone(name: str, changes: dict[str, Any]) -> None:
    controllers = [make(name, seed, **changes) for seed in range(3)]
    others = [make("linear"), make("mlp", 1), make_controller(5, 10)]
    found = scores([*controllers, *others], HALF, POSES, 2.0, dtype="float64", world=ODD)
    for controller, row in zip(controllers, found, strict=False):
        alone = [swim(controller, HALF, pose, "numba", 2.0, ODD).distance for pose in POSES]
        np.testing.assert_allclose(row, alone, atol=1e-9)
    single = scores([*controllers, *others], HALF, POSES, 2.0, world=ODD)
    np.testing.assert_allclose(single, found, atol=1e-3)
    assert np.ptp(found[:3]) > 1e-3


def test_path_has_its_start_and_a_sample_for_every_command() -> None:
    path = swim(make_controller(), HALF, (0.1, -0.2, 0.3), engine="numba", seconds=0.98)
    assert path.time == pytest.approx([*np.arange(0.0, 0.96, 0.05), 0.98])
    assert path.position.shape == path.fin_angles.shape == (21, 3)
    np.testing.assert_array_equal(path.position[0], 0.0)
    assert path.fin_angles[0] == pytest.approx([0.1, -0.2, 0.3])
    assert path.distance == path.position[-1, 1]
    assert path.gyro is not None
    assert path.gyro.shape == (98, 3)


def test_distance_is_through_the_water_and_the_path_over_ground() -> None:
    """A robot that lies still is carried, and has swum nowhere."""
    world = WorldConfig(current=(0.0, 0.2, 0.0), servo_gain=(1.0, 0.0, 1.0))
    path = swim(lambda _o, _t: (0.0, 1.0, -1.0), None, engine="numba", seconds=60.0, world=world)
    assert path.distance == path.position[-1, 1] - 0.2 * 60.0
    assert path.position[-1, 1] > 3.0
    # It starts at rest over ground, and it takes a while until the water takes it along.
    assert path.distance < 0.0
    np.testing.assert_allclose(path.fin_angles, 0.0, atol=1e-12)  # the right servo is seized


@pytest.mark.parametrize("gain", [1.0, 0.9])
def test_controller_reckons_its_fins_from_its_commands(gain: float) -> None:
    senses = Senses(imu=False, clock=0, fins=True)
    weights = np.zeros((3, 9))
    weights[np.arange(3), [0, 3, 4]] = 0.1  # the sine of one, the cosine of another
    shows = Controller(weights, np.full(3, 0.1), np.ones(3), 0.7, BODY, 0, senses=senses)
    begin = np.array([0.3, -2.0, 1.0])
    policy = shows.policy(begin, (gain,) * 3)
    actions = np.array([policy(np.zeros(9), 0.05 * k) for k in range(40)])
    log = simulate(
        BODY, np.repeat(scale_action(AQUAFISH, actions), 5, axis=0)[None], begin, steps=200,
        record="pose",
        servo_gain=(gain,) * 3, dtype="float64",
    )  # fmt: skip
    assert log.fin_angles is not None
    angles = np.vstack([begin, log.fin_angles[0]])[:200:5]
    waves = np.stack([np.sin(angles[:, 0]), np.cos(angles[:, 1]), np.sin(angles[:, 2])], axis=1)
    np.testing.assert_allclose(actions, np.tanh(2.5 * (0.1 + 0.1 * waves)), atol=1e-9)


def test_controller_swims_by_its_belief_about_the_fins() -> None:
    controller = make("recurrent", 1)
    right = scores([controller], BODY, POSES, 2.0)
    wrong = scores([controller], BODY, POSES, 2.0, believed=POSES + 1.0)
    slow = scores([controller], BODY, POSES, 2.0, believed_gain=(0.9, 0.9, 0.9))
    assert (right != wrong).all()
    assert (right != slow).all()
    same = scores([controller], BODY, POSES, 2.0, believed=POSES + 2 * np.pi)
    np.testing.assert_allclose(same, right, atol=1e-3)
    alone = swim(controller, BODY, POSES[0], "numba", 2.0, believed=POSES[0] + 1.0)
    assert alone.distance == pytest.approx(float(wrong[0, 0]), abs=1e-3)
    with pytest.raises(InvalidArgumentError, match="believed"):
        scores([controller], BODY, POSES, 1.0, believed=np.zeros((2, 3)))


@pytest.mark.parametrize("world", [ODD, LATE])
def test_score_is_of_single_swims_in_its_world(world: WorldConfig) -> None:
    """All poses are swum at once."""
    controller = make_controller(1, 15)
    scored = swims_on(controller, HALF, POSES, "numba", 1.0, world)
    alone = [swim(controller, HALF, pose, "numba", 1.0, world).distance for pose in POSES]
    np.testing.assert_allclose(scored.random_distances, alone, atol=1e-12)
    zero = swim(controller, HALF, engine="numba", seconds=1, world=world)
    assert scored.distance == zero.distance


def test_only_the_target_of_a_transfer_is_in_another_world() -> None:
    controller = make_controller(1, 15)
    config = TransferConfig(poses=2, seconds=1.0, target_engine="numba")
    plain = transfer(controller, HALF, config)
    odd = transfer(controller, HALF, config, world=ODD)
    assert odd.native.to_dict() == plain.native.to_dict()
    assert np.abs(odd.target.random_distances - plain.target.random_distances).min() > 1e-4


def test_the_native_body_of_a_transfer_has_a_world_too() -> None:
    controller = make_controller(1, 15)
    config = TransferConfig(poses=2, seconds=1.0, target_engine="numba")
    both = transfer(controller, controller.morphology, config, world=ODD, native_world=ODD)
    assert both.native.to_dict() == both.target.to_dict()
    plain = transfer(controller, HALF, config)
    odd = transfer(controller, HALF, config, native_world=ODD)
    assert odd.target.to_dict() == plain.target.to_dict()
    assert np.abs(odd.native.random_distances - plain.native.random_distances).min() > 1e-4


def test_gait_is_evolved_for_its_world(tmp_path: Path) -> None:
    config = EvolveConfig(seed=3, generations=2, population=12, poses=1, seconds=1.0, paper=True)
    seized = WorldConfig(servo_gain=(1.0, 0.0, 1.0))
    evolved = evolve_gait(HALF, config, out=tmp_path, world=seized)
    poses = np.vstack([zero_pose(), random_poses(32, stream(3, 1))])
    there = distances([evolved.controller], HALF, poses, 1.0, world=seized)
    np.testing.assert_array_equal(evolved.distances, there[0])
    with pytest.raises(InvalidArgumentError, match="world"):
        evolve_gait(HALF, EvolveConfig(task="station"), world=seized)


def test_golden_ratios_of_more_dimensions() -> None:
    # Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018.
    assert [round(golden_ratio(n), 8) for n in (1, 2)] == [1.61803399, 1.32471796]
    assert golden_ratio(3) == 1.2207440846057596  # on which committed gaits depend to the bit


@pytest.mark.parametrize("plan", [AQUAFISH, FOUR_FINS])
def test_spread_poses_are_uniform_and_their_mean_varies_less(plan: BodyPlan) -> None:
    """Over many seeds a spread pose is uniform; the mean of a wave over seven is nearer to 0."""

    def waves(poses: np.ndarray) -> np.ndarray:
        angles = poses.reshape(400, 7, len(plan.fins))
        return np.asarray(np.cos(np.concatenate([angles, angles - np.roll(angles, 1, axis=2)], 2)))

    seeds = np.random.SeedSequence(1).spawn(400)
    spread = np.concatenate([spread_poses(7, seed, plan) for seed in seeds])
    independent = np.concatenate([random_poses(7, seed, plan) for seed in seeds])
    assert np.abs(spread).max() <= np.pi
    for fin in spread.T:
        counts, _ = np.histogram(fin, 8, (-np.pi, np.pi))
        assert np.abs(counts / 350 - 1.0).max() < 0.2
    errors = [waves(poses).mean(axis=1).var() for poses in (spread, independent)]
    assert errors[0] < 0.6 * errors[1]


@pytest.mark.parametrize("count", [1, 2, 9, 50])
def test_bodies_are_dealt_equally(count: int) -> None:
    bodies = np.arange(count * 9.0).reshape(count, 9)
    dealt, poses = draw_swims(bodies, NINE, stream(0, 3, 7))
    drawn, times = np.unique(dealt[:, 0], return_counts=True)
    assert len(drawn) == min(count, len(NINE))
    assert times.max() - times.min() <= 1
    np.testing.assert_array_equal(poses, NINE)


def test_batch_of_bodies_agrees_with_each_alone() -> None:
    controllers = [make_controller(seed, mutations=8) for seed in range(3)]
    together = scores(controllers, BODIES, NINE[:5], 1.0)
    assert together.shape == (3, 5)
    for i, body in enumerate(BODIES):
        alone = scores(controllers, body, NINE[i : i + 1], 1.0)
        np.testing.assert_array_equal(together[:, i : i + 1], alone)
    listed = [Morphology.from_array(body) for body in BODIES]
    np.testing.assert_array_equal(scores(controllers, listed, NINE[:5], 1.0), together)
    one_pose = scores(controllers, BODIES, NINE[:1], 1.0)
    np.testing.assert_array_equal(one_pose[:, 0], together[:, 0])
    assert one_pose.shape == (3, 5)


def test_unequal_bodies_and_poses_are_refused() -> None:
    with pytest.raises(InvalidArgumentError, match=r"equally many, or one for all; got 5 and 4"):
        scores([make_controller()], BODIES, NINE[:4])
    with pytest.raises(InvalidArgumentError, match=r"morphologies\[1, 2\] must lie in"):
        scores([make_controller()], np.vstack([BODIES[0], BODIES[1] + [0, 0, 9, *[0] * 6]]))


@pytest.mark.parametrize("task", ["forward", "return"])
def test_no_swim_has_no_score(task: str) -> None:
    nobody = np.zeros((0, 9))
    assert scores([make_controller()], nobody, np.zeros((0, 3)), task=task).shape == (1, 0)


def test_distances_are_means_over_the_poses_on_every_body() -> None:
    controllers = [make_controller(seed, mutations=8) for seed in range(2)]
    found = distances(controllers, BODIES, NINE[:3], seconds=1.0, threads=1)
    assert found.shape == (2, 5)
    for i, body in enumerate(BODIES):
        swims = scores(controllers, body, NINE[:3], 1.0)
        np.testing.assert_array_equal(found[:, i], swims.mean(axis=1))
    assert np.ptp(found, axis=1).min() > 0.01  # the bodies differ
    one = distances(controllers, Morphology.from_array(BODIES[0]), NINE[:3], seconds=1.0)
    np.testing.assert_array_equal(one, found[:, :1])


def test_diverged_robot_counts_as_swimming_backwards(monkeypatch: pytest.MonkeyPatch) -> None:
    def sick(*_: object, **__: object) -> object:
        end = np.array([[0.0, y, 0.0] for y in (1.0, np.nan, 2.0, 4.0)])
        return SimpleNamespace(end=end)

    monkeypatch.setattr("gait.swims.scores.rollout", sick)
    found = distances([make_controller()], BODIES[:2], NINE[:2], seconds=3.0)
    np.testing.assert_array_equal(found, [[(1.0 + 3 * DIVERGED_SPEED) / 2, 3.0]])
    bodies, poses = every_pair(BODIES[:2], NINE[:2])
    plain = scores([make_controller()], bodies, poses, 3.0, penalize=False)
    np.testing.assert_array_equal(plain, [[1.0, np.nan, 2.0, 4.0]])
    assert penalize_diverged(np.array([np.inf]), 2.0) == 2 * DIVERGED_SPEED
