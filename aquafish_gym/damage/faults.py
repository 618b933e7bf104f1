"""The table of faults: the word, its range, its edit of a scenario, and its description.

A fault is a word about a part, with a number where the word takes one: ``caudal:length=0.5``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from dataclasses import fields as dataclass_fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage.tiers import TIERS
from aquafish_gym.morphology import DIMENSIONS, FIN_WORDS, FINS, SIZES
from aquafish_gym.scenario import CHANNELS
from aquafish_gym.utils.validation import InvalidArgumentError, brief, finite_array, one_of

SHORTEST, LONGEST = 1e-3, 1e6  # s
MOST_SPIN = 100.0  # rad/s, of the gyroscope's noise and bias
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
        What happens to it, of :func:`words_of` that part.
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
        if self.number is not None or kind.takes_number:
            self._set_number(kind)
        if self.word == "weak" and self.number == -1.0:
            object.__setattr__(self, "word", "reversed")
            object.__setattr__(self, "number", None)
        if isinstance(self.onset, list | tuple):
            row = finite_array("damage onset", self.onset, (2,), 0.0, LONGEST, "s")
            early, late = row.tolist()
            if early > late:
                raise InvalidArgumentError(
                    f"damage onset must be the earliest and the latest; got {early:g} and {late:g}"
                )
            object.__setattr__(self, "onset", (early, late))
        else:
            self._set("onset", 0.0, LONGEST)
        if self.duration is not None:
            self._set("duration", SHORTEST, LONGEST)
        if self.word == "seized" and self.number is not None and self.onset != 0.0:
            raise InvalidArgumentError(
                f"damage {self.part}:seized has an angle only from the beginning, since a fin "
                f"cannot get there later; got {self.number:g} with the onset {self.onset}"
            )

    def _set_number(self, kind: Kind) -> None:
        name = f"damage {self.part}:{self.word}"
        if kind.takes_number is False:
            raise InvalidArgumentError(f"{name} takes no number; got {self.number:g}")
        if self.number is None:
            raise InvalidArgumentError(
                f"{name} needs a number, for example {self.part}:{self.word}=0.5"
            )
        # Only gyroscopes are in rad/s, the other channels have no unit and lie in [-1, 1].
        low, high, unit = kind.low, kind.high, kind.unit
        if self.word == "bias" and not self.part.startswith("gyro"):
            low, high, unit = -2.0, 2.0, ""
        value = finite_array(name, self.number, (), low, high, unit)
        object.__setattr__(self, "number", float(value))

    def _set(self, name: str, low: float, high: float) -> None:
        value = finite_array(f"damage {name}", getattr(self, name), (), low, high, "s")
        object.__setattr__(self, name, float(value))

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
        """Break robots, in place.

        Raises
        ------
        InvalidArgumentError
            If it is random, or a fin would leave its range.
        """
        if self.part == RANDOM:
            raise InvalidArgumentError(
                f"damage {self} is left to chance: sample it first (Damage.sample)"
            )
        self.kind.edit(robots, self)

    def to_dict(self) -> dict[str, Any]:
        """Return the fault as files hold it: with the name of its kind."""
        kind, number = self.kind, -1.0 if self.word == "reversed" else self.number
        named = ((kind.part, self.part), (kind.word, self.word), (kind.field, number))
        found = {name: value for name, value in named if name is not None}
        return {"onset": self.onset, "duration": self.duration, **found, "kind": kind.name}

    def __str__(self) -> str:
        text = f"{self.part}:{self.word}" + ("" if self.number is None else f"={self.number!r}")
        onset, lasts = self.onset, "" if self.duration is None else f"+{self.duration!r}"
        if isinstance(onset, tuple):
            return f"{text}@{onset[0]!r}-{onset[1]!r}{lasts}"
        return text + (f"@{onset!r}{lasts}" if onset or lasts else "")


class Kind(NamedTuple):
    """A row of the table of faults."""

    name: str  #: In files.
    edit: Callable[[Robots, Fault], None]
    phrase: Callable[[Fault], str] = lambda _: ""
    low: float = 0.0  #: The range of the number.
    high: float = 0.0
    unit: str = ""
    takes_number: bool | None = False  #: None is if one is given.
    field: str | None = None  #: What files call the number,
    part: str | None = "fin"  #: the part,
    word: str | None = None  #: and the word; None where they do not need it.


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


def _nothing(robots: Robots, fault: Fault) -> None:
    """Stand for the edits of a random fault, which is sampled first."""


def _servo(fault: Fault, what: str) -> str:
    return f"servo of the {FIN_WORDS[fault.part]}: {what}"


def _bias_phrase(fault: Fault) -> str:
    by, unit = fault.amount, " rad/s" if fault.part.startswith("gyro") else ""
    return f"{fault.part}: reads {abs(by):g}{unit} too {'high' if by > 0 else 'low'}"


_BODY = {
    **{
        size: Kind("FinScaled", _scale, high=np.inf, takes_number=True, field="factor", word="size")
        for size in SIZES
    },
    "missing": Kind("FinMissing", _remove),
    "entangled": Kind("FinEntangled", _entangle, high=1.0, takes_number=True, field="share"),
}
_FIN = _BODY | {
    "weak": Kind(
        "ServoGain", _weaken, lambda f: _servo(f, f"turns at {f.number:g} times its command"),
        -2.0, 2.0, takes_number=True, field="gain",
    ),
    "reversed": Kind("ServoGain", _weaken, lambda f: _servo(f, "turns the other way"),
                     field="gain"),
    "seized": Kind(
        "ServoSeized", _seize,
        lambda f: _servo(f, "seized" + ("" if f.number is None else f" at {f.number:.3g} rad")),
        -np.pi, np.pi, "rad", None, "angle",
    ),
    "dead": Kind("ServoDead", _cut_power, lambda f: _servo(f, "dead")),
}  # fmt: skip
_GYRO = {
    "noise": Kind(
        "GyroNoise", _add_noise, lambda f: f"gyro: noise of {f.number:g} rad/s",
        0.0, MOST_SPIN, "rad/s", True, "deviation", None,
    ),
}  # fmt: skip
_CHANNEL = {
    "bias": Kind("ChannelBias", _add_bias, _bias_phrase, -MOST_SPIN, MOST_SPIN, "rad/s",
                 True, "by", "channel"),
    "stuck": Kind("ChannelStuck", _stick, lambda f: f"{f.part}: stuck", part="channel"),
    "dropped": Kind("ChannelDropped", _drop, lambda f: f"{f.part}: reads 0", part="channel"),
}  # fmt: skip
_TIER = Kind(
    "RandomFaults", _nothing, lambda f: f"random {f.word} damage", part=None, word="tier"
)  # fmt: skip
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
    words = _words_of(one_of("damage part", part, (*PARTS, RANDOM)))
    return words[one_of("damage", word, words, MEANT)]


def _words_of(part: str) -> Mapping[str, Kind]:
    return dict.fromkeys(TIERS, _TIER) if part == RANDOM else PARTS[part]


def fault_from_dict(written: Mapping[str, Any]) -> Fault:
    """Return the fault of ``Fault.to_dict``, or of ``dataclasses.asdict``."""
    given = dict(written)
    if "kind" not in given:
        return _make(given, given)
    names = {kind.name for part in (*PARTS, RANDOM) for kind in _words_of(part).values()}
    wanted = one_of("damage kind", given.pop("kind"), names)
    part, kinds = next(
        (part, kinds)
        for part in (*PARTS, RANDOM)
        if (kinds := {w: k for w, k in _words_of(part).items() if k.name == wanted})
    )
    word, kind = next(iter(kinds.items()))
    named = {kind.part: "part", kind.word: "word", kind.field: "number"}
    fields = {named.get(name, name): value for name, value in given.items()}
    return _make({"part": part, "word": word} | fields, written)


def _make(fields: Mapping[str, Any], written: Mapping[str, Any]) -> Fault:
    try:
        return Fault(**fields)
    except TypeError:
        names = ", ".join(one.name for one in dataclass_fields(Fault))
        raise InvalidArgumentError(
            f"a fault must have the fields {names}, or those of its kind; "
            f"got {brief(dict(written))}"
        ) from None
