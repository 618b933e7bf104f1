"""The robot in MuJoCo, which the verification compares with ours."""

from __future__ import annotations

import math
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym.command import servo_speeds
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from instruments.verification.convergence import attitude_gap
from instruments.verification.harness import POSITION, QUATERNION, march
from instruments.verification.mechanics import extrapolate
from instruments.verification.mujoco_world import BoxWorld, MujocoWorld
from instruments.verification.paper_robot import SWEEP
from instruments.verification.trials import random_trials

pytest.importorskip("mujoco")

TRIALS = random_trials(3, seed=1)
STILL = (0.0, 0.0, 0.0)


def started(trial: int, current: tuple[float, float, float] = STILL, finer: int = 1) -> MujocoWorld:
    world = MujocoWorld(substeps=finer)
    angles = TRIALS.fin_angles[trial]
    world.start(Scenario.create(TRIALS.morphologies[trial], fin_angles=angles, current=current))
    return world


def dry_end(trial: int, seconds: float, finer: int) -> tuple[np.ndarray, np.ndarray]:
    """Return where a trial's robot ends without water, and its orientation there."""
    world = started(trial, finer=finer)
    world.model.opt.density = world.model.opt.viscosity = 0.0
    world.advance(tuple(TRIALS.commands[trial]), round(seconds / TIMESTEP))
    return np.array(world.state().position), np.array(world.state().orientation)


def test_joints_follow_their_commands() -> None:
    """Fins without mass do, too, and all do in a strong current."""
    command, angles = np.array((0.5, -0.5, 1.0)), np.array((3.0, -2.0, 1.0))
    for body in (Morphology.nominal().to_array(), AQUAFISH.maxima, np.zeros(9)):
        world = MujocoWorld()
        world.start(Scenario.create(body, fin_angles=angles, current=(0.0, -20.0, 0.0)))
        for step in range(1, 101):
            world.advance(tuple(command))
            left, right, phase = angles + 2 * math.pi * command * step * TIMESTEP
            wanted = (left, right, SWEEP * math.sin(phase))
            np.testing.assert_allclose(world.data.qpos[7:], wanted, atol=1e-5)


def test_without_water_its_motion_tends_to_ours_with_order_one() -> None:
    """tests/physics/test_oracles.py compares our limit with an independent one."""
    trial, seconds, one = 0, 1.0, slice(0, 1)
    rows = layout(AQUAFISH).start(TRIALS.fin_angles[one])
    ours = [
        march("float64", TRIALS.morphologies[one], rows, TRIALS.commands[one], h,
              round(seconds / h), wet=False)[:, 0]
        for h in (0.002, 0.001, 0.0005)
    ]  # fmt: skip
    limit = extrapolate(*ours)
    turned = limit[QUATERNION] / np.linalg.norm(limit[QUATERNION])
    ends = [dry_end(trial, seconds, finer) for finer in (1, 2, 4)]
    gaps = [float(attitude_gap(q, turned)) for _, q in ends]
    assert gaps[0] < 0.01
    assert all(1.8 < coarse / fine < 2.2 for coarse, fine in pairwise(gaps))
    position, quaternion = (extrapolate(*(end[i] for end in ends)) for i in (0, 1))
    np.testing.assert_allclose(position, limit[POSITION], atol=1e-5)
    np.testing.assert_allclose(np.abs(quaternion @ turned), 1.0, atol=1e-8)


def test_current_is_a_change_of_frame() -> None:
    current = np.array((0.15, -0.1, 0.05))
    world, still = started(0, tuple(current)), started(0)
    world.data.qvel[:3] = current
    for one in (world, still):
        one.advance(tuple(TRIALS.commands[0]), 200)
    drifted = np.array(world.state().position) - 2.0 * current
    np.testing.assert_allclose(drifted, still.state().position, atol=1e-9)


@pytest.mark.parametrize("kind", [MujocoWorld, BoxWorld])
def test_an_environment_swims_in_mujocos_water(kind: type[MujocoWorld]) -> None:
    action = np.array([0.5, -0.25, 1.0], np.float32)
    env = gym.make("AquaFish-v0", engine=kind, current=(0.1, 0.0, 0.0), fin_angles=(0.5, 1.0, 2.0))
    env.reset(seed=0)
    world = kind()
    world.start(Scenario.create(fin_angles=(0.5, 1.0, 2.0), current=(0.1, 0.0, 0.0)))
    for _ in range(20):
        info = env.step(action)[-1]
        world.advance(servo_speeds(AQUAFISH, tuple(action.tolist())), 20)
    x, y, z = world.state().position
    assert (info["x_position"], info["y_position"], info["z_position"]) == (x, y, z)
    assert abs(y) > 0.1


@pytest.mark.parametrize("kind", [MujocoWorld, BoxWorld])
def test_damage_strikes_in_mid_swim(kind: type[MujocoWorld]) -> None:
    whole = Scenario.create(fin_angles=(0.5, 1.0, 2.0))
    sizes, gains = 0.5 * whole.body, (0.0, -1.0, 0.5)
    broken = Scenario.create(sizes, servo_gain=gains, current=(0.0, 0.3, 0.0))
    world, command = kind(), (0.5, 0.4, 1.0)
    world.start(whole)
    world.advance(command, 300)
    before, angles, masses = world.state(), world.fin_angles, world.model.body_mass[2:]
    world.update(broken)
    assert world.state() == before
    np.testing.assert_allclose(world.model.body_mass[2:], 0.125 * masses)
    world.advance(command, 10)
    turned = np.subtract(world.fin_angles, angles) / (0.2 * math.pi)
    np.testing.assert_allclose(turned, np.multiply(gains, command), atol=1e-9)
    for one, other in zip(before[:4], world.state()[:4], strict=True):
        assert 1e-6 < np.abs(np.subtract(one, other)).max() < 0.3


def test_mujocos_water_has_no_options_of_ours() -> None:
    for other in ({"reactive": True}, {"drag": (1.0, 0.5)}, {"fin_density": 0.5}):
        with pytest.raises(
            InvalidArgumentError, match=r"reactive must be False and drag and fin density 1;"
        ):
            BoxWorld().start(Scenario.create(**other))
