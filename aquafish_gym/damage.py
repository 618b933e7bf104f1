"""What can break: a body with faults is another body.

In text a fault is ``fin:word`` or ``fin:word=number``, and faults are joined by ``;`` or
``,``: ``left_pectoral:length=0.5; caudal:missing``.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from itertools import chain
from typing import Any, Self

import numpy as np

from aquafish_gym.morphology import DIMENSIONS, FINS, SIZES, Morphology, change_in_words
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    one_of,
    parse_json,
)


@dataclass(frozen=True)
class FinScaled:
    """A fin's length, width or thickness is multiplied by ``factor``, which is 0 or more."""

    fin: str
    size: str
    factor: float
    # So that ``asdict``, and with it an environment's ``spec.to_json()``, can be read back.
    kind: str = field(default="FinScaled", init=False, repr=False)

    def __post_init__(self) -> None:
        one_of("fin", self.fin, FINS)
        one_of("size", self.size, SIZES)
        factor = finite_array(f"damage factor of {self.fin}:{self.size}", self.factor, (), 0.0)
        object.__setattr__(self, "factor", float(factor))

    def apply(self, morphology: Morphology) -> Morphology:
        """Return the body with that size scaled; its range is not left.

        A silently clipped fault would be another one than was asked for.
        """
        name = f"{self.fin}.{self.size}"
        index = next(i for i, dimension in enumerate(DIMENSIONS) if dimension.name == name)
        sizes = morphology.to_array().tolist()  # plain numbers overflow without a warning
        sizes[index] *= self.factor
        maximum = DIMENSIONS[index].maximum
        if sizes[index] > maximum:
            raise InvalidArgumentError(
                f"damage {self} would make {name} {sizes[index]:g}; it must lie in [0, {maximum:g}]"
            )
        return Morphology.from_array(sizes)

    def __str__(self) -> str:
        return f"{self.fin}:{self.size}={self.factor!r}"


@dataclass(frozen=True)
class FinMissing:
    """A fin is gone: all three of its sizes are zero. Its servo turns on, moving nothing."""

    fin: str
    kind: str = field(default="FinMissing", init=False, repr=False)

    def __post_init__(self) -> None:
        one_of("fin", self.fin, FINS)

    def apply(self, morphology: Morphology) -> Morphology:
        """Return the body without that fin."""
        return Morphology.coerce({**morphology.to_dict(), self.fin: (0.0, 0.0, 0.0)})

    def __str__(self) -> str:
        return f"{self.fin}:missing"


Fault = FinScaled | FinMissing
SCALED = 0.2, 0.9  # of what a size was, where chance breaks it
_KINDS: dict[str, Any] = {kind.__name__: kind for kind in (FinScaled, FinMissing)}


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
        ``to_list`` or ``dataclasses.asdict`` wrote it; a list or tuple joins any of these.
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
            case FinScaled() | FinMissing():
                return cls((value,))
            case {"faults": list() | tuple() as faults, **others} if not others:
                return cls._coerce(faults)
            case Mapping():
                return cls((_fault_from_dict(value),))
            case list() | tuple():
                return cls(tuple(chain.from_iterable(map(cls._coerce, value))))
        wanted = "text such as 'left_pectoral:length=0.5', a Damage, or a list"
        raise InvalidArgumentError(f"damage must be {wanted}; got {brief(value)}")

    @classmethod
    def random(cls, rng: np.random.Generator) -> Self:
        """Return what may happen at sea: one fin or two, equally likely, each with one fault.

        A fin is missing one time in four; else its length, width or thickness is 0.2 to 0.9 of what
        it was, uniformly.

        Examples
        --------
        >>> len(Damage.random(np.random.default_rng(0))) in (1, 2)
        True
        """
        fins = rng.permutation(FINS)[: rng.integers(1, 3)].tolist()
        faults: list[Fault] = []
        for fin in fins:
            missing, size, factor = rng.random() < 0.25, rng.choice(SIZES), rng.uniform(*SCALED)
            faults.append(FinMissing(fin) if missing else FinScaled(fin, str(size), factor))
        return cls(tuple(faults))

    def apply(self, morphology: Morphology) -> Morphology:
        """Return the body with every fault, one after another."""
        if not isinstance(morphology, Morphology):
            raise InvalidArgumentError(
                f"damage is applied to a Morphology; got {brief(morphology)}"
            )
        for fault in self.faults:
            morphology = fault.apply(morphology)
        return morphology

    def in_words(self, morphology: Morphology) -> str:
        """Return what it does to a body, as :func:`change_in_words` says it.

        Examples
        --------
        >>> Damage.parse("left_pectoral:length=0.5").in_words(Morphology.nominal())
        'left flipper: half its length, 0.80 where it was 1.60'
        """
        return change_in_words(morphology, self.apply(morphology))

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
    fin, colon, what = (part.strip() for part in text.partition(":"))
    if not colon or not what:
        raise InvalidArgumentError(
            "damage must be written fin:word=number, as left_pectoral:length=0.5 or "
            f"caudal:missing; got {brief(text.strip())}"
        )
    word, equals, digits = (part.strip() for part in what.partition("="))
    one_of("damage fin", fin, FINS)
    one_of("damage", word, (*SIZES, "missing"))
    damage, number = f"damage {fin}:{word}", None
    if equals:
        try:
            number = float(digits)
        except ValueError:
            got = brief(digits)
            raise InvalidArgumentError(f"{damage} needs a number after '='; got {got}") from None
    if word == "missing":
        if number is not None:
            raise InvalidArgumentError(f"{damage} takes no number; got {number:g}")
        return FinMissing(fin)
    if number is None:
        raise InvalidArgumentError(f"{damage} needs a factor, for example {fin}:{word}=0.5")
    return FinScaled(fin, word, number)


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
