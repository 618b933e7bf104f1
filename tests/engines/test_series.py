"""Trials of several commands, and trials that begin in mid-swim."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from aquafish_gym import simulate
from aquafish_gym.physics.layout import FIELDS, angles_of_rows
from aquafish_gym.utils.validation import InvalidArgumentError
from instruments.verification.trials import lane_batch, one_world, random_trials, rotations

COUNT, COMMANDS, INTERVAL, STEPS = 9, 12, 5, 70
TRIALS = random_trials(COUNT, seed=5)
BODIES, ANGLES = TRIALS.morphologies, TRIALS.fin_angles
_rng = np.random.default_rng(6)
SERIES = _rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (COUNT, COMMANDS, 3))
LAGS = _rng.uniform(0.0, 0.13, COUNT)
GAINS = _rng.uniform(0.8, 1.2, (COUNT, 3))


def swim(commands: Any = SERIES, **options: Any) -> Any:
    defaults: dict[str, Any] = {"steps": STEPS, "dtype": "float64", "record": "pose"}
    return simulate(BODIES, commands, ANGLES, **defaults | {"interval": INTERVAL} | options)


@pytest.mark.parametrize("lag", [0.0, 0.034])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_series_of_one_command_equals_that_command(lag: float, dtype: str) -> None:
    held, series = SERIES[:, 0], np.repeat(SERIES[:, :1], COMMANDS, axis=1)
    one = swim(held, lag=lag, dtype=dtype, interval=1)
    other = swim(series, lag=lag, dtype=dtype)
    if lag == 0.0 or dtype == "float64":
        assert_allclose(one.gyro, other.gyro, rtol=0, atol=1e-12 if dtype == "float64" else 0)
    else:  # the shares of a command that follows itself add up to one but for rounding
        assert_allclose(one.gyro, other.gyro, rtol=0, atol=1e-3)


@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_servo_angles_integrate_the_series(engine: str) -> None:
    log = swim(engine=engine)
    speeds = np.repeat(SERIES, INTERVAL, axis=1)
    speeds = np.concatenate([speeds, np.repeat(speeds[:, -1:], STEPS - speeds.shape[1], axis=1)], 1)
    wanted = ANGLES[:, None] + 2 * np.pi * 0.01 * np.cumsum(speeds, axis=1)
    apart = np.angle(np.exp(1j * (log.fin_angles - wanted)))
    assert_allclose(apart, 0.0, atol=1e-9)


@pytest.mark.pybullet
@pytest.mark.parametrize("lag", [0.0, LAGS])
def test_the_engines_agree_on_series(lag: Any) -> None:
    options: dict[str, Any] = {"lag": lag, "servo_gain": GAINS}
    options |= {"velocity": (0.1, 0.5, -0.2), "spin": (0.3, -0.2, 0.1)}
    ours, bullet = (swim(engine=engine, **options) for engine in ("numba", "pybullet"))
    assert_allclose(ours.gyro, bullet.gyro, rtol=0, atol=1e-9)


def test_world_commanded_step_by_step_equals_the_series() -> None:
    log = swim(lag=LAGS, servo_gain=GAINS)
    for i in range(3):
        world = one_world("numba", BODIES[i], ANGLES[i], servo_gain=GAINS[i], servo_lag=LAGS[i])
        felt = []
        for t in range(STEPS):
            world.advance(tuple(SERIES[i, min(t // INTERVAL, COMMANDS - 1)].tolist()))
            felt.append(world.state().spin)
        assert_allclose(log.gyro[i], felt, rtol=0, atol=1e-12)


@pytest.mark.parametrize("cut", [1, 23, 68])
@pytest.mark.parametrize("reactive", [False, True])
def test_trial_in_two_parts_equals_the_whole(cut: int, reactive: bool) -> None:
    servos: dict[str, Any] = {"servo_gain": GAINS, "reactive": reactive, "substeps": 2}
    whole = swim(lag=LAGS, **servos)
    first = lane_batch(BODIES, ANGLES, dtype=np.float64, servo_lag=LAGS, **servos)
    first.log(SERIES, cut, "gyro", INTERVAL)
    now = first.state()
    turned = rotations(first.states[FIELDS["rpy"]].T)
    rest = simulate(
        BODIES, SERIES, angles_of_rows(first.states).T, steps=STEPS - cut, dtype="float64",
        record="gyro", interval=INTERVAL, begun=cut, lag=LAGS, spin=np.transpose(now.spin),
        velocity=np.einsum("bji,jb->bi", turned, np.array(now.velocity)), **servos,
    )  # fmt: skip
    assert_allclose(rest.gyro, whole.gyro[:, cut:], rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"commands": np.zeros((COUNT, 0, 3))}, "commands must hold a command at least"),
        ({"commands": np.ones((COUNT, 2, 3))}, r"commands\[0, 0, 0\] must lie in \[-0.5, 0.5\]"),
        ({"interval": 0}, "interval must be a whole number of at least 1"),
        ({"begun": -1}, "begun must be a whole number of at least 0"),
        ({"spin": (0.0, 0.0, 101.0)}, r"spin\[0, 2\] must lie in"),
        ({"velocity": np.zeros((2, 3))}, "velocity and spin must be equally many"),
        ({"commands": SERIES[:, 0]}, r"interval must be 1 for commands that are held throughout"),
    ],
)
def test_wrong_series_is_refused(wrong: dict[str, Any], says: str) -> None:
    with pytest.raises(InvalidArgumentError, match=says):
        swim(**wrong)


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"begun": 3}, 'begun must be 0 .* "pybullet"'),
        ({"dtype": "float32"}, "dtype must be \"float64\" .* 'float32'"),
        ({"threads": 2}, "threads None .* got 'float64' and 2"),
    ],
)
def test_what_pybullet_has_not_is_refused(wrong: dict[str, Any], says: str) -> None:
    with pytest.raises(InvalidArgumentError, match=says):
        swim(engine="pybullet", **wrong)
