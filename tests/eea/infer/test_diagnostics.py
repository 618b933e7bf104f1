from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from eea.fish.hypotheses import AS_COMMANDED
from eea.infer.mixture import Mixture
from eea.infer.robot import Robot
from eea.infer.statement import Hypothesis, Number, Part
from eea.infer.words import Fit, findings
from linear_worlds import mode

NAMES = ("fin.length", "fin.width", "fin.thickness", "tail.length", "tail.width", "gain", "phase")
CIRCULAR = np.array([False] * 6 + [True])
RANGES = (2.0, 1.0, 0.1, 2.0, 1.0, 1.2)
NUMBERS = {name: Number(0.0, high) for name, high in zip(NAMES, RANGES, strict=False)}
NUMBERS["phase"] = Number.angle()
SIZES = {name: name.partition(".")[2] for name in NAMES[:5]}
FIN = Part({name: SIZES[name] for name in NAMES[:3]}, NAMES[:2], "faster flippers would tell")
TAIL = Part({name: SIZES[name] for name in NAMES[3:5]}, NAMES[3:5], "a faster tail would tell")
BOTH = {"fin": FIN, "tail": TAIL}
KNOWN = np.full(7, 1e4)
MIDDLE = np.full(7, 0.5)


def known(*modes):
    return Mixture(NAMES, np.zeros(7), np.ones(7), CIRCULAR, modes)


def robot_of(parts):
    return Robot(lambda *_: None, NUMBERS, {"gyro": "rad/s"}, parts=parts, nominal=AS_COMMANDED)


def said_of(posterior, parts=BOTH):
    """Return the findings on a robot of these parts."""
    return findings(posterior, robot_of(parts))


def test_of_a_body_that_is_known_there_is_nothing_to_say():
    assert said_of(known(mode(MIDDLE, np.diag(KNOWN), 0.0))) == []


def test_a_fin_of_no_length_is_absent_and_of_its_other_sizes_nothing_is_said():
    theta, precision = MIDDLE.copy(), KNOWN.copy()
    theta[0], precision[1:3] = 0.0, 0.0
    said = said_of(known(mode(theta, np.diag(precision), 0.0)))
    assert len(said) == 1
    assert said[0].startswith("the fin is absent: its area is at most 0.0")


def test_of_data_that_tell_nothing_one_sentence_says_so():
    precision = KNOWN.copy()
    precision[:5] = 0.0
    said = said_of(known(mode(MIDDLE, np.diag(precision), 0.0)))
    assert said == ["the data do not constrain the body: no size is determined"]


@pytest.mark.parametrize(("pull", "theta", "beyond"), [(6, 1, 1), (3, 1, 0), (-6, 0, 0)])
def test_a_size_that_would_rather_be_beyond_its_range_is_named(pull, theta, beyond):
    """A best fit so many sd, 0.01, above the range; below it there is nothing."""
    at, slope = MIDDLE.copy(), np.zeros(7)
    at[0], slope[0] = theta, -100.0 * pull
    said = said_of(
        known(mode(at, np.diag(KNOWN), 0.0, slope)), {"tail": TAIL, "fin": replace(FIN, area=())}
    )
    expected = "the fin's length is at the end of its range, 2, and may be beyond it"
    assert said == [expected] * beyond


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_sizes_that_trade_off_are_named_with_what_would_tell(sign):
    information = np.diag(KNOWN)
    information[3:5, 3:5] = 1e4 * np.array([[1.0, 0.99 * sign], [0.99 * sign, 1.0]])
    found = known(mode(MIDDLE, information, 0.0))
    expected = "the tail's length and width trade off; a faster tail would tell"
    assert said_of(found) == [expected]
    assert said_of(found, {"fin": FIN}) == []


def test_a_size_that_is_not_told_is_named_with_its_range_in_its_unit():
    precision = KNOWN.copy()
    precision[2] = 0.0
    said = said_of(known(mode(MIDDLE, np.diag(precision), 0.0)))
    assert len(said) == 1
    told = re.fullmatch(
        "the data do not tell the fin's thickness: anything from (.*) to (.*); "
        "faster flippers would tell",
        said[0],
    )
    assert [float(end) for end in told.groups()] == pytest.approx([0.005, 0.095], abs=0.002)


def test_several_bodies_are_told_with_their_weights_where_they_differ():
    other = MIDDLE.copy()
    other[3] = 0.8
    odds = np.log(0.7 / 0.3)
    found = known(mode(MIDDLE, np.diag(KNOWN), 0.0), mode(other, np.diag(KNOWN), odds))
    said = said_of(found)
    assert said[:1] == [
        "2 bodies explain it: 70% the tail's length 1, or 30% the tail's length 1.6"
    ]


@pytest.mark.parametrize(("low", "high", "bodies"), [(0.0, 1.0, 1), (0.4, 0.6, 2)])
def test_bodies_that_differ_by_less_than_a_hundredth_of_the_range_are_one(low, high, bodies):
    other = MIDDLE.copy()
    other[3] += 0.005  # 50 sd
    modes = (
        mode(MIDDLE, np.diag(1e8 * np.ones(7)), 0.0),
        mode(other, np.diag(1e8 * np.ones(7)), 0.0),
    )
    found = Mixture(NAMES, np.full(7, low), np.full(7, high), CIRCULAR, modes)
    assert len(found.modes) == 2
    assert [said[:22] for said in said_of(found)] == ["2 bodies explain it: 5"] * (bodies - 1)


def test_modes_of_other_angles_and_nuisances_are_one_body():
    other = MIDDLE.copy()
    other[5], other[6] = 0.1, 2.5
    modes = (mode(MIDDLE, np.diag(KNOWN), 0.0), mode(other, np.diag(KNOWN), 0.0))
    assert len(known(*modes).modes) == 2
    assert said_of(known(*modes)) == []
    other[3] += 0.015  # a sd and a half: the shapes of the two lengths overlap
    assert said_of(known(modes[0], mode(other, np.diag(KNOWN), 0.0))) == []
    gain = {"servos": Part({"gain": "gain"})}
    assert said_of(known(*modes), gain)[0].startswith("2 bodies explain it: ")


def test_numbers_have_the_units_that_the_robot_states():
    at = MIDDLE.copy()
    slope = np.zeros(7)
    at[0] = 1.0
    slope[0] = -600.0
    metres = {name: replace(NUMBERS[name], unit="m") for name in ("fin.length", "fin.width")}
    robot = replace(robot_of({"fin": FIN}), numbers={**NUMBERS, **metres})
    (said,) = findings(known(mode(at, np.diag(KNOWN), 0.0, slope)), robot)
    assert said == "the fin's length is at the end of its range, 2 m, and may be beyond it"
    at[0] = 0.0
    (said,) = findings(known(mode(at, np.diag(KNOWN), 0.0)), robot)
    assert said.startswith("the fin is absent")
    assert said.endswith(" m^2")


def test_nothing_is_said_of_the_servo_of_an_absent_part():
    """The tail is not absent and its servo seized: what is not there cannot be stuck."""
    theta, precision = MIDDLE.copy(), KNOWN.copy()
    theta[3], precision[4] = 0.0, 0.0
    absent = known(mode(theta, np.diag(precision), 0.0))
    joint = robot_of(BOTH)
    seized = Hypothesis("the servo of the tail is seized", part="tail")
    missing = Hypothesis(
        "the tail is missing", {"tail.length": 0.0, "tail.width": 0.0}, part="tail"
    )
    other = Hypothesis("the servo of the fin is dead", part="fin")
    fits = [Fit(AS_COMMANDED, 0.8, 0.0), Fit(seized, 0.05, 3.0), Fit(missing, 0.1, 2.0)]
    said = findings(absent, joint, [*fits, Fit(other, 0.05, 9.0)])
    assert said[0] == "the servo of the fin is dead (5%)"
    assert said[1].startswith("the tail is absent: its area")
    assert len(said) == 2
    said = findings(absent, joint, [Fit(missing, 0.9, 0.0), Fit(seized, 0.1, 9.0)])
    assert said == ["the tail is missing (90%)"]
    present = known(mode(MIDDLE, np.diag(KNOWN), 0.0))
    said = findings(present, joint, [Fit(seized, 0.9, 0.0), Fit(AS_COMMANDED, 0.1, 9.0)])
    assert said == ["the servo of the tail is seized (90%)"]
