"""One controller, every engine: floats, both precisions of the lanes, and PyBullet agree."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError
from gait.evolve import EvolveConfig, evolve_gait
from gait.rollout import INTERVAL, ZERO_POSE, random_poses, step_count, swim, swim_all
from gait_fakes import make_controller

HALF = Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal())
POSES = random_poses(3, 7)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_pybullet_swims_as_the_lanes_do(seed: int) -> None:
    controller = make_controller(seed, 15)
    pose = random_poses(1, seed)[0]
    bullet = swim(controller, HALF, pose, "pybullet", seconds=3.0)
    compiled = swim(controller, HALF, pose, "numba", seconds=3.0)
    np.testing.assert_allclose(bullet.position, compiled.position, atol=1e-9)
    lanes = swim_all([controller], HALF, [pose], 3.0, "float64")[0, 0]
    assert bullet.distance == pytest.approx(lanes, abs=1e-9)
    # q and -q are one attitude.
    same = np.abs((bullet.quaternion * compiled.quaternion).sum(axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-9)
    np.testing.assert_allclose(bullet.fin_angles, compiled.fin_angles, atol=1e-9)


def test_a_whole_population_swims_as_each_would_alone() -> None:
    controllers = [make_controller(seed, mutations=seed) for seed in range(12)]
    assert len({c.nodes for c in controllers}) > 2
    together = swim_all(controllers, HALF, POSES, 2.0, dtype="float64")
    alone = [[swim(c, HALF, p, "numba", 2.0).distance for p in POSES] for c in controllers]
    np.testing.assert_allclose(together, alone, atol=1e-12)
    single = swim_all(controllers, HALF, POSES, 2.0)
    np.testing.assert_allclose(single, together, atol=1e-3)


def test_a_swim_depends_neither_on_company_nor_on_threads() -> None:
    controllers = [make_controller(seed, mutations=10) for seed in range(20)]
    everyone = swim_all(controllers, HALF, POSES, 2.0, threads=2)
    np.testing.assert_array_equal(everyone, swim_all(controllers, HALF, POSES, 2.0, threads=1))
    np.testing.assert_array_equal(everyone[3:9], swim_all(controllers[3:9], HALF, POSES, 2.0))


def test_controllers_keep_their_own_clocks_side_by_side() -> None:
    from dataclasses import replace

    slow = make_controller(5, 10)
    quick = replace(slow, clock=2.0)
    both = swim_all([slow, quick], HALF, POSES, 2.0, dtype="float64")
    assert np.abs(both[0] - both[1]).min() > 1e-6
    np.testing.assert_allclose(both[1:], swim_all([quick], HALF, POSES, 2.0, "float64"), atol=1e-12)


def test_a_path_has_its_start_and_a_sample_for_every_command() -> None:
    path = swim(make_controller(), HALF, (0.1, -0.2, 0.3), engine="numba", seconds=0.98)
    assert path.time == pytest.approx([*np.arange(0.0, 0.96, 0.05), 0.98])
    assert path.position.shape == path.fin_angles.shape == (21, 3)
    assert path.quaternion.shape == (21, 4)
    np.testing.assert_array_equal(path.position[0], 0.0)
    assert path.fin_angles[0] == pytest.approx([0.1, -0.2, 0.3])
    assert path.distance == path.position[-1, 1]
    assert step_count(20.0) == 2000
    assert step_count(20.0) % INTERVAL == 0


def test_a_policy_steers_the_gymnasium_environment_too() -> None:
    controller = make_controller(2, 15)
    angles = (0.4, 2.0, -1.0)
    env = gym.make("AquaFish-v0", morphology=HALF.to_dict(), fin_angles=angles, frame_skip=5)
    observation, _ = env.reset(seed=0)
    policy = controller.policy()
    for step in range(40):
        observation, *_, info = env.step(policy(observation, time=0.05 * step))
    env.close()
    # Observations are single precision.
    far = swim(controller, HALF, angles, seconds=2.0).distance
    assert info["y_position"] == pytest.approx(far, abs=1e-4)


def test_a_short_evolution_finds_something_that_swims() -> None:
    config = EvolveConfig(seed=1000, generations=8, population=40, poses=0, paper=True)
    evolved = evolve_gait(None, config)
    far = swim(evolved.controller, Morphology.nominal(), engine="numba").distance
    assert far > 3.0
    assert far == pytest.approx(evolved.fitness, abs=0.05)


def test_no_robots_is_no_distances() -> None:
    assert swim_all([], HALF, POSES).shape == (0, 3)
    assert swim_all([make_controller()], HALF, np.zeros((0, 3))).shape == (1, 0)


def test_bad_arguments_are_refused_by_name() -> None:
    controller = make_controller()
    with pytest.raises(InvalidArgumentError, match=r"fin_angles must have shape \(any, 3\)"):
        swim_all([controller], HALF, ZERO_POSE)
    with pytest.raises(InvalidArgumentError, match="fin_angles must be finite"):
        swim(controller, HALF, (0.0, np.nan, 0.0))
    with pytest.raises(InvalidArgumentError, match="seconds must lie in"):
        swim(controller, HALF, seconds=-1.0)
    with pytest.raises(UnknownNameError, match="did you mean 'pybullet'"):
        swim(controller, HALF, engine="pybulet")
    with pytest.raises(UnknownNameError, match="dtype must be one of"):
        swim_all([controller], HALF, dtype="float16")
    for threads in (0, -3, 1.5):
        with pytest.raises(InvalidArgumentError, match="threads must be a whole number"):
            swim_all([controller], HALF, threads=threads)  # type: ignore[arg-type]
    for count in (-1, 2.5):
        with pytest.raises(InvalidArgumentError, match="count must be a whole number"):
            random_poses(count, 0)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgumentError, match="seed must be a whole number"):
        random_poses(1, -1)
    with pytest.raises(InvalidArgumentError, match="morphology must have shape"):
        swim(controller, np.zeros(3))


def test_a_body_is_whatever_makes_one() -> None:
    controller = make_controller()
    far = swim_all([controller], HALF, seconds=0.5)
    sizes = {"left_pectoral": HALF.left_pectoral}
    np.testing.assert_array_equal(swim_all([controller], sizes, seconds=0.5), far)
    np.testing.assert_array_equal(swim_all([controller], HALF.to_array(), seconds=0.5), far)
    whole = swim(controller, Morphology.nominal(), engine="numba", seconds=0.5)
    assert swim(controller, None, engine="numba", seconds=0.5).distance == whole.distance
