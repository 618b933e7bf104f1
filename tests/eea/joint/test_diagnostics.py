from __future__ import annotations

import re

import numpy as np
import pytest

from eea.joint.diagnostics import Group, Size, findings
from eea.joint.posterior import Mode, Posterior

NAMES = ("fin.length", "fin.width", "fin.thickness", "tail.length", "tail.width", "gain", "phase")
CIRCULAR = np.array([False] * 6 + [True])
FAST = "faster flippers would tell"
LENGTH, WIDTH = Size("the fin", "length", 0, 0, 2, FAST), Size("the fin", "width", 1, 0, 1, FAST)
FIN = Group(
    "the fin", (LENGTH, WIDTH, Size("the fin", "thickness", 2, 0, 0.1, FAST)), (LENGTH, WIDTH)
)
SIDES = tuple(
    Size("the tail", label, index, 0, high, "a faster tail would tell")
    for label, index, high in (("length", 3, 2), ("width", 4, 1))
)
TAIL = Group("the tail", SIDES, SIDES)
KNOWN = np.full(7, 1e4)
MIDDLE = np.full(7, 0.5)


def known(*modes):
    return Posterior(NAMES, np.zeros(7), np.ones(7), CIRCULAR, modes)


def test_of_a_body_that_is_known_there_is_nothing_to_say():
    assert findings(known(Mode(MIDDLE, np.diag(KNOWN), 0.0)), [FIN, TAIL]) == []


def test_a_fin_of_no_length_is_absent_and_of_its_other_sizes_nothing_is_said():
    theta, precision = MIDDLE.copy(), KNOWN.copy()
    theta[0], precision[1:3] = 0.0, 0.0
    said = findings(known(Mode(theta, np.diag(precision), 0.0)), [FIN, TAIL])
    assert len(said) == 1
    assert said[0].startswith("the fin is absent: its area is at most 0.0")


def test_of_data_that_tell_nothing_one_sentence_says_so():
    precision = KNOWN.copy()
    precision[:5] = 0.0
    said = findings(known(Mode(MIDDLE, np.diag(precision), 0.0)), [FIN, TAIL])
    assert said == ["the data tell next to nothing of the body: each size may be almost any"]


@pytest.mark.parametrize(("pull", "theta", "beyond"), [(6, 1, 1), (3, 1, 0), (-6, 0, 0)])
def test_a_size_that_would_rather_be_beyond_its_range_is_named(pull, theta, beyond):
    """A best fit so many sd, 0.01, above the range; below it there is nothing."""
    at, slope = MIDDLE.copy(), np.zeros(7)
    at[0], slope[0] = theta, -100.0 * pull
    said = findings(known(Mode(at, np.diag(KNOWN), 0.0, slope)), [TAIL, FIN._replace(area=None)])
    expected = "the fin's length is at the end of its range, 2, and may be beyond it"
    assert said == [expected] * beyond


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_sizes_that_trade_off_are_named_with_what_would_tell(sign):
    information = np.diag(KNOWN)
    information[3:5, 3:5] = 1e4 * np.array([[1.0, 0.99 * sign], [0.99 * sign, 1.0]])
    found = known(Mode(MIDDLE, information, 0.0))
    expected = "the tail's length and width trade off; a faster tail would tell"
    assert findings(found, [FIN, TAIL]) == [expected]
    assert findings(found, [FIN]) == []


def test_a_size_that_is_not_told_is_named_with_its_range_in_its_unit():
    precision = KNOWN.copy()
    precision[2] = 0.0
    said = findings(known(Mode(MIDDLE, np.diag(precision), 0.0)), [FIN, TAIL])
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
    found = known(Mode(MIDDLE, np.diag(KNOWN), 0.0), Mode(other, np.diag(KNOWN), odds))
    said = findings(found, [FIN, TAIL])
    assert said[:1] == [
        "two bodies explain it: 70% the tail's length 1, or 30% the tail's length 1.6"
    ]


def test_modes_of_other_angles_and_nuisances_are_one_body():
    other = MIDDLE.copy()
    other[5], other[6] = 0.1, 2.5
    modes = (Mode(MIDDLE, np.diag(KNOWN), 0.0), Mode(other, np.diag(KNOWN), 0.0))
    assert len(known(*modes).modes) == 2
    assert findings(known(*modes), [FIN, TAIL]) == []
    other[3] += 0.015  # a sd and a half: the shapes of the two lengths overlap
    assert findings(known(modes[0], Mode(other, np.diag(KNOWN), 0.0)), [FIN, TAIL]) == []
    gain = Group("the servos", (Size("the servos", "gain", 5, 0.8, 1.2),))
    assert findings(known(*modes), [gain])[0].startswith("two bodies explain it: ")
