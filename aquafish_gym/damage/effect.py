"""What damage makes of a robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology

Triple = tuple[float, float, float]
CHANNELS = tuple(f"{sense}_{axis}" for sense in ("up", "north", "gyro") for axis in "xyz")


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
