"""The table of damage: what can be said of each part, and the number that each word takes.

A fault is a word about a part, with a number where the word takes one: ``caudal:length=0.5``.
Everything that speaks of damage takes its words and ranges from here.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import NamedTuple, TypeGuard

import numpy as np

from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.plans.plan import SIZES
from aquafish_gym.scenario import CHANNELS, LARGEST_SCALE, LONGEST_DELAY, MAXIMUM_SPIN

SHORTEST_SECONDS = 1e-3
LONGEST_SECONDS = 1e6
LARGEST_NUMBER = 1e30  # of a number of an environment whose units are its own, in any precision
RANDOM = "random"


class Range(NamedTuple):
    """The number that a word takes."""

    low: float
    high: float
    name: str = "NUMBER"  #: Its name in ``--help``.
    unit: str = ""
    neutral: float | None = 0.0  #: The number that changes nothing, if there is one.
    optional: bool = False


#: Word -> its number, or None where it takes none.
Words = Mapping[str, Range | None]


def _factor(low: float, high: float, name: str = "FACTOR") -> Range:
    return Range(low, high, name, neutral=1.0)


def _link(scale: float, longest: float) -> dict[str, Range | None]:
    """Return the words about what a channel carries, and when."""
    late = Range(SHORTEST_SECONDS, longest, "SECONDS", "s")
    return {"scale": _factor(-scale, scale), "delay": late, "hold": late}


def _actuator(angle: float, unit: str = "") -> dict[str, Range | None]:
    """Return the words about an actuator, which may be seized up to ``angle`` either way."""
    return {
        "weak": _factor(-2.0, 2.0, "GAIN"),
        "reversed": None,
        "seized": Range(-angle, angle, "ANGLE", unit, neutral=None, optional=True),
        "dead": None,
    }


def _sensor(bias: float, unit: str = "") -> dict[str, Range | None]:
    """Return the words about a sensor."""
    return {"bias": Range(-bias, bias, "BY", unit), "stuck": None, "dropped": None}


#: The words about a fin itself.
BODY_WORDS: Words = {
    **dict.fromkeys(SIZES, _factor(0.0, np.inf)),
    "missing": None,
    "entangled": Range(0.0, 1.0, "SHARE"),
}
#: The words about its servo.
SERVO_WORDS: Words = _actuator(np.pi, "rad")
#: The words about the gyroscope as a whole, and about each channel of the IMU: here of a direction.
NOISE_WORDS: Words = {"noise": Range(0.0, MAXIMUM_SPIN, "SD", "rad/s")}
SENSOR_WORDS: Words = _sensor(2.0)
#: The words about what any of them carries, and when.
LINK_WORDS: Words = _link(LARGEST_SCALE, LONGEST_DELAY)
#: All words about a fin.
FIN_WORDS: Words = {**BODY_WORDS, **SERVO_WORDS, **_link(2.0, LONGEST_DELAY)}  # "scale" is "weak"
_GYRO = {**NOISE_WORDS, **LINK_WORDS}
_RATE = {**_sensor(MAXIMUM_SPIN, "rad/s"), **LINK_WORDS}
_DIRECTION = {**SENSOR_WORDS, **LINK_WORDS}
#: Of the IMU: part -> word -> its number, or None where it takes none.
SENSOR_PARTS: Mapping[str, Words] = {
    "gyro": _GYRO,
    **{name: _RATE if name.startswith("gyro") else _DIRECTION for name in CHANNELS},
}


@functools.cache
def parts_of(plan: BodyPlan) -> Mapping[str, Words]:
    """Return what may break of a plan's fish: part -> word -> its number, None if it takes none."""
    return {**dict.fromkeys(plan.names, FIN_WORDS), **SENSOR_PARTS}


#: Those of the paper's fish.
PARTS: Mapping[str, Words] = parts_of(AQUAFISH)


#: The same about the channels of any environment, such as ``action_0``, ``observation_3-5``
#: (from 3 to 5) or ``observation`` (all of them).
CHANNEL_WORDS: Mapping[str, Words] = {
    "action": _actuator(LARGEST_NUMBER) | _link(LARGEST_NUMBER, LONGEST_SECONDS),
    "observation": {"noise": Range(0.0, LARGEST_NUMBER, "SD")}
    | _sensor(LARGEST_NUMBER)
    | _link(LARGEST_NUMBER, LONGEST_SECONDS),
}

#: Word -> what it says of a part; # is the number, in percent where it is a factor.
PHRASES: Mapping[str, str] = {
    **{size: f"has # of its {size}" for size in SIZES},
    "missing": "is missing",
    "entangled": "drags something along",
    "weak": "turns at # of its speed",
    "reversed": "turns the wrong way",
    "seized": "is seized at #",
    "dead": "does not move",
    "scale": "is scaled by #",
    "delay": "is # late",
    "hold": "changes only every #",
    "noise": "has noise of #",
    "bias": "is off by #",
    "stuck": "repeats its last value",
    "dropped": "gives no readings",
}


def needs_number(number: Range | None) -> TypeGuard[Range]:
    """Return whether a word cannot do without its number."""
    return number is not None and not number.optional


def can_grow(word: str, number: Range | None) -> bool:
    """Return whether a word may grow: its number has one that changes nothing, and is no time."""
    return number is not None and number.neutral is not None and word not in ("delay", "hold")


def forms_of(words: Words) -> str:
    """Return how words are written, for a message: ``weak=GAIN, reversed, dead``."""
    forms = []
    for word, number in words.items():
        if number is None or number.optional:
            forms.append(word)
        if number is not None:
            forms.append(f"{word}={number.name}")
    return ", ".join(forms)
