"""The physics where the answer is known, on everything that can swim a robot.

Each test says what it needs of a swimmer. ``python tests/physics/test_known_answers.py`` prints
the tests that do not apply to some of them, and why.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from aquafish_gym.engines.compiled import kernel
from aquafish_gym.physics import dynamics
from aquafish_gym.physics.hydrodynamics import AXIAL_DRAG, DENSITY, NORMAL_DRAG, SKIN_FRICTION
from aquafish_gym.physics.law import law
from aquafish_gym.physics.layout import layout
from aquafish_gym.physics.robot import MINIMUM_FIN_MASS, hull_numbers
from aquafish_gym.plans import AQUAFISH, BodyPlan
from instruments.verification import harness
from instruments.verification.harness import (
    BACKENDS,
    POSITION,
    QUATERNION,
    SPIN,
    VELOCITY,
    march,
)
from instruments.verification.momentum import (
    Momentum,
    angular_momentum,
    kinetic_energy,
    total_momentum,
)
from instruments.verification.paper_robot import SWEEP
from instruments.verification.quadrature import mount_plates
from instruments.verification.rk4 import rotation_matrix
from instruments.verification.trials import Trials, random_trials
from swimmers import OF_OTHER_PLANS, SWIMMERS, Swimmer
from tests.plans import EACH_PLAN, ODD


def hull_alone(plan: BodyPlan) -> tuple[np.ndarray, float, float]:
    """Return a body without fins, (1, S), its mass, and its axial force per speed squared."""
    count = len(plan.fins)
    mass = hull_numbers(plan.hull).mass * (1 + count * MINIMUM_FIN_MASS)
    plates = sum(width * length for _, _, width, length in mount_plates(plan))
    axial = AXIAL_DRAG * math.pi * plan.hull.radius**2 + 2 * SKIN_FRICTION * plates
    return np.zeros((1, 3 * count)), mass, 0.5 * DENSITY * axial


def locked(plan: BodyPlan) -> np.ndarray:
    """Return fins of one robot at angle 0, or at speed 0."""
    return np.zeros((1, len(plan.fins)))


# (test, swimmer, reason): what is left out, which no test is silently.
LEFT_OUT: list[tuple[str, str, str]] = []


def contract(*needs: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Run a test for every swimmer that can do what it ``needs``."""

    def mark(test: Callable[..., None]) -> Callable[..., None]:
        able = []
        for swimmer in SWIMMERS:
            missing = [swimmer.cannot[need] for need in needs if need in swimmer.cannot]
            if missing:
                LEFT_OUT.append((test.__name__, swimmer.name, missing[0]))
                continue
            marks = [pytest.mark.pybullet] if "pybullet" in swimmer.name else []
            marks += [pytest.mark.slow] if swimmer in OF_OTHER_PLANS else []
            able.append(pytest.param(swimmer, marks=marks, id=swimmer.name))
        return pytest.mark.parametrize("swimmer", able)(test)

    return mark


def some_trials(swimmer: Swimmer, seed: int = 0, count: int | None = None) -> Trials:
    return random_trials(count or swimmer.robots, seed, swimmer.plan)


def moving_rows(trials: Trials, seed: int, speed: float = 1.0) -> np.ndarray:
    """Return robots in any attitude, moving and turning, with their joints still."""
    angles = trials.fin_angles
    rng, rows = np.random.default_rng(seed), layout(trials.plan).start(angles)
    q = rng.normal(size=(4, len(angles)))
    rows[QUATERNION] = q / np.linalg.norm(q, axis=0)
    rows[VELOCITY], rows[SPIN] = speed * rng.normal(size=(2, 3, len(angles)))
    return rows


@contract("short steps", "rigid", "mirror")
def test_a_capsule_that_coasts_slows_as_one_over_t(swimmer: Swimmer) -> None:
    still = locked(swimmer.plan)
    hull, mass, axial = hull_alone(swimmer.plan)
    states = layout(swimmer.plan).start(still, velocity=(0.0, 2.0, 0.0))
    after = swimmer.march(hull, states, still, h=1e-3, steps=2000)
    k = axial / mass
    assert_allclose(after[8], 2.0 / (1 + k * 2.0 * 2.0), rtol=1e-4)
    assert_allclose(after[[7, 9, 10, 11, 12]], 0, atol=1e-6)


@contract("push", "mirror")
def test_a_pushed_capsule_gains_speed_along_a_tanh(swimmer: Swimmer) -> None:
    push = 5.0
    still = locked(swimmer.plan)
    hull, mass, axial = hull_alone(swimmer.plan)
    terminal = math.sqrt(push / axial)
    states = layout(swimmer.plan).start(still)
    long = round(6.2 * mass * terminal / push / 0.01)  # of six time constants
    for steps, tolerance in ((200, 2e-3), (long, 1e-4)):
        time = 0.01 * steps
        after = swimmer.march(hull, states, still, steps=steps, push=(0.0, push, 0.0))
        expected = terminal * math.tanh(time * push / (mass * terminal))
        assert_allclose(after[8], expected, rtol=tolerance)
    assert_allclose(after[8], terminal, rtol=1e-4)


@contract("drag")
def test_a_pushed_plate_reaches_its_terminal_velocity_along_a_tanh(swimmer: Swimmer) -> None:
    fin, push, mass, h = np.array([[0.8], [1.5], [0.0]]), 0.3, 0.7, 1e-3
    area = 0.8 * 1.5
    terminal = math.sqrt(2 * push / (DENSITY * NORMAL_DRAG * area))
    speed, motion = 0.0, np.zeros((6, 1))
    for step in range(1, 12001):
        motion[2] = speed
        speed += h * (push + float(swimmer.drag(fin, motion)[2, 0])) / mass
        if step == 1000:
            expected = terminal * math.tanh(step * h * push / (mass * terminal))
            assert_allclose(speed, expected, rtol=1e-3)
    assert_allclose(speed, terminal, rtol=1e-5)


@contract("drag")
def test_a_hinged_plate_that_turns_feels_an_eighth_rho_cn_width_length4_rate2(
    swimmer: Swimmer,
) -> None:
    width, length, rate = 0.8, 1.5, 2.5
    motion = np.zeros((6, 1))
    motion[3] = rate
    force = swimmer.drag(np.array([[width], [length], [0.0]]), motion)
    torque = DENSITY * NORMAL_DRAG * width * length**4 * rate**2 / 8
    assert_allclose(force[3], -torque, rtol=20 * swimmer.rounding)


@contract("drag")
def test_drag_never_gives_power(swimmer: Swimmer) -> None:
    rng = np.random.default_rng(1)
    fins = rng.uniform(0, 1, (3, 500)) * np.array([[1.0], [2.0], [0.5]])
    motion = rng.normal(size=(6, 500))
    power = (swimmer.drag(fins, motion) * motion).sum(axis=0)
    assert (power <= 20 * swimmer.rounding).all()
    assert power.min() < -0.1


@contract("dry", "short steps")
def test_without_fluid_momenta_are_kept_to_first_order(swimmer: Swimmer) -> None:
    """Every step solves Newton's and Euler's laws of the whole: the scheme's only error is O(h)."""
    bodies, commands, angles, plan = some_trials(swimmer)
    errors = []
    for h in (0.005, 0.0025):
        one = swimmer.march(bodies, layout(plan).start(angles), commands, h=h, steps=1, wet=False)
        end = swimmer.march(bodies, one, commands, h=h, steps=round(2 / h), wet=False)
        changes = [
            [
                abs(total_momentum(body, after, plan) - total_momentum(body, before, plan)).max(),
                abs(
                    angular_momentum(body, after, plan) - angular_momentum(body, before, plan)
                ).max(),
            ]
            for body, before, after in zip(bodies, one.T, end.T, strict=True)
        ]
        errors.append(np.max(changes, axis=0))
    assert errors[1][0] < 0.02
    assert errors[1][1] < 0.1
    assert (errors[1] < 0.6 * errors[0] + 100 * swimmer.rounding).all()


@pytest.mark.parametrize("plan", EACH_PLAN)
def test_without_fluid_rk4_keeps_momenta_to_rounding(plan: BodyPlan) -> None:
    trials = random_trials(3, 0, plan)
    for number in range(3 if plan == AQUAFISH else 1):
        model = Momentum.of(trials, number, wet=False)
        start = model.moving(np.array([0.2, -0.1, 0.3]), np.array([0.5, 1.0, -0.7]))
        end = model.run(start, 0.005, 400)
        for before, after in zip(model.momenta(start), model.momenta(end), strict=True):
            assert_allclose(after, before, atol=1e-9)


@contract("rigid")
def test_with_joints_locked_in_still_water_energy_never_rises(swimmer: Swimmer) -> None:
    trials = some_trials(swimmer, seed=3)
    bodies, plan = trials.morphologies, trials.plan
    states = moving_rows(trials, seed=4)
    energies = []
    for _ in range(60):
        energies.append([kinetic_energy(b, s, plan) for b, s in zip(bodies, states.T, strict=True)])
        states = swimmer.march(bodies, states, 0 * trials.commands, steps=5)
    assert (np.diff(energies, axis=0) <= 20 * swimmer.rounding).all()
    assert (np.array(energies[-1]) < 0.5 * np.array(energies[0])).all()


@contract()
def test_a_robot_with_no_fins_stays_at_rest(swimmer: Swimmer) -> None:
    plan = swimmer.plan
    hull, _, _ = hull_alone(plan)
    command = np.where(np.arange(len(plan.fins)) % 2, plan.command_low, plan.command_high)[None]
    after = swimmer.march(hull, layout(plan).start(locked(plan)), command, steps=1000)
    assert_allclose(after[VELOCITY], 0, atol=1e-5)
    assert_allclose(after[POSITION], 0, atol=1e-4)


@contract("mirror")
def test_a_symmetric_stroke_swims_straight(swimmer: Swimmer) -> None:
    plan = swimmer.plan
    bodies, commands, angles = plan.nominal[None], locked(plan), locked(plan)
    pairs = [group for group in plan.groups if len(group) == 2]
    for left, _ in pairs:
        commands[0, left], angles[0, left] = 0.37, 0.3
    image = mirrored(Trials(bodies, commands, angles, plan), True)
    for _, right in pairs:
        commands[0, right], angles[0, right] = image.commands[0, right], image.fin_angles[0, right]
    after = swimmer.march(bodies, layout(plan).start(angles), commands, steps=400)
    assert abs(after[[8, 9, 10], 0]).max() > 1e-3, "it moves ahead or up, or pitches"
    assert_allclose(after[[4, 7, 11, 12]], 0, atol=50 * swimmer.rounding)


def mirrored(trials: Trials, left_right: bool) -> Trials:
    """Return the mirror images of trials; every fin's axis is x or z.

    A mirror keeps the turns about its own normal, and turns others round.
    """
    bodies, commands, angles, plan = trials
    order = np.arange(len(plan.fins))
    for one, *other in plan.groups if left_right else ():
        for each in other:
            order[[one, each]] = each, one
    bodies = bodies.reshape(-1, len(order), 3)[:, order].reshape(bodies.shape)
    commands, angles = commands[:, order], angles[:, order]
    for i, fin in enumerate(plan.fins):
        if (fin.axis[0] == 0.0) == left_right:
            if fin.turns:
                commands[:, i] *= -1
                angles[:, i] *= -1
            else:
                angles[:, i] += math.pi
    return Trials(bodies, commands, angles, plan)


@contract("mirror")
@pytest.mark.parametrize("left_right", [True, False], ids=["left-right", "up-down"])
def test_the_mirrored_robot_swims_the_mirrored_path(swimmer: Swimmer, left_right: bool) -> None:
    trials = some_trials(swimmer, seed=5)
    paths = []
    for bodies, commands, angles, plan in (trials, mirrored(trials, left_right)):
        paths.append(swimmer.march(bodies, layout(plan).start(angles), commands, steps=256))
    flip = np.ones((3, 1))
    flip[0 if left_right else 2] = -1
    scale = 2e3 * swimmer.rounding
    assert abs(paths[0][POSITION]).max() > 0.05
    assert_allclose(paths[1][POSITION], paths[0][POSITION] * flip, atol=scale)
    assert_allclose(paths[1][SPIN], -paths[0][SPIN] * flip, atol=10 * scale)


@contract()
def test_a_current_is_a_change_of_frame(swimmer: Swimmer) -> None:
    bodies, commands, angles, plan = some_trials(swimmer, seed=6)
    u = np.array([0.3, -0.2, 0.1])
    states = layout(plan).start(angles)
    still = swimmer.march(bodies, states, commands, steps=256)
    states[VELOCITY] = u[:, None]
    carried = swimmer.march(bodies, states, commands, steps=256, current=(0.3, -0.2, 0.1))
    tolerance = 2e3 * swimmer.rounding
    assert_allclose(carried[POSITION] - u[:, None] * 2.56, still[POSITION], atol=tolerance)
    assert_allclose(carried[SPIN], still[SPIN], atol=10 * tolerance)


@contract()
def test_no_place_and_no_heading_is_special(swimmer: Swimmer) -> None:
    """A robot that starts elsewhere, turned, swims the same path there, turned."""
    bodies, commands, angles, plan = some_trials(swimmer, seed=12)
    here = swimmer.march(bodies, layout(plan).start(angles), commands, steps=128)
    states, q = layout(plan).start(angles), np.array([0.5, 0.1, -0.7, 0.5])
    states[QUATERNION] = (q / np.linalg.norm(q))[:, None]
    states[POSITION] = [[3.0], [-2.0], [1.0]]
    there = swimmer.march(bodies, states, commands, steps=128)
    turn = rotation_matrix(states[QUATERNION, 0])
    tolerance = 2e3 * swimmer.rounding
    assert_allclose(there[POSITION] - states[POSITION], turn @ here[POSITION], atol=tolerance)
    assert_allclose(there[SPIN], here[SPIN], atol=10 * tolerance)


@contract("short steps")
def test_twice_the_speed_at_half_the_step_traces_the_same_path(swimmer: Swimmer) -> None:
    bodies, commands, angles, plan = some_trials(swimmer, seed=7)
    commands *= 0.5
    slow = swimmer.march(bodies, layout(plan).start(angles), commands, h=0.01, steps=256)
    fast = swimmer.march(bodies, layout(plan).start(angles), 2 * commands, h=0.005, steps=256)
    tolerance = 2e3 * swimmer.rounding
    assert_allclose(fast[POSITION], slow[POSITION], atol=tolerance)
    assert_allclose(fast[VELOCITY], 2 * slow[VELOCITY], atol=10 * tolerance)


@contract("drag")
def test_the_tail_gives_no_mean_force_while_the_base_is_held(swimmer: Swimmer) -> None:
    """So its thrust comes from recoil."""
    fin, total, samples = np.array([[0.6], [1.4], [0.4]]), np.zeros(2), 64
    for i in range(samples):
        phase = 2 * math.pi * (i + 0.5) / samples
        angle = SWEEP * math.sin(phase)
        motion = np.zeros((6, 1))
        motion[3] = SWEEP * 2 * math.pi * math.cos(phase)
        total += along_the_hinge(swimmer.drag(fin, motion), angle)
    assert_allclose(total / samples, 0, atol=20 * swimmer.rounding)


def along_the_hinge(force: np.ndarray, angle: float) -> np.ndarray:
    """Return a force's parts along the hinge frame's length and normal."""
    _, along, normal = force[:3, 0]
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * along - s * normal, s * along + c * normal])


@contract("drag")
def test_only_a_quadratic_law_rows_with_full_turns(swimmer: Swimmer) -> None:
    """A paddle whose speed varies within the turn makes a net impulse; a linear law's is none."""
    fin, samples = np.array([[0.4], [1.6], [0.1]]), 256
    total, linear = np.zeros(2), np.zeros(2)
    for i in range(samples):
        angle = 2 * math.pi * i / samples
        rate = 2.5 * (1 + 0.5 * math.cos(angle))
        motion = np.zeros((6, 1))
        motion[3] = rate
        force = along_the_hinge(swimmer.drag(fin, motion), angle)
        total += force / rate  # the time spent at an angle is 1 / rate
        linear += force / rate**2  # the same force, were it proportional to the speed
    assert abs(total / samples).max() > 0.1
    assert_allclose(linear / samples, 0, atol=20 * swimmer.rounding)


@functools.cache
def rk4_ends(plan: BodyPlan) -> np.ndarray:
    """Return where three robots are after 1.28 s, by the momentum form's RK4."""
    trials = random_trials(3, 8, plan)
    models = [Momentum.of(trials, number) for number in range(3)]
    return np.array([model.run(model.at_rest(), 0.01, 128)[:3] for model in models])


@contract("short steps", "rigid")
def test_the_scheme_converges_to_rk4_with_order_one(swimmer: Swimmer) -> None:
    bodies, commands, angles, plan = some_trials(swimmer, seed=8, count=3)
    errors = []
    for h in (0.01, 0.005, 0.0025):
        ends = swimmer.march(
            bodies, layout(plan).start(angles), commands, h=h, steps=round(1.28 / h)
        )
        errors.append(np.linalg.norm(ends[POSITION].T - rk4_ends(plan), axis=1))
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    assert_allclose(np.median(orders), 1.0, atol=0.1)


@contract("rigid")
def test_every_swimmer_swims_the_same_from_any_state(swimmer: Swimmer) -> None:
    """Any attitude, velocity, spin, joint angles and rates, in a current."""
    trials = some_trials(swimmer, seed=9)
    bodies, commands, _, plan = trials
    bodies[0], bodies[1] = 0, plan.maxima
    states = moving_rows(trials, seed=10, speed=0.5)
    states[layout(plan).rates] = np.random.default_rng(11).uniform(-3, 3, commands.T.shape)
    current = (0.2, 0.1, -0.3)
    ends = swimmer.march(bodies, states, commands, steps=256, current=current)
    reference = march("numba", bodies, states, commands, steps=256, current=current, plan=plan)
    same = np.sign((ends[QUATERNION] * reference[QUATERNION]).sum(axis=0))
    ends[QUATERNION] *= same  # q and -q are one attitude
    rows = layout(plan).state_numbers
    assert_allclose(ends[:rows], reference[:rows], atol=1e5 * swimmer.rounding)


def test_float64_lanes_are_plain_python_to_the_last_bit() -> None:
    bodies, commands, angles, _ = random_trials(5, seed=9)
    bodies[0], bodies[1] = 0, AQUAFISH.maxima
    ends = [
        march(c, bodies, layout(AQUAFISH).start(angles), commands, steps=256) for c in BACKENDS[:3]
    ]
    assert_array_equal(ends[1], ends[0])
    assert_array_equal(ends[2], ends[0])


def test_the_harness_runs_the_very_functions_that_the_engines_run() -> None:
    assert harness.forces is dynamics.forces
    assert harness.move is dynamics.move
    assert kernel.law is law is harness.law


def test_every_swimmer_answers_most_of_the_contract() -> None:
    """And the arithmetic, which are the physics itself, all of it."""
    left_out = dict.fromkeys((s.name for s in SWIMMERS), 0)
    for _, name, reason in LEFT_OUT:
        left_out[name] += 1
        assert reason
    whole = [s.name for s in SWIMMERS if s.name.startswith("backend") and s.plan != ODD]
    assert all(left_out[name] == 0 for name in whole)
    assert max(left_out.values()) <= 14


if __name__ == "__main__":
    for test, name, reason in LEFT_OUT:
        print(f"{name:24s} {test}: {reason}")
