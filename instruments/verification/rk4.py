"""The classical Runge-Kutta method, with which the oracles integrate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def integrate(
    rate: Callable[[float, Array], Array], y: Array, h: float, steps: int, start: float = 0.0
) -> Array:
    """Return y after ``steps`` of length ``h``, s, of y' = rate(t, y) from ``start``, s."""
    for i in range(steps):
        t = start + i * h
        k1 = rate(t, y)
        k2 = rate(t + h / 2, y + h / 2 * k1)
        k3 = rate(t + h / 2, y + h / 2 * k2)
        k4 = rate(t + h, y + h * k3)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return y


def cross(a: Array, b: Array) -> Array:
    """Return a x b of two vectors (3,); numpy's own is made for many at once."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def quaternion_rate(q: Array, spin: Array) -> Array:
    """Return dq/dt of a quaternion (x, y, z, w) that turns with ``spin`` in its own axes."""
    x, y, z, w = q
    a, b, c = spin
    return 0.5 * np.array(
        [
            w * a + y * c - z * b,
            w * b + z * a - x * c,
            w * c + x * b - y * a,
            -x * a - y * b - z * c,
        ]
    )


def rotation_matrix(q: Array) -> Array:
    """Return the rotation matrix (3, 3) of a unit quaternion (x, y, z, w)."""
    v, w = q[:3], q[3]
    skew = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    matrix: Array = np.eye(3) + 2 * w * skew + 2 * skew @ skew
    return matrix
