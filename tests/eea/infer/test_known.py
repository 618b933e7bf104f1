"""What is known of a robot, however it came to be known: asked the same questions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from cart import CART, PUSH, QUICK, SD, SOUGHT, measured, with_numbers
from eea import Hypothesis, Number, Robot, Trial
from eea.core.checks import ConfigurationError
from eea.infer.known import Known

NOISE = dict(zip(CART.channels, SD, strict=True))
HEAVIER = Hypothesis("it is heavier", moves={"gain": Number(mean=0.0, sd=0.3, low=0.0)}, odds=0.1)
ROBOT = replace(SOUGHT, hypotheses=[HEAVIER])


def from_answer():
    logs = [measured(np.random.default_rng(seed)) for seed in range(3)]
    return SOUGHT.infer(logs, config=QUICK, noise=NOISE).known(ROBOT)


def from_logs():
    return ROBOT.learn([measured(np.random.default_rng(seed)) for seed in range(20, 30)])


def from_statement():
    fixed = {"gain": Number(0.0, 2.0, healthy=1.0), "drag": Number(0.0, 2.0, healthy=1.0)}
    robot = replace(with_numbers(ROBOT, **fixed), hypotheses=[HEAVIER])
    return Known(robot, SOUGHT.infer([measured(np.random.default_rng(0))], config=QUICK).noise)


WAYS = pytest.mark.parametrize("way", [from_answer, from_logs, from_statement])


@WAYS
def test_a_log_of_the_same_robot_is_the_same_and_of_another_is_not(way):
    known = way()
    for seed in range(3):
        verdict = known.test(measured(np.random.default_rng(100 + seed)))
        assert verdict.same
        assert 0.5 < verdict.excess < 2.0
    other = known.test(measured(np.random.default_rng(200), gain=1.6))
    assert not other.same
    assert other.excess > 2.0 or other.p < 1e-6


@WAYS
def test_what_has_changed_since_is_inferred(way):
    known = way()
    found = known.infer([measured(np.random.default_rng(300), gain=1.3)], config=QUICK)
    assert found.probability("it is heavier") > 0.99
    _, low, high = found.broken("gain")
    assert low < 1.3 < high < low + 0.1
    same = known.infer([measured(np.random.default_rng(301))], config=QUICK)
    assert same.probability("it is heavier") < 0.2


@pytest.mark.parametrize("way", [from_answer, from_logs])
def test_numbers_are_followed_from_what_is_known(way):
    known = way()
    follower = known.follow()
    before = follower.table()["gain"]
    for seed in range(4):
        assert not follower.update(measured(np.random.default_rng(400 + seed))).alarm
    low, high = follower.table()["gain"][1:]
    assert low < 1.0 < high
    assert high - low < before[2] - before[1]
    follower.update(measured(np.random.default_rng(500), gain=1.4))
    named = follower.update(measured(np.random.default_rng(501), gain=1.4))
    assert named.alarm
    assert named.findings[0].startswith("it is heavier (")


def test_the_chance_is_uniform_where_the_robot_is_the_same():
    """Of an answer with its uncertainty: the noise is known, so the statistic is chi-square."""
    rng = np.random.default_rng(7)
    p = []
    for _ in range(60):
        known = SOUGHT.infer([measured(rng)], config=QUICK, noise=NOISE).known()
        p.append(known.test(measured(rng)).p)
    assert kstest(p, "uniform").pvalue > 0.01


@pytest.mark.slow
def test_noise_that_few_samples_told_raises_no_false_alarm():
    rng = np.random.default_rng(8)
    alarms = np.zeros(3)
    for _ in range(100):
        known = SOUGHT.infer([measured(rng)], config=QUICK).known()
        log = measured(rng)
        p = (
            known.test(log).p,
            known.follow().update(log).p,
            known.infer([log], config=QUICK).goodness.size_p,
        )
        alarms += np.array(p) < 0.01
    assert (alarms <= 3).all()  # by chi-square follow() and infer() raise it 5 times


def test_a_number_that_has_changed_stays_changed():
    broken = replace(CART, hypotheses=[HEAVIER])
    found = broken.infer([measured(np.random.default_rng(8), gain=1.4)], config=QUICK, noise=NOISE)
    known = found.known()
    assert known.test(measured(np.random.default_rng(9), gain=1.4)).same
    assert not known.test(measured(np.random.default_rng(10))).same


SENSOR_OFF = Hypothesis("the sensor is off", moves={"bias": Number(0.0, sd=1.0)}, odds=0.1)
WIDER = replace(SOUGHT, hypotheses=[SENSOR_OFF])  # its ranges have room for the change
WHOLE_BIAS = 0.12


def biased(seed):
    return measured(np.random.default_rng(seed), bias=WHOLE_BIAS)


@pytest.mark.parametrize("robot", [SOUGHT, WIDER], ids=["before", "with the hypothesis"])
def test_what_is_known_is_the_same_number_in_a_wider_range(robot):
    """A prior is of shares of ranges, which hypotheses widen."""
    found = robot.infer([biased(20)], config=QUICK, noise=NOISE)
    middle, low, high = found.table()["bias"]
    known = found.known(WIDER)
    number = known.robot.table["bias"]
    i = known.robot.prior.names.index("bias")
    span = number.high - number.low
    assert number.low + span * known.robot.prior.mean[i] == pytest.approx(middle, abs=0.002)
    sd = span * known.robot.prior.covariance[i, i] ** 0.5
    assert 3.29 * sd == pytest.approx(high - low, rel=0.1)
    assert all(known.test(biased(seed)).same for seed in range(30, 34))
    assert known.infer([biased(40)], config=QUICK).probability("the sensor is off") < 0.1
    off = known.infer([measured(np.random.default_rng(41), bias=0.9)], config=QUICK)
    assert off.probability("the sensor is off") > 0.99


def test_numbers_are_followed_in_the_ranges_that_hypotheses_widen():
    follower = WIDER.follow(NOISE)
    for seed in range(3):
        assert not follower.update(biased(seed)).alarm
    low, high = follower.table()["bias"][1:]
    assert low < WHOLE_BIAS < high < low + 0.1


def test_what_a_hypothesis_fixes_stays_fixed_while_another_number_changes():
    """Of a number that was healthy, of a switch, and of one with a prior."""
    stuck = Hypothesis("it is stuck", fixed={"gain": 0.4, "valve": 0.0, "bias": 0.9}, odds=0.1)
    drags = Hypothesis("it drags", moves={"drag": Number(0.0, sd=0.5)}, odds=0.1)
    robot = Robot(
        lambda values, wave: (
            (values["gain"] * (1.0 + values["valve"]))[:, None] * wave
            + values["drag"][:, None] * np.cos(3.0 * wave)
            + values["bias"][:, None]
        )[:, :, None],
        {
            "gain": Number(0.0, 2.0, healthy=1.0),
            "drag": Number(0.0, 2.0, healthy=1.0),
            "valve": Number(0.0, 1.0, mean=1.0, switch=True),
            "bias": Number(0.0, sd=0.1),
        },
        {"force": "N"},
        hypotheses=[stuck, drags],
    )
    wave = np.sin(0.3 * np.arange(60))
    noise = np.random.default_rng(0).normal(0.0, 0.1, (2, 60))
    before, later = (
        Trial((0.4 * wave + drag * np.cos(3.0 * wave) + 0.9 + one)[:, None], wave)
        for drag, one in zip((1.0, 1.6), noise, strict=True)
    )
    found = robot.infer([before], noise={"force": 0.1})
    assert found.probability("it is stuck") > 0.99
    again = found.known().infer([later])
    assert again.good
    assert again.probability("it drags") > 0.99
    assert again.broken("drag")[0] == pytest.approx(1.6, abs=0.1)


def test_a_switch_that_has_moved_is_followed_from_there():
    robot = Robot(
        lambda values, wave: (
            values["gain"][:, None] * wave + values["valve"][:, None] * np.cos(3.0 * wave)
        )[:, :, None],
        {"gain": Number(0.0, 2.0), "valve": Number(0.0, 1.0, mean=1.0, switch=True)},
        {"force": "N"},
        hypotheses=[Hypothesis("the valve is half open", moves={"valve": Number(0.0)}, odds=0.1)],
    )
    wave = np.sin(0.3 * np.arange(60))
    rng = np.random.default_rng(0)

    def felt():
        signal = 0.7 * wave + 0.5 * np.cos(3.0 * wave) + rng.normal(0.0, 0.1, 60)
        return Trial(signal[:, None], wave)

    follower = robot.infer([felt()], noise={"force": 0.1}).known().follow()
    for _ in range(3):
        followed = follower.update(felt())
        assert not followed.alarm
    assert followed.table["valve"][0] == pytest.approx(0.5, abs=0.05)


def test_an_answer_that_no_robot_explains_or_two_explain_is_not_known():
    bad = SOUGHT.infer([measured(np.random.default_rng(0), sd=(0.0, 0.0)),
                        measured(np.random.default_rng(0), sd=(0.0, 0.0), gain=1.7)],
                       config=QUICK, noise=NOISE)  # fmt: skip
    with pytest.raises(ConfigurationError, match="an answer must be good to be known"):
        bad.known()
    times = 0.1 * np.arange(1.0, 61.0)
    wave = Robot(
        lambda values, times: np.sin(values["g"][:, None] ** 2 * times)[:, :, None],
        {"g": Number(-2.0, 2.0)},
        {"signal": "V"},
    )
    signal = np.sin(1.14**2 * times) + np.random.default_rng(0).normal(0.0, 0.1, 60)
    found = wave.infer([Trial(signal[:, None], times)])
    with pytest.raises(ConfigurationError, match="must be one to be known; got: two values of g"):
        found.known()
    followed = wave.follow({"signal": 0.1}).update(Trial(signal[:, None], times))
    assert any("two values of g" in said for said in followed.findings)
    low, high = followed.table["g"][1:]
    assert low < -1.5 < 1.5 < high  # not one of the two


def test_hypotheses_that_explain_alike_leave_a_number_open():
    times = 0.05 * np.arange(200)

    def wave(values, _):
        return ((values["a"] + values["b"])[:, None] * np.sin(times))[:, :, None]

    changed = [Hypothesis(f"{name} is off", moves={name: Number(0.0)}) for name in "ab"]
    numbers = {name: Number(0.0, 3.0, healthy=1.0) for name in "ab"}
    robot = Robot(wave, numbers, {"signal": "V"}, hypotheses=changed)
    noise = np.random.default_rng(6).normal(0.0, 0.05, 200)
    found = robot.infer([Trial((2.7 * np.sin(times) + noise)[:, None])])
    for _, low, high in found.table().values():
        assert low == pytest.approx(1.0, abs=0.05)
        assert high == pytest.approx(1.7, abs=0.05)
    alone = found.table(hypothesis="a is off")
    assert alone["b"] == pytest.approx((1.0, 1.0, 1.0), abs=1e-4)
    assert alone["a"][2] - alone["a"][1] < 0.05
    with pytest.raises(ConfigurationError, match="two hypotheses explain the log, with other"):
        found.known()


@pytest.mark.parametrize(
    ("robot", "said"),
    [
        (3, "robot must be of type RobotModel; got 3"),
        (
            replace(CART, channels={"force": "N", "rate": "rad/s"}),
            "channels of robot must be those",
        ),
        (
            replace(SOUGHT, numbers={"gain": Number(0.0, 2.0, unit="m"), "drag": Number(0.0, 2.0)}),
            "numbers of robot must be those that the trials told; bias is missing",
        ),
        (CART, "gain of robot must be such as"),  # which takes it to be healthy
        (
            with_numbers(SOUGHT, drag=Number(1.5, 3.0)),
            "the range of drag must hold 1, which is known",
        ),
    ],
)
def test_another_robot_is_not_known(robot, said):
    log = measured(np.random.default_rng(0), sd=(1e-3, 1.0))
    found = SOUGHT.infer([log], config=QUICK)
    with pytest.raises(ConfigurationError, match=said):
        found.known(robot)


@WAYS
def test_logs_in_a_list_are_no_log_to_test(way):
    with pytest.raises(ConfigurationError, match=r"log must be of type Trial; got \["):
        way().test([measured(np.random.default_rng(0))])


def test_what_a_log_adds_nothing_to_is_not_called_unmeasured():
    """A log that tells less than what is known leaves it as well known as before."""
    logs = [measured(np.random.default_rng(seed)) for seed in range(3)]
    known = SOUGHT.infer(logs, config=QUICK, noise=NOISE).known()
    found = known.infer([measured(np.random.default_rng(3))], config=QUICK)
    assert found.good
    said = [words for words in found.findings if words.startswith("hardly better known than")]
    assert len(said) == 1
    assert "gain" in said[0]
    assert not any("not measured" in words for words in found.findings)


def test_a_later_log_is_read_as_the_known_good_ones_were():
    rng = np.random.default_rng(11)

    def held():
        signal = np.array(measured(rng).signal)
        signal[:, 1] = np.repeat(signal[::3, 1], 3)
        return Trial(signal, PUSH)

    known = ROBOT.learn([held() for _ in range(6)])
    for _ in range(3):
        found = known.infer([held()], config=QUICK)
        assert found.good, found.verdict
        said = "force repeats the reading before in 40 of 60 rows: they are left out"
        assert said in found.findings
