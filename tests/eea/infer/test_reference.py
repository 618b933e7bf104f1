"""What known-good logs teach: the spread within and between sessions; and what has changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student

from cart import CART, PUSH, QUICK, SD, SOUGHT, measured, with_numbers
from eea import Hypothesis, Number, Robot, Trial
from eea.core.checks import ConfigurationError
from eea.infer.file import from_arrays, to_arrays

SESSIONS, LOGS = 6, 2
BETWEEN, WITHIN = 0.05, 0.02  # sd of the gain, in its unit
EFFORT = replace(QUICK, bodies=2, poses=1, descents=1, alternatives="never")
HEAVIER = Hypothesis("it is heavier", moves={"gain": Number(mean=0.0, sd=0.3, low=0.0)}, odds=0.1)
SENSOR_OFF = Hypothesis("the sensor is off", moves={"bias": Number(0.0, sd=0.5)}, odds=0.1)
ONE_ROW = Trial([[1.0, 1.0]], PUSH[:1])
ROBOT = replace(SOUGHT, hypotheses=[HEAVIER, SENSOR_OFF])


def known_good(rng, sessions=SESSIONS, logs=LOGS):
    """Return logs and their sessions' labels; the gains' sample variances are as they should be."""
    builds = rng.normal(size=sessions)
    builds = (builds - builds.mean()) / builds.std(ddof=1)
    builds *= np.hypot(BETWEEN, WITHIN / logs**0.5)
    apart = np.linspace(-1.0, 1.0, logs) * WITHIN * (1.0 - 1.0 / logs) ** 0.5 if logs > 1 else [0.0]
    trials = [
        measured(rng, gain=1.0 + build + own, bias=0.02 * rng.normal())
        for build in builds
        for own in apart
    ]
    return trials, [f"build {session}" for session in range(sessions) for _ in range(logs)]


def spread_of(reference, name="gain"):
    """Return the sd that a reference gives a number, in its unit."""
    prior = reference.robot.prior
    number = reference.robot.table[name]
    i = prior.names.index(name)
    return (number.high - number.low) * prior.covariance[i, i] ** 0.5


@pytest.fixture(scope="module")
def reference():
    return ROBOT.learn(*known_good(np.random.default_rng(0)), config=EFFORT)


def widening(freedom):
    return student.ppf(0.95, freedom) / student.ppf(0.95, 1e9)


def test_the_spread_of_a_new_session_is_found_and_widened_by_students_t(reference):
    new = np.hypot((1.0 + 1.0 / SESSIONS) ** 0.5 * BETWEEN, WITHIN)
    assert spread_of(reference) == pytest.approx(widening(SESSIONS - 1) * new, rel=0.15)


def test_the_spread_of_logs_of_one_session_is_that_within():
    logs = [measured(np.random.default_rng(i), gain=1.0 + WITHIN * (-1) ** i) for i in range(6)]
    expected = widening(5) * (1.0 + 1.0 / 6) ** 0.5 * WITHIN * (6 / 5) ** 0.5
    assert spread_of(ROBOT.learn(logs, config=EFFORT)) == pytest.approx(expected, rel=0.3)


def test_sessions_of_one_log_are_as_wide_as_logs_of_one_session():
    trials, _ = known_good(np.random.default_rng(2), sessions=6, logs=1)
    one, each = (
        spread_of(ROBOT.learn(trials, labels, config=EFFORT)) for labels in (None, range(6))
    )
    assert one == pytest.approx(each, rel=0.1)


def test_fewer_sessions_tell_less_of_a_new_one(reference):
    few = ROBOT.learn(*known_good(np.random.default_rng(3), sessions=3), config=EFFORT)
    assert spread_of(few) > 1.2 * spread_of(reference)


def test_later_logs_of_an_ongoing_session_are_judged_by_that_session():
    rng = np.random.default_rng(8)
    trials, labels = known_good(rng)
    columns = np.column_stack([PUSH, np.ones_like(PUSH)])
    gains = np.linalg.lstsq(columns, np.transpose([t.signal[:, 0] for t in trials]))[0][0]
    means = gains.reshape(SESSIONS, LOGS).mean(axis=1)
    label = f"build {means.argmax()}"
    ongoing = ROBOT.learn(trials, labels, config=EFFORT, ongoing=label)
    assert ongoing.robot.usual["gain"] == pytest.approx(means.max(), abs=0.01)
    within = widening(SESSIONS * (LOGS - 1)) * (1.0 + 1.0 / LOGS) ** 0.5 * WITHIN
    assert spread_of(ongoing) == pytest.approx(within, rel=0.25)


def test_the_session_that_goes_on_must_be_known():
    trials, labels = known_good(np.random.default_rng(9), sessions=2)
    for sessions, ongoing in ((labels, "build 7"), (None, "build 0")):
        with pytest.raises(ConfigurationError, match="ongoing must be one of the labels"):
            ROBOT.learn(trials, sessions, config=EFFORT, ongoing=ongoing)
    with pytest.raises(ConfigurationError, match="ongoing needs a session of two logs"):
        ROBOT.learn(trials[::2], labels[::2], config=EFFORT, ongoing="build 0")


def test_a_log_of_fewer_samples_than_numbers_is_judged(reference):
    start = measured(np.random.default_rng(10))
    short = Trial(start.signal[:1], start.inputs)
    found = reference.infer([short], config=QUICK)
    assert found.probability("nothing is broken") > 0.5
    with pytest.raises(ConfigurationError, match="more samples than"):
        ROBOT.infer([short], config=QUICK)


def test_noise_and_what_is_known_are_learned(reference):
    np.testing.assert_allclose(reference.noise.sd, SD, rtol=0.1)
    assert np.abs(reference.noise.correlation).max() == 0.0
    assert reference.robot.usual["gain"] == pytest.approx(1.0, abs=0.06)
    assert reference.misfits.mean() == pytest.approx(1.0, abs=0.1)


def test_watch_raises_false_alarms_at_its_rate(reference):
    rng = np.random.default_rng(4)
    logs = [trial for trial, _ in zip(*known_good(rng, 40, 1), strict=True)]
    p = np.array([reference.test(log).p for log in logs])
    assert (p < 0.1).mean() <= 0.2
    assert (p < 1e-3).sum() == 0
    assert (p > 0.5).sum() >= 8


def test_watch_notices_a_changed_log_and_an_unexplained_one(reference):
    rng = np.random.default_rng(5)
    assert reference.test(measured(rng)).same
    assert not reference.test(measured(rng, gain=1.6)).same  # numbers far away
    stopped = measured(rng)
    stopped.signal[30:] = 0.0  # what no numbers explain
    look = reference.test(stopped)
    assert not look.same
    assert look.excess > 2.0


def test_a_change_is_found_in_its_direction_only(reference):
    rng = np.random.default_rng(6)
    heavier = reference.infer([measured(rng, gain=1.5)], config=QUICK)
    assert heavier.probability("it is heavier") > 0.99
    assert heavier.good, heavier.verdict
    _, low, high = heavier.broken("gain")
    assert low < 1.5 < high
    lighter = reference.infer([measured(rng, gain=0.5)], config=QUICK)
    assert lighter.probability("it is heavier") < 0.01
    assert not lighter.good
    assert "sd from those of known-good logs" in lighter.verdict
    off = reference.infer([measured(rng, bias=0.4)], config=QUICK)
    assert off.findings[0].startswith("the sensor is off (100%): bias 0.")


def test_a_change_within_the_spread_between_sessions_is_not_named(reference):
    found = reference.infer([measured(np.random.default_rng(7), gain=1.04)], config=QUICK)
    assert found.probability("nothing is broken") > 0.8
    shown = found.findings[-1].removeprefix("a change of gain by less than ").split()
    assert float(shown[0]) > 2.0 * spread_of(reference)


def test_a_log_is_judged_by_how_well_known_good_ones_are_explained():
    """A simulator that is a little wrong is so in known-good logs, too."""

    def bent(trial):
        return Trial(
            trial.signal * np.where(np.arange(60) % 20 < 4, 0.6, 1.0)[:, None], trial.inputs
        )

    rng = np.random.default_rng(8)
    trials = [bent(trial) for trial in known_good(rng, 6, 1)[0]]
    reference = ROBOT.learn(trials, config=EFFORT)
    assert reference.test(bent(measured(rng))).same
    noise = dict(zip(ROBOT.channels, SD, strict=True))
    alone = replace(SOUGHT, hypotheses=()).infer([bent(measured(rng))], config=QUICK, noise=noise)
    assert not alone.good


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"known_good": []}, "known_good must be two logs or more; got 0"),
        ({"known_good": 3}, "known_good must be a list or tuple of Trial; got 3"),
        ({"known_good": [ONE_ROW, ONE_ROW]}, "known_good must have more samples than the"),
        ({"sessions": ["a"]}, "sessions must be one label for each of 2 logs, such as"),
        ({"sessions": 3}, "sessions must be one label for each of 2 logs"),
        ({"sessions": {"a", "b"}}, "sessions must be one label for each of 2 logs"),
        ({"sessions": {"log 1": "a", "log 2": "a"}}, "sessions must be one label for each"),
        ({"sessions": ["a", None]}, "sessions must be one label for each of 2 logs"),
        ({"sessions": np.array([1.0, np.nan])}, "sessions must be one label for each of 2 logs"),
        ({"sessions": [[1], [1]]}, "sessions must be one label for each of 2 logs"),
        ({"sessions": np.ones((2, 2))}, "sessions must be one label for each of 2 logs"),
        ({"sessions": [1, 1], "ongoing": np.ones(2)}, "ongoing must be one of the labels"),
        ({"config": 3}, "config must be of type FitConfig; got 3"),
    ],
)
def test_wrong_logs_are_refused(change, message):
    given = {"known_good": known_good(np.random.default_rng(9), 2, 1)[0], **change}
    with pytest.raises(ConfigurationError) as refusal:
        ROBOT.learn(**given)
    assert message in str(refusal.value)


def test_watch_refuses_what_is_no_log_or_rate(reference):
    for log, alarm, message in (
        ([measured(np.random.default_rng(0))], 0.01, "log must be of type Trial"),
        (measured(np.random.default_rng(0)), 2.0, "alarm must be a finite number in [1e-100, 1]"),
    ):
        with pytest.raises(ConfigurationError) as refusal:
            reference.test(log, alarm=alarm)
        assert message in str(refusal.value)


STATED = with_numbers(
    ROBOT, gain=Number(0.0, 2.0, healthy=0.9, unit="m"), drag=Number(0.0, 2.0, healthy=1.0)
)


def test_the_answer_says_that_known_good_logs_contradict_whole():
    trials, labels = known_good(np.random.default_rng(11))
    reference = STATED.learn(trials, labels, config=EFFORT)
    (said,) = reference.findings
    assert said.startswith("the known-good logs contradict healthy: gain is 0.99")
    assert said.endswith(", and not 0.9")
    answer = reference.infer(trials[:1], config=QUICK)
    assert answer.findings[-1] == said
    assert from_arrays(to_arrays(answer)).findings == answer.findings


def test_whole_that_agrees_with_the_logs_is_not_contradicted():
    rng = np.random.default_rng(12)
    for _ in range(5):
        logs = [measured(rng, bias=0.02 * rng.normal()) for _ in range(4)]
        assert CART.learn(logs, config=EFFORT).findings == ()


def test_whole_at_the_end_of_a_range_is_not_contradicted_by_noise():
    rng = np.random.default_rng(13)
    whole = with_numbers(
        CART, gain=Number(1.0, 2.0, healthy=1.0), drag=Number(0.0, 1.0, healthy=1.0)
    )
    logs = [measured(rng) for _ in range(40)]
    assert whole.learn(logs, config=EFFORT).findings == ()


def test_known_good_logs_without_noise_are_said_to_have_none():
    rng = np.random.default_rng(11)
    logs = [measured(rng, sd=0.0, gain=1.0 + 0.02 * i) for i in range(4)]
    found = ROBOT.learn(logs, config=EFFORT).findings
    assert any("is only rounding: by it any noise in a log counts as a change" in s for s in found)
    assert not any("rounding" in said for said in ROBOT.learn(known_good(rng)[0]).findings)


def pendulum(values, torque):
    """Return the gyroscopes (B, T, 1) of pendulums that torques (B, T) drive from rest."""
    angle = values["angle"].copy()
    rate = np.zeros(len(torque))
    gyro = np.empty((*torque.shape, 1))
    for step, push in enumerate(torque.T):
        rate += 0.01 * (values["motor"] * push - 9.81 / values["length"] * np.sin(angle))
        angle += 0.01 * rate
        gyro[:, step, 0] = rate + values["bias"]
    return gyro


@pytest.mark.slow
def test_a_search_that_ends_elsewhere_does_not_pass_for_a_spread():
    """From near the top a pendulum has many valleys: one log in eight ended in a wrong one."""
    robot = Robot(
        pendulum,
        {
            "length": Number(0.2, 2.0),
            "motor": Number(0.0, 2.0),
            "bias": Number(0.0, sd=0.03),
            "angle": Number.angle(),
        },
        {"gyro": "rad/s"},
    )
    rng = np.random.default_rng(1)

    def record(samples=150, motor=1.0):
        values = {"length": 0.63, "motor": motor, "bias": 0.02, "angle": rng.uniform(-3, 3)}
        torque = 6.0 * np.sign(np.sin(0.05 * np.arange(samples)))
        signal = pendulum({n: np.array([v]) for n, v in values.items()}, torque[None])[0]
        signal += rng.normal(0.0, 0.05, signal.shape)
        signal[rng.random(samples) < 0.1] = np.nan
        return Trial(signal, torque)

    for samples in (150, 100):  # the next log but one begins at 2.8 rad
        record(samples)
    known_good = [record(motor=motor) for motor in rng.normal(1.0, 0.03, 4).repeat(2)]
    reference = robot.learn(known_good, sessions=[1, 1, 2, 2, 3, 3, 4, 4])
    assert reference.misfits.max() < 1.5
    prior = reference.robot.prior
    assert prior.names == ("length", "motor", "bias")
    assert (np.sqrt(np.diag(prior.covariance)) < [0.01, 0.03, 0.03]).all()


def test_a_later_log_may_begin_elsewhere_than_the_known_good_ones():
    """All logs began at rest: that is no knowledge of the robot."""

    def glide(values, push):
        time = 0.05 * np.arange(push.shape[1])
        speed = values["speed at first"][:, None] * np.exp(-values["drag"][:, None] * time)
        return (speed + values["gain"][:, None] * push)[:, :, None]

    robot = Robot(
        glide,
        {
            "drag": Number(0.5, 2.0),
            "gain": Number(0.0, 2.0),
            "speed at first": Number(0.0, sd=1.0, varies=True),
        },
        {"speed": "m/s"},
        hypotheses=[Hypothesis("it is weak", moves={"gain": Number(mean=0, sd=0.3, high=0)})],
    )
    rng = np.random.default_rng(0)

    def log(speed, gain=1.0):
        values = {"drag": 1.0, "gain": gain, "speed at first": speed}
        signal = glide({n: np.array([v]) for n, v in values.items()}, PUSH[None])[0]
        return Trial(signal + rng.normal(0.0, 0.05, signal.shape), PUSH)

    reference = robot.learn([log(0.3), *(log(0.0) for _ in range(7))])
    assert reference.robot.prior.names == ("drag", "gain")
    for speed in (1.5, -1.0):
        assert reference.test(log(speed)).same
        found = reference.infer([log(speed)])
        assert found.branches[0].hypothesis.name == "nothing is broken"
        assert found.good
        _, low, high = found.table(0.99)["speed at first@1"]
        assert low < speed < high
    assert not reference.test(log(1.5, gain=0.7)).same


COUNT = np.arange(80)


def test_known_good_logs_that_two_answers_explain_alike_are_refused():
    def alias(values, _):  # four samples a turn: 1 turn more is the same signal
        turns = 0.25 * COUNT * values["speed"][:, None]
        return np.sin(2.0 * np.pi * turns)[:, :, None]

    wheel = Robot(alias, {"speed": Number(0.1, 7.9, unit="Hz")}, {"side": "m"})
    rng = np.random.default_rng(0)
    side = np.sin(2.0 * np.pi * 0.25 * 2.7 * COUNT)[:, None]
    logs = [Trial(side + rng.normal(0.0, 0.1, side.shape)) for _ in range(3)]
    with pytest.raises(ConfigurationError, match=r"one answer; .*: 2\.7 Hz and 6\.7 Hz"):
        wheel.learn(logs)


@pytest.mark.parametrize("gain", [1.3, 0.5])
def test_known_good_logs_beyond_a_range_are_said_to_be(gain):
    wave = np.sin(0.1 * COUNT)[:, None]
    robot = Robot(
        lambda values, _: values["gain"][:, None, None] * wave,
        {"gain": Number(0.0, 1.0)},
        {"side": "m"},
    )
    rng = np.random.default_rng(0)
    logs = [Trial(gain * wave + rng.normal(0.0, 0.3, wave.shape)) for _ in range(4)]
    said = robot.learn(logs).findings
    at_end = "gain is at the end of its range, 1, and may be beyond it"
    assert said == ((at_end,) if gain > 1.0 else ())
