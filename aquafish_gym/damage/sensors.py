"""What the inertial measurement unit can suffer."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aquafish_gym.damage.effect import CHANNELS, Effect
from aquafish_gym.damage.fault import Fault, named, set_number
from aquafish_gym.utils.validation import one_of

MOST_SPIN = 100.0  # rad/s, of the gyroscope's noise and bias


@dataclass(frozen=True)
class GyroNoise(Fault):
    """The gyroscope is noisy: ``deviation`` in rad/s, independent in each observation and axis."""

    deviation: float
    kind: str = named("GyroNoise")

    def __post_init__(self) -> None:
        super().__post_init__()
        set_number(self, "deviation", 0.0, MOST_SPIN, "rad/s", of="gyro:noise")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"gyro:noise={self.deviation!r}"

    @property
    def words(self) -> str:
        """See :class:`Fault`."""
        return f"gyro: noise of {self.deviation:g} rad/s"

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
        set_number(self, "by", -most, most, of=f"{self.channel}:bias")

    @property
    def what(self) -> str:
        """See :class:`Fault`."""
        return f"{self.channel}:bias={self.by!r}"

    @property
    def words(self) -> str:
        """See :class:`Fault`."""
        unit = " rad/s" if self.channel.startswith("gyro") else ""
        return (
            f"{self.channel}: says {abs(self.by):g}{unit} too {'much' if self.by > 0 else 'little'}"
        )

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

    @property
    def words(self) -> str:
        """See :class:`Fault`."""
        return f"{self.channel}: stuck"

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

    @property
    def words(self) -> str:
        """See :class:`Fault`."""
        return f"{self.channel}: says 0"

    def strike(self, robot: Effect) -> Effect:
        """Return the robot with that channel."""
        return robot.having("dropped", self.index, True)
