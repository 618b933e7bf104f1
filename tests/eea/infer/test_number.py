"""What a robot's numbers may be, how hypotheses change them, and that files keep them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cart import CART, QUICK, SOUGHT, measured, with_numbers
from eea import Hypothesis, Number, Robot, Trial
from eea.core.checks import ConfigurationError
from eea.infer.answer import Answer
from eea.infer.branch import Branch
from eea.infer.file import from_arrays, to_arrays
from eea.infer.goodness import Goodness
from eea.infer.mixture import Mode
from eea.infer.unknowns import Unknowns

EXPLAINED = Goodness(1.0, 1.0, 1.0, 1.0, 1.0, good=True, verdict="as noise would")
TIME = 0.01 * np.arange(1, 81)


@st.composite
def robots_numbers(draw):
    """Return a valid number of any kind, in a robot."""
    low = draw(st.floats(-1e3, 1e3))
    high = low + draw(st.floats(1e-3, 1e3))
    inside = min(low + (high - low) * draw(st.floats(0.0, 1.0)), high)
    sd = draw(st.floats(1e-3, 1e3))
    one = {"unit": draw(st.sampled_from(["", "m", "rad/s"]))}
    many = {**one, "valleys": draw(st.integers(0, 20))}
    group = draw(st.sampled_from(["", "water"]))
    kinds = (
        lambda: Number(low, high, **many),
        lambda: Number(low, high, healthy=inside, **many),
        lambda: Number(inside, sd=sd, group=group, **many),
        lambda: Number(mean=inside, sd=sd, low=low, **many),
        lambda: Number(low, high, mean=inside, sd=sd, group=group, **many),
        lambda: Number(low, high, varies=True, **many),
        lambda: Number(inside, sd=sd, varies=True, **many),
        lambda: Number(low, high, mean=inside, switch=True, **one),
        lambda: Number.angle(**one),
        lambda: Number.angle(varies=False, **one),
    )
    return draw(st.sampled_from(kinds))()


def stated(numbers):
    """Return a robot of some numbers by their places."""
    named = {f"number {i}": number for i, number in enumerate(numbers)}
    return Robot(lambda *_: np.zeros((1, 9, 1)), named, {"signal": "V"})


some_robots = (
    st.lists(robots_numbers(), min_size=1, max_size=5)
    .filter(lambda numbers: not all(number.switch for number in numbers))
    .map(stated)
)


@given(some_robots, st.integers(1, 3))
@settings(max_examples=60, deadline=None)
def test_any_numbers_come_back_from_a_file(robot, trials):
    parameters = Unknowns.of(robot, trials, robot.groups)
    theta = np.where(parameters.circular, 0.5, parameters.prior_mean)
    information = parameters.proper_prior
    mode = Mode(theta, information, np.zeros(len(theta)), 0.0)
    posterior = parameters.posterior([mode])
    branch = Branch(robot.nominal, 1.0, parameters, posterior, posterior)
    found = from_arrays(to_arrays(Answer((branch,), EXPLAINED, 1.0, 0)))
    assert list(found.robot.table.items()) == list(robot.table.items())
    assert [*found.robot.alternatives] == [*robot.alternatives]
    assert found.branches[0].parameters.names == parameters.names
    assert found.table() == Answer((branch,), EXPLAINED, 1.0, 0).table()


@given(some_robots)
@settings(max_examples=200, deadline=None)
def test_ends_of_a_range_are_exact_in_natural_units(robot):
    parameters = Unknowns.of(replace(robot, hypotheses=()), 1, robot.groups)
    straight = np.flatnonzero(~parameters.circular)
    table = [robot.table[parameters.base(i)] for i in straight]
    for share, end in ((0.0, "low"), (1.0, "high")):
        theta = np.full(len(parameters), share)
        wanted = [getattr(number, end) for number in table]
        assert parameters.natural(theta)[straight].tolist() == wanted
        slots = np.full((1, len(robot.names)), share)
        simulated = parameters.values(slots)
        assert [simulated[parameters.base(i)][0] for i in straight] == wanted
    shares = [(n.high - n.low) / (n.high - n.low) for n in table]
    assert shares == [1.0] * len(table)


def test_no_number_is_simulated_beyond_its_range():
    """The sum -0.3 + (0.1 + 0.3) is beyond 0.1, where a simulator may have no value."""
    asked = []

    def decay(values, inputs):
        assert inputs is None
        asked.append(values["rate"])
        return (values["rate"][:, None] * TIME)[:, :, None]

    robot = Robot(decay, {"rate": Number(-0.3, 0.1)}, {"level": "m"})
    noise = np.random.default_rng(0).normal(0.0, 0.01, TIME.shape)
    found = robot.infer([Trial((0.4 * TIME + noise)[:, None])], config=QUICK)
    assert found.table()["rate"][2] == 0.1
    rates = np.concatenate(asked)
    assert rates.max() == 0.1
    assert rates.min() >= -0.3


def test_numbers_are_ordered_by_what_is_asked_of_them():
    numbers = {
        "heading": Number.angle(),
        "speed": Number(0.0, sd=1.0, varies=True),
        "bias": Number(0.0, sd=0.1),
        "length": Number(0.2, 2.0),
        "servo": Number(0.0, 1.0, mean=1.0, switch=True),
        "mass": Number(1.0, 2.0, healthy=1.5),
        "phase": Number.angle(varies=False),
    }
    robot = replace(SOUGHT, numbers=numbers)
    assert robot.sought == ("length", "mass")
    assert robot.names == ("length", "mass", "bias", "servo", "speed", "heading", "phase")
    names = Unknowns.of(robot, 2, robot.groups).names
    assert names[:4] == ("length", "mass", "bias", "phase")
    assert names[4:] == ("speed@1", "heading@1", "speed@2", "heading@2")


@pytest.mark.parametrize(
    ("moves", "message"),
    [
        (
            {"gain": Number(0.0, sd=1.0, unit="m")},
            "moves of gain must be ends, a mean and an sd, or an angle of all trials; got "
            "Number(mean=0.0, sd=1.0, unit='m'), so state Number(mean=0.0, sd=1.0)",
        ),
        ({"gain": Number(0.0, 1.0, healthy=0.5)}, "so state Number(0, 1)"),
        ({"gain": Number(0.0, sd=1.0, varies=True)}, "so state Number(mean=0.0, sd=1.0)"),
        ({"angle": Number.angle()}, "so state Number(-3.14159, 3.14159, unit='rad', circular=True"),
        ({"gain": 0.3}, "moves must be a mapping from names to Number"),
    ],
)
def test_a_change_says_how_far_and_no_more(moves, message):
    with pytest.raises(ConfigurationError) as refusal:
        Hypothesis("x", moves=moves)
    assert message in str(refusal.value)


@pytest.mark.parametrize(
    ("moves", "message"),
    [
        ({"gain": Number.angle(varies=False)}, "must be such as Number(0.0, sd=0.1) of gain"),
        ({"heading": Number(0.0)}, "must be such as Number.angle(varies=False) of heading"),
        ({"phase": Number.angle(varies=False)}, "must be one of gain, drag, bias, heading"),
        (
            {"bias": Number(0.0)},
            "low and high of bias must be given, for a hypothesis moves it anywhere",
        ),
    ],
)
def test_a_change_fits_its_number(moves, message):
    angles = {"heading": Number.angle(), "phase": Number.angle(varies=False)}
    robot = with_numbers(CART, **angles)
    with pytest.raises(ConfigurationError) as refusal:
        replace(robot, hypotheses=[Hypothesis("x", moves=moves)])
    assert message in str(refusal.value)


def test_a_range_has_room_for_a_change_between_ends():
    """A uniform change has no sd, but it has ends."""
    change = Hypothesis("x", moves={"bias": Number(0.5, 0.8)})
    number = replace(CART, hypotheses=[change]).table["bias"]
    assert number.high == pytest.approx(0.8 + 5 * 0.1)
    assert number.low == -number.high


def test_a_number_that_a_hypothesis_moves_is_inferred_without_its_group():
    cause = Hypothesis("the sensor is off", moves={"bias": Number(0.0, sd=0.5)})
    robot = replace(CART, hypotheses=[cause])
    trial = measured(np.random.default_rng(0), bias=0.4)
    found = robot.infer([trial], config=replace(QUICK, nuisances=()))
    assert not Unknowns.of(robot, 1, ()).has("bias")
    assert found.probability("the sensor is off") > 0.99
    middle, low, high = found.broken("bias")
    assert low < 0.4 < high
    assert middle == pytest.approx(0.4, abs=0.05)


def sway(values, inputs):
    """Return a pendulum that swings from an angle, or one whose joint is stuck at it."""
    assert inputs is None
    angle = values["angle"][:, None]
    swing = values["servo"][:, None] * 9.0 * TIME
    return np.stack([np.cos(angle + swing), np.sin(angle + swing)], axis=-1)


SWAY = Robot(
    sway,
    {"servo": Number(0.0, 2.0, healthy=1.0), "angle": Number.angle()},
    {"x": "m", "y": "m"},
    hypotheses=[
        Hypothesis("stuck", fixed={"servo": 0.0}, moves={"angle": Number.angle(varies=False)})
    ],
)


def swayed(rng, **values):
    """Return a trial of the pendulum."""
    signal = sway({name: np.array([value]) for name, value in values.items()}, None)[0]
    return Trial(signal + 0.1 * rng.normal(size=signal.shape))


def test_an_angle_moves_to_one_in_all_trials():
    rng = np.random.default_rng(0)
    stuck = SWAY.infer([swayed(rng, servo=0.0, angle=3.12) for _ in range(3)], config=QUICK)
    assert stuck.branches[0].hypothesis.name == "stuck"
    middle, low, high = stuck.broken("angle")
    off = math.remainder(middle - 3.12, math.tau)
    assert abs(off) < 0.03
    assert low < middle < high < low + 0.06  # as narrow as elsewhere, though it may cross pi
    apart = SWAY.infer([swayed(rng, servo=0.0, angle=a) for a in (0.5, 1.0, 2.0)], config=QUICK)
    assert not apart.good  # a stuck joint has one angle


def test_what_has_changed_is_known_afterwards():
    """The robot after an answer has the new value as its prior, not the healthy one."""
    weak = Hypothesis("it is weak", moves={"gain": Number(mean=0.0, sd=0.3, high=0.0)})
    robot = replace(CART, hypotheses=[weak])
    found = robot.infer([measured(np.random.default_rng(1), gain=0.6)], config=QUICK)
    known = found.branches[0].known(robot)
    assert found.branches[0].hypothesis is weak
    assert set(known.healthy) == {"drag"}
    parameters = Unknowns.of(known, 1, known.groups)
    i = parameters.first_entry("gain")
    assert 2.0 * parameters.prior_mean[i] == pytest.approx(0.6, abs=0.05)
    assert parameters.prior_precision[i] > 100.0


@pytest.mark.parametrize(
    ("name", "number", "change", "mean", "variance", "ends"),
    [
        ("gain", Number(0.0, 2.0, healthy=1.0), Number(0.1, sd=0.3), 1.1, 0.09, (0.0, 2.0)),
        (
            "gain",
            Number(0.0, 2.0, healthy=1.0),
            Number(mean=0.0, sd=0.3, high=0.0),
            1.0,
            0.09,
            (0.0, 1.0),
        ),
        ("gain", Number(0.0, 2.0, healthy=1.0), Number(0.0), 1.0, math.inf, (0.0, 2.0)),
        ("bias", Number(-2.0, 2.0, mean=0.1, sd=0.3), Number(0.0, sd=0.4), 0.1, 0.25, (-2.0, 2.0)),
    ],
)
def test_a_change_adds_to_what_was_known(name, number, change, mean, variance, ends):
    """Of a healthy number nothing else is known; of one with a prior the variances add."""
    changed = Hypothesis("it has changed", moves={name: change})
    robot = replace(CART, numbers={**CART.numbers, name: number}, hypotheses=[changed])
    parameters = Unknowns.of(robot, 1, robot.groups, changed)
    i = parameters.first_entry(name)
    span = number.high - number.low
    shares = (parameters.low[i], parameters.high[i], parameters.prior_mean[i])
    found = [number.low + span * share for share in shares]
    assert found == pytest.approx([*ends, mean])
    precision = parameters.prior_information[i, i]
    assert precision / span**2 == pytest.approx(1.0 / variance)


def test_a_switch_that_was_moved_stays_known():
    numbers = {**CART.numbers, "gain": Number(0.0, 2.0, mean=1.0, switch=True)}
    weak = Hypothesis("it is weak", moves={"gain": Number(0.0)})
    robot = replace(CART, numbers=numbers, hypotheses=[weak])
    found = robot.infer([measured(np.random.default_rng(2), gain=0.6)], config=QUICK)
    assert found.probability("it is weak") > 0.99
    known = found.branches[0].known(robot)
    parameters = Unknowns.of(known, 1, known.groups)
    assert parameters.prior_mean[parameters.first_entry("gain")] == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize(
    ("number", "config"),
    [
        (Number(0.0, 2.0, mean=1.0, switch=True), QUICK),
        (Number(1.0, sd=0.1), replace(QUICK, nuisances=())),
    ],
)
def test_a_robot_without_unknowns_is_refused(number, config):
    robot = Robot(roll_one, {"gain": number}, {"rate": "rad/s"})
    with pytest.raises(ConfigurationError, match="must have one that is unknown if nothing is bro"):
        robot.infer([Trial(np.ones((9, 1)))], config=config)


def roll_one(values, inputs):
    assert inputs is None
    return np.broadcast_to(values["gain"][:, None, None], (len(values["gain"]), 40, 1))


def test_a_robot_may_have_numbers_with_a_prior_alone():
    robot = Robot(roll_one, {"gain": Number(1.0, sd=0.5)}, {"rate": "rad/s"})
    signal = 1.3 + np.random.default_rng(0).normal(0.0, 0.1, (40, 1))
    found = robot.infer([Trial(signal)], config=QUICK)
    middle, low, high = found.table()["gain"]
    assert low < 1.3 < high
    assert middle == pytest.approx(signal.mean(), abs=0.01)
    assert found.model.shape == (0,)
    assert from_arrays(to_arrays(found)).to_dict() == found.to_dict()
    assert [one.name for one in found.identified().told] == ["gain"]
