"""What strangers' simulators do: take one candidate, fail, take long; and what logs do: wrap."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from cart import CART, PUSH, QUICK, SD, SOUGHT, TRUTH, measured, roll
from eea import FitConfig, Number, Robot, Trial, one_by_one
from eea.core.checks import ConfigurationError, TargetError

TURN = 2.0 * np.pi
THRUST = np.random.default_rng(0).uniform(-1.0, 1.0, 20).repeat(10)
COURSE = {
    "gain": Number(0.1, 3.0),
    "drag": Number(0.05, 2.0),
    "heading": Number(-3.2, 3.2, mean=0.0, sd=2.0, varies=True),
}


def one_cart(values, push):
    signal = roll({name: np.array([value]) for name, value in values.items()}, push[None])
    return signal[0]


def wrapped(angle, turn=TURN):
    return (angle + turn / 2) % turn - turn / 2


def turn(values, thrust, wraps, scale=1.0):
    """Return rates and headings (B, T, 2) in rad/s and rad, or in other units."""
    rate = np.zeros(len(thrust))
    heading = values["heading"].copy()
    out = np.empty((*thrust.shape, 2))
    for step in range(thrust.shape[1]):
        rate = rate + 0.1 * (values["gain"] * thrust[:, step] - values["drag"] * rate)
        heading = heading + 0.1 * rate
        out[:, step] = np.stack([rate, wrapped(heading) if wraps else heading], axis=-1)
    return out * [1.0, scale]


def ship(log_wraps, simulator_wraps, unit, scale=1.0):
    """Return what is inferred of a ship whose heading crosses half a turn."""
    true = {"gain": 1.3, "drag": 0.6, "heading": 2.5}
    rng = np.random.default_rng(0)
    signal = turn({k: np.array([v]) for k, v in true.items()}, THRUST[None], False)[0]
    signal += rng.normal(0.0, [0.02, 0.05], signal.shape)
    if log_wraps:
        signal[:, 1] = wrapped(signal[:, 1])
    robot = Robot(
        lambda values, thrust: turn(values, thrust, simulator_wraps, scale),
        COURSE,
        {"gyro": "rad/s", "compass": unit},
    )
    found = robot.infer([Trial(signal * [1.0, scale], THRUST)])
    return found, true


@pytest.mark.parametrize("log_wraps", [True, False])
@pytest.mark.parametrize("simulator_wraps", [True, False])
@pytest.mark.parametrize(
    ("unit", "scale"), [("rad, wraps", 1.0), ("deg, wraps", 360.0 / TURN), ("rev, wraps", 1 / TURN)]
)
def test_a_compass_that_wraps_is_compared_the_short_way(log_wraps, simulator_wraps, unit, scale):
    found, true = ship(log_wraps, simulator_wraps, unit, scale)
    assert found.good, found.verdict
    assert found.findings == []
    plain, _ = ship(False, False, unit.partition(",")[0], scale)
    for name, row in found.table().items():
        assert row[1] < true[name.partition("@")[0]] < row[2]
        assert row == pytest.approx(plain.table()[name], rel=1e-3)


@pytest.mark.parametrize(("log_wraps", "simulator_wraps"), [(1, 1), (1, 0), (0, 1)])
def test_a_compass_that_wraps_unsaid_is_named_with_the_way_out(log_wraps, simulator_wraps):
    found, _ = ship(log_wraps, simulator_wraps, "rad")
    (said,) = [one for one in found.findings if one.startswith("compass ")]
    assert "state its unit as 'rad, wraps'" in said


def test_a_heading_that_goes_on_beyond_a_turn_is_no_jump():
    found, _ = ship(False, False, "rad")
    assert found.findings == []


def attitude(values, times):
    half = 0.5 * (values["rate"][:, None] * times + 0.3)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), np.sin(half), zero, zero], axis=-1)


@pytest.mark.parametrize("unit", ["quaternion", "1"])
def test_a_quaternion_has_two_signs(unit):
    times = 0.1 * np.arange(1.0, 61.0)
    rng = np.random.default_rng(0)
    signal = attitude({"rate": np.array([0.7])}, times)[0] + rng.normal(0.0, 0.01, (60, 4))
    signal[20:35] *= -1.0
    names = ("q w", "q x", "q y", "q z")
    robot = Robot(attitude, {"rate": Number(0.0, 2.0)}, dict.fromkeys(names, unit))
    found = robot.infer([Trial(signal, times)])
    if unit == "quaternion":
        assert found.good, found.verdict
        _, low, high = found.table()["rate"]
        assert low < 0.7 < high < low + 0.02
    else:
        assert any("change their sign at once 2 times in the log" in f for f in found.findings)


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        ({"a": "m, wraps"}, "the unit of a must be a plain one, or one of 'rad, wraps', 'deg, "),
        ({"a": "rad wraps"}, "the unit of a must be a plain one, or one of 'rad, wraps'"),
        ({"a": "rad, turns"}, "the unit of a must be a plain one, or one of 'rad, wraps'"),
        (dict.fromkeys("abc", "quaternion"), "must be four, one after the other; got 3"),
        ({"a": "quaternion", "b": "m"}, "must be four, one after the other; got 1"),
    ],
)
def test_a_channel_of_an_unknown_kind_is_refused(channels, message):
    with pytest.raises(ConfigurationError) as refused:
        Robot(attitude, {"rate": Number(0.0, 2.0)}, channels)
    assert message in str(refused.value)


def test_a_simulator_of_one_trial_gives_the_same_answer():
    trials = [measured(np.random.default_rng(0)), measured(np.random.default_rng(1), PUSH[:40])]
    one = replace(CART, simulate=one_by_one(one_cart)).infer(trials, config=QUICK)
    assert one.table() == CART.infer(trials, config=QUICK).table()


def test_one_that_raises_is_left_out_and_named():
    def give_up(values, push):
        if values["gain"] > 1.5:
            raise ArithmeticError("no solution")
        return one_cart(values, push)

    trials = [measured(np.random.default_rng(0))]
    found = replace(SOUGHT, simulate=one_by_one(give_up)).infer(trials, config=QUICK)
    assert found.good
    (said,) = [one for one in found.findings if "raised" in one]
    assert re.search(r"first ArithmeticError \(no solution\) at gain 1\.\d+, drag", said)


def test_a_signal_of_one_trial_has_a_shape_that_does_not_change():
    with pytest.raises(ConfigurationError, match=r"the signal \(T, channels\) of one trial"):
        one_by_one(lambda _, push: push)({"gain": np.ones(2)}, np.ones((2, 5)))
    lengths = iter((3, 4))
    with pytest.raises(ConfigurationError, match=r"of shape \(3, 1\) and \(4, 1\)"):
        one_by_one(lambda *_: np.ones((next(lengths), 1)))({"gain": np.ones(2)}, None)
    with pytest.raises(ConfigurationError, match="simulate must be"):
        one_by_one(3)


@pytest.mark.parametrize(
    "simulate",
    [
        lambda values, push: np.stack([values["gain"] * push[0]] * 2, axis=-1),
        lambda values, push: one_cart({n: v[0] for n, v in values.items()}, push[0]),
        lambda values, push: one_cart({n: float(v) for n, v in values.items()}, push),
    ],
)
def test_a_simulator_of_one_candidate_is_told_how_to_be_wrapped(simulate):
    with pytest.raises(ConfigurationError, match=r"one_by_one\(simulate\)"):
        replace(SOUGHT, simulate=simulate).infer([measured(np.random.default_rng(0))], config=QUICK)


def counted(calls):
    def simulate(values, push):
        calls.append(len(push))
        return roll(values, push)

    return simulate


@pytest.mark.parametrize("evaluations", [30, 100, 250])
def test_a_budget_ends_the_search_with_the_best_so_far(evaluations):
    calls = []
    robot = replace(SOUGHT, simulate=counted(calls))
    trials = [measured(np.random.default_rng(0))]
    config = FitConfig(alternatives="always", evaluations=evaluations)
    found = robot.infer(trials, config=config)
    assert not found.good
    assert found.verdict.startswith(f"unfinished, by the budget of {evaluations} simulations")
    assert found.findings[0] == found.verdict
    assert sum(calls) < evaluations + 150  # what the answer asks of the best so far
    assert found.table()["gain"][0] == pytest.approx(TRUTH["gain"], abs=0.3)
    assert found.table() == robot.infer(trials, config=config).table()


def test_a_budget_that_suffices_changes_nothing_but_the_scan():
    trials = [measured(np.random.default_rng(0))]
    config = replace(QUICK, evaluations=10**6)
    found = SOUGHT.infer(trials, config=config)
    assert found.table() == SOUGHT.infer(trials, config=QUICK).table()
    assert found.good


def test_a_budget_too_small_for_any_answer_says_so():
    with pytest.raises(TargetError, match="the budget of 1 simulations ended the search before"):
        SOUGHT.infer([measured(np.random.default_rng(0))], config=FitConfig(evaluations=1))


def test_ctrl_c_gives_the_best_so_far():
    calls = []

    def interrupted(values, push):
        calls.append(len(push))
        if sum(calls) > 150 and not any(n < 0 for n in calls):
            calls.append(-1)
            raise KeyboardInterrupt
        return roll(values, push)

    robot = replace(SOUGHT, simulate=interrupted)
    found = robot.infer([measured(np.random.default_rng(0))])
    assert found.verdict.startswith("unfinished, by Ctrl-C: so far the best fit leaves")
    assert not found.good


def test_an_answer_may_be_asked_beyond_its_budget():
    trials = [measured(np.random.default_rng(0))]
    found = SOUGHT.infer(trials, config=FitConfig(evaluations=100))
    assert found.identified().told
    assert found.prospects({"again": trials[0]})


def test_the_log_density_is_that_of_the_posterior():
    rng = np.random.default_rng(3)
    trials = [measured(rng), measured(rng, PUSH[:40])]
    density = SOUGHT.log_density(trials, dict(zip(CART.channels, SD, strict=True)))
    assert density.names == ("gain", "drag", "bias")
    assert (density.low[0], density.high[0]) == (0.0, 2.0)
    vectors = rng.normal([1.0, 1.0, 0.0], [0.05, 0.05, 0.02], (50, 3))
    expected = -0.5 * (vectors[:, 2] / 0.1) ** 2
    for trial in trials:
        values = dict(zip(density.names, vectors.T, strict=True))
        apart = (roll(values, np.tile(trial.inputs, (50, 1))) - trial.signal) / SD
        expected -= 0.5 * (apart**2).sum(axis=(1, 2))
    got = density(vectors)
    np.testing.assert_allclose(got - got[0], expected - expected[0], rtol=1e-9, atol=1e-6)
    assert density(vectors[3]) == got[3]
    for gain in (-1.0, 2.5):
        assert density([gain, 1.0, 0.0]) == -np.inf
    with pytest.raises(ConfigurationError, match="vectors must have shape"):
        density(vectors[0, :2])


def test_an_angle_of_the_log_density_has_any_value():
    """A turn more is the same angle."""
    times = 0.1 * np.arange(40.0)
    wheel = Robot(
        lambda values, times: np.sin(times + values["phase"][:, None])[:, :, None],
        {"phase": Number.angle()},
        {"signal": "V"},
    )
    density = wheel.log_density([Trial(np.sin(times + 1.0)[:, None], times)], {"signal": 0.1})
    assert density.names == ("phase@1",)
    np.testing.assert_allclose(density([[1.0], [1.0 + TURN], [1.0 - TURN]]), 0.0, atol=1e-9)
