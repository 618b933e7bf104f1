"""The robot's variable body: nine fin dimensions (Sec. 3.1 of the paper)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    UnknownNameError,
    brief,
    finite_array,
    one_of,
    parse_json,
)


class Dimension(NamedTuple):
    """One of the nine morphological variables.

    ``axis`` 0, 1, 2 is x, y (along the body) and z (vertical), and ``size`` its meaning for this
    fin: the pectoral flippers lie flat, so z is their thickness; the caudal fin is upright, so z is
    its width.

    Examples
    --------
    >>> DIMENSIONS[1].name, DIMENSIONS[1].maximum, DIMENSIONS[1].nominal
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


# The only statement of names, order, ranges and genome bits. Ranges: Sec. 3.1, [0, maximum] each,
# in units of 5 cm. Bits: Sec. 3.2 gives 5, 6, 4 for the pectorals; for the caudal fin only the
# total of 15, which the same quantum splits 4, 6, 5. Nominal sizes: Fig. 1 (flippers 2 x 8 cm,
# tail 7 cm long, 3 cm tall, 2 cm thick); the flippers' thickness is not in the paper (assumed).
DIMENSIONS: tuple[Dimension, ...] = (
    Dimension("left_pectoral", 0, "width", 1.0, 0.4, 5),
    Dimension("left_pectoral", 1, "length", 2.0, 1.6, 6),
    Dimension("left_pectoral", 2, "thickness", 0.5, 0.1, 4),
    Dimension("right_pectoral", 0, "width", 1.0, 0.4, 5),
    Dimension("right_pectoral", 1, "length", 2.0, 1.6, 6),
    Dimension("right_pectoral", 2, "thickness", 0.5, 0.1, 4),
    Dimension("caudal", 0, "thickness", 0.5, 0.4, 4),
    Dimension("caudal", 1, "length", 2.0, 1.4, 6),
    Dimension("caudal", 2, "width", 1.0, 0.6, 5),
)
FINS: tuple[str, ...] = ("left_pectoral", "right_pectoral", "caudal")
# In the order in which faults and words name them.
SIZES: tuple[str, ...] = ("length", "width", "thickness")
MAXIMA: NDArray[np.float64] = np.array([d.maximum for d in DIMENSIONS])
MAXIMA.setflags(write=False)

#: What is said of a body that is none of ours.
OTHER_PLANS = (
    "; another body plan is not possible yet: use eea.Robot to infer any robot that you simulate "
    "(docs/howto/robot.md), or aquafish_gym.FaultWrapper to break any environment"
)

Size = tuple[float, float, float]


@dataclass(frozen=True)
class Morphology:
    """Three fins' (x, y, z) sizes in units of 5 cm; a size of 0 is legal.

    A size that is not finite or leaves its range in ``DIMENSIONS`` raises InvalidArgumentError.

    Examples
    --------
    >>> Morphology.nominal().caudal
    (0.4, 1.4, 0.6)
    """

    left_pectoral: Size
    right_pectoral: Size
    caudal: Size

    def __post_init__(self) -> None:
        for fin, most in zip(FINS, MAXIMA.reshape(3, 3), strict=True):
            size = finite_array(f"morphology.{fin}", getattr(self, fin), (3,), 0.0, most)
            object.__setattr__(self, fin, tuple(size.tolist()))

    @classmethod
    def nominal(cls) -> Self:
        """Return the undamaged prototype (Fig. 1)."""
        return cls.from_array([d.nominal for d in DIMENSIONS])

    @classmethod
    def from_array(cls, sizes: ArrayLike) -> Self:
        """Return the body of nine sizes in the order of ``DIMENSIONS``, shape (9,)."""
        array = finite_array("morphology", sizes, (9,), hint=OTHER_PLANS)
        return cls(*(tuple(array[3 * i : 3 * i + 3]) for i in range(3)))

    @classmethod
    def coerce(cls, value: MorphologyLike) -> Morphology:
        """Return the body of ``None`` (nominal), nine numbers, or a mapping from fins to sizes."""
        if value is None:
            return cls.nominal()
        if isinstance(value, Morphology):
            return value
        if isinstance(value, Mapping):
            try:
                given = {one_of("morphology fin", fin, FINS): size for fin, size in value.items()}
            except UnknownNameError as error:
                raise UnknownNameError(f"{error}{OTHER_PLANS}") from None
            return cls(**{**asdict(cls.nominal()), **given})
        return cls.from_array(value)

    def to_array(self) -> NDArray[np.float64]:
        """Return the nine sizes in the order of ``DIMENSIONS``, shape (9,)."""
        return np.array([*self.left_pectoral, *self.right_pectoral, *self.caudal])

    def to_dict(self) -> dict[str, list[float]]:
        """Return fin -> [x, y, z], ready for JSON."""
        return {fin: list(getattr(self, fin)) for fin in FINS}

    def to_json(self) -> str:
        """Return one line of JSON that ``from_json`` reads back exactly."""
        return json.dumps(self.to_dict(), allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Morphology:
        """Return the body of the JSON of ``to_json``; anything else is refused."""
        sizes: Any = parse_json("morphology", text)
        if not isinstance(sizes, dict) or sorted(sizes) != sorted(FINS):
            wanted = f"an object with the keys {', '.join(FINS)}"
            raise InvalidArgumentError(
                f"a morphology's JSON must be {wanted}; got {brief(sizes)}{OTHER_PLANS}"
            )
        return cls.coerce(sizes)


# What ``Morphology.coerce`` takes.
MorphologyLike = Morphology | Mapping[str, ArrayLike] | ArrayLike | None


FIN_WORDS = {"left_pectoral": "left flipper", "right_pectoral": "right flipper", "caudal": "tail"}
