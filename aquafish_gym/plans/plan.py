"""A body plan: a hull, and the fins on it. What differs from fish to fish is stated here alone.

Axes are the body's: x to the right, y forward along the hull, z up; the origin is the hull's
centre. A unit of length is 5 cm and water has density 1.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    instance,
    integer,
    one_of,
    parse_json,
    sequence,
)

Point = tuple[float, float, float]

#: In the order in which faults and words name them.
SIZES: tuple[str, ...] = ("length", "width", "thickness")
_IN_FRAME = ("width", "length", "thickness")  # in the order of a fin's axes
#: The step in which a genome counts sizes, units (Sec. 3.2 of the paper: 6 bits for 2 units).
QUANTUM = 1 / 32
#: How far from the hull's surface a hinge may be, in the hull's radii; a plate bridges the gap.
LONGEST_MOUNT = 1.0
_LARGEST = 100.0  # units, of a hull or a fin
_MOST_FINS = 16
_ROUNDING = 1e-9
_NAME = re.compile(r"[a-z][a-z0-9_]*")
_WORD = re.compile(r"[\w' -]*")
# What damage, files, a Morphology, inference and pictures call by these names is no fin.
_TAKEN = re.compile(
    r"(act|obs).*|gyro(_[xyz])?|(up|north)_[xyz]|random|none|time|trial"
    r"|sizes|plan|nominal|coerce|(from|to)_.*|lag|body|.*_(mount|break)"
)


class Sizes(NamedTuple):
    """The sizes of a fin, units: along its direction, along its hinge, and across both."""

    length: float
    width: float
    thickness: float


class Dimension(NamedTuple):
    """One of a body's variable sizes.

    ``axis`` 0, 1, 2 is x, y (along the body) and z (vertical) for a fin that lies along the body's
    axes, and ``size`` its meaning for this fin: where flippers lie flat, z is their thickness;
    where a tail is upright, z is its width.

    Examples
    --------
    >>> from aquafish_gym.plans import AQUAFISH
    >>> AQUAFISH.dimensions[1].name, AQUAFISH.dimensions[1].maximum, AQUAFISH.dimensions[1].nominal
    ('left_pectoral.length', 2.0, 1.6)
    """

    fin: str
    axis: int
    size: str
    maximum: float
    nominal: float
    bits: int

    @property
    def name(self) -> str:
        """For example ``left_pectoral.length``."""
        return f"{self.fin}.{self.size}"


@dataclass(frozen=True)
class Hull:
    """A capsule along y: a cylinder with a half sphere at each end.

    Sizes that are no capsule's raise InvalidArgumentError.

    Examples
    --------
    >>> Hull(length=4.0, radius=0.5).distance(np.array([[0.75, 0.0, 0.0], [0.0, -2.5, 0.0]]))
    array([0.25, 0.5 ])
    """

    length: float
    """With both ends, units."""
    radius: float
    """Units; at most half of the length."""

    def __post_init__(self) -> None:
        for name in ("length", "radius"):
            value = finite_array(f"hull.{name}", getattr(self, name), (), 0.01, _LARGEST, "units")
            object.__setattr__(self, name, float(value))
        if 2 * self.radius > self.length:
            raise InvalidArgumentError(
                f"hull.radius must be at most half of the length, {self.length / 2:g}; "
                f"got {self.radius:g}"
            )

    def distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far points (..., 3) lie outside of the surface, units; negative inside."""
        x, y, z = np.moveaxis(points, -1, 0)
        beyond = np.maximum(np.abs(y) - (self.length / 2 - self.radius), 0.0)
        return np.asarray(np.sqrt(x * x + beyond * beyond + z * z) - self.radius)


@dataclass(frozen=True)
class FinPlan:
    """A fin: a box on a hinge that a servo turns.

    What is no fin raises InvalidArgumentError, which names the field.

    Examples
    --------
    >>> tail = FinPlan(
    ...     "tail", hinge=(0, -2, 0), axis=(0, 0, 1), direction=(0, -1, 0), drive="sweeps",
    ...     speed=1.0, sweep=0.5, nominal=Sizes(1.4, 0.6, 0.4), largest=Sizes(2.0, 1.0, 0.5),
    ... )
    >>> BodyPlan("minnow", Hull(4.0, 0.5), (tail,)).dimensions[0].name
    'tail.thickness'
    """

    name: str
    """What damage calls it, such as ``left_pectoral``: lower-case letters, digits and ``_``."""
    hinge: Point
    """The middle of its hinge in body axes, units."""
    axis: Point
    """The hinge's direction, about which a positive angle turns the fin; its width is along it."""
    direction: Point
    """From the hinge to the fin's end at angle 0; at right angles to ``axis``."""
    drive: Literal["turns", "sweeps"]
    """A servo that ``turns`` goes round at a speed either way. One that ``sweeps`` swings the fin
    to and fro: its angle is ``sweep`` times the sine of a phase, which goes on at a frequency."""
    speed: float
    """The largest speed, rev/s, of a servo that turns, or the highest frequency, Hz."""
    nominal: Sizes
    """The sizes of the whole fish, units."""
    largest: Sizes
    """The largest sizes that a fin may have, units."""
    sweep: float = 0.0
    """How far the fin sweeps to each side, rad; only for one that ``sweeps``."""
    word: str = ""
    """What people call it, such as "left flipper", in letters; by default the name."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not _NAME.fullmatch(self.name):
            raise InvalidArgumentError(
                "a fin's name must be lower-case letters, digits and _, such as left_pectoral; "
                f"got {brief(self.name)}"
            )
        if _TAKEN.fullmatch(self.name):
            raise InvalidArgumentError(
                f"a fin's name must not be that of something else; got {brief(self.name)}"
            )
        at = f"fin {self.name}: "
        one_of(f"{at}drive", self.drive, ("turns", "sweeps"))
        for name in ("hinge", "axis", "direction"):
            point = finite_array(f"{at}{name}", getattr(self, name), (3,), -_LARGEST, _LARGEST)
            if name != "hinge":
                norm = float(np.linalg.norm(point))
                if norm == 0.0:
                    raise InvalidArgumentError(f"{at}{name} must have a length; got {brief(point)}")
                if abs(norm - 1.0) > 1e-15:  # else a plan would not be read back to the bit
                    point = point / norm
            object.__setattr__(self, name, tuple(point.tolist()))
        if abs(np.dot(self.axis, self.direction)) > _ROUNDING:
            raise InvalidArgumentError(
                f"{at}direction must be at right angles to axis; got {self.direction} and "
                f"{self.axis}"
            )
        least, widest = (0.0, 0.0) if self.turns else (0.01, math.pi / 2)
        for name, low, high, unit in (("speed", 0.01, 10.0, ""), ("sweep", least, widest, "rad")):
            number = finite_array(f"{at}{name}", getattr(self, name), (), low, high, unit)
            object.__setattr__(self, name, float(number))
        word = instance(f"{at}word", self.word, str).strip() or self.name.replace("_", " ")
        if not _WORD.fullmatch(word):
            raise InvalidArgumentError(
                f"{at}word must be letters, digits, spaces, - and '; got {brief(word)}"
            )
        object.__setattr__(self, "word", word)
        largest = finite_array(f"{at}largest", self.largest, (3,), QUANTUM, _LARGEST, "units")
        nominal = finite_array(f"{at}nominal", self.nominal, (3,), 0.0, largest, "units")
        object.__setattr__(self, "largest", Sizes(*largest.tolist()))
        object.__setattr__(self, "nominal", Sizes(*nominal.tolist()))

    @property
    def turns(self) -> bool:
        """Whether its servo goes round, at a speed of either sign."""
        return self.drive == "turns"

    @property
    def unit(self) -> str:
        """The unit of its command."""
        return "rev/s" if self.turns else "Hz"

    @cached_property
    def frame(self) -> tuple[Point, Point, Point]:
        """The hinge frame's axes in body axes: width, length (towards the hull), and normal."""
        width = np.array(self.axis)
        length = -np.array(self.direction)
        across = np.cross(width, length)
        rows = [tuple((row + 0.0).tolist()) for row in (width, length, across)]  # no -0.0
        return (rows[0], rows[1], rows[2])

    @property
    def is_along_axes(self) -> bool:
        """Whether its hinge frame's axes are the body's, in any order."""
        return all(x in (-1.0, 0.0, 1.0) for row in self.frame for x in row)

    @cached_property
    def attitude(self) -> tuple[float, float, float, float]:
        """The quaternion (x, y, z, w) that turns the body's axes to the hinge frame's."""
        (a, d, g), (b, e, h), (c, f, i) = self.frame
        # Bar-Itzhack (2000): it is this matrix's eigenvector of the largest eigenvalue.
        matrix = [
            [a - e - i, d + b, g + c, h - f],
            [d + b, e - a - i, h + f, c - g],
            [g + c, h + f, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
        x, y, z, w = np.linalg.eigh(matrix)[1][:, -1].tolist()
        return (x, y, z, w)

    @cached_property
    def order(self) -> tuple[str, str, str]:
        """Its sizes in the order in which a morphology has them.

        They are those along x, y and z for a fin along the body's axes, else width, length and
        thickness.
        """
        if not self.is_along_axes:
            return _IN_FRAME
        along = [int(np.argmax(np.abs(row))) for row in self.frame]
        first, second, third = (_IN_FRAME[along.index(axis)] for axis in range(3))
        return (first, second, third)


@dataclass(frozen=True)
class BodyPlan:
    """A hull and its fins.

    Raises
    ------
    InvalidArgumentError
        If there is no fin, a fin's hinge is off the hull, a whole fin would swing into the hull, or
        two fins have one name.

    Examples
    --------
    >>> from aquafish_gym.plans import AQUAFISH
    >>> AQUAFISH.names
    ('left_pectoral', 'right_pectoral', 'caudal')
    >>> BodyPlan.from_json(AQUAFISH.to_json()) == AQUAFISH
    True
    """

    name: str
    """What files and reports call it, such as ``aquafish``."""
    hull: Hull
    fins: tuple[FinPlan, ...]
    """One to sixteen; commands, observations and sizes follow their order."""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.replace("-", "_").isidentifier():
            raise InvalidArgumentError(
                f"a plan's name must be letters, digits, - and _; got {brief(self.name)}"
            )
        instance("hull", self.hull, Hull)
        object.__setattr__(self, "fins", tuple(sequence("fins", self.fins)))
        integer("the number of fins", len(self.fins), 1, _MOST_FINS)
        for fin in self.fins:
            instance("a fin", fin, FinPlan)
            self._check_fin(fin)
        for what, each in (("names", self.names), ("words", [fin.word for fin in self.fins])):
            for one, other in pairwise(sorted(each)):
                if one == other:
                    raise InvalidArgumentError(f"fins must have different {what}; two are {one}")

    def _check_fin(self, fin: FinPlan) -> None:
        gap = float(self.hull.distance(np.array(fin.hinge)))
        most = LONGEST_MOUNT * self.hull.radius
        if not -_ROUNDING <= gap <= most + _ROUNDING:
            raise InvalidArgumentError(
                f"fin {fin.name}: hinge must lie on the hull or up to {most:g} units from it; got "
                f"{fin.hinge}, {abs(gap):.3g} units {'outside' if gap > 0 else 'inside'}"
            )
        swept = _swept(fin)
        inside = swept[self.hull.distance(swept) < -_ROUNDING]
        if len(inside):
            raise InvalidArgumentError(
                f"fin {fin.name}: it must not swing into the hull; with its nominal sizes it "
                f"does at {tuple(np.round(inside[0], 2).tolist())}"
            )

    def __repr__(self) -> str:
        return f"BodyPlan({self.name!r}: {', '.join(self.names)})"

    def __hash__(self) -> int:  # kernels are kept by plan and asked for in each step
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.name, self.hull, self.fins))

    def __getstate__(self) -> dict[str, Any]:  # another process hashes texts otherwise
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the fins."""
        return tuple(fin.name for fin in self.fins)

    @cached_property
    def words(self) -> dict[str, str]:
        """What people call each fin, by its name."""
        return {fin.name: fin.word for fin in self.fins}

    @cached_property
    def dimensions(self) -> tuple[Dimension, ...]:
        """The body's sizes: their order, ranges, nominal values and bits in a genome."""
        found = []
        for fin in self.fins:
            for axis, size in enumerate(fin.order):
                most = getattr(fin.largest, size)
                bits = max(1, math.ceil(math.log2(most / QUANTUM)))
                nominal = getattr(fin.nominal, size)
                found.append(Dimension(fin.name, axis, size, most, nominal, bits))
        return tuple(found)

    @cached_property
    def columns(self) -> NDArray[np.intp]:
        """The places (F, 3) of each fin's width, length and thickness among a body's sizes."""
        places = [[fin.order.index(size) for size in _IN_FRAME] for fin in self.fins]
        return 3 * np.arange(len(self.fins))[:, None] + places

    @cached_property
    def maxima(self) -> NDArray[np.float64]:
        """The largest sizes (S,) in the order of ``dimensions``, units."""
        return _constant([d.maximum for d in self.dimensions])

    @cached_property
    def nominal(self) -> NDArray[np.float64]:
        """The sizes (S,) of the whole fish in the order of ``dimensions``, units."""
        return _constant([d.nominal for d in self.dimensions])

    @cached_property
    def command_low(self) -> NDArray[np.float64]:
        """The lowest command (F,) of each servo, rev/s or Hz."""
        return _constant([-fin.speed if fin.turns else 0.0 for fin in self.fins])

    @cached_property
    def command_high(self) -> NDArray[np.float64]:
        """The highest command (F,) of each servo, rev/s or Hz."""
        return _constant([fin.speed for fin in self.fins])

    @cached_property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """The numbers of the fins, two that mirror each other in one group; pairs come first."""
        left = dict(enumerate(self.fins))
        pairs: list[tuple[int, ...]] = []
        for i, fin in enumerate(self.fins):
            x, y, z = fin.hinge
            mirrored = [j for j in left if j > i and left[j].hinge == (-x, y, z)]
            if i in left and x != 0.0 and mirrored:
                pairs.append((i, mirrored[0]))
                del left[i], left[mirrored[0]]
        return (*pairs, *((i,) for i in left))

    def to_json(self) -> str:
        """Return one line of JSON that ``from_json`` reads back exactly."""
        return json.dumps(self.to_dict(), allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the plan of the JSON of ``to_json``; anything else is refused.

        Sizes are lists of length, width and thickness, in units.
        """
        return cls.from_dict(parse_json("plan", text))

    def to_dict(self) -> dict[str, Any]:
        """Return what ``from_dict`` reads back exactly, ready for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, value: object) -> Self:
        """Return the plan of the fields of ``to_dict``; anything else is refused."""
        document = _object("plan", value, cls)
        hull = Hull(**_object("plan.hull", document["hull"], Hull))
        fins = sequence("plan.fins", document["fins"])
        each = [FinPlan(**_object("a fin of plan.fins", fin, FinPlan)) for fin in fins]
        return cls(document["name"], hull, tuple(each))


def check_same_plan(argument: str, plan: BodyPlan, wanted: BodyPlan) -> None:
    """Raise InvalidArgumentError if an argument is of another plan than the robots."""
    if plan != wanted:
        got = f"the plan {plan.name}" if plan.name != wanted.name else "another plan of that name"
        raise InvalidArgumentError(
            f"{argument} must be of the plan {wanted.name}; got one of {got}"
        )


def _object(argument: str, value: object, kind: type) -> dict[str, Any]:
    """Return an object with the fields of a dataclass; those with a default may be missing."""
    names = {each.name: each for each in fields(kind)}
    if not isinstance(value, Mapping):
        raise InvalidArgumentError(f"{argument} must be an object; got {brief(value)}")
    for name in value:
        one_of(f"a key of {argument}", name, names)
    missing = [n for n, each in names.items() if n not in value and each.default is MISSING]
    if missing:
        raise InvalidArgumentError(f"{argument} must have {', '.join(missing)}; got {brief(value)}")
    return dict(value)


def _constant(values: list[float]) -> NDArray[np.float64]:
    array = np.array(values)
    array.setflags(write=False)
    return array


def _swept(fin: FinPlan) -> NDArray[np.float64]:
    """Return points (N, 3) of a whole fin's middle plane wherever it swings."""
    width, length, normal = np.array(fin.frame)
    reach = math.pi if fin.turns else fin.sweep
    angle, share, side = np.meshgrid(
        np.linspace(-reach, reach, 25), np.linspace(0.0, 1.0, 9), (-0.5, 0.0, 0.5), indexing="ij"
    )
    along = -(np.cos(angle)[..., None] * length + np.sin(angle)[..., None] * normal)
    ahead = (share * fin.nominal.length)[..., None] * along
    beside = (side * fin.nominal.width)[..., None] * width
    return np.reshape(fin.hinge + ahead + beside, (-1, 3))
