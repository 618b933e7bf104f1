"""Where a robot got in a step: straight-line code, stated once.

A number may be a float, a row (B,) of B robots' numbers, or compiled (``envs/compiled.py``).
"""

from __future__ import annotations

from typing import Any

from aquafish_gym.physics.arithmetic import Number, Vector, square_root


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
