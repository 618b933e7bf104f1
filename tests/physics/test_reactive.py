"""The optional reactive terms: conserved quantities, known answers, and swims with them."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from aquafish_gym import simulate
from aquafish_gym.physics import reactive
from aquafish_gym.physics.added_mass import (
    fin_added_mass,
    finite_span,
    hull_added_mass,
    plate_inertia,
    plate_mass,
    trailing_edge,
)
from aquafish_gym.physics.dynamics import Water, advance, forces, whole_inertia
from aquafish_gym.physics.hydrodynamics import DENSITY
from aquafish_gym.physics.kinematics import (
    State,
    at_rest,
    drive,
    joint_accelerations,
    joint_angles,
    next_joints,
)
from aquafish_gym.physics.reactive import accelerations_with, added_water, step_reactive
from aquafish_gym.physics.robot import Fin, Robot, hull_numbers
from aquafish_gym.plans import AQUAFISH, BodyPlan, Hull
from instruments.verification import propulsion
from instruments.verification.lattice import ASPECTS, lattice_share
from instruments.verification.momentum import hinge_motion, inertia_and_swing, robot_at
from instruments.verification.paper_robot import (
    BODY_ADDED_INERTIA,
    BODY_ADDED_MASS,
    BODY_INERTIA,
    BODY_MASS,
    CAUDAL_Y,
    LEAST_FIN_MASS,
)
from instruments.verification.propulsion import lighthill_thrust, tail_body
from instruments.verification.rk4 import rotation_matrix
from instruments.verification.trials import lane_batch, random_trials
from instruments.verification.water_momentum import (
    ReactiveMomentum,
    scheme_errors,
    water_inertia_and_swing,
)
from tests.plans import COMPILED_PLANS, EACH_PLAN, ODD, PLANS, plans

Vector = tuple[float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)
NO_FINS = np.zeros(9)
BODY = np.array([0.7, 1.3, 0.3, 0.5, 1.9, 0.1, 0.4, 1.1, 0.8])
TAIL_ALONE = np.array([0.0] * 6 + [0.1, 1.4, 0.6])
SHARES = st.one_of(st.just(0.0), st.just(1.0), st.floats(0, 1))
ANGLES = st.floats(-math.pi, math.pi)
SPEEDS = st.floats(-5, 5)


def robot_with(sizes: np.ndarray) -> Robot:
    return robot_at(AQUAFISH, np.asarray(sizes, np.float64))


def dry(plan: BodyPlan) -> Water:
    return Water(((ZERO, ZERO),) * len(plan.fins), (ZERO, ZERO))


def moving(velocity: Vector, spin: Vector = ZERO, angles: tuple[float, ...] = ZERO) -> State:
    return at_rest(angles)._replace(velocity=velocity, spin=spin)


def march(
    robot: Robot,
    state: State,
    command: tuple[float, ...],
    h: float,
    steps: int,
    wet: bool,
    plan: BodyPlan = AQUAFISH,
) -> State:
    """Advance on plain floats, with the law's drag or without."""
    by = drive(command, h)
    for _ in range(steps):
        joints = next_joints(plan, state, by, h)
        push = joint_accelerations(state, joints, h)
        water = forces(plan, robot, state, ZERO) if wet else dry(plan)
        added = added_water(plan, robot, state, push, ZERO)
        whole = whole_inertia(plan, robot, state, push, water)
        found = accelerations_with(whole, added, state.spin)
        state = advance(state, joints, found, h)
    return state


def totals(robot: Robot, state: State, plan: BodyPlan = AQUAFISH) -> tuple[np.ndarray, float]:
    """Return impulse and angular impulse of robot and water (6,), and their energy if locked.

    By the virtual work of ``verification/water_momentum.py``, which knows no accelerations.
    """
    rates = np.array(state.rates)
    angles, _, _ = hinge_motion(plan, np.array(joint_angles(state.joints)), 0 * rates)
    rigid, swing = inertia_and_swing(plan, robot, angles, rates)
    carried, swept = water_inertia_and_swing(plan, robot, angles, rates)
    inertia, r = rigid + carried, rotation_matrix(np.array(state.orientation))
    v = np.concatenate([r.T @ np.array(state.velocity), state.spin])
    momenta = inertia @ v + swing + swept
    p, momentum = r @ momenta[:3], r @ momenta[3:]
    return (
        np.concatenate([p, momentum + np.cross(state.position, p)]),
        float(0.5 * v @ inertia @ v),
    )


@pytest.mark.parametrize("locked", [True, False], ids=["locked", "moving"])
@pytest.mark.parametrize(("plan", "seconds"), [(AQUAFISH, 0.8), (ODD, 0.4)], ids=str)
def test_robot_and_water_keep_their_impulse_to_first_order(
    plan: BodyPlan, seconds: float, locked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without drag and without shedding; with locked joints they keep their energy, too."""
    monkeypatch.setattr(reactive, "trailing_edge", lambda *_: ZERO)
    robot = robot_at(plan, BODY if plan == AQUAFISH else 0.7 * plan.maxima)
    command = tuple(([0.5, -0.3, 0.8, 0.4, 0.6] * np.array(not locked)).tolist()[: len(plan.fins)])
    begun = moving((0.5, 0.3, -0.4), (0.8, -0.5, 0.6), (0.3, -1.0, 0.7, 0.2, 0.5)[: len(plan.fins)])
    errors = []
    for h in (0.004, 0.002):
        # One step first, within which the joints jump to speed.
        start = march(robot, begun, command, h, 1, wet=False, plan=plan)
        end = march(robot, start, command, h, round(seconds / h), wet=False, plan=plan)
        before, energy = totals(robot, start, plan)
        after, energy_after = totals(robot, end, plan)
        assert np.linalg.norm(before) > 1
        error = list(abs(after - before) / np.linalg.norm(before))
        if locked:
            error.append(abs(energy_after - energy) / energy)
        errors.append(np.array(error))
    assert errors[1].max() < 0.01
    large = errors[0] > 0.1 * errors[0].max()
    assert_allclose(errors[0][large] / errors[1][large], 2.0, atol=0.3)


@pytest.mark.parametrize("plan", EACH_PLAN)
def test_rk4_keeps_the_whole_impulse_to_rounding(
    plan: BodyPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = ReactiveMomentum.of(random_trials(1, 3, plan), 0)
    monkeypatch.setattr(model, "wet", False)
    start = model.moving(np.array([0.5, 0.3, -0.4]), np.array([0.8, -0.5, 0.6]))
    end = model.run(start, 0.005, 100)
    for before, after in zip(model.momenta(start), model.momenta(end), strict=True):
        assert_allclose(after, before, atol=1e-9)


def test_with_joints_locked_in_still_water_the_whole_energy_never_rises() -> None:
    rng = np.random.default_rng(0)
    for sizes in (BODY, TAIL_ALONE, AQUAFISH.maxima):
        robot = robot_with(sizes)
        for angles in rng.uniform(-math.pi, math.pi, (3, 3)):
            state = moving(tuple(rng.normal(size=3)), tuple(rng.normal(size=3)), tuple(angles))
            energies = [totals(robot, state)[1]]
            for _ in range(10):
                state = march(robot, state, ZERO, 0.01, 5, wet=True)
                energies.append(totals(robot, state)[1])
            assert (np.diff(energies) < 0).all()
            assert energies[-1] < 0.9 * energies[0]


def mobility(
    robot: Robot, angles: tuple[float, ...] = ZERO, plan: BodyPlan = AQUAFISH
) -> np.ndarray:
    """Return what ``accelerations_with`` answers to unit forces and torques, (6, 6)."""
    state, still = at_rest(angles), (0.0,) * len(plan.fins)
    whole = whole_inertia(plan, robot, state, still, dry(plan))
    added = added_water(plan, robot, state, still, ZERO)
    columns = []
    for unit in np.eye(6):
        asked = whole._replace(force=tuple(unit[:3]), torque=tuple(unit[3:]))
        columns.append(np.concatenate(accelerations_with(asked, added, ZERO)))
    return np.array(columns).T


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(PLANS) | plans(), st.data())
def test_the_whole_mass_is_symmetric_positive_and_that_of_virtual_work(
    plan: BodyPlan, data: st.DataObject
) -> None:
    fins = len(plan.fins)
    shares = data.draw(st.lists(SHARES, min_size=3 * fins, max_size=3 * fins))
    angles = tuple(data.draw(st.lists(ANGLES, min_size=fins, max_size=fins)))
    robot = robot_at(plan, np.array(shares) * plan.maxima)
    found = mobility(robot, angles, plan)
    scale = np.sqrt(np.outer(np.diag(found), np.diag(found)))
    assert_allclose(found / scale, found.T / scale, atol=1e-12)
    assert np.linalg.eigvalsh((found + found.T) / 2).min() > 0
    still = np.zeros(fins)
    hinges, _, _ = hinge_motion(plan, np.array(angles), still)
    rigid, _ = inertia_and_swing(plan, robot, hinges, still)
    carried, _ = water_inertia_and_swing(plan, robot, hinges, still)
    assert_allclose(found @ (rigid + carried), np.eye(6), atol=1e-9)


def test_the_body_adds_what_lambs_table_says() -> None:
    """Length four times the diameter; Lamb has 0.082, 0.860 and 0.608."""
    assert_allclose(np.array(BODY_ADDED_MASS) / BODY_MASS, [0.860, 0.082, 0.860], atol=6e-4)
    assert_allclose(BODY_ADDED_INERTIA[0] / BODY_INERTIA[0], 0.608, atol=6e-4)
    assert BODY_ADDED_INERTIA[0] == BODY_ADDED_INERTIA[2]
    assert BODY_ADDED_INERTIA[1] == 0


def test_a_sphere_adds_half_its_mass_and_a_near_one_nearly_as_much() -> None:
    """On both sides of the series for nearly round hulls, too."""
    mass, inertia = hull_added_mass(Hull(2.0, 1.0))
    assert_allclose(mass, 0.5 * hull_numbers(Hull(2.0, 1.0)).mass)
    assert inertia == (0.0, 0.0, 0.0)
    # Hulls whose eccentricity is 0.1 less and more 1e-6.
    lengths = [2.0 / math.sqrt(1 - (0.1 + more) ** 2) for more in (-1e-6, 1e-6)]
    below, above = (np.concatenate(hull_added_mass(Hull(one, 1.0))) for one in lengths)
    assert_allclose(below, above, rtol=1e-4)
    assert below[3] > 0


def test_fins_of_no_size_add_nothing() -> None:
    added = added_water(
        AQUAFISH, robot_with(NO_FINS), moving((0.4, 1.0, 0.3)), (3.0, 1.0, -2.0), ZERO
    )
    assert added.linear == (*BODY_ADDED_MASS, 0, 0, 0)
    assert added.angular == (*BODY_ADDED_INERTIA, 0, 0, 0)
    assert_array_equal(added.coupling, np.zeros((3, 3)))
    assert_array_equal(added.force, np.zeros(3))


def test_a_fin_of_one_size_alone_adds_nothing_and_of_two_is_one_plate() -> None:
    def added(*sizes: float) -> list[float]:
        masses, inertias = fin_added_mass(Fin(*sizes, 1.0, (1.0, 1.0, 1.0)))
        return [*masses, *inertias]

    for sizes in ((1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 0.5)):
        assert added(*sizes) == [0] * 6
    plate = [0, 0, plate_mass(0.7, 1.2), plate_inertia(0.7, 1.2), plate_inertia(1.2, 0.7), 0]
    assert_allclose(added(0.7, 1.2, 0.0), plate, rtol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_pushed_body_without_fins_accelerates_by_mass_and_added_mass(axis: int) -> None:
    """From rest, by the mass and the added mass together, and the torque likewise."""
    mobile = mobility(robot_with(NO_FINS))
    mass = BODY_MASS + 3 * LEAST_FIN_MASS
    assert_allclose(mobile[axis, axis], 1 / (mass + BODY_ADDED_MASS[axis]), rtol=1e-6)
    assert_allclose(
        mobile[3 + axis, 3 + axis], 1 / (BODY_INERTIA[axis] + BODY_ADDED_INERTIA[axis]), rtol=1e-4
    )


def test_munks_moment_turns_the_body_broadside() -> None:
    aside, ahead = 0.3, 1.2
    added = added_water(AQUAFISH, robot_with(NO_FINS), moving((aside, ahead, 0.0)), ZERO, ZERO)
    moment = (BODY_ADDED_MASS[0] - BODY_ADDED_MASS[1]) * aside * ahead
    # It moves forward and to the right, and its nose turns left: broadside to where it goes.
    assert moment > 0
    assert_allclose(added.torque, (0, 0, moment), atol=1e-14)
    assert_allclose(added.force, 0, atol=1e-14)


@given(
    st.floats(0, 1), st.floats(0, 2), ANGLES, st.tuples(SPEEDS, SPEEDS, SPEEDS)
)  # fmt: skip
def test_the_trailing_edge_takes_power_and_never_gives_it(
    width: float, length: float, angle: float, velocity: Vector
) -> None:
    fin = Fin(width, length, 0.1, 1.0, (1.0, 1.0, 1.0))
    c, s = math.cos(angle), math.sin(angle)
    along, normal = (-s, c, 0.0), (-c, -s, 0.0)
    power = np.dot(trailing_edge(fin, velocity, along, normal), velocity)
    m = DENSITY * math.pi / 4 * width**2 * finite_span(width, length)
    u, w = np.dot(velocity, along), np.dot(velocity, normal)
    assert power <= 1e-13
    assert_allclose(power, -0.5 * m * w * w * abs(u), atol=1e-12)


@given(ANGLES, st.floats(1e-3, 5), SPEEDS)
def test_the_trailing_edge_pushes_as_lighthill_says(angle: float, u: float, w: float) -> None:
    """His (P, Q) at the tail: m w (dz/dt, -dx/dt) - 1/2 m w^2 (dx/da, dz/da) (1971).

    Here x, z are the body's x and y, and a runs along the fin towards the hinge.
    """
    fin = Fin(0.6, 1.4, 0.1, 1.0, (1.0, 1.0, 1.0))
    dx_da, dz_da = -math.sin(angle), math.cos(angle)
    along, normal = (dx_da, dz_da, 0.0), (-dz_da, dx_da, 0.0)
    velocity = np.array(along) * u + np.array(normal) * w
    dx_dt, dz_dt, _ = velocity
    m = DENSITY * math.pi / 4 * fin.width**2 * finite_span(fin.width, fin.length)
    expected = (
        m * w * dz_dt - 0.5 * m * w * w * dx_da,
        -m * w * dx_dt - 0.5 * m * w * w * dz_da,
        0,
    )
    assert_allclose(trailing_edge(fin, tuple(velocity), along, normal), expected, atol=1e-12)


def test_a_slender_tail_at_incidence_lifts_as_jones_says_at_its_leading_edge() -> None:
    """R. T. Jones, 1946: rho pi/4 span^2 speed^2 incidence, at a rectangle's leading edge."""
    width, length, speed, incidence = 0.3, 2.0, 1.7, 1e-5
    sizes = np.array([0.0] * 6 + [0.0, length, width])
    velocity = (speed * incidence, speed, 0.0)
    added = added_water(AQUAFISH, robot_with(sizes), moving(velocity), ZERO, ZERO)
    bare = added_water(AQUAFISH, robot_with(NO_FINS), moving(velocity), ZERO, ZERO)
    lift = math.pi / 4 * width**2 * speed**2 * incidence * finite_span(width, length)
    # The tail moves to the right, too, so the water lifts it to the left.
    assert_allclose(added.force[0], -lift, rtol=1e-6)
    assert abs(added.force[1]) < incidence * lift
    torque = np.subtract(added.torque, bare.torque)
    assert_allclose(torque, np.cross((0, CAUDAL_Y, 0), added.force), atol=1e-6 * lift)
    assert 0.9 < finite_span(width, length) < 1


@pytest.mark.parametrize("tail", propulsion.TAILS)
def test_a_held_tail_thrusts_by_shedding_alone(tail: str) -> None:
    robot = robot_with(tail_body(propulsion.TAILS[tail], pectorals=False))
    drag, thrust = propulsion.held_thrust(robot, 0.8)
    assert abs(drag) < 1e-12
    assert_allclose(thrust, lighthill_thrust(robot.fins[-1], 0.8), rtol=1e-12)
    assert thrust > 0.5


@pytest.mark.parametrize(
    ("aspect", "known"), [(1, 0.579), (1.25, 0.642), (2, 0.757), (4, 0.872), (5, 0.897)]
)
def test_the_lattice_finds_the_known_added_mass_of_rectangles(aspect: float, known: float) -> None:
    """The classical shares, as handbooks print them; half a unit of their last digit."""
    assert abs(lattice_share(1.0, aspect, panels=4) - known) < 6e-4
    assert_allclose(lattice_share(1.0, aspect, 4), lattice_share(aspect, 1.0, 4) * aspect)


@pytest.mark.parametrize("aspect", ASPECTS)
def test_the_law_is_the_lattice(aspect: float) -> None:
    mass = math.pi / 4 * aspect * lattice_share(1.0, aspect, 4)
    assert_allclose(plate_mass(1.0, aspect), mass, rtol=2.5e-3)
    assert_allclose(plate_mass(aspect, 1.0), plate_mass(1.0, aspect), rtol=1e-12)
    swing = math.pi / 48 * aspect**3 * lattice_share(1.0, aspect, 4, "swing")
    assert_allclose(plate_inertia(1.0, aspect), swing, rtol=6e-3)
    twist = math.pi / 128 * aspect * lattice_share(1.0, aspect, 4, "twist")
    assert_allclose(plate_inertia(aspect, 1.0), twist, rtol=6e-3)


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.3, 5.0])
def test_a_rectangle_swings_about_one_axis_as_its_turned_self_twists(aspect: float) -> None:
    swing = lattice_share(1.0, aspect, 4, "swing") * math.pi / 48 * aspect**3
    twist = lattice_share(aspect, 1.0, 4, "twist") * math.pi / 128 * aspect**4
    assert_allclose(swing, twist, rtol=1e-12)
    assert lattice_share(1.0, aspect, 4, "swing") < lattice_share(1.0, aspect, 4)


def test_the_share_tends_to_a_strip_and_to_a_short_fin() -> None:
    assert_allclose(finite_span(1e-3, 1.0), 1.0, atol=1e-3)
    assert_allclose(finite_span(1.0, 1e-3), 1e-3, rtol=1e-3)
    assert finite_span(0.0, 0.0) == 0


def swim(bodies: np.ndarray, commands: np.ndarray, angles: np.ndarray, **more: object):  # type: ignore[no-untyped-def]
    options = {"steps": 256, "dtype": "float64", "record": "pose", "reactive": True, **more}
    return simulate(bodies, commands, angles, **options)  # type: ignore[arg-type]


Trial = tuple[np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def trials() -> Trial:
    """Random ones, the first two of them with no fins and with the greatest."""
    drawn = random_trials(24, seed=1)
    drawn.morphologies[0], drawn.morphologies[1] = 0.0, AQUAFISH.maxima
    return drawn.morphologies, drawn.commands, drawn.fin_angles


def test_the_terms_are_off_unless_asked_for(trials: Trial) -> None:
    default = simulate(*trials, steps=64, dtype="float64", record="pose")
    off = simulate(*trials, steps=64, dtype="float64", record="pose", reactive=False)
    on = simulate(*trials, steps=64, dtype="float64", record="pose", reactive=True)
    for name in ("rpy", "gyro", "position", "quaternion", "fin_angles"):
        assert getattr(default, name).tobytes() == getattr(off, name).tobytes()
    assert abs(on.position[1:] - off.position[1:]).max() > 0.01


def test_lanes_are_plain_python_to_the_last_bit(trials: Trial) -> None:
    bodies, commands, angles = (part[:6] for part in trials)
    u = (0.2, -0.1, 0.3)
    lanes = lane_batch(bodies, angles, u, np.float64, reactive=True)
    lanes.advance(commands, 12)
    for body, command, angle, row in zip(bodies, commands, angles, lanes.states.T, strict=True):
        robot = robot_with(body)
        state = at_rest(tuple(angle.tolist()))
        by = drive(tuple(command.tolist()), 0.01)
        for _ in range(12):
            state = step_reactive(AQUAFISH, robot, state, by, u, 0.01)
        assert_array_equal(np.concatenate([np.ravel(part) for part in state]), row[:22])


def test_float32_stays_near_float64(trials: Trial) -> None:
    double = swim(*trials, steps=512)
    single = swim(*trials, steps=512, dtype="float32")
    worst = abs(single.rpy - double.rpy).max(axis=(1, 2))
    assert np.median(worst) < 1e-3
    assert not single.diverged.any()


@pytest.mark.parametrize("plan", COMPILED_PLANS)
def test_the_scheme_converges_to_the_momentum_form_with_order_one(plan: BodyPlan) -> None:
    drawn = random_trials(2, 2, plan)
    found = scheme_errors(drawn, samples=8)
    for what in ("position", "attitude", "gyro"):
        errors = np.array([np.median(gap[what]) for gap in found])
        assert_allclose(np.log2(errors[:-1] / errors[1:]), 1.0, atol=0.15)
    assert np.median(found[0]["position"]) < 0.03


def test_extreme_bodies_stay_finite_under_bang_bang_commands() -> None:
    """All 2^9 of no size and greatest sizes, each servo at a bound, drawn anew every 0.1 s."""
    bodies = np.array(list(itertools.product((0.0, 1.0), repeat=9))) * AQUAFISH.maxima
    rng = np.random.default_rng(3)
    angles = rng.uniform(-math.pi, math.pi, (len(bodies), 3))
    lanes = lane_batch(bodies, angles, dtype=np.float64, reactive=True)
    for _ in range(20):
        high = rng.integers(0, 2, (len(bodies), 3))
        lanes.advance(np.where(high, [0.5, 0.5, 1.0], [-0.5, -0.5, 0.0]), 10)
    rows = lanes.states
    assert rows.shape[1] * 200 > 1e5
    assert np.isfinite(rows).all()
    assert abs(rows[7:13]).max() < 30
    assert abs(rows[4:7]).max() > 0.5
