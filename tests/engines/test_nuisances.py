"""What differs from the model, from robot to robot: currents, drag, servos; and the bare gyroscope.

That the engines agree on all of it is in ``test_agreement.py``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from aquafish_gym import ImuLog, simulate
from aquafish_gym.engines.base import TIMESTEP
from aquafish_gym.engines.compiled.kernel import hold
from aquafish_gym.engines.compiled.lanes import LaneBatch, pack_rows
from aquafish_gym.engines.worlds import ServoWorld, World, make_world
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.attitude import rotations
from aquafish_gym.physics.compiling import register_module
from aquafish_gym.physics.layout import FIELDS, STATE_ROWS
from gait import network
from gait.controller import scratch_size
from gait.search.neat import Evolution, genome_to_controller
from tests.verification.trials import random_trials

COUNT = 21  # no multiple of a register's robots
TRIALS = random_trials(COUNT, seed=3)
BODIES, COMMANDS, ANGLES = TRIALS.morphologies, TRIALS.commands, TRIALS.fin_angles
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


# --- one for all, or one each --------------------------------------------------------------------


@dtypes
def test_each_robot_swims_as_it_would_alone(dtype: str) -> None:
    together = swim(**DIFFERENT, dtype=dtype)
    for i in (0, 7, COUNT - 1):
        alone = simulate(
            BODIES[i], COMMANDS[i], ANGLES[i], steps=60, dtype=dtype, record="pose",
            **{name: value[i] for name, value in DIFFERENT.items()},
        )  # fmt: skip
        assert_array_equal(alone.gyro[0], together.gyro[i])  # type: ignore[index]
        assert_array_equal(alone.position[0], together.position[i])  # type: ignore[index]


@pytest.mark.parametrize("name", DIFFERENT)
def test_one_row_serves_for_all_and_changes_what_they_feel(name: str) -> None:
    row = DIFFERENT[name][0]
    one, each = (swim(**{name: value}) for value in (row, np.array([row] * COUNT)))
    assert_same(one, each)
    assert (one.gyro != swim().gyro).any()


def test_many_conditions_spread_one_robot() -> None:
    log = simulate(None, (0.3, 0.3, 0.5), steps=9, lag=[0.0, 0.01, 0.02], record="gyro")
    assert len(log) == 3
    with pytest.raises(ValueError, match=r"must be equally many, .* got 1, 1, 1, 2, 1, 1, 3, 1, 1"):
        simulate(None, (0.3, 0.3, 0.5), current=np.zeros((2, 3)), lag=[0.0, 0.01, 0.02])


def test_replaced_robots_keep_their_water_and_servos() -> None:
    lanes = LaneBatch(BODIES, ANGLES, drag=DIFFERENT["drag"], servo_gain=DIFFERENT["servo_gain"])
    first = lanes.advance(COMMANDS, 30, "gyro")
    lanes.replace(np.arange(COUNT) % 2 == 0, BODIES[::2], ANGLES[::2])
    again = lanes.advance(COMMANDS, 30, "gyro")
    assert_array_equal(again.gyro[::2], first.gyro[::2])  # type: ignore[index]
    assert (again.gyro[1::2] != first.gyro[1::2]).any()  # type: ignore[index]


# --- known answers -------------------------------------------------------------------------------


def test_a_current_is_a_start_with_the_opposite_velocity() -> None:
    current = DIFFERENT["current"]
    carried = swim(current=current)
    lanes = LaneBatch(BODIES, ANGLES, dtype=np.float64)
    lanes._table(lanes._states, STATE_ROWS)[FIELDS["velocity"]] = -current.T
    thrown = lanes.advance(COMMANDS, 60, "pose")
    assert_allclose(carried.gyro, thrown.gyro, rtol=0, atol=1e-12)  # type: ignore[arg-type]
    drift = TIMESTEP * np.arange(1, 61)[:, None] * current[:, None]
    assert_allclose(carried.position, thrown.position + drift, rtol=0, atol=1e-12)  # type: ignore[operator]


def test_twice_the_drag_is_twice_the_current_for_what_only_drifts() -> None:
    """Along its axis an idle robot obeys m w' = -k w^2, in which k and w come as a product."""
    idle: dict[str, Any] = {"commands": LOCKED, "fin_angles": LOCKED, "steps": 200}
    idle |= {"dtype": "float64", "record": "pose", "morphologies": None}
    thick = simulate(**idle, drag=(2.0, 2.0), current=(0.0, 1.0, 0.0))
    fast = simulate(**idle, current=(0.0, 2.0, 0.0))
    assert_allclose(2 * thick.position, fast.position, rtol=0, atol=1e-14)  # type: ignore[operator]
    assert fast.position[0, -1, 1] > 0.5  # type: ignore[index]


@pytest.mark.parametrize("reactive", [False, True])
def test_the_two_scales_are_those_of_fins_and_body(reactive: bool) -> None:
    """Over one step the velocity is linear in each."""
    options: dict[str, Any] = {"steps": 1, "current": (2.0, -3.0, 1.0), "reactive": reactive}
    none, fins, body, some = (
        swim(**options, drag=drag) for drag in ((0, 0), (1, 0), (0, 1), (0.7, 1.9))
    )
    for name in ("gyro", "position"):
        o, f, b, s = (getattr(log, name) for log in (none, fins, body, some))
        assert_allclose(s, o + 0.7 * (f - o) + 1.9 * (b - o), rtol=0, atol=1e-13)
        assert abs(f - o).max() > 1e-4
        assert abs(b - o).max() > 1e-4
    finless = swim(bodies=np.zeros((1, 9)), **options, drag=(7.0, 1.0))
    assert_same(finless, swim(bodies=np.zeros((1, 9)), **options))


def test_without_drag_a_current_moves_nothing() -> None:
    log = swim(commands=LOCKED, drag=(0.0, 0.0), current=(1.0, 1.0, 1.0))
    assert not log.position.any()  # type: ignore[union-attr]
    assert not log.gyro.any()  # type: ignore[union-attr]


@dtypes
@pytest.mark.parametrize("gain", [0.95, (0.5, 1.0, 0.0), (-1.0, -0.5, 1.0), "each"])
def test_a_gain_is_another_command(gain: Any, dtype: str) -> None:
    gain = np.clip(DIFFERENT["servo_gain"], 0.0, 1.0) if gain == "each" else gain
    tuned, told = swim(servo_gain=gain, dtype=dtype), swim(np.multiply(gain, COMMANDS), dtype=dtype)
    if dtype == "float64":
        assert_same(tuned, told)
    else:
        assert_allclose(tuned.gyro, told.gyro, rtol=0, atol=1e-4)


@pytest.mark.parametrize("command", [(0.5, -0.5, 1.0), (0.1, 0.2, 0.3)])
def test_a_seized_servo_stays_where_it_is(command: tuple[float, float, float]) -> None:
    turned = swim(command, servo_gain=(0, 1, 1)).fin_angles
    assert_allclose(turned[:, :, 0], ANGLES[:, None, 0] + np.zeros(60), atol=1e-14)  # type: ignore[index]
    assert (abs(turned[:, -1, 1:] - ANGLES[:, 1:]) > 1e-3).all()  # type: ignore[index]


@pytest.mark.parametrize("substeps", [1, 4])
def test_a_lag_of_five_steps_is_the_log_five_samples_later(substeps: int) -> None:
    late, prompt = (swim(lag=lag, substeps=substeps) for lag in (5 * TIMESTEP, 0.0))
    assert not late.gyro[:, :5].any()  # type: ignore[index]
    assert_allclose(late.gyro[:, 5:], prompt.gyro[:, :-5], rtol=0, atol=1e-12)  # type: ignore[index]
    assert_allclose(late.position[:, 5:], prompt.position[:, :-5], rtol=0, atol=1e-12)  # type: ignore[index]


@dtypes
def test_servos_have_turned_since_the_lag_ended(dtype: str) -> None:
    lag = DIFFERENT["lag"]
    turned = swim(lag=lag, dtype=dtype).fin_angles
    moving = np.maximum(np.arange(1, 61) - lag[:, None] / TIMESTEP, 0.0)[:, :, None]
    expected = ANGLES[:, None] + TURN * moving * COMMANDS[:, None]
    assert_allclose(
        np.exp(1j * turned), np.exp(1j * expected), atol=1e-12 if dtype == "float64" else 1e-5
    )  # type: ignore[operator]


def test_what_is_felt_has_a_derivative_in_the_lag() -> None:
    """In the middle of a sample, and at its ends from either side, the gyroscope is continuous."""
    for lag in (0.025, 0.02, 0.07):
        before, here, after = (swim(lag=lag + d).gyro for d in (-1e-7, 0.0, 1e-7))
        for side in (before, after):
            assert 1e-9 < abs(side - here).max() < 1e-3  # type: ignore[operator]
    slopes = [(swim(lag=0.025 + d).gyro - swim(lag=0.025).gyro) / d for d in (1e-6, -1e-6)]  # type: ignore[operator]
    assert_allclose(*slopes, atol=1e-3 * abs(slopes[0]).max())


def test_a_late_batch_in_parts_is_the_batch_in_one() -> None:
    whole = LaneBatch(BODIES, ANGLES).advance(COMMANDS, 60, "gyro", DIFFERENT["lag"])
    lanes = LaneBatch(BODIES, ANGLES)
    parts = [lanes.advance(COMMANDS, n, "gyro", DIFFERENT["lag"]).gyro for n in (1, 12, 47)]
    assert_array_equal(np.concatenate(parts, axis=1), whole.gyro)  # type: ignore[arg-type]


# --- the bare gyroscope --------------------------------------------------------------------------


@engines
@dtypes
def test_the_gyroscope_alone_is_that_of_the_attitudes_log(engine: str, dtype: str) -> None:
    rows: dict[str, Any] = {name: value[:5] for name, value in DIFFERENT.items()}
    trials = BODIES[:5], COMMANDS[:5], ANGLES[:5]
    bare, both = (
        simulate(*trials, 50, engine, dtype, record=record, **rows)
        for record in ("gyro", "attitude")
    )
    assert bare.rpy is None
    assert bare.position is None
    assert bare.gyro is not None
    assert bare.gyro.tobytes() == both.gyro.tobytes()  # type: ignore[union-attr]
    assert (len(bare), repr(bare)) == (5, "ImuLog(B=5, T=50: gyro)")
    assert "roll" not in bare._repr_html_()
    assert len(bare.plot(3).axes) == 1


@dtypes
def test_the_state_still_holds_an_attitude(dtype: str) -> None:
    bare, full = (LaneBatch(BODIES, ANGLES, dtype=np.dtype(dtype).type) for _ in range(2))
    bare.advance(COMMANDS, 200, "gyro")
    full.advance(COMMANDS, 200, "rpy")
    turned = [rotations(lanes.state()["rpy"]) for lanes in (bare, full)]
    assert_allclose(*turned, atol=1e-12 if dtype == "float64" else 1e-5)
    for name in ("gyro", "position", "quaternion"):
        assert_array_equal(bare.state()[name], full.state()[name])


def test_a_policy_that_asks_for_the_attitude_gets_it_though_it_is_not_recorded() -> None:
    register_module(network)
    genome = Evolution(10, seed=3).ask()[0]
    controller = genome_to_controller(genome, 1.0, Morphology.nominal(), 0)
    genes, layout = controller.genes(8)[:, None], controller.layout(8)
    bare, both = (
        (lanes := LaneBatch(BODIES, ANGLES)).run(
            network.steer, pack_rows(genes.repeat(COUNT, 1), np.float32, lanes.width),
            layout, scratch_size(controller, 8), 60, 5, record,
        )
        for record in ("gyro", "attitude")
    )  # fmt: skip
    assert bare.rpy is None
    assert_array_equal(bare.gyro, both.gyro)  # type: ignore[arg-type]
    idle = LaneBatch(BODIES, ANGLES).advance(np.zeros((COUNT, 3)), 60, "gyro")
    assert (bare.gyro != idle.gyro).any(), "it steers"  # type: ignore[union-attr]


# --- worlds of one robot -------------------------------------------------------------------------


def as_trial(i: int) -> dict[str, Any]:
    return {
        "drag": DIFFERENT["drag"][i],
        "servo_gain": DIFFERENT["servo_gain"][i],
        "lag": float(DIFFERENT["lag"][i]),
    }


def put(world: World, i: int, current: Any = LOCKED) -> None:
    left, right, phase = ANGLES[i].tolist()
    x, y, z = np.asarray(current, float).tolist()
    world.reset(BODIES[i], (left, right, phase), (x, y, z))


@engines
@pytest.mark.parametrize("reactive", [False, True])
@pytest.mark.parametrize("substeps", [1, 3])
def test_a_world_swims_as_the_lanes_do(engine: str, reactive: bool, substeps: int) -> None:
    for i in (0, 1, 2):
        world = make_world(engine, reactive, **as_trial(i), substeps=substeps)
        put(world, i, DIFFERENT["current"][i])
        left, right, caudal = COMMANDS[i].tolist()
        for steps in (7, 53):
            world.advance((left, right, caudal), steps)
        state = world.state()
        world.close()
        log = simulate(
            BODIES[i], COMMANDS[i], ANGLES[i], 60, dtype="float64", record="pose",
            reactive=reactive, substeps=substeps, current=DIFFERENT["current"][i], **as_trial(i),
        )  # fmt: skip
        assert_allclose(state.spin, log.gyro[0, -1], rtol=0, atol=1e-10)  # type: ignore[index]
        assert_allclose(state.position, log.position[0, -1], rtol=0, atol=1e-10)  # type: ignore[index]


@engines
@pytest.mark.parametrize("lag", [0.0, 0.004, 0.03, 0.0575, 0.29])
def test_a_world_obeys_what_it_was_told_a_lag_before(engine: str, lag: float) -> None:
    """Its servos' angles are the integral of the commands up to the lag before now."""
    commands, gain = np.random.default_rng(5).uniform(0.0, 0.5, (12, 3)), (1.0, 0.5, 1.5)
    world = make_world(engine, servo_gain=gain, lag=lag)
    for _ in range(2):  # a reset forgets what was told
        put(world, 0)
        told = np.zeros((1, 3))
        for command in commands:
            left, right, caudal = command.tolist()
            world.advance((left, right, caudal), 5)
            told = np.concatenate([told, [command] * 5])
            whole = np.cumsum(told, axis=0)
            moments = np.arange(len(told))
            turned = [np.interp(moments[-1] - lag / TIMESTEP, moments, w) for w in whole.T]
            expected = ANGLES[0] + TURN * np.multiply(gain, turned)
            assert_allclose(np.exp(1j * np.array(world.fin_angles)), np.exp(1j * expected))
    world.close()


def test_worlds_whose_servos_obey_are_bare() -> None:
    assert not isinstance(make_world("numba", drag=(0.5, 2.0), substeps=2), ServoWorld)
    assert isinstance(make_world("numba", lag=0.01), ServoWorld)
    assert isinstance(make_world("numba", servo_gain=(1, 1, 0.9)), ServoWorld)


def test_a_world_says_that_its_robot_ran_away() -> None:
    world = make_world("numba", lag=0.02)
    put(world, 0)
    world.advance((1e250, 1e250, 0.0), 2)
    assert not world.diverged, "the servos do not move yet"
    world.advance((1e250, 1e250, 0.0), 20)
    assert world.diverged


def test_who_needs_no_lag_pays_for_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """The policy of a lag sets the servos anew in every sample."""
    used = []
    run = LaneBatch.run
    monkeypatch.setattr(
        LaneBatch,
        "run",
        lambda self, policy, *rest: used.append(policy) or run(self, policy, *rest),
    )
    swim(steps=2, lag=np.zeros(COUNT))
    swim(steps=2, lag=0.01)
    assert used[0] is hold
    assert used[1] is not hold
