"""The physics where the answer is known, on every carrier that runs it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import harness
from aquafish_gym.engines.lanes import rest_rows
from aquafish_gym.morphology import MAXIMA, Morphology
from aquafish_gym.physics.hydrodynamics import (
    AXIAL_DRAG,
    DENSITY,
    NORMAL_DRAG,
    SKIN_FRICTION,
)
from aquafish_gym.robot import (
    BODY_MASS,
    MOUNT_LENGTH,
    MOUNT_WIDTH,
    RADIUS,
    robot_from_column,
    robot_parameters,
)
from harness import CARRIERS, ROUNDING, drag, march
from momentum import Momentum

POSITION, VELOCITY, SPIN = slice(4, 7), slice(7, 10), slice(10, 13)
NOMINAL = Morphology.nominal().to_array()
STILL = np.zeros((1, 3))

carriers = pytest.mark.parametrize("carrier", CARRIERS)


def some_trials(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return (
        rng.uniform(0, 1, (count, 9)) * MAXIMA,
        rng.uniform([-0.5, -0.5, 0], [0.5, 0.5, 1], (count, 3)),
        rng.uniform(-math.pi, math.pi, (count, 3)),
    )


def turned(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Turn v (3, B) by quaternions q (4, B)."""
    t = 2 * np.cross(q[:3], v, axis=0)
    return v + q[3] * t + np.cross(q[:3], t, axis=0)


@carriers
def test_a_capsule_that_coasts_slows_as_one_over_t(carrier: str) -> None:
    states = rest_rows(np.zeros((1, 3)))
    states[8] = 2.0
    after = march(carrier, np.zeros((1, 9)), states, STILL, h=1e-3, steps=2000)
    area = (
        0.5
        * DENSITY
        * (AXIAL_DRAG * math.pi * RADIUS**2 + 2 * 2 * SKIN_FRICTION * MOUNT_WIDTH * MOUNT_LENGTH)
    )
    k = area / BODY_MASS
    assert_allclose(after[8], 2.0 / (1 + k * 2.0 * 2.0), rtol=1e-4)
    assert_allclose(after[[7, 9, 10, 11, 12]], 0, atol=1e-6)


@carriers
def test_a_pushed_plate_reaches_its_terminal_velocity_along_a_tanh(carrier: str) -> None:
    fin, push, mass, h = np.array([[0.8], [1.5], [0.0]]), 0.3, 0.7, 1e-3
    area = 0.8 * 1.5
    terminal = math.sqrt(2 * push / (DENSITY * NORMAL_DRAG * area))
    speed, motion = 0.0, np.zeros((6, 1))
    for step in range(1, 12001):
        motion[2] = speed
        speed += h * (push + float(drag(carrier, fin, motion)[2, 0])) / mass
        if step == 1000:
            expected = terminal * math.tanh(step * h * push / (mass * terminal))
            assert_allclose(speed, expected, rtol=1e-3)
    assert_allclose(speed, terminal, rtol=1e-5)


@carriers
def test_a_hinged_plate_that_turns_feels_an_eighth_rho_cn_width_length4_rate2(carrier: str) -> None:
    width, length, rate = 0.8, 1.5, 2.5
    motion = np.zeros((6, 1))
    motion[3] = rate
    force = drag(carrier, np.array([[width], [length], [0.0]]), motion)
    torque = DENSITY * NORMAL_DRAG * width * length**4 * rate**2 / 8
    assert_allclose(force[3], -torque, rtol=20 * ROUNDING[carrier])


@carriers
def test_drag_never_gives_power(carrier: str) -> None:
    rng = np.random.default_rng(1)
    fins = rng.uniform(0, 1, (3, 500)) * np.array([[1.0], [2.0], [0.5]])
    motion = rng.normal(size=(6, 500))
    power = (drag(carrier, fins, motion) * motion).sum(axis=0)
    assert (power <= 1e-6).all()
    assert power.min() < -0.1


@carriers
def test_without_fluid_linear_momentum_is_kept(carrier: str) -> None:
    """Every step solves Newton's law for the whole robot, so the scheme's only error is O(h)."""
    bodies, commands, angles = some_trials(6)
    errors = []
    for h in (0.004, 0.002):
        states = rest_rows(angles)
        states[POSITION] = 0.0
        one = march(carrier, bodies, states, commands, h=h, steps=1, wet=False)
        end = march(carrier, bodies, one, commands, h=h, steps=round(2 / h), wet=False)
        errors.append(
            max(
                abs(momentum(bodies[b], end[:, b]) - momentum(bodies[b], one[:, b])).max()
                for b in range(6)
            )
        )
    assert errors[1] < 0.02
    assert errors[1] < 0.6 * errors[0] + 1e-4


def momentum(body: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Return the whole robot's linear momentum in the world, from scratch."""
    robot = robot_from_column(robot_parameters(body[None])[:, 0])
    angles = np.array([math.atan2(state[14], state[13]), math.atan2(state[16], state[15])])
    phase = math.atan2(state[18], state[17])
    tail = math.radians(30) * math.sin(phase)
    model = Momentum(robot, np.zeros(3), np.array([*angles, phase]))
    model.joints = lambda _t: (np.array([*angles, tail]), state[19:22], phase)  # type: ignore[method-assign]
    q = state[0:4, None]
    velocity = turned(np.concatenate([-q[:3], q[3:]]), state[7:10, None])[:, 0]
    p = model.start_momenta(velocity, state[10:13])[:3]
    return turned(q, p[:, None])[:, 0]


def test_without_fluid_rk4_keeps_momenta_to_rounding() -> None:
    bodies, commands, angles = some_trials(3)
    for body, command, fins in zip(bodies, commands, angles, strict=True):
        robot = robot_from_column(robot_parameters(body[None])[:, 0])
        model = Momentum(robot, command, fins, wet=False)
        p0 = model.start_momenta(np.array([0.2, -0.1, 0.3]), np.array([0.5, 1.0, -0.7]))
        y = model.run(np.concatenate([np.zeros(3), [0, 0, 0, 1.0], p0]), 0.005, 400)
        q = (y[3:7] / np.linalg.norm(y[3:7]))[:, None]
        assert_allclose(turned(q, y[7:10, None])[:, 0], p0[:3], atol=1e-9)
        about_origin = turned(q, y[10:13, None])[:, 0] + np.cross(y[:3], p0[:3])
        assert_allclose(about_origin, p0[3:], atol=1e-9)


@carriers
def test_with_joints_locked_in_still_water_energy_never_rises(carrier: str) -> None:
    bodies, _, angles = some_trials(8, seed=3)
    rng = np.random.default_rng(4)
    states = rest_rows(angles)
    states[VELOCITY], states[SPIN] = rng.normal(size=(3, 8)), rng.normal(size=(3, 8))
    energies = []
    for _ in range(60):
        energies.append([energy(bodies[b], states[:, b]) for b in range(8)])
        states = march(carrier, bodies, states, np.zeros((8, 3)), steps=5)
    assert (np.diff(energies, axis=0) <= 1e-6).all()
    assert (np.array(energies[-1]) < 0.5 * np.array(energies[0])).all()


def energy(body: np.ndarray, state: np.ndarray) -> float:
    """Return the kinetic energy of a robot whose joints stand still."""
    robot = robot_from_column(robot_parameters(body[None])[:, 0])
    phase = math.atan2(state[18], state[17])
    fins = np.array([math.atan2(state[14], state[13]), math.atan2(state[16], state[15]), phase])
    whole = Momentum(robot, np.zeros(3), fins).masses(0.0)[0]
    q = state[0:4, None]
    v = turned(np.concatenate([-q[:3], q[3:]]), state[7:10, None])[:, 0]
    u = np.concatenate([v, state[10:13]])
    return float(0.5 * u @ whole @ u)


@carriers
def test_a_symmetric_stroke_swims_straight(carrier: str) -> None:
    body = NOMINAL.copy()
    after = march(carrier, body[None], rest_rows(np.array([[0.3, 0.3, 0.0]])),
                  np.array([[0.37, 0.37, 0.0]]), steps=400)  # fmt: skip
    assert abs(after[9, 0]) + abs(after[10, 0]) > 1e-3, "it moves up or pitches"
    assert_allclose(after[[4, 7, 11, 12]], 0, atol=50 * ROUNDING[carrier])


def mirrored(bodies, commands, angles, left_right: bool):  # type: ignore[no-untyped-def]
    bodies, commands, angles = bodies.copy(), commands.copy(), angles.copy()
    if left_right:
        bodies = bodies[:, [3, 4, 5, 0, 1, 2, 6, 7, 8]]
        commands, angles = commands[:, [1, 0, 2]], angles[:, [1, 0, 2]]
        angles[:, 2] += math.pi
    else:
        commands[:, :2] *= -1
        angles[:, :2] *= -1
    return bodies, commands, angles


@carriers
@pytest.mark.parametrize("left_right", [True, False], ids=["left-right", "up-down"])
def test_the_mirrored_robot_swims_the_mirrored_path(carrier: str, left_right: bool) -> None:
    trials = some_trials(10, seed=5)
    paths = []
    for bodies, commands, angles in (trials, mirrored(*trials, left_right)):
        paths.append(march(carrier, bodies, rest_rows(angles), commands, steps=256))
    axis = 0 if left_right else 2
    flip = np.ones(3)
    flip[axis] = -1
    scale = 2e3 * ROUNDING[carrier]
    assert_allclose(paths[1][POSITION], paths[0][POSITION] * flip[:, None], atol=scale)
    assert_allclose(paths[1][SPIN], -paths[0][SPIN] * flip[:, None], atol=10 * scale)


@carriers
def test_a_current_is_a_change_of_frame(carrier: str) -> None:
    bodies, commands, angles = some_trials(10, seed=6)
    u = np.array([0.3, -0.2, 0.1])
    states = rest_rows(angles)
    still = march(carrier, bodies, states, commands, steps=256)
    states[VELOCITY] = u[:, None]
    carried = march(carrier, bodies, states, commands, steps=256, current=tuple(u))
    drift = u[:, None] * 2.56
    tolerance = 2e3 * ROUNDING[carrier]
    assert_allclose(carried[POSITION] - drift, still[POSITION], atol=tolerance)
    assert_allclose(carried[SPIN], still[SPIN], atol=10 * tolerance)


@carriers
def test_twice_the_speed_at_half_the_step_traces_the_same_path(carrier: str) -> None:
    bodies, commands, angles = some_trials(10, seed=7)
    commands *= 0.5
    slow = march(carrier, bodies, rest_rows(angles), commands, h=0.01, steps=256)
    fast = march(carrier, bodies, rest_rows(angles), 2 * commands, h=0.005, steps=256)
    tolerance = 2e3 * ROUNDING[carrier]
    assert_allclose(fast[POSITION], slow[POSITION], atol=tolerance)
    assert_allclose(fast[VELOCITY], 2 * slow[VELOCITY], atol=10 * tolerance)


@carriers
def test_the_tail_gives_no_mean_force_while_the_base_is_held(carrier: str) -> None:
    """So its thrust comes from recoil."""
    fin, total, samples = np.array([[0.6], [1.4], [0.4]]), np.zeros(2), 64
    for i in range(samples):
        phase = 2 * math.pi * (i + 0.5) / samples
        angle = math.radians(30) * math.sin(phase)
        motion = np.zeros((6, 1))
        motion[3] = math.radians(30) * 2 * math.pi * math.cos(phase)
        _, along, normal = drag(carrier, fin, motion)[:3, 0]
        c, s = math.cos(angle), math.sin(angle)
        total += [c * along - s * normal, s * along + c * normal]
    assert_allclose(total / samples, 0, atol=20 * ROUNDING[carrier])


@carriers
def test_only_a_quadratic_law_rows_with_full_turns(carrier: str) -> None:
    """A paddle whose speed varies within the turn makes a net impulse; a linear law's is none."""
    fin, samples = np.array([[0.4], [1.6], [0.1]]), 256
    total, linear = np.zeros(2), np.zeros(2)
    for i in range(samples):
        angle = 2 * math.pi * i / samples
        rate = 2.5 * (1 + 0.5 * math.cos(angle))
        motion = np.zeros((6, 1))
        motion[3] = rate
        _, along, normal = drag(carrier, fin, motion)[:3, 0]
        c, s = math.cos(angle), math.sin(angle)
        force = np.array([c * along - s * normal, s * along + c * normal])
        total += force / rate  # the time spent at an angle is 1 / rate
        linear += force / rate**2  # the same force, were it proportional to the speed
    assert abs(total / samples).max() > 0.1
    assert_allclose(linear / samples, 0, atol=20 * ROUNDING[carrier])


def test_the_scheme_converges_to_rk4_with_order_one() -> None:
    bodies, commands, angles = some_trials(3, seed=8)
    orders = []
    for i in range(3):
        robot = robot_from_column(robot_parameters(bodies[i : i + 1])[:, 0])
        model = Momentum(robot, commands[i], angles[i])
        # The engines' robot starts at rest and its joints jump to speed in the first step,
        # which passes momentum from fins to body; RK4 starts with the same total: none.
        start = np.concatenate([np.zeros(3), [0, 0, 0, 1.0], np.zeros(6)])
        truth = model.run(start, 0.005, 256)[:3]
        errors = []
        for h in (0.01, 0.005, 0.0025):
            end = march("float64", bodies[i : i + 1], rest_rows(angles[i : i + 1]),
                        commands[i : i + 1], h=h, steps=round(1.28 / h))  # fmt: skip
            errors.append(np.linalg.norm(end[POSITION, 0] - truth))
        orders.append(math.log2(errors[0] / errors[1]))
        orders.append(math.log2(errors[1] / errors[2]))
    assert_allclose(np.median(orders), 1.0, atol=0.1)


def test_carriers_agree() -> None:
    bodies, commands, angles = some_trials(20, seed=9)
    bodies[0], bodies[1] = 0, MAXIMA
    ends = {c: march(c, bodies, rest_rows(angles), commands, steps=512) for c in CARRIERS}
    assert_array_equal(ends["float64"], ends["floats"], "to the last bit")
    assert np.median(abs(ends["float32"] - ends["float64"]).max(axis=0)) < 1e-3


def test_a_robot_with_no_fins_stays_at_rest() -> None:
    for carrier in CARRIERS:
        after = march(carrier, np.zeros((1, 9)), rest_rows(np.zeros((1, 3))),
                      np.array([[0.5, -0.5, 1.0]]), steps=1000)  # fmt: skip
        assert_allclose(after[VELOCITY], 0, atol=1e-5)
        assert_allclose(after[POSITION], 0, atol=1e-4)


def test_the_harness_runs_the_very_functions_that_the_engines_run() -> None:
    from aquafish_gym.engines import kernel
    from aquafish_gym.physics import dynamics

    assert harness.forces is dynamics.forces
    assert harness.move is dynamics.move
    assert kernel.step is dynamics.step
