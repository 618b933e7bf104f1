"""What a servo can suffer. Its fin is whole, and does not do what it is told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquafish_gym.damage.effect import Effect
from aquafish_gym.damage.fault import named, set_number
from aquafish_gym.damage.fins import OfFin
from aquafish_gym.utils.validation import InvalidArgumentError

MOST_GAIN = 2.0


@dataclass(frozen=True)
class ServoGain(OfFin):
    """A servo turns at ``gain`` times what it should: weak below 1, reversed at -1."""

    gain: float
    kind: str = named("ServoGain")

    def __post_init__(self) -> None:
        super().__post_init__()
        set_number(self, "gain", -MOST_GAIN, MOST_GAIN, of=f"gain of {self.fin}:weak")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.fin}:reversed" if self.gain == -1 else f"{self.fin}:weak={self.gain!r}"

    @property
    def words(self) -> str:
        """See :class:`Fault`."""
        how = "the other way" if self.gain == -1 else f"at {self.gain:g} times what it is told"
        return f"servo of the {self.name}: turns {how}"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that servo."""
        return robot.having("gains", self.index, robot.gains[self.index] * self.gain)


@dataclass(frozen=True)
class ServoSeized(OfFin):
    """A servo does not turn any more. Its fin stands where it stood, or at ``angle``, in rad.

    An angle can be given of one that is seized from the beginning, for it cannot get there later.
    The tail's is the phase of its sweep.
    """

    angle: float | None = None
    kind: str = named("ServoSeized")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.angle is None:
            return
        set_number(self, "angle", -np.pi, np.pi, "rad", of=f"angle of {self.fin}:seized")
        if self.onset != 0.0:
            raise InvalidArgumentError(
                f"damage {self.fin}:seized has an angle only from the beginning; got the angle "
                f"{self.angle:g} with the onset {self.onset}"
            )

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.fin}:seized" + ("" if self.angle is None else f"={self.angle!r}")

    @property
    def words(self) -> str:
        """See :class:`Fault`."""
        where = "" if self.angle is None else f" at {self.angle:.3g} rad"
        return f"servo of the {self.name}: seized{where}"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that servo."""
        still = robot.having("gains", self.index, 0.0)
        return still if self.angle is None else still.having("stands", self.index, self.angle)


@dataclass(frozen=True)
class ServoDead(OfFin):
    """A servo has no power: it does not turn. Its fin stands anywhere when an episode begins."""

    kind: str = named("ServoDead")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.fin}:dead"

    @property
    def words(self) -> str:
        """See :class:`Fault`."""
        return f"servo of the {self.name}: dead"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that servo."""
        return robot.having("gains", self.index, 0.0).having("stands", self.index, "anywhere")
