"""Numbers are followed window by window, and a change is named."""

from __future__ import annotations

import numpy as np
import pytest

from cart import record
from eea import Hypothesis, Number, Robot, Trial
from eea.core.checks import ConfigurationError
from eea.infer.words import ALARM_FINDING

NOISE = {"force": 0.1}
FEELS = {"force": "N"}
DAMPER = Hypothesis("the damper leaks", moves={"damping": Number(0.0, sd=1.0)}, odds=0.1)
SPRING = Hypothesis(
    "the spring is weak", moves={"stiffness": Number(mean=0.0, sd=2.0, high=0.0)}, odds=0.1
)


def push(values, motion):
    """Return the forces (B, T, 1) of springs and dampers in motion (B, T, 2): place and speed."""
    spring = values["stiffness"][:, None] * motion[:, :, 0]
    return (spring + values["damping"][:, None] * motion[:, :, 1])[:, :, None]


STRUT = Robot(
    simulate=push,
    numbers={"stiffness": Number(0.0, 10.0), "damping": Number(0.0, 4.0)},
    channels=FEELS,
    hypotheses=[DAMPER, SPRING],
)


def window(rng, stiffness=5.0, damping=1.0, moves=True, samples=40, noise=0.1):
    time = rng.uniform(0.0, 10.0) + 0.1 * np.arange(samples)
    motion = np.stack([np.sin(time), np.cos(time) * moves], axis=-1)
    return record(push, {"stiffness": stiffness, "damping": damping}, motion, noise, rng)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture
def follower():
    return STRUT.follow(NOISE)


def test_the_intervals_close_in_on_the_truth(rng, follower):
    assert follower.table()["stiffness"][0] == 5.0  # the middle of its range
    widths = []
    for _ in range(9):
        followed = follower.update(window(rng))
        _, low, high = followed.table["damping"]
        widths.append(high - low)
    assert widths[-1] == pytest.approx(widths[0] / 3.0, rel=0.1)
    for name, true in {"stiffness": 5.0, "damping": 1.0}.items():
        middle, low, high = follower.table(0.999)[name]
        assert low < true < high
        assert low < middle < high
    again, rng = STRUT.follow(NOISE), np.random.default_rng(0)
    for _ in range(9):
        repeated = again.update(window(rng))
    assert (repeated.table, repeated.p) == (followed.table, followed.p)


def test_what_no_window_tells_stays_open_in_the_middle_of_its_range(rng, follower):
    for _ in range(4):
        followed = follower.update(window(rng, moves=False))
    middle, low, high = followed.table["damping"]
    assert middle == pytest.approx(2.0, abs=0.05)
    assert high - low > 3.0
    assert not followed.alarm
    assert followed.innovation_rms == pytest.approx(1.0, abs=0.3)
    # It is told later, without an alarm.
    assert not follower.update(window(rng)).alarm
    assert follower.table()["damping"][0] == pytest.approx(1.0, abs=0.1)


def test_healthy_windows_alarm_at_the_stated_rate(rng):
    follower = STRUT.follow(NOISE, alarm=0.05)
    alarms = sum(follower.update(window(rng)).alarm for _ in range(100))
    assert 1 <= alarms <= 12


@pytest.mark.parametrize(
    ("name", "value", "cause"), [("damping", 0.5, DAMPER), ("stiffness", 4.0, SPRING)]
)
def test_a_change_is_named_and_followed_on(name, value, cause, rng, follower):
    change = {name: value}
    for _ in range(5):
        follower.update(window(rng))
    first = follower.update(window(rng, **change))
    assert first.alarm
    assert first.findings == (ALARM_FINDING,)
    followed = follower.update(window(rng, **change))
    assert followed.alarm
    assert followed.explained
    assert followed.innovation_rms > 1.5
    assert followed.findings[0].startswith(cause.name)
    for _ in range(3):
        assert not follower.update(window(rng, **change)).alarm
    _, low, high = follower.table(0.999)[name]
    assert low < value < high


@pytest.mark.parametrize("earlier", [0, 5])
def test_a_window_that_nothing_explains_is_left_out(earlier, rng, follower):
    for _ in range(earlier):
        follower.update(window(rng))
    before = follower.table()
    for _ in range(2):
        odd = window(rng)
        odd.signal[20:] *= -1.0
        followed = follower.update(odd)
        assert followed.alarm
    assert not followed.explained
    assert followed.findings[0].startswith("no robot explains the log")
    assert follower.table() == before
    assert not follower.update(window(rng)).alarm
    assert follower.table()["damping"][0] == pytest.approx(1.0, abs=0.1)


def test_a_number_that_wanders_raises_no_alarm_if_it_is_said_to(rng, follower):
    stiff = 5.0 - 0.05 * np.arange(30)
    logs = [window(rng, stiffness=one) for one in stiff]
    assert any(follower.update(log).alarm for log in logs)
    wandering = STRUT.follow(NOISE, drift={"stiffness": 0.1})
    assert not any(wandering.update(log).alarm for log in logs)
    _, low, high = wandering.table(0.999)["stiffness"]
    assert low < stiff[-1] < high


def test_an_innovation_is_what_was_observed_minus_what_was_predicted(rng, follower):
    assert follower.update(window(rng)).innovation is None
    for _ in range(8):
        follower.update(window(rng))
    struck = window(rng)
    struck.signal[20] += 0.5  # 5 sd
    struck.signal[3:9] = np.nan
    innovation = follower.update(struck).innovation
    assert innovation.shape == (40, 1)
    assert innovation[20, 0] == pytest.approx(5.0, abs=2.5)
    assert np.flatnonzero(np.isnan(innovation[:, 0])).tolist() == list(range(3, 9))


def test_a_hidden_angle_is_found_in_each_window(rng):
    def spin(values, times):
        return np.sin(values["speed"][:, None] * times + values["phase"][:, None])[:, :, None]

    wheel = Robot(spin, {"speed": Number(0.5, 1.5), "phase": Number.angle()}, {"signal": "V"})
    times = 0.1 * np.arange(80)
    follower = wheel.follow({"signal": 0.1})
    for _ in range(4):
        signal = np.sin(1.1 * times + rng.uniform(-3.0, 3.0)) + rng.normal(0.0, 0.1, 80)
        followed = follower.update(Trial(signal[:, None], times))
        assert not followed.alarm
    assert followed.table["speed"][0] == pytest.approx(1.1, abs=0.01)


def test_wrong_settings_are_refused():
    for options, said in (
        ({"noise": {}}, "noise must be that of every channel; force has none"),
        ({"drift": {"mass": 1.0}}, "drift must be one of"),
        ({"drift": {"damping": -1.0}}, "drift of damping must be a finite number of at least 0"),
    ):
        with pytest.raises(ConfigurationError, match=said):
            STRUT.follow(**({"noise": NOISE} | options))


def test_a_log_without_noise_raises_no_alarm_and_noise_of_rounding_says_so(rng, follower):
    assert not any(follower.update(window(rng, noise=0.0)).alarm for _ in range(4))
    rounding = STRUT.follow({"force": 1e-8})
    for _ in range(2):
        found = rounding.update(window(rng))
        assert found.alarm
        assert any("noise of force, 1e-08 N, is only rounding" in said for said in found.findings)


def test_each_window_says_that_a_number_is_at_the_end_of_its_range(rng):
    wave = np.sin(0.1 * np.arange(80))[:, None]
    robot = Robot(
        lambda values, _: values["gain"][:, None, None] * wave,
        {"gain": Number(0.0, 1.0)},
        {"side": "m"},
    )
    at_end = "gain is at the end of its range, 1, and may be beyond it"
    for gain, said in ((1.1, (at_end,)), (0.5, ())):
        follower = robot.follow({"side": 0.3})
        for _ in range(3):
            found = follower.update(Trial(gain * wave + rng.normal(0.0, 0.3, wave.shape)))
            assert not found.alarm
            assert found.findings == said


def test_a_window_that_overlaps_the_one_before_is_named(rng, follower):
    whole = window(rng, samples=100)
    signal, motion = np.asarray(whole.signal), np.asarray(whole.inputs)
    rows = [slice(0, 40), slice(20, 60), slice(60, 100)]
    said = [follower.update(Trial(signal[own], motion[own])).findings for own in rows]
    assert said[1:] == [("the window repeats samples of the one before: they count twice",), ()]
