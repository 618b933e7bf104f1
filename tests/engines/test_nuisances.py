"""Trials of currents, drag, servo gains, lags and series of commands, one for all or one each.

``test_agreement.py`` compares the engines in all of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from aquafish_gym import ImuLog, simulate
from aquafish_gym.engines.api import simulate_scenario
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from instruments.verification.foreign_law import Defects, simulate_law
from instruments.verification.trials import lane_batch, one_world, random_trials, rotations

COUNT = 21  # no multiple of a register's robots
TRIALS = random_trials(COUNT, seed=3)
BODIES, COMMANDS, ANGLES = TRIALS[:3]
LOCKED = (0.0, 0.0, 0.0)
TURN = 2 * np.pi * TIMESTEP

_rng = np.random.default_rng(4)
DIFFERENT: dict[str, Any] = {
    "current": _rng.uniform(-0.3, 0.3, (COUNT, 3)),
    "drag": _rng.uniform(0.0, 2.0, (COUNT, 2)),
    "servo_gain": _rng.uniform(-2.0, 2.0, (COUNT, 3)),
    "lag": _rng.uniform(0.0, 0.3, COUNT),
}
SERIES = _rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (COUNT, 10, 3))
INTERVAL = 5  # steps of each of the ten commands, of which the last is held on
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


@dtypes
def test_servos_turn_from_the_end_of_their_lag(dtype: str) -> None:
    lag = DIFFERENT["lag"]
    turned = swim(lag=lag, dtype=dtype).fin_angles
    moving = np.maximum(np.arange(1, 61) - lag[:, None] / TIMESTEP, 0.0)[:, :, None]
    expected = ANGLES[:, None] + TURN * moving * COMMANDS[:, None]
    assert_allclose(
        np.exp(1j * turned), np.exp(1j * expected), atol=1e-12 if dtype == "float64" else 1e-5
    )  # type: ignore[operator]


@engines
def test_servo_angles_integrate_the_series(engine: str) -> None:
    log = swim(SERIES, engine=engine, interval=INTERVAL)
    given = np.repeat(SERIES, [INTERVAL] * 9 + [60 - 9 * INTERVAL], axis=1)
    expected = ANGLES[:, None] + TURN * np.cumsum(given, axis=1)
    assert_allclose(np.exp(1j * log.fin_angles), np.exp(1j * expected), atol=1e-9)  # type: ignore[operator]


@pytest.mark.parametrize(("cut", "reactive"), [(1, False), (23, True), (58, False)])
def test_trial_in_two_parts_equals_the_whole(cut: int, reactive: bool) -> None:
    servos: dict[str, Any] = {"reactive": reactive, "substeps": 2}
    servos["servo_gain"] = DIFFERENT["servo_gain"]
    lag = DIFFERENT["lag"]
    whole = swim(SERIES, lag=lag, interval=INTERVAL, **servos)
    first = lane_batch(BODIES, ANGLES, dtype=np.float64, servo_lag=lag, **servos)
    first.log(SERIES, cut, "gyro", INTERVAL)
    now = first.state()
    turned = rotations(first.states[layout(AQUAFISH).rpy].T)
    rest = simulate(
        BODIES, SERIES, layout(AQUAFISH).angles(first.states).T, steps=60 - cut, dtype="float64",
        record="gyro", interval=INTERVAL, begun=cut, lag=lag, spin=np.transpose(now.spin),
        velocity=np.einsum("bji,jb->bi", turned, np.array(now.velocity)), **servos,
    )  # fmt: skip
    assert_allclose(rest.gyro, whole.gyro[:, cut:], rtol=0, atol=1e-11)  # type: ignore[index]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"commands": np.zeros((COUNT, 0, 3))}, "commands must hold a command at least"),
        ({"velocity": np.zeros((2, 3))}, "velocity and spin must be equally many"),
        ({"interval": 5}, "interval must be 1 for commands that are held throughout"),
    ],
)
def test_trials_that_do_not_fit_are_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidArgumentError, match=words):
        swim(**wrong)


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"begun": 3, "interval": 5, "commands": SERIES}, 'begun must be 0 .* "pybullet"'),
        ({"dtype": "float32"}, "dtype must be \"float64\" .* 'float32'"),
        ({"threads": 2}, "threads None .* got 'float64' and 2"),
    ],
)
def test_what_pybullet_has_not_is_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidArgumentError, match=words):
        swim(engine="pybullet", **wrong)


def test_gyroscope_is_differentiable_in_the_lag() -> None:
    """In the middle of a sample, and at its ends from either side."""
    for lag in (0.025, 0.02, 0.07):
        before, here, after = (swim(lag=lag + d).gyro for d in (-1e-7, 0.0, 1e-7))
        for side in (before, after):
            assert 1e-9 < abs(side - here).max() < 1e-3  # type: ignore[operator]
    slopes = [(swim(lag=0.025 + d).gyro - swim(lag=0.025).gyro) / d for d in (1e-6, -1e-6)]  # type: ignore[operator]
    assert_allclose(*slopes, atol=1e-3 * abs(slopes[0]).max())


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


@pytest.mark.parametrize("reactive", [False, True])
@pytest.mark.parametrize("substeps", [1, 3])
def test_world_swims_as_the_lanes_do(reactive: bool, substeps: int) -> None:
    for i in (0, 1, 2):
        fields = {name: value[i] for name, value in DIFFERENT.items()}
        lag = fields.pop("lag")
        world = one_world("numba", BODIES[i], ANGLES[i], substeps=substeps, reactive=reactive,
                          servo_lag=lag, **fields)  # fmt: skip
        left, right, caudal = COMMANDS[i].tolist()
        for steps in (7, 53):
            world.advance((left, right, caudal), steps)
        state = world.state()
        log = simulate(
            BODIES[i], COMMANDS[i], ANGLES[i], 60, dtype="float64", record="pose",
            reactive=reactive, substeps=substeps, lag=lag, **fields,
        )  # fmt: skip
        assert_allclose(state.spin, log.gyro[0, -1], rtol=0, atol=1e-10)  # type: ignore[index]
        assert_allclose(state.position, log.position[0, -1], rtol=0, atol=1e-10)  # type: ignore[index]
