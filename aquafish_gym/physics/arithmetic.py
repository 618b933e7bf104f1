"""Arithmetic that the drag law and the dynamics need beyond ``+ - * /`` and ``sqrt``.

The physics is written once and runs on four scalar backends: plain floats (the reference), numba's
float64 and float32, SIMD lanes of either (``simd.py``), and symbols (``symbols.py``), by which it
is printed in other languages. All code is straight-line: no branch depends on data, because the
robots in one vector register share their instructions. The primitives below have a second, vector
body in ``simd.py``. They also take rows (numpy arrays with one number per robot), for tasks and
observations.

Multiply-adds are fused only in :func:`fma`: a compiler that may fuse freely rounds differently at
every lane width.
"""

from __future__ import annotations

import ctypes
import math
import sys
from typing import Any

import numpy as np

from aquafish_gym.physics.symbols import Symbol, operation

Number = Any  # a float, a row of floats, a SIMD lane of floats, or a symbol
Vector = tuple[Number, Number, Number]
Matrix = tuple[Vector, Vector, Vector]  # rows
Symmetric = tuple[Number, Number, Number, Number, Number, Number]  # xx, yy, zz, xy, xz, yz

TAU = 2 * math.pi


# The C library's, with which Python is linked except on Windows; Python's own is of 3.13.
_fma = ctypes.CDLL("ucrtbase" if sys.platform == "win32" else None).fma
_fma.restype = ctypes.c_double
_fma.argtypes = [ctypes.c_double] * 3


def fma(a: Number, b: Number, c: Number) -> Number:
    """Return a b + c, rounded once (rows: twice)."""
    if isinstance(a, np.ndarray):
        return a * b + c
    try:
        return _fma(a, b, c)
    except ctypes.ArgumentError:  # no check before, which would slow down plain floats
        return operation("fma", a, b, c)


def where_less(a: Number, b: Number, then: Number, otherwise: Number) -> Number:
    """Return ``then`` where a < b, else ``otherwise``."""
    less = a < b
    if isinstance(less, Symbol):
        return operation("where_less", a, b, then, otherwise)
    if isinstance(less, np.ndarray):
        return np.where(less, then, otherwise)
    return then if less else otherwise


def floor(x: Number) -> Number:
    """Return the largest integer not above ``x``, as a float."""
    if isinstance(x, Symbol):
        return operation("floor", x)
    return np.floor(x) if isinstance(x, np.ndarray) else float(math.floor(x))


def square_root(x: Number) -> Number:
    """Return the square root of ``x``."""
    if isinstance(x, float):
        return math.sqrt(x)
    return operation("square_root", x) if isinstance(x, Symbol) else np.sqrt(x)


def cosine_sine(angle: Number) -> tuple[Number, Number]:
    """Return (cos, sin) of an angle in rad; lanes and symbols use :func:`sine_cosine`."""
    if isinstance(angle, Symbol):
        sine, cosine = sine_cosine(angle * (1 / TAU))
        return cosine, sine
    return np.cos(angle), np.sin(angle)


def fetch(array: Any, index: int, like: Number) -> Number:  # noqa: ARG001
    """Return entry ``index`` of a flat array; in lanes, the entries of ``width`` robots.

    ``like`` selects the backend: in lanes of width w, entries index * w to index * w + w - 1.
    """
    return array[index]


def put(array: Any, index: int, value: Number) -> None:
    """Set entry ``index`` of a flat array; in lanes, the entries of ``width`` robots."""
    array[index] = value


def clip(x: Number, limit: Number) -> Number:
    """Return ``x`` clipped to [-limit, limit]."""
    low = where_less(x, -limit, -limit, x)
    return where_less(limit, low, limit, low)


def dot(a: Vector, b: Vector) -> Number:
    """Return a . b."""
    return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return (
        fma(a[1], b[2], -(a[2] * b[1])),
        fma(a[2], b[0], -(a[0] * b[2])),
        fma(a[0], b[1], -(a[1] * b[0])),
    )


def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(k: Number, a: Vector) -> Vector:
    """Return k a."""
    return (k * a[0], k * a[1], k * a[2])


def add_scaled(a: Vector, k: Number, b: Vector) -> Vector:
    """Return a + k b."""
    return (fma(k, b[0], a[0]), fma(k, b[1], a[1]), fma(k, b[2], a[2]))


def times(a: Symmetric, v: Vector) -> Vector:
    """Return a v for a symmetric 3 x 3 matrix."""
    xx, yy, zz, xy, xz, yz = a
    return (dot((xx, xy, xz), v), dot((xy, yy, yz), v), dot((xz, yz, zz), v))


def inverse(a: Symmetric) -> Symmetric:
    """Return the inverse of a positive definite 3 x 3 matrix (its cofactors)."""
    xx, yy, zz, xy, xz, yz = a
    c_xx = fma(yy, zz, -(yz * yz))
    c_xy = fma(xz, yz, -(xy * zz))
    c_xz = fma(xy, yz, -(xz * yy))
    c_yy = fma(xx, zz, -(xz * xz))
    c_yz = fma(xy, xz, -(xx * yz))
    c_zz = fma(xx, yy, -(xy * xy))
    k = 1.0 / fma(xx, c_xx, fma(xy, c_xy, xz * c_xz))
    return (k * c_xx, k * c_yy, k * c_zz, k * c_xy, k * c_xz, k * c_yz)


def small_sine_cosine(x: Number) -> tuple[Number, Number]:
    """Return (sin x, cos x) for abs(x) <= 0.6, to 4e-16: their Taylor series."""
    z = x * x
    s = fma(z, 1 / 6227020800, -1 / 39916800)
    s = fma(z, s, 1 / 362880)
    s = fma(z, s, -1 / 5040)
    s = fma(z, s, 1 / 120)
    s = fma(z, s, -1 / 6)
    c = fma(z, -1 / 87178291200, 1 / 479001600)
    c = fma(z, c, -1 / 3628800)
    c = fma(z, c, 1 / 40320)
    c = fma(z, c, -1 / 720)
    c = fma(z, c, 1 / 24)
    c = fma(z, c, -1 / 2)
    return fma(x * z, s, x), fma(z, c, 1.0)


def sine_cosine(turns: Number) -> tuple[Number, Number]:
    """Return (sin, cos) of an angle given in turns: three doublings of an eighth of the angle."""
    s, c = small_sine_cosine((turns - floor(turns + 0.5)) * (TAU / 8))
    for _ in range(3):
        s, c = 2 * s * c, c * c - s * s
    return s, c


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
    p = fma(z, 0.021135373157693246, -0.04348052215716462)
    p = fma(z, p, 0.056883492268090106)
    p = fma(z, p, -0.06640233930429408)
    p = fma(z, p, 0.07689953496306857)
    p = fma(z, p, -0.09090773074808414)
    p = fma(z, p, 0.11111106180455946)
    p = fma(z, p, -0.14285714180976467)
    p = fma(z, p, 0.1999999999885511)
    p = fma(z, p, -0.3333333333332844)
    angle = fma(u * z, p, u)
    angle = angle + where_less(near, low, 0.25 * math.pi, 0.0)
    angle = where_less(across, up, 0.5 * math.pi - angle, angle)
    angle = where_less(x, 0.0, math.pi - angle, angle)
    return where_less(y, 0.0, -angle, angle)
