"""What can break, one thing at a time: a fin, the servo that turns it, or the sensor.

Each fault has an ``onset`` and a ``duration``, in seconds of an episode. When it ends, what was
broken is whole again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import DIMENSIONS, FINS, SIZES, Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, one_of

Triple = tuple[float, float, float]
CHANNELS = tuple(f"{sense}_{axis}" for sense in ("up", "north", "gyro") for axis in "xyz")
LONGEST = 1e6  # s
MOST_SPIN = 100.0  # rad/s, of the gyroscope's noise and bias
MOST_GAIN = 2.0


@dataclass(frozen=True)
class Effect:
    """What a robot is at a moment: its body, what its servos do and what its sensor says.

    Attributes
    ----------
    faults
        How many there are.
    gains
        The left, right and caudal servo's speeds are gain times command.
    stands
        Where a servo that does not turn stands when an episode begins: an angle in rad, "anywhere",
        or None for where it is put.
    noise
        Standard deviation of the gyroscope's noise in each observation, rad/s.
    biases
        What is added to each of ``CHANNELS``.
    stuck, dropped
        Whether each of ``CHANNELS`` repeats what it said when that began, or says 0.
    """

    body: Morphology
    faults: int = 0
    gains: Triple = (1.0, 1.0, 1.0)
    stands: tuple[float | str | None, ...] = (None,) * 3
    noise: float = 0.0
    biases: tuple[float, ...] = (0.0,) * len(CHANNELS)
    stuck: tuple[bool, ...] = (False,) * len(CHANNELS)
    dropped: tuple[bool, ...] = (False,) * len(CHANNELS)

    @cached_property
    def truth(self) -> dict[str, NDArray[Any]]:
        """What damage makes of the robot, in arrays: what ``info`` says and no observation."""
        return {
            "faults": np.array(self.faults),
            "morphology": self.body.to_array(),
            "servo_gain": np.array(self.gains),
            "sensor_noise": np.array(self.noise),
            "sensor_bias": np.array(self.biases),
            "sensor_lost": np.array(self.stuck) | np.array(self.dropped),
        }

    def having(self, name: str, index: int, value: Any) -> Effect:
        """Return the robot with one entry of one of its rows replaced."""
        row = getattr(self, name)
        return replace(self, **{name: (*row[:index], value, *row[index + 1 :])})  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Something that breaks, and when.

    Attributes
    ----------
    onset
        In s; or the earliest and the latest, between which chance decides.
    duration
        In s; None is for good.
    """

    onset: float | tuple[float, float] = 0.0
    duration: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.onset, list | tuple):
            row = finite_array("damage onset", self.onset, (2,), 0.0, LONGEST, "s")
            early, late = row.tolist()
            if early > late:
                raise InvalidArgumentError(
                    f"damage onset must be the earliest and the latest; got {early:g} and {late:g}"
                )
            object.__setattr__(self, "onset", (early, late))
        else:
            _number(self, "onset", 0.0, LONGEST, "s")
        if self.duration is not None:
            _number(self, "duration", 0.0, LONGEST, "s")

    @property
    def what(self) -> str:
        """What breaks, in text."""
        raise NotImplementedError

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with this fault."""
        raise NotImplementedError

    def drawn(self, rng: np.random.Generator) -> tuple[Fault, ...]:
        """Return what it comes to: itself, unless it leaves something to chance."""
        return (self.at(rng),)

    def at(self, rng: np.random.Generator) -> Self:
        """Return it with an onset that chance has decided."""
        if not isinstance(self.onset, tuple):
            return self
        return replace(self, onset=float(rng.uniform(*self.onset)))

    @property
    def is_random(self) -> bool:
        """Whether it leaves something to chance."""
        return isinstance(self.onset, tuple)

    def holds(self, seconds: float) -> bool:
        """Whether it is there at a moment of an episode; its onset must be decided."""
        begin, end = self.span
        return begin <= seconds < end

    @property
    def span(self) -> tuple[float, float]:
        """When it begins and when it ends, in s."""
        if isinstance(self.onset, tuple):
            raise InvalidArgumentError(f"damage {self} leaves its onset to chance: draw it first")
        return self.onset, self.onset + (np.inf if self.duration is None else self.duration)

    def __str__(self) -> str:
        onset, lasts = self.onset, "" if self.duration is None else f"+{self.duration!r}"
        if isinstance(onset, tuple):
            return f"{self.what}@{onset[0]!r}-{onset[1]!r}{lasts}"
        return self.what + (f"@{onset!r}{lasts}" if onset or lasts else "")


def _number(
    fault: Fault, name: str, low: float, high: float = np.inf, unit: str = "", of: str = ""
) -> None:
    value = finite_array(f"damage {of or name}", getattr(fault, name), (), low, high, unit)
    object.__setattr__(fault, name, float(value))


def named(name: str) -> Any:
    """Return a field that says what kind of fault it is.

    So that ``asdict``, and with it an environment's ``spec.to_json()``, can be read back.
    """
    return field(default=name, init=False, repr=False)


@dataclass(frozen=True)
class _OfFin(Fault):
    fin: str

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("fin", self.fin, FINS)

    @property
    def index(self) -> int:
        """Of the fin."""
        return FINS.index(self.fin)


@dataclass(frozen=True)
class FinScaled(_OfFin):
    """A fin's length, width or thickness is multiplied by ``factor``, which is 0 or more."""

    size: str
    factor: float
    kind: str = named("FinScaled")

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("size", self.size, SIZES)
        _number(self, "factor", 0.0, of=f"factor of {self.fin}:{self.size}")

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
class FinMissing(_OfFin):
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
class FinEntangled(_OfFin):
    """Something hangs on a fin: its width grows by ``share`` of what it lacks to its maximum."""

    share: float
    kind: str = named("FinEntangled")

    def __post_init__(self) -> None:
        super().__post_init__()
        _number(self, "share", 0.0, 1.0, of=f"share of {self.fin}:entangled")

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


@dataclass(frozen=True)
class ServoGain(_OfFin):
    """A servo turns at ``gain`` times what it should: weak below 1, reversed at -1."""

    gain: float
    kind: str = named("ServoGain")

    def __post_init__(self) -> None:
        super().__post_init__()
        _number(self, "gain", -MOST_GAIN, MOST_GAIN, of=f"gain of {self.fin}:weak")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.fin}:reversed" if self.gain == -1 else f"{self.fin}:weak={self.gain!r}"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that servo."""
        return robot.having("gains", self.index, robot.gains[self.index] * self.gain)


@dataclass(frozen=True)
class ServoSeized(_OfFin):
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
        _number(self, "angle", -np.pi, np.pi, "rad", of=f"angle of {self.fin}:seized")
        if self.onset != 0.0:
            raise InvalidArgumentError(
                f"damage {self.fin}:seized has an angle only from the beginning; got the angle "
                f"{self.angle:g} with the onset {self.onset}"
            )

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.fin}:seized" + ("" if self.angle is None else f"={self.angle!r}")

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that servo."""
        still = robot.having("gains", self.index, 0.0)
        return still if self.angle is None else still.having("stands", self.index, self.angle)


@dataclass(frozen=True)
class ServoDead(_OfFin):
    """A servo has no power: it does not turn. Its fin stands anywhere when an episode begins."""

    kind: str = named("ServoDead")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.fin}:dead"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that servo."""
        return robot.having("gains", self.index, 0.0).having("stands", self.index, "anywhere")


@dataclass(frozen=True)
class GyroNoise(Fault):
    """The gyroscope is noisy: ``deviation`` in rad/s, independent in each observation and axis."""

    deviation: float
    kind: str = named("GyroNoise")

    def __post_init__(self) -> None:
        super().__post_init__()
        _number(self, "deviation", 0.0, MOST_SPIN, "rad/s", of="gyro:noise")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"gyro:noise={self.deviation!r}"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that noise, and what it had."""
        return replace(robot, noise=float(np.hypot(robot.noise, self.deviation)))


@dataclass(frozen=True)
class _OfChannel(Fault):
    channel: str

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("channel", self.channel, CHANNELS)

    @property
    def index(self) -> int:
        """Of the channel."""
        return CHANNELS.index(self.channel)


@dataclass(frozen=True)
class ChannelBias(_OfChannel):
    """A channel of the sensor says ``by`` too much: rad/s of the gyroscope, else without a unit."""

    by: float
    kind: str = named("ChannelBias")

    def __post_init__(self) -> None:
        super().__post_init__()
        most = MOST_SPIN if self.channel.startswith("gyro") else 2.0
        _number(self, "by", -most, most, of=f"{self.channel}:bias")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.channel}:bias={self.by!r}"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that bias, and what it had."""
        return robot.having("biases", self.index, robot.biases[self.index] + self.by)


@dataclass(frozen=True)
class ChannelStuck(_OfChannel):
    """A channel of the sensor repeats what it said when that began."""

    kind: str = named("ChannelStuck")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.channel}:stuck"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that channel."""
        return robot.having("stuck", self.index, True)


@dataclass(frozen=True)
class ChannelDropped(_OfChannel):
    """A channel of the sensor says nothing but 0."""

    kind: str = named("ChannelDropped")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.channel}:dropped"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that channel."""
        return robot.having("dropped", self.index, True)


class Word(NamedTuple):
    """How a fault is made of a part and, if it takes one, a number."""

    make: Callable[..., Fault]
    takes: bool | None = False  #: None is if it is given.


def _scaled(size: str, fin: str, factor: float) -> Fault:
    return FinScaled(fin, size, factor)


_FIN_WORDS = {size: Word(partial(_scaled, size), True) for size in SIZES} | {
    "missing": Word(FinMissing),
    "entangled": Word(FinEntangled, True),
    "weak": Word(ServoGain, True),
    "reversed": Word(lambda fin: ServoGain(fin, -1.0)),
    "seized": Word(ServoSeized, None),
    "dead": Word(ServoDead),
}
_CHANNEL_WORDS = {
    "bias": Word(ChannelBias, True),
    "stuck": Word(ChannelStuck),
    "dropped": Word(ChannelDropped),
}
#: What can be said of each part.
WORDS: dict[str, dict[str, Word]] = {
    **dict.fromkeys(FINS, _FIN_WORDS),
    "gyro": {"noise": Word(lambda _part, deviation: GyroNoise(deviation), True)},
    **dict.fromkeys(CHANNELS, _CHANNEL_WORDS),
}
