"""What of the fish's table is broken of its sensors and servos, by the words of channels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.scenario import GYRO_CHANNELS
from aquafish_gym.utils.array_types import Rows

#: The index of the robot in a batch of one.
ONLY_ROBOT: Rows = np.zeros(1, np.intp)
_OF_SENSORS = ("bias", "stuck", "dropped", "scale", "delay", "hold")
_OF_SERVOS = ("delay", "hold")


def sensor_columns(columns: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return what is broken of the channels (n, C) of the IMU, given a scenario's columns (n, ...).

    Only the gyro's channels have noise.
    """
    found = {word: columns[f"sensor_{word}"] for word in _OF_SENSORS}
    noise = np.zeros(found["bias"].shape)
    noise[:, GYRO_CHANNELS] = columns["gyro_noise"][:, None]
    return {"noise": noise, **found}


def servo_columns(columns: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return how late and slow servos (n, S) are, s, given a scenario's columns (n, ...)."""
    return {word: columns[f"servo_{word}"] for word in _OF_SERVOS}
