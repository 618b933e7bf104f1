"""What a fin can suffer."""

from __future__ import annotations

from dataclasses import dataclass, replace

from aquafish_gym.damage.effect import Effect
from aquafish_gym.damage.fault import Fault, named, set_number
from aquafish_gym.morphology import DIMENSIONS, FIN_WORDS, FINS, SIZES, Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, one_of


@dataclass(frozen=True)
class OfFin(Fault):
    """A fault of a fin or its servo."""

    fin: str

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("fin", self.fin, FINS)

    @property
    def index(self) -> int:
        """Of the fin."""
        return FINS.index(self.fin)

    @property
    def name(self) -> str:
        """Of the fin, for people."""
        return FIN_WORDS[self.fin]


class OfSizes(OfFin):
    """A fault that is seen: it changes a fin's sizes."""

    @property
    def words(self) -> str:
        """Nothing: the body that is left says it."""
        return ""


@dataclass(frozen=True)
class FinScaled(OfSizes):
    """A fin's length, width or thickness is multiplied by ``factor``, which is 0 or more."""

    size: str
    factor: float
    kind: str = named("FinScaled")

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("size", self.size, SIZES)
        set_number(self, "factor", 0.0, of=f"factor of {self.fin}:{self.size}")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.fin}:{self.size}={self.factor!r}"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that size scaled; its range is not left.

        A silently clipped fault would be another one than was asked for.
        """
        name = f"{self.fin}.{self.size}"
        index = next(i for i, dimension in enumerate(DIMENSIONS) if dimension.name == name)
        sizes = robot.body.to_array().tolist()  # plain numbers overflow without a warning
        sizes[index] *= self.factor
        maximum = DIMENSIONS[index].maximum
        if sizes[index] > maximum:
            raise InvalidArgumentError(
                f"damage {self} would make {name} {sizes[index]:g}; it must lie in [0, {maximum:g}]"
            )
        return replace(robot, body=Morphology.from_array(sizes))


@dataclass(frozen=True)
class FinMissing(OfSizes):
    """A fin is gone: all three of its sizes are zero. Its servo turns on, moving nothing."""

    kind: str = named("FinMissing")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.fin}:missing"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot without that fin."""
        body = Morphology.coerce({**robot.body.to_dict(), self.fin: (0.0, 0.0, 0.0)})
        return replace(robot, body=body)


@dataclass(frozen=True)
class FinEntangled(OfSizes):
    """Something hangs on a fin: its width grows by ``share`` of what it lacks to its maximum."""

    share: float
    kind: str = named("FinEntangled")

    def __post_init__(self) -> None:
        super().__post_init__()
        set_number(self, "share", 0.0, 1.0, of=f"share of {self.fin}:entangled")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.fin}:entangled={self.share!r}"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that fin wider."""
        names = [dimension.name for dimension in DIMENSIONS]
        index, sizes = names.index(f"{self.fin}.width"), robot.body.to_array().tolist()
        sizes[index] += self.share * (DIMENSIONS[index].maximum - sizes[index])
        return replace(robot, body=Morphology.from_array(sizes))
