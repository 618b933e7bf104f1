"""The table of faults: the word, its range, its edit of a scenario, and its description.

A fault is a word about a part, with a number where the word takes one: ``caudal:length=0.5``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage.tiers import TIERS
from aquafish_gym.morphology import DIMENSIONS, FIN_WORDS, FINS, SIZES
from aquafish_gym.scenario import CHANNELS, MAXIMUM_SPIN
from aquafish_gym.utils.validation import InvalidArgumentError, brief, finite_array, one_of

SHORTEST, LONGEST = 1e-3, 1e6  # s
RANDOM = "random"
_COLUMNS = {(d.fin, d.size): i for i, d in enumerate(DIMENSIONS)}

# The fields of a scenario that faults edit, (B, ...) each, in arrays that may be written to.
Robots = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Fault:
    """One thing that breaks, and when.

    Attributes
    ----------
    part
        A fin, "gyro", one of ``CHANNELS``, or "random".
    word
        What happens to it: a key of ``PARTS[part]``, or a tier.
    number
        What the word takes, or None.
    onset
        In s; or the earliest and the latest, between which it is drawn.
    duration
        In s; None is until the end.

    Raises
    ------
    InvalidArgumentError, UnknownNameError
        If there is no such part or word, or a number is missing or out of range.

    Examples
    --------
    >>> str(Fault("caudal", "seized", onset=4, duration=2))
    'caudal:seized@4.0+2.0'
    """

    part: str
    word: str
    number: float | None = None
    onset: float | tuple[float, float] = 0.0
    duration: float | None = None

    def __post_init__(self) -> None:
        kind = self.kind  # refuses unknown parts and words
        self._check_number(kind)
        if self.word == "weak" and self.number == -1.0:
            object.__setattr__(self, "word", "reversed")
            object.__setattr__(self, "number", None)
        if isinstance(self.onset, list | tuple):
            early, late = finite_array("damage onset", self.onset, (2,), 0.0, LONGEST, "s").tolist()
            if early > late:
                raise InvalidArgumentError(
                    f"damage onset must be the earliest and the latest; got {early:g} and {late:g}"
                )
            object.__setattr__(self, "onset", (early, late))
        else:
            self._check("onset", "damage onset", 0.0, LONGEST, "s")
        if self.duration is not None:
            self._check("duration", "damage duration", SHORTEST, LONGEST, "s")
        if self.word == "seized" and self.number is not None and self.onset != 0.0:
            raise InvalidArgumentError(
                f"damage {self.part}:seized has an angle only from the beginning, since a fin "
                f"cannot get there later; got {self.number:g} with the onset {self.onset}"
            )

    def _check_number(self, kind: Kind) -> None:
        name = f"damage {self.part}:{self.word}"
        if self.number is None:
            if kind.takes_number:
                example = f"{self.part}:{self.word}=0.5"
                raise InvalidArgumentError(f"{name} needs a number, for example {example}")
            return
        if kind.takes_number is False:
            raise InvalidArgumentError(f"{name} takes no number; got {brief(self.number)}")
        low, high, unit = kind.low, kind.high, kind.unit
        if self.word == "bias" and not self.part.startswith("gyro"):
            low, high, unit = -2.0, 2.0, ""  # of channels without a unit, which lie in [-1, 1]
        self._check("number", name, low, high, unit)

    def _check(self, field: str, name: str, low: float, high: float, unit: str) -> None:
        value = finite_array(name, getattr(self, field), (), low, high, unit)
        object.__setattr__(self, field, float(value))

    @property
    def kind(self) -> Kind:
        """The row of the table."""
        return kind_of(self.part, self.word)

    @property
    def index(self) -> int:
        """Of the fin or the channel."""
        return FINS.index(self.part) if self.part in FINS else CHANNELS.index(self.part)

    @property
    def amount(self) -> float:
        """The number of a fault that needs one."""
        return 0.0 if self.number is None else self.number

    @property
    def phrase(self) -> str:
        """What breaks, in words; nothing where the remaining body shows it."""
        return self.kind.phrase(self)

    @property
    def changes_body(self) -> bool:
        """Whether it changes a fin's sizes, and nothing else."""
        return self.word in _BODY

    @property
    def is_random(self) -> bool:
        """Whether it must be sampled before it can be applied."""
        return self.part == RANDOM or isinstance(self.onset, tuple)

    @property
    def span(self) -> tuple[float, float]:
        """When it begins and when it ends, in s."""
        if isinstance(self.onset, tuple):
            raise InvalidArgumentError(
                f"damage {self} leaves its onset to chance: sample it first (Damage.sample)"
            )
        return self.onset, self.onset + (np.inf if self.duration is None else self.duration)

    @property
    def when(self) -> str:
        """Return when it is active, in words; nothing if it always is."""
        onset, lasts = self.onset, self.duration
        if isinstance(onset, tuple):
            since = f"from some time between {onset[0]:g} and {onset[1]:g} s on"
            return since if lasts is None else f"{since}, for {lasts:g} s"
        if lasts is not None:
            return f"from {onset:g} to {onset + lasts:g} s"
        return f"from {onset:g} s on" if onset else ""

    def edit(self, robots: Robots) -> None:
        """Break robots, in place; InvalidArgumentError if it is random or does not fit them."""
        self.kind.edit(robots, self)

    def __str__(self) -> str:
        text = f"{self.part}:{self.word}" + ("" if self.number is None else f"={self.number!r}")
        onset, lasts = self.onset, "" if self.duration is None else f"+{self.duration!r}"
        if isinstance(onset, tuple):
            return f"{text}@{onset[0]!r}-{onset[1]!r}{lasts}"
        return text + (f"@{onset!r}{lasts}" if onset or lasts else "")


class Kind(NamedTuple):
    """A row of the table of faults."""

    edit: Callable[[Robots, Fault], None]
    phrase: Callable[[Fault], str] = lambda _: ""
    low: float = 0.0  #: The range of the number.
    high: float = 0.0
    unit: str = ""
    takes_number: bool | None = False  #: None is if one is given.


def _scale(robots: Robots, fault: Fault) -> None:
    column = _COLUMNS[fault.part, fault.word]
    body, dimension = robots["body"], DIMENSIONS[column]
    with np.errstate(over="ignore"):
        body[:, column] *= fault.amount
    largest = body[:, column].max(initial=0.0)
    if largest > dimension.maximum:  # to clip it would be another fault than was asked for
        raise InvalidArgumentError(
            f"damage {fault} would make {dimension.name} {largest:g}; "
            f"it must lie in [0, {dimension.maximum:g}]"
        )


def _remove(robots: Robots, fault: Fault) -> None:
    robots["body"][:, [_COLUMNS[fault.part, size] for size in SIZES]] = 0.0


def _entangle(robots: Robots, fault: Fault) -> None:
    column = _COLUMNS[fault.part, "width"]
    width = robots["body"][:, column]
    width += fault.amount * (DIMENSIONS[column].maximum - width)


def _weaken(robots: Robots, fault: Fault) -> None:
    robots["servo_gain"][:, fault.index] *= -1.0 if fault.number is None else fault.number


def _seize(robots: Robots, fault: Fault) -> None:
    robots["servo_gain"][:, fault.index] = 0.0
    if fault.number is not None:
        robots["fin_angles"][:, fault.index] = fault.number


def _cut_power(robots: Robots, fault: Fault) -> None:
    robots["servo_gain"][:, fault.index] = 0.0
    robots["fin_angles"][:, fault.index] = np.nan  # random at the start


def _add_noise(robots: Robots, fault: Fault) -> None:
    robots["gyro_noise"][:] = np.hypot(robots["gyro_noise"], fault.amount)


def _add_bias(robots: Robots, fault: Fault) -> None:
    robots["sensor_bias"][:, fault.index] += fault.amount


def _stick(robots: Robots, fault: Fault) -> None:
    robots["sensor_stuck"][:, fault.index] = True


def _drop(robots: Robots, fault: Fault) -> None:
    robots["sensor_dropped"][:, fault.index] = True


def _refuse_random(_robots: Robots, fault: Fault) -> None:
    raise InvalidArgumentError(f"damage {fault} is left to chance: sample it first (Damage.sample)")


def _servo(fault: Fault, what: str) -> str:
    return f"servo of the {FIN_WORDS[fault.part]}: {what}"


def _bias_phrase(fault: Fault) -> str:
    by, unit = fault.amount, " rad/s" if fault.part.startswith("gyro") else ""
    return f"{fault.part}: reads {abs(by):g}{unit} too {'high' if by > 0 else 'low'}"


_BODY = {
    **dict.fromkeys(SIZES, Kind(_scale, high=np.inf, takes_number=True)),
    "missing": Kind(_remove),
    "entangled": Kind(_entangle, high=1.0, takes_number=True),
}
_FIN = _BODY | {
    "weak": Kind(
        _weaken, lambda f: _servo(f, f"turns at {f.number:g} times its command"), -2.0, 2.0,
        takes_number=True,
    ),
    "reversed": Kind(_weaken, lambda f: _servo(f, "turns the other way")),
    "seized": Kind(
        _seize,
        lambda f: _servo(f, "seized" + ("" if f.number is None else f" at {f.number:.3g} rad")),
        -np.pi, np.pi, "rad", takes_number=None,
    ),
    "dead": Kind(_cut_power, lambda f: _servo(f, "dead")),
}  # fmt: skip
_GYRO = {
    "noise": Kind(
        _add_noise, lambda f: f"gyro: noise of {f.number:g} rad/s", 0.0, MAXIMUM_SPIN, "rad/s",
        takes_number=True,
    ),
}  # fmt: skip
_CHANNEL = {
    "bias": Kind(_add_bias, _bias_phrase, -MAXIMUM_SPIN, MAXIMUM_SPIN, "rad/s", takes_number=True),
    "stuck": Kind(_stick, lambda f: f"{f.part}: stuck"),
    "dropped": Kind(_drop, lambda f: f"{f.part}: reads 0"),
}
_TIER = Kind(_refuse_random, lambda f: f"random {f.word} damage")
PARTS: dict[str, dict[str, Kind]] = {
    **dict.fromkeys(FINS, _FIN),
    "gyro": _GYRO,
    **dict.fromkeys(CHANNELS, _CHANNEL),
}
#: Words that are no faults, and which fault they mean.
MEANT = {
    **dict.fromkeys(("shortened", "shorter"), "length=0.5"),
    **dict.fromkeys(("narrowed", "narrower"), "width=0.5"),
    **dict.fromkeys(("thinned", "thinner"), "thickness=0.5"),
    **dict.fromkeys(("oversized", "larger", "wider"), "entangled=0.5"),
    **dict.fromkeys(("lost", "gone", "torn"), "missing"),
    **dict.fromkeys(("slow", "slower"), "weak=0.5"),
    **dict.fromkeys(("jammed", "locked"), "seized"),
    **{word: f"gyro_x:{word}" for word in _CHANNEL},
}


def kind_of(part: object, word: object) -> Kind:
    """Return a word's row of the table; :class:`UnknownNameError` offers the nearest."""
    known = one_of("damage part", part, (*PARTS, RANDOM))
    words = dict.fromkeys(TIERS, _TIER) if known == RANDOM else PARTS[known]
    return words[one_of("damage", word, words, MEANT)]
