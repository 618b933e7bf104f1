"""What whole sensors observe, and where a robot got: straight-line code, stated once.

A number may be a float, a row (B,) of B robots' numbers, or compiled (``envs/compiled.py``).
"""

from __future__ import annotations

from typing import Any

from aquafish_gym.physics.arithmetic import Number, Vector, square_root, subtract

Quaternion = tuple[Number, Number, Number, Number]


def up_and_north(orientation: Quaternion) -> tuple[Vector, Vector]:
    """Return the world's z and y in body axes: rows of the rotation matrix."""
    x, y, z, w = orientation
    xx, yz, wx = x * x, y * z, w * x
    up = (2 * (x * z - w * y), 2 * (yz + wx), 1 - 2 * (xx + y * y))
    north = (2 * (x * y + w * z), 1 - 2 * (xx + z * z), 2 * (yz - wx))
    return up, north


def way_to(goal: Vector, position: Vector, orientation: Quaternion) -> Vector:
    """Return the way from a position to a goal in body axes, units."""
    x, y, z, w = orientation
    up, north = up_and_north(orientation)
    east = (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y))
    way = subtract(goal, position)
    return (
        way[0] * east[0] + way[1] * north[0] + way[2] * up[0],
        way[0] * east[1] + way[1] * north[1] + way[2] * up[1],
        way[0] * east[2] + way[1] * north[2] + way[2] * up[2],
    )


def motion(before: Vector, after: Vector, dt: float) -> tuple[Number, ...]:
    """Return the position, the mean velocity of a step of ``dt`` s, and the distance covered."""
    x, y, z = after
    return (
        x,
        y,
        z,
        (x - before[0]) / dt,
        (y - before[1]) / dt,
        (z - before[2]) / dt,
        square_root(x * x + y * y + z * z),
    )


def motion_info(before: Vector, after: Vector, dt: float) -> dict[str, Any]:
    """Return :func:`motion` by its names in ``info``."""
    x, y, z, along_x, along_y, along_z, distance = motion(before, after, dt)
    return {
        "x_position": x,
        "y_position": y,
        "z_position": z,
        "x_velocity": along_x,
        "y_velocity": along_y,
        "z_velocity": along_z,
        "distance_from_origin": distance,
    }


_NOWHERE = (0.0, 0.0, 0.0)
#: The names of the numbers of :func:`motion`.
MOTION = tuple(motion_info(_NOWHERE, _NOWHERE, 1.0))
