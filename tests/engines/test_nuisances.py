"""Currents, drag, servo gains and lags, one for all robots or one each; the bare gyroscope.

``test_agreement.py`` compares the engines in all of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from aquafish_gym import ImuLog, simulate
from aquafish_gym.engines.api import simulate_scenario
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.physics.layout import FIELDS
from aquafish_gym.scenario import TIMESTEP, Scenario
from instruments.verification.foreign_law import Defects, simulate_law
from instruments.verification.trials import lane_batch, one_world, random_trials, rotations
from tests.scenarios import with_changes

COUNT = 21  # no multiple of a register's robots
TRIALS = random_trials(COUNT, seed=3)
BODIES, COMMANDS, ANGLES = TRIALS
LOCKED = (0.0, 0.0, 0.0)
TURN = 2 * np.pi * TIMESTEP

_rng = np.random.default_rng(4)
DIFFERENT: dict[str, Any] = {
    "current": _rng.uniform(-0.3, 0.3, (COUNT, 3)),
    "drag": _rng.uniform(0.0, 2.0, (COUNT, 2)),
    "servo_gain": _rng.uniform(-2.0, 2.0, (COUNT, 3)),
    "lag": _rng.uniform(0.0, 0.3, COUNT),
}
dtypes = pytest.mark.parametrize("dtype", ["float32", "float64"])
engines = pytest.mark.parametrize("engine", ["numba", "pybullet"])


def swim(commands: Any = COMMANDS, bodies: Any = BODIES, **options: Any) -> ImuLog:
    defaults = {"steps": 60, "dtype": "float64", "record": "pose"}
    return simulate(bodies, commands, ANGLES, **defaults | options)


def assert_same(one: ImuLog, other: ImuLog) -> None:
    for name in ("rpy", "gyro", "position", "quaternion", "fin_angles"):
        assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@dtypes
def test_each_robot_swims_as_alone(dtype: str) -> None:
    together = swim(**DIFFERENT, dtype=dtype)
    for i in (0, 7, COUNT - 1):
        alone = simulate(
            BODIES[i], COMMANDS[i], ANGLES[i], steps=60, dtype=dtype, record="pose",
            **{name: value[i] for name, value in DIFFERENT.items()},
        )  # fmt: skip
        assert_array_equal(alone.gyro[0], together.gyro[i])  # type: ignore[index]
        assert_array_equal(alone.position[0], together.position[i])  # type: ignore[index]


def test_many_conditions_spread_one_robot() -> None:
    log = simulate(None, (0.3, 0.3, 0.5), steps=9, lag=[0.0, 0.01, 0.02], record="gyro")
    assert len(log) == 3
    with pytest.raises(ValueError, match=r"must be equally many, .* got 1, 1, 1, 2, 1, 1, 3, 1, 1"):
        simulate(None, (0.3, 0.3, 0.5), current=np.zeros((2, 3)), lag=[0.0, 0.01, 0.02])


# --- known answers -------------------------------------------------------------------------------


@engines
def test_a_heavier_hull_is_lighter_fins_and_less_drag(engine: str) -> None:
    """Against MuJoCo's mechanics, where it is the hull that weighs twice as much."""
    body, command, angles = np.full(9, 0.4), np.array([0.2, 0.4, 0.7]), np.array([0.3, -0.6, 1.0])
    fields = {"fin_angles": angles, "drag": (0.5, 0.5), "fin_density": 0.5}
    logs = []
    for changed in ({"fin_angles": angles}, fields):
        scenario = Scenario.create(body, **changed)
        logs.append(simulate_scenario(scenario, command[None], 64, engine, "float64").gyro[0])  # type: ignore[index]
    plain, heavy = logs
    for found, hull in ((plain, 1.0), (heavy, 2.0)):
        other = simulate_law(body, command, angles, 64, Defects(hull=hull))
        assert np.abs(found - other).max() < 0.05 * np.abs(plain - heavy).max()


def test_current_is_a_start_with_the_opposite_velocity() -> None:
    current = DIFFERENT["current"]
    carried = swim(current=current)
    lanes = lane_batch(BODIES, ANGLES, dtype=np.float64)
    lanes.states[FIELDS["velocity"]] = -current.T
    thrown = lanes.log(COMMANDS, 60, "pose")
    assert_allclose(carried.gyro, thrown.gyro, rtol=0, atol=1e-12)  # type: ignore[arg-type]
    drift = TIMESTEP * np.arange(1, 61)[:, None] * current[:, None]
    assert_allclose(carried.position, thrown.position + drift, rtol=0, atol=1e-12)  # type: ignore[operator]


def test_twice_the_drag_is_twice_the_current_for_a_drifting_robot() -> None:
    """Along its axis an idle robot obeys m w' = -k w^2, in which k and w come as a product."""
    idle: dict[str, Any] = {"commands": LOCKED, "fin_angles": LOCKED, "steps": 200}
    idle |= {"dtype": "float64", "record": "pose", "morphologies": None}
    thick = simulate(**idle, drag=(2.0, 2.0), current=(0.0, 1.0, 0.0))
    fast = simulate(**idle, current=(0.0, 2.0, 0.0))
    assert_allclose(2 * thick.position, fast.position, rtol=0, atol=1e-14)  # type: ignore[operator]
    assert fast.position[0, -1, 1] > 0.5  # type: ignore[index]


@pytest.mark.parametrize("reactive", [False, True])
def test_drag_scales_fins_and_body_apart(reactive: bool) -> None:
    """Over one step the velocity is linear in each."""
    options: dict[str, Any] = {"steps": 1, "current": (2.0, -3.0, 1.0), "reactive": reactive}
    none, fins, body, some = (
        swim(**options, drag=drag) for drag in ((0, 0), (1, 0), (0, 1), (0.7, 1.9))
    )
    for name in ("gyro", "position"):
        o, f, b, s = (getattr(log, name) for log in (none, fins, body, some))
        assert_allclose(s, o + 0.7 * (f - o) + 1.9 * (b - o), rtol=0, atol=1e-13)
        assert min(abs(f - o).max(), abs(b - o).max()) > 1e-4


@dtypes
@pytest.mark.parametrize("gain", [0.95, (0.5, 1.0, 0.0), (-1.0, -0.5, 1.0)])
def test_servo_gain_is_another_command(gain: Any, dtype: str) -> None:
    tuned = swim(servo_gain=gain, dtype=dtype)
    commanded = swim(np.multiply(gain, COMMANDS), dtype=dtype)
    if dtype == "float64":
        assert_same(tuned, commanded)
    else:
        assert_allclose(tuned.gyro, commanded.gyro, rtol=0, atol=1e-4)


@pytest.mark.parametrize("substeps", [1, 4])
def test_lag_of_five_steps_delays_the_log_by_five_samples(substeps: int) -> None:
    late, prompt = (swim(lag=lag, substeps=substeps) for lag in (5 * TIMESTEP, 0.0))
    assert not late.gyro[:, :5].any()  # type: ignore[index]
    assert_allclose(late.gyro[:, 5:], prompt.gyro[:, :-5], rtol=0, atol=1e-12)  # type: ignore[index]
    assert_allclose(late.position[:, 5:], prompt.position[:, :-5], rtol=0, atol=1e-12)  # type: ignore[index]


@dtypes
def test_servos_turn_from_the_end_of_their_lag(dtype: str) -> None:
    lag = DIFFERENT["lag"]
    turned = swim(lag=lag, dtype=dtype).fin_angles
    moving = np.maximum(np.arange(1, 61) - lag[:, None] / TIMESTEP, 0.0)[:, :, None]
    expected = ANGLES[:, None] + TURN * moving * COMMANDS[:, None]
    assert_allclose(
        np.exp(1j * turned), np.exp(1j * expected), atol=1e-12 if dtype == "float64" else 1e-5
    )  # type: ignore[operator]


def test_gyroscope_is_differentiable_in_the_lag() -> None:
    """In the middle of a sample, and at its ends from either side."""
    for lag in (0.025, 0.02, 0.07):
        before, here, after = (swim(lag=lag + d).gyro for d in (-1e-7, 0.0, 1e-7))
        for side in (before, after):
            assert 1e-9 < abs(side - here).max() < 1e-3  # type: ignore[operator]
    slopes = [(swim(lag=0.025 + d).gyro - swim(lag=0.025).gyro) / d for d in (1e-6, -1e-6)]  # type: ignore[operator]
    assert_allclose(*slopes, atol=1e-3 * abs(slopes[0]).max())


# --- schedules -----------------------------------------------------------------------------------


def scheduled(lag: float = 0.0) -> Scenario:
    """Return robots of which some lose a fin at step 20, and some a servo at step 35."""
    whole = Scenario.create(BODIES, fin_angles=ANGLES, servo_lag=lag)
    one, other = np.array([0, 2, 5]), np.array([2, 3])
    finless = replace(whole.take(one), body=whole.body[one] * np.repeat([1, 0, 1], 3))
    gains = np.array([(1.0, 1.0, 0.0), (0.5, 1.0, 1.0)])
    weak = replace(whole.take(other), servo_gain=gains)
    return with_changes(whole, [(20, one, finless), (35, other, weak)])


@pytest.mark.pybullet
@pytest.mark.parametrize("lag", [0.0, 0.037])
def test_engines_agree_on_a_schedule(lag: float) -> None:
    scenario = scheduled(lag).take(slice(0, 6))
    ours, bullet = (
        simulate_scenario(scenario, COMMANDS[:6], 60, engine, "float64", record="pose")
        for engine in ("numba", "pybullet")
    )
    for name in ("gyro", "position", "rpy"):
        assert_allclose(getattr(ours, name), getattr(bullet, name), rtol=0, atol=1e-9)


def test_schedule_changes_its_robots_from_its_step_on() -> None:
    whole = swim()
    log = simulate_scenario(scheduled(), COMMANDS, 60, dtype="float64", record="pose")
    changed = (log.gyro != whole.gyro).any(axis=2)  # type: ignore[union-attr]
    first = np.where(changed.any(axis=1), changed.argmax(axis=1), -1)
    assert {i: int(t) for i, t in enumerate(first) if t >= 0} == {0: 20, 2: 20, 3: 35, 5: 20}


# --- the bare gyroscope --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("engine", "dtype"), [("numba", "float32"), ("numba", "float64"), ("pybullet", "float64")]
)
def test_gyroscope_alone_is_that_of_the_full_log(engine: str, dtype: str) -> None:
    rows: dict[str, Any] = {name: value[:5] for name, value in DIFFERENT.items()}
    trials = BODIES[:5], COMMANDS[:5], ANGLES[:5]
    bare, both = (
        simulate(*trials, 50, engine, dtype, record=record, **rows)
        for record in ("gyro", "attitude")
    )
    assert bare.rpy is bare.position is None
    assert bare.gyro.tobytes() == both.gyro.tobytes()  # type: ignore[union-attr]


@dtypes
def test_state_still_holds_an_attitude(dtype: str) -> None:
    bare, full = (lane_batch(BODIES, ANGLES, dtype=np.dtype(dtype).type) for _ in range(2))
    bare.log(COMMANDS, 200, "gyro")
    full.log(COMMANDS, 200, "rpy")
    turned = [rotations(lanes.states[FIELDS["rpy"]].T) for lanes in (bare, full)]
    assert_allclose(*turned, atol=1e-12 if dtype == "float64" else 1e-5)
    assert_array_equal(bare.states[: FIELDS["rpy"].start], full.states[: FIELDS["rpy"].start])


# --- worlds of one robot -------------------------------------------------------------------------


@engines
@pytest.mark.parametrize("reactive", [False, True])
@pytest.mark.parametrize("substeps", [1, 3])
def test_world_swims_as_the_lanes_do(engine: str, reactive: bool, substeps: int) -> None:
    for i in (0, 1, 2):
        fields = {name: value[i] for name, value in DIFFERENT.items()}
        lag = fields.pop("lag")
        world = one_world(engine, BODIES[i], ANGLES[i], substeps=substeps, reactive=reactive,
                          servo_lag=lag, **fields)  # fmt: skip
        left, right, caudal = COMMANDS[i].tolist()
        for steps in (7, 53):
            world.advance((left, right, caudal), steps)
        state = world.state()
        world.close()
        log = simulate(
            BODIES[i], COMMANDS[i], ANGLES[i], 60, dtype="float64", record="pose",
            reactive=reactive, substeps=substeps, lag=lag, **fields,
        )  # fmt: skip
        assert_allclose(state.spin, log.gyro[0, -1], rtol=0, atol=1e-10)  # type: ignore[index]
        assert_allclose(state.position, log.position[0, -1], rtol=0, atol=1e-10)  # type: ignore[index]


@engines
@pytest.mark.parametrize("lag", [0.0, 0.004, 0.0575, 0.29])
def test_world_follows_the_delayed_commands(engine: str, lag: float) -> None:
    """Its servos' angles are the integral of the commands up to the lag before now."""
    commands, gain = np.random.default_rng(5).uniform(0.0, 0.5, (12, 3)), (1.0, 0.5, 1.5)
    start = Scenario.create(BODIES[0], fin_angles=ANGLES[0], servo_gain=gain, servo_lag=lag)
    world = one_world(engine, BODIES[0], ANGLES[0], servo_gain=gain, servo_lag=lag)
    for _ in range(2):  # a start forgets earlier commands
        world.start(start)
        given = np.zeros((1, 3))
        for command in commands:
            left, right, caudal = command.tolist()
            world.advance((left, right, caudal), 5)
            given = np.concatenate([given, [command] * 5])
            whole = np.cumsum(given, axis=0)
            moments = np.arange(len(given))
            turned = [np.interp(moments[-1] - lag / TIMESTEP, moments, w) for w in whole.T]
            expected = ANGLES[0] + TURN * np.multiply(gain, turned)
            assert_allclose(np.exp(1j * np.array(world.fin_angles)), np.exp(1j * expected))
    world.close()


def test_world_reports_divergence() -> None:
    world = one_world("numba", BODIES[0], servo_lag=0.02)
    world.advance((1e250, 1e250, 0.0), 2)
    assert not world.diverged, "the servos do not move yet"
    world.advance((1e250, 1e250, 0.0), 20)
    assert world.diverged


def test_restarted_robots_swim_as_at_first() -> None:
    scenario = Scenario.create(BODIES, fin_angles=ANGLES, drag=DIFFERENT["drag"])
    lanes = LaneBatch(scenario)
    first = lanes.log(COMMANDS, 30, "gyro")
    lanes.start(scenario.take(slice(None, None, 2)), np.arange(0, COUNT, 2))
    again = lanes.log(COMMANDS, 30, "gyro")
    assert_array_equal(again.gyro[::2], first.gyro[::2])  # type: ignore[index]
    assert (again.gyro[1::2] != first.gyro[1::2]).any()  # type: ignore[index]
