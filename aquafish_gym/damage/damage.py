"""What is broken: a robot with faults is another robot.

In text a fault is ``part:word`` or ``part:word=number``, and faults are joined by ``;`` or ``,``:
``left_pectoral:length=0.5; caudal:missing``. With ``@onset`` and ``+duration``, in seconds, it does
not last from the beginning to the end of an episode, ``caudal:seized@4+2``; and with a dash chance
decides when it strikes, ``random:moderate@2-8``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import reduce
from itertools import chain, groupby
from typing import Any, Self

import numpy as np

from aquafish_gym.damage.effect import Effect
from aquafish_gym.damage.fault import Fault
from aquafish_gym.damage.fins import FinEntangled, FinMissing, FinScaled, OfSizes
from aquafish_gym.damage.sensors import ChannelBias, ChannelDropped, ChannelStuck, GyroNoise
from aquafish_gym.damage.servos import ServoDead, ServoGain, ServoSeized
from aquafish_gym.damage.tiers import TIERS, RandomFaults, broken_fins
from aquafish_gym.damage.words import MEANT, WORDS, Word
from aquafish_gym.morphology import Morphology, change_in_words
from aquafish_gym.utils.validation import InvalidArgumentError, brief, one_of, parse_json

_KINDS: dict[str, Any] = {
    kind.__name__: kind
    for kind in (
        FinScaled, FinMissing, FinEntangled, ServoGain, ServoSeized,
        ServoDead, GyroNoise, ChannelBias, ChannelStuck,
        ChannelDropped, RandomFaults,
    )
}  # fmt: skip
_RANDOM = {tier: Word(lambda _part, tier=tier: RandomFaults(tier)) for tier in TIERS}
_WORDS = {**WORDS, "random": _RANDOM}
# Numbers may have a sign of their own only behind an e.
_TIME = r"[^-+@]+?(?:[eE][-+]?\d+)?"
_WHEN = re.compile(
    rf"(?P<what>[^@]*)(?:@(?P<onset>{_TIME})(?:-(?P<latest>{_TIME}))?(?:\+(?P<duration>{_TIME}))?)?"
)


@dataclass(frozen=True)
class Damage:
    """Everything that is broken, in the order in which it is applied.

    What it cannot be made of, InvalidArgumentError says, and for a name UnknownNameError.

    Examples
    --------
    >>> damage = Damage.parse("left_pectoral:length=0.5; caudal:missing")
    >>> damage.apply(Morphology.nominal()).left_pectoral
    (0.4, 0.8, 0.1)
    >>> str(damage)
    'left_pectoral:length=0.5;caudal:missing'
    """

    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        # Faults have an order, which sets lack, and an end, which generators may lack.
        if not isinstance(self.faults, list | tuple):
            raise InvalidArgumentError(f"damage must be a row of faults; got {brief(self.faults)}")
        for fault in self.faults:
            if not isinstance(fault, Fault):
                raise InvalidArgumentError(f"damage must be made of faults; got {brief(fault)}")
        object.__setattr__(self, "faults", tuple(self.faults))

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read faults joined by ``;`` or ``,``; no text, or ``none``, is no damage."""
        if not isinstance(text, str):
            raise InvalidArgumentError(f"damage must be text to be parsed; got {brief(text)}")
        if text.strip().lower() in ("", "none"):
            return cls()
        return cls(tuple(_read_fault(part) for part in text.replace(",", ";").split(";")))

    @classmethod
    def coerce(cls, value: object) -> Damage:
        """Make one from whatever a user may mean.

        ``None`` is no damage; text is parsed; a fault is itself; a mapping is read as
        ``to_list`` or ``dataclasses.asdict`` wrote it; a list or tuple is of faults, or of such
        mappings. One of texts or of damages is refused, as it might be of several robots.
        """
        try:
            return cls._coerce(value)
        except RecursionError:
            raise InvalidArgumentError("damage is nested too deep to be read") from None

    @classmethod
    def _coerce(cls, value: object) -> Damage:
        match value:
            case None:
                return cls()
            case Damage():
                return value
            case str():
                return cls.parse(value)
            case Fault():
                return cls((value,))
            case {"faults": list() | tuple() as faults, **others} if not others:
                return cls._coerce(faults)
            case Mapping():
                return cls((_fault_from_dict(value),))
            case list() | tuple() if cls.is_list_of_faults(value):
                return cls(tuple(chain.from_iterable(map(cls._coerce, value))))
            case list() | tuple():
                raise InvalidArgumentError(
                    "damage must be one robot's, whose faults are joined by ';' in one text, or a "
                    f"list of Fault; got a list of {len(value)}: {brief(value)}"
                )
        wanted = "text such as 'left_pectoral:length=0.5', a Damage, or a list of faults"
        raise InvalidArgumentError(f"damage must be {wanted}; got {brief(value)}")

    @staticmethod
    def is_list_of_faults(value: object) -> bool:
        """Whether it is what one robot's faults are listed in, and no damages of several robots."""
        return isinstance(value, list | tuple) and all(
            isinstance(one, Fault) or (isinstance(one, Mapping) and "kind" in one) for one in value
        )

    @classmethod
    def random(cls, rng: np.random.Generator) -> Self:
        """Return fins that broke at sea: one or two, equally likely, each with one fault.

        A fin is missing one time in four; else its length, width or thickness is 0.2 to 0.9 of what
        it was, uniformly. (``Damage.parse("random:moderate").drawn(rng)`` breaks servos, too.)

        Examples
        --------
        >>> len(Damage.random(np.random.default_rng(0))) in (1, 2)
        True
        """
        return cls(broken_fins(rng))

    @property
    def is_random(self) -> bool:
        """Whether it leaves something to chance, so that it must be drawn."""
        return any(fault.is_random for fault in self.faults)

    def drawn(self, rng: np.random.Generator) -> Self:
        """Return what it comes to in one episode, where it leaves something to chance.

        Examples
        --------
        >>> str(Damage.parse("caudal:missing@2-8").drawn(np.random.default_rng(0)))
        'caudal:missing@5.821770123928726'
        """
        if not self.is_random:
            return self
        return type(self)(tuple(chain.from_iterable(f.drawn(rng) for f in self.faults)))

    def effect(self, morphology: Morphology) -> Effect:
        """Return what a robot is with every fault, one after another, whenever they strike.

        Raises
        ------
        InvalidArgumentError
            If a fault does not fit the body, or is left to chance.
        """
        if not isinstance(morphology, Morphology):
            raise InvalidArgumentError(
                f"damage is applied to a Morphology; got {brief(morphology)}"
            )
        whole = Effect(morphology, faults=len(self.faults))
        return reduce(lambda robot, fault: fault.strike(robot), self.faults, whole)

    def apply(self, morphology: Morphology) -> Morphology:
        """Return the damaged body: the fins with every fault, one after another.

        Raises
        ------
        InvalidArgumentError
            If something else than sizes is broken, or not always, which no body says; and as
            :meth:`effect`, whose ``body`` is that with all faults of the fins.
        """
        body = self.effect(morphology).body
        for fault in self.split()[1]:
            raise InvalidArgumentError(
                "damage of a body must be of its fins' sizes, and last throughout; got "
                f"{fault}, which environments and an eea.EngineTarget can have"
            )
        return body

    def split(self) -> tuple[Self, Self]:
        """Return what makes another body throughout, and all else.

        Examples
        --------
        >>> body, rest = Damage.parse("caudal:length=0.5; caudal:weak=0.5").split()
        >>> str(body), str(rest)
        ('caudal:length=0.5', 'caudal:weak=0.5')
        """
        always = [
            isinstance(fault, OfSizes) and fault.onset == 0.0 and fault.duration is None
            for fault in self.faults
        ]
        body, rest = (
            tuple(fault for fault, own in zip(self.faults, always, strict=True) if own is wanted)
            for wanted in (True, False)
        )
        return type(self)(body), type(self)(rest)

    def in_words(self, morphology: Morphology) -> str:
        """Return what it does to a robot of this body, the body as :func:`change_in_words` does.

        Examples
        --------
        >>> Damage.parse("left_pectoral:length=0.5").in_words(Morphology.nominal())
        'left flipper: half its length, 0.80 where it was 1.60'
        >>> Damage.parse("caudal:missing; caudal:dead@4+2").in_words(Morphology.nominal())
        'tail: missing; servo of the tail: dead, from 4 to 6 s'
        """
        said, was = [], morphology
        for when, together in groupby(self.faults, lambda fault: fault.when):
            faults = tuple(together)
            body = Damage(tuple(f for f in faults if isinstance(f, OfSizes))).effect(was).body
            parts = [change_in_words(was, body)] if body != was else []
            parts += [fault.words for fault in faults if fault.words]
            said += [f"{part}, {when}" if when else part for part in parts]
            was = body
        return "; ".join(said) or change_in_words(morphology, was)

    def __iter__(self) -> Iterator[Fault]:
        return iter(self.faults)

    def __len__(self) -> int:
        return len(self.faults)

    def __str__(self) -> str:
        return ";".join(map(str, self.faults)) or "none"

    def to_list(self) -> list[dict[str, Any]]:
        """Return the faults as objects ready for JSON."""
        return [asdict(fault) for fault in self.faults]

    def to_json(self) -> str:
        """Return one line of JSON that ``from_json`` reads back exactly."""
        return json.dumps(self.to_list(), allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Damage:
        """Read what ``to_list`` gives, as JSON; anything else is refused."""
        faults = parse_json("damage", text)
        if not isinstance(faults, list) or not all(isinstance(f, dict) for f in faults):
            raise InvalidArgumentError("a damage's JSON must be a list of faults")
        return cls.coerce(faults)


def _read_fault(text: str) -> Fault:
    when = _WHEN.fullmatch(text.strip())
    part, colon, what = (one.strip() for one in (when["what"] if when else "").partition(":"))
    if not when or not colon or not what:
        raise InvalidArgumentError(
            "damage must be written part:word=number, as left_pectoral:length=0.5 or "
            "caudal:missing, with @onset+duration in s where it does not last throughout; got "
            f"{brief(text.strip())}"
        )
    made = _make(one_of("damage part", part, _WORDS), *what.partition("="))
    times = {name: when[name] for name in ("onset", "latest", "duration") if when[name]}
    if not times:
        return made
    read = {name: _read_number(f"damage {name}", digits) for name, digits in times.items()}
    onset = (read["onset"], read["latest"]) if "latest" in read else read["onset"]
    return replace(made, onset=onset, duration=read.get("duration"))


def _make(part: str, word: str, equals: str, digits: str) -> Fault:
    word = one_of("damage", word.strip(), _WORDS[part], MEANT)
    damage, (make, takes) = f"damage {part}:{word}", _WORDS[part][word]
    if not equals:
        if takes:
            raise InvalidArgumentError(f"{damage} needs a number, for example {part}:{word}=0.5")
        return make(part)
    number = _read_number(damage, digits)
    if takes is False:
        raise InvalidArgumentError(f"{damage} takes no number; got {number:g}")
    return make(part, number)


def _read_number(damage: str, digits: str) -> float:
    try:
        return float(digits)
    except ValueError:
        got = brief(digits.strip())
        raise InvalidArgumentError(f"{damage} needs a number; got {got}") from None


def _fault_from_dict(written: Mapping[str, Any]) -> Fault:
    kind = _KINDS[one_of("damage kind", written.get("kind"), _KINDS)]
    try:
        fault: Fault = kind(**{name: value for name, value in written.items() if name != "kind"})
    except TypeError:
        names = ", ".join(one.name for one in fields(kind) if one.init)
        raise InvalidArgumentError(
            f"damage of kind {kind.__name__} must have the fields {names}; "
            f"got {brief(dict(written))}"
        ) from None
    return fault
