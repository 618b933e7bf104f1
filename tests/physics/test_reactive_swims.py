"""Swims with the optional reactive terms: symmetries, engines, convergence, and the study."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from aquafish_gym import simulate
from aquafish_gym.morphology import MAXIMA, Morphology
from aquafish_gym.physics.dynamics import step
from aquafish_gym.physics.kinematics import (
    at_rest,
    drive,
    rotation,
    to_body,
)
from aquafish_gym.physics.layout import robot_from_column, robot_parameters
from aquafish_gym.physics.reactive import step_reactive
from aquafish_gym.physics.robot import (
    Robot,
)
from instruments.verification import propulsion, reactive_terms
from instruments.verification.propulsion import tail_body
from instruments.verification.rk4 import rotation_matrix
from instruments.verification.trials import lane_batch, random_trials
from instruments.verification.water_momentum import (
    scheme_errors,
)

Vector = tuple[float, float, float]

ZERO: Vector = (0.0, 0.0, 0.0)


def robot_of(sizes: np.ndarray) -> Robot:
    return robot_from_column(robot_parameters(np.asarray(sizes, np.float64)[None])[:, 0])


# --- symmetries -----------------------------------------------------------------------------


def swim(bodies: np.ndarray, commands: np.ndarray, angles: np.ndarray, **more: object):  # type: ignore[no-untyped-def]
    options = {"steps": 256, "dtype": "float64", "record": "pose", "reactive": True, **more}
    return simulate(bodies, commands, angles, **options)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def trials() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random ones, the first two of them with no fins and with the greatest."""
    drawn = random_trials(24, seed=1)
    drawn.morphologies[0], drawn.morphologies[1] = 0.0, MAXIMA
    return drawn.morphologies, drawn.commands, drawn.fin_angles


@pytest.mark.parametrize("left_right", [True, False], ids=["left-right", "up-down"])
def test_the_mirrored_robot_swims_the_mirrored_path(trials, left_right: bool) -> None:  # type: ignore[no-untyped-def]
    bodies, commands, angles = (part.copy() for part in trials)
    path = swim(bodies, commands, angles)
    if left_right:
        bodies = bodies[:, [3, 4, 5, 0, 1, 2, 6, 7, 8]]
        commands, angles = commands[:, [1, 0, 2]], angles[:, [1, 0, 2]]
        angles[:, 2] += math.pi
    else:
        commands[:, :2] *= -1
        angles[:, :2] *= -1
    mirrored = swim(bodies, commands, angles)
    flip = np.ones(3)
    flip[0 if left_right else 2] = -1
    assert abs(path.position).max() > 0.05
    assert_allclose(mirrored.position, path.position * flip, atol=1e-10)
    assert_allclose(mirrored.gyro, -path.gyro * flip, atol=1e-9)


def test_a_current_is_a_change_of_frame(trials) -> None:  # type: ignore[no-untyped-def]
    bodies, _, angles = trials
    u, h = (0.3, -0.2, 0.1), 0.01
    for body, angle in zip(bodies[:4], angles[:4], strict=True):
        robot, by = robot_of(body), drive((0.4, -0.3, 0.7), h)
        still, carried = at_rest(tuple(angle)), at_rest(tuple(angle))._replace(velocity=u)
        for _ in range(40):
            still = step_reactive(robot, still, by, ZERO, h)
            carried = step_reactive(robot, carried, by, u, h)
        drift = np.array(u) * 40 * h
        assert_allclose(np.subtract(carried.position, drift), still.position, atol=1e-12)
        assert_allclose(carried.spin, still.spin, atol=1e-12)
        if body.any():
            assert np.linalg.norm(still.position) > 1e-4


# --- the option, and the engines ------------------------------------------------------------


def test_the_terms_are_off_unless_asked_for(trials) -> None:  # type: ignore[no-untyped-def]
    default = simulate(*trials, steps=64, dtype="float64", record="pose")
    off = simulate(*trials, steps=64, dtype="float64", record="pose", reactive=False)
    on = simulate(*trials, steps=64, dtype="float64", record="pose", reactive=True)
    for name in ("rpy", "gyro", "position", "quaternion", "fin_angles"):
        assert getattr(default, name).tobytes() == getattr(off, name).tobytes()
    assert abs(on.position[1:] - off.position[1:]).max() > 0.01


@pytest.mark.parametrize("on", [False, True], ids=["drag", "reactive"])
def test_lanes_are_plain_python_to_the_last_bit(trials, on: bool) -> None:  # type: ignore[no-untyped-def]
    bodies, commands, angles = (part[:6] for part in trials)
    u = (0.2, -0.1, 0.3)
    lanes = lane_batch(bodies, angles, u, np.float64, **({"reactive": True} if on else {}))
    lanes.advance(commands, 12)
    for body, command, angle, row in zip(bodies, commands, angles, lanes.states.T, strict=True):
        robot, state = robot_of(body), at_rest(tuple(float(a) for a in angle))
        by = drive(tuple(float(c) for c in command), 0.01)
        for _ in range(12):
            state = (step_reactive if on else step)(robot, state, by, u, 0.01)
        assert_array_equal(np.concatenate([np.ravel(part) for part in state]), row[:22])


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("substeps", "current"), [(1, ZERO), (1, (0.3, -0.2, 0.1)), (4, (0.0, 0.4, 0.0))]
)
def test_lanes_equal_pybullet(trials, substeps: int, current: Vector) -> None:  # type: ignore[no-untyped-def]
    ours, bullets = (
        swim(*(part[:10] for part in trials), engine=engine, substeps=substeps, current=current)
        for engine in ("numba", "pybullet")
    )
    for name in ("rpy", "gyro", "position", "quaternion"):
        assert abs(getattr(ours, name) - getattr(bullets, name)).max() < 1e-9, name
    assert abs(ours.position).max() > 0.1


def test_float32_stays_near_float64(trials) -> None:  # type: ignore[no-untyped-def]
    double = swim(*trials, steps=512)
    single = swim(*trials, steps=512, dtype="float32")
    worst = abs(single.rpy - double.rpy).max(axis=(1, 2))
    assert np.median(worst) < 1e-3
    assert not single.diverged.any()


@pytest.mark.parametrize(
    "options",
    [
        # Each width is compiled anew, which takes ten seconds.
        pytest.param({"width": 4}, marks=pytest.mark.slow),
        {"threads": 3},
    ],
    ids=["width", "threads"],
)
def test_width_batch_and_threads_change_nothing(trials, options: dict[str, int]) -> None:  # type: ignore[no-untyped-def]
    bodies, commands, angles = trials
    rows = []
    for more in (options, {"threads": 1}):
        lanes = lane_batch(bodies, angles, dtype=np.float64, reactive=True, **more)  # type: ignore[arg-type]
        lanes.advance(commands, 1000)
        rows.append(lanes.states)
    assert_array_equal(rows[0], rows[1])
    one = lane_batch(bodies[5:6], angles[5:6], dtype=np.float64, reactive=True)
    one.advance(commands[5:6], 1000)
    assert_array_equal(one.states[:, 0], rows[0][:, 5])


# --- the scheme -----------------------------------------------------------------------------


def test_the_scheme_converges_to_the_momentum_form_with_order_one() -> None:
    drawn = random_trials(4, seed=2)
    found = scheme_errors(drawn, samples=8)
    for what in ("position", "attitude", "gyro"):
        errors = np.array([np.median(gap[what]) for gap in found])
        assert_allclose(np.log2(errors[:-1] / errors[1:]), 1.0, atol=0.15)
    assert np.median(found[0]["position"]) < 0.02


def test_extreme_bodies_stay_finite_under_bang_bang_commands() -> None:
    """All 2^9 of no size and greatest sizes, each servo at a bound, drawn anew every 0.1 s."""
    bodies = np.array(list(itertools.product((0.0, 1.0), repeat=9))) * MAXIMA
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


# --- the study ------------------------------------------------------------------------------


def test_the_study_prints_every_table() -> None:
    report = reactive_terms.study(quick=True)
    for table in reactive_terms.make_tables(report).values():
        assert table.rows
        assert all(len(row) == len(table.columns) for row in table.rows)
    swimming = {
        (r["tail"], r["pectorals"], r["reactive"]): r["speed"]
        for r in report["swimming"]
        if r["frequency"] == 1
    }
    for tail in propulsion.TAILS:
        assert swimming[tail, False, True] > swimming[tail, False, False]


def test_tails_of_the_study_are_the_nominal_bodys_but_for_thickness() -> None:
    sizes = tail_body(0.02, pectorals=True)
    nominal = Morphology.nominal().to_array()
    assert_array_equal(np.flatnonzero(sizes != nominal), [6])
    assert_array_equal(tail_body(0.4, pectorals=False)[6:], nominal[6:])
    assert not tail_body(0.4, pectorals=False)[:6].any()


def test_rotation_helpers_of_the_two_statements_agree() -> None:
    q = np.array([0.1, -0.5, 0.3, 0.8])
    q /= np.linalg.norm(q)
    v = (0.3, -0.7, 1.1)
    assert_allclose(to_body(rotation(tuple(q)), v), rotation_matrix(q).T @ v, atol=1e-15)
