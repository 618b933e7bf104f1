"""The robot's observation: the channels of its IMU, their limits, and the vector to a goal.

Environments, compiled kernels and self-models call these functions, so that all observe alike. A
``Number`` is a float, a row (B,) with a number for each of B robots, or a lane of compiled code.

The IMU has nine channels: the world's up (z) and north (y) as unit vectors in body axes, and the
angular velocity in body axes, rad/s. Orientations are unit quaternions (x, y, z, w) that turn body
axes into the world's.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.physics.arithmetic import (
    Number,
    Vector,
    clip,
    dot,
    subtract,
    where_less,
)
from aquafish_gym.physics.kinematics import State
from aquafish_gym.utils.array_types import Floats

Quaternion = tuple[Number, Number, Number, Number]

#: Angular velocity at which the gyroscope saturates, rad/s: 2000 degrees/s in single precision.
GYRO_RANGE = float(np.float32(math.radians(2000.0)))
#: The largest distance at which a goal is observed along each axis, units.
GOAL_RANGE = 100.0
#: Readings up to this factor times a channel's limit are valid, as single precision rounds.
RANGE_TOLERANCE = 1.0 + 1e-6


def up_and_north(orientation: Quaternion) -> tuple[Vector, Vector]:
    """Return the world's up (z) and north (y) as unit vectors in body axes."""
    x, y, z, w = orientation
    xx = x * x
    yz = y * z
    wx = w * x
    up = (2 * (x * z - w * y), 2 * (yz + wx), 1 - 2 * (xx + y * y))
    north = (2 * (x * y + w * z), 1 - 2 * (xx + z * z), 2 * (yz - wx))
    return up, north


def axes(orientation: Quaternion) -> tuple[Vector, Vector, Vector]:
    """Return the world's east (x), north (y) and up (z) as unit vectors in body axes."""
    x, y, z, w = orientation
    up, north = up_and_north(orientation)
    east = (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y))
    return east, north, up


def way_to(goal: Vector, position: Vector, east: Vector, north: Vector, up: Vector) -> Vector:
    """Return the observed vector from a position to a goal, in body axes, units.

    ``goal`` and ``position`` are in world axes. ``east``, ``north`` and ``up`` are what
    :func:`axes` returns. Each component saturates at ``GOAL_RANGE``.
    """
    way = subtract(goal, position)
    return (
        clip(dot(way, (east[0], north[0], up[0])), GOAL_RANGE),
        clip(dot(way, (east[1], north[1], up[1])), GOAL_RANGE),
        clip(dot(way, (east[2], north[2], up[2])), GOAL_RANGE),
    )


def imu(state: State) -> list[Number]:
    """Return the nine channels of the IMU in a state, before they saturate."""
    up, north = up_and_north(state.orientation)
    return [*up, *north, *state.spin]


def beyond_imu(
    state: State, fin_angles: ArrayLike | None = None, goal: Vector | None = None
) -> list[Number]:
    """Return the optional channels, which follow the nine of the IMU.

    Fin angles in rad give their sines, then their cosines; a goal gives the vector to it. None
    gives no channels.
    """
    found: list[Number] = []
    if fin_angles is not None:
        found += [*np.sin(fin_angles), *np.cos(fin_angles)]
    if goal is not None:
        found += way_to(goal, state.position, *axes(state.orientation))
    return found


def observe(
    state: State, fin_angles: ArrayLike | None = None, goal: Vector | None = None
) -> NDArray[np.float32]:
    """Return the observation of sensors without faults: (9,), or more with fin angles or a goal.

    In a state of rows (B,), it is (B, 9) or more. Values saturate at the bounds of the observation
    space. ``fin_angles`` are in rad, ``goal`` in world axes and units.
    """
    senses = imu(state)
    if fin_angles is not None or goal is not None:
        senses += beyond_imu(state, fin_angles, goal)
    seen = np.array(senses).T
    fins = 0 if fin_angles is None else len(fin_angles)  # type: ignore[arg-type]
    most = limits(fins, goal is not None)
    np.maximum(seen, -most, out=seen)
    np.minimum(seen, most, out=seen)
    return seen.astype(np.float32, "C")


def faulty(
    reading: Number, latched: Number, fresh: Number, stuck: Number, dropped: Number
) -> tuple[Number, Number]:
    """Return what a channel observes, and the reading that it holds from now on.

    ``reading`` is what the channel would observe were it neither stuck nor dropped, and ``latched``
    the reading that it repeats if it is stuck. The others are flags, 0 or 1: if ``fresh``, the
    channel first latches this reading; if ``stuck``, it observes the latched one; if
    ``dropped``, it observes 0.
    """
    latched = where_less(0.0, fresh, reading, latched)
    reading = where_less(0.0, stuck, latched, reading)
    return where_less(0.0, dropped, 0.0, reading), latched


@cache
def limits(fins: int = 0, has_goal: bool = False) -> Floats:
    """Return the largest magnitude of each channel of an observation, in its order.

    ``fins`` is how many fins are observed.
    """
    most = [1.0] * 6 + [GYRO_RANGE] * 3
    most += [1.0] * 2 * fins + [GOAL_RANGE] * 3 * has_goal
    found = np.array(most, np.float64)
    found.setflags(write=False)
    return found


def valid_readings(readings: ArrayLike, most: Floats) -> Floats:
    """Return readings (..., k), NaN where they lie outside of the observation space.

    Sensors saturate there, so the transmission of such a number failed. ``most`` (k,) is what
    :func:`limits` returns.
    """
    values = np.asarray(readings, np.float64)
    inside = np.abs(values) <= most * RANGE_TOLERANCE
    return np.where(inside, values, np.nan)
