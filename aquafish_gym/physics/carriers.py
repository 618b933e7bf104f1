"""Arithmetic that the drag law and the dynamics need beyond ``+ - * /`` and ``sqrt``.

The physics is written once and runs on three carriers: plain floats (the reference), numba's
float64 and float32, and SIMD lanes of either (``simd.py``). Everything here is straight-line:
no branch depends on data, because the robots in one vector register share their instructions.
The four primitives below have a second, vector body in ``simd.py``.
"""

from __future__ import annotations

import math
from typing import Any

Number = Any  # a float or a SIMD lane of floats
Vector = tuple[Number, Number, Number]

TAU = 2 * math.pi


def where_less(a: Number, b: Number, then: Number, otherwise: Number) -> Number:
    """Return ``then`` where a < b, else ``otherwise``."""
    return then if a < b else otherwise


def floor(x: Number) -> Number:
    """Return the greatest whole number not above ``x``, as a float."""
    return float(math.floor(x))


def fetch(array: Any, index: int, like: Number) -> Number:  # noqa: ARG001
    """Return entry ``index`` of a flat array; of ``width`` robots side by side, in lanes.

    ``like`` tells the carrier: in lanes of width w, entries index * w to index * w + w - 1.
    """
    return array[index]


def put(array: Any, index: int, value: Number) -> None:
    """Set entry ``index`` of a flat array; of ``width`` robots side by side, in lanes."""
    array[index] = value


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def scale(k: Number, a: Vector) -> Vector:
    """Return k a."""
    return (k * a[0], k * a[1], k * a[2])


def small_sine_cosine(x: Number) -> tuple[Number, Number]:
    """Return (sin x, cos x) for abs(x) <= 0.6, to 4e-16: their Taylor series."""
    z = x * x
    s = 1 - z * (1 / 110) * (1 - z * (1 / 156))
    s = 1 - z * (1 / 6) * (1 - z * (1 / 20) * (1 - z * (1 / 42) * (1 - z * (1 / 72) * s)))
    c = 1 - z * (1 / 90) * (1 - z * (1 / 132) * (1 - z * (1 / 182)))
    c = 1 - z * (1 / 2) * (1 - z * (1 / 12) * (1 - z * (1 / 30) * (1 - z * (1 / 56) * c)))
    return x * s, c


def arctangent2(y: Number, x: Number) -> Number:
    """Return the angle of the point (x, y) in [-pi, pi], to 4e-16; 0 at the origin.

    The polynomial is the minimax fit of atan(u) / u in u^2 over [0, tan(pi/8)], whose own
    error is 3.5e-17 (mpmath's ``chebyfit`` at 40 digits).
    """
    across, up = abs(x), abs(y)
    high = where_less(across, up, up, across)
    low = where_less(across, up, across, up)
    # tan(a - pi/4) = (tan a - 1) / (tan a + 1) brings [tan(pi/8), 1] to [-tan(pi/8), 0].
    near = high * 0.41421356237309503
    top = where_less(near, low, low - high, low)
    bottom = where_less(near, low, low + high, high)
    u = top / (bottom + 1e-30)
    z = u * u
    p = 0.021135373157693246
    p = p * z - 0.04348052215716462
    p = p * z + 0.056883492268090106
    p = p * z - 0.06640233930429408
    p = p * z + 0.07689953496306857
    p = p * z - 0.09090773074808414
    p = p * z + 0.11111106180455946
    p = p * z - 0.14285714180976467
    p = p * z + 0.1999999999885511
    p = p * z - 0.3333333333332844
    angle = u + u * z * p
    angle = angle + where_less(near, low, 0.25 * math.pi, 0.0)
    angle = where_less(across, up, 0.5 * math.pi - angle, angle)
    angle = where_less(x, 0.0, math.pi - angle, angle)
    return where_less(y, 0.0, -angle, angle)
