"""What the robot senses, its limits, and the way to the goal: the one statement.

A number may be a float, a row (B,) of B robots' numbers, or a lane of compiled code. The nine
channels are the world's up and north in body axes, and the angular velocity.
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

#: Gyroscopes saturate at 2000 degrees/s; in rad/s, as single precision has it.
GYRO_RANGE = float(np.float32(math.radians(2000.0)))
#: The largest distance at which a goal is observed along each axis, units.
GOAL_RANGE = 100.0
#: Share of its range by which a reading may exceed it: single precision rounds.
RANGE_TOLERANCE = 1.0 + 1e-6


def up_and_north(orientation: Quaternion) -> tuple[Vector, Vector]:
    """Return the world's z and y in body axes: rows of the rotation matrix."""
    x, y, z, w = orientation
    xx = x * x
    yz = y * z
    wx = w * x
    up = (2 * (x * z - w * y), 2 * (yz + wx), 1 - 2 * (xx + y * y))
    north = (2 * (x * y + w * z), 1 - 2 * (xx + z * z), 2 * (yz - wx))
    return up, north


def axes(orientation: Quaternion) -> tuple[Vector, Vector, Vector]:
    """Return the world's x, y and z in body axes: the rows of the rotation matrix."""
    x, y, z, w = orientation
    up, north = up_and_north(orientation)
    east = (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y))
    return east, north, up


def way_to(goal: Vector, position: Vector, east: Vector, north: Vector, up: Vector) -> Vector:
    """Return the observed way from a position to a goal, units, in body axes.

    The world's axes are given in body axes, as :func:`axes` returns them.
    """
    way = subtract(goal, position)
    return (
        clip(dot(way, (east[0], north[0], up[0])), GOAL_RANGE),
        clip(dot(way, (east[1], north[1], up[1])), GOAL_RANGE),
        clip(dot(way, (east[2], north[2], up[2])), GOAL_RANGE),
    )


def imu(state: State) -> list[Number]:
    """Return the nine channels of the inertial measurement unit in a state."""
    up, north = up_and_north(state.orientation)
    return [*up, *north, *state.spin]


def beyond_imu(
    state: State, fin_angles: ArrayLike | None = None, goal: Vector | None = None
) -> list[Number]:
    """Return what is observed after the nine channels, if asked for: the fins, and the way."""
    found: list[Number] = []
    if fin_angles is not None:
        found += [*np.sin(fin_angles), *np.cos(fin_angles)]
    if goal is not None:
        found += way_to(goal, state.position, *axes(state.orientation))
    return found


def observe(
    state: State, fin_angles: ArrayLike | None = None, goal: Vector | None = None
) -> NDArray[np.float32]:
    """Return the observation of whole sensors, (9,), or more with the fins' angles or a goal.

    Every number may be a row (B,) instead; the result is then (B, 9) or more. Values saturate at
    the bounds of the observation space. The angles are in rad, the goal in the world.
    """
    senses = imu(state)
    if fin_angles is not None or goal is not None:
        senses += beyond_imu(state, fin_angles, goal)
    seen = np.array(senses).T
    most = limits(fin_angles is not None, goal is not None)
    np.maximum(seen, -most, out=seen)
    np.minimum(seen, most, out=seen)
    return seen.astype(np.float32, "C")


def faulty(
    reading: Number, held: Number, fresh: Number, stuck: Number, dropped: Number
) -> tuple[Number, Number]:
    """Return what a channel observes where it would read a number, and what it holds.

    A channel holds its ``fresh`` reading, repeats what it holds while it is ``stuck``, and observes
    0 while it is ``dropped``: flags of 0 and 1.
    """
    held = where_less(0.0, fresh, reading, held)
    reading = where_less(0.0, stuck, held, reading)
    return where_less(0.0, dropped, 0.0, reading), held


@cache
def limits(observe_fins: bool, has_goal: bool) -> Floats:
    """Return the largest values of an observation: up, north, gyro, fins, goal."""
    most = [1.0] * 6 + [GYRO_RANGE] * 3
    most += [1.0] * 6 * observe_fins + [GOAL_RANGE] * 3 * has_goal
    found = np.array(most, np.float64)
    found.setflags(write=False)
    return found


def valid_readings(readings: ArrayLike, most: Floats) -> Floats:
    """Return readings (..., k), NaN where they lie outside of the observation space.

    No sensor reads such a number, so its transmission failed. ``most`` (k,) are the ``limits``.
    """
    values = np.asarray(readings, np.float64)
    inside = np.abs(values) <= most * RANGE_TOLERANCE
    return np.where(inside, values, np.nan)
