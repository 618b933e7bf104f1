"""What a controller computes, as straight-line scalar Python.

:func:`steer` is the only statement of the controller's inputs and of its forward pass. It
runs on plain floats (one robot), and the lane engine compiles the same function objects into
its time loop, where a number is a register of many robots. So nothing here branches on data,
and nothing but ``+ - * /`` and the primitives of ``arithmetic.py`` is used.
"""

from __future__ import annotations

from typing import Any

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW
from aquafish_gym.physics.arithmetic import (
    TAU,
    Number,
    Vector,
    fetch,
    floor,
    put,
    small_sine_cosine,
    where_less,
)

# What the IMU gives, as AquaFish-v0 observes it, and a clock; in this order in every
# controller's weights. Attitude comes as direction cosines rather than as angles: they are
# bounded, never jump, and do not depend on which of its two triples (see imu.py) the log is in.
INPUTS: tuple[str, ...] = (
    "up_x",  # the world's vertical (z) in body axes
    "up_y",
    "up_z",
    "north_x",  # the world's y, where the robot faces at the start, in body axes
    "north_y",
    "north_z",
    "gyro_x",  # body rates, 1 at GYRO_SCALE, clipped to [-1, 1]
    "gyro_y",
    "gyro_z",
    "clock_sine",
    "clock_cosine",
)
OUTPUTS: tuple[str, ...] = ("left_pectoral", "right_pectoral", "caudal")
INPUT_COUNT = len(INPUTS)

GYRO_SCALE = 2.0  # rad/s

# neat-python's activation is tanh(2.5 z); its clamp at 60 is far beyond where tanh is 1.
GAIN = 2.5
_TANH_LIMIT = 20.0  # 1 - tanh(20) = 8e-18

# scale_action, for one robot in numbers of any arithmetic.
_MIDDLE = tuple(float(v) for v in (COMMAND_LOW + COMMAND_HIGH) / 2)
_REACH = tuple(float(v) for v in (COMMAND_HIGH - COMMAND_LOW) / 2)


def clip(x: Number, limit: float) -> Number:
    """Return ``x`` held within [-limit, limit]."""
    low = where_less(x, -limit, -limit, x)
    return where_less(limit, low, limit, low)


def tanh(z: Number) -> Number:
    """Return tanh z to 1e-15 in float64, with one division and no exponential.

    The Pade approximant [7/6] of tanh(z / 32) as a fraction, then five times the
    double-angle formula tanh 2y = 2 n d / (d^2 + n^2), which needs no division either.
    """
    y = clip(z, _TANH_LIMIT) * (1 / 32)
    q = y * y
    n = y * (1 + q * (17325 / 135135 + q * (378 / 135135 + q * (1 / 135135))))
    d = 1 + q * (62370 / 135135 + q * (3150 / 135135 + q * (28 / 135135)))
    for _ in range(5):
        n, d = 2 * n * d, d * d + n * n
    return n / d


def sine_cosine(turns: Number) -> tuple[Number, Number]:
    """Return (sin, cos) of an angle given in turns, by thrice doubling an eighth of it."""
    s, c = small_sine_cosine((turns - floor(turns + 0.5)) * (TAU / 8))
    for _ in range(3):
        s, c = 2 * s * c, c * c - s * s
    return s, c


def listen(
    values: Any, clock: Number, time: float, up: Vector, north: Vector, gyro: Vector
) -> None:
    """Put the inputs, in the order of ``INPUTS``, into the first entries of ``values``.

    The clock is in Hz, and the time in s since the controller was switched on; ``up`` and
    ``north`` are the world's z and y, and ``gyro`` the angular velocity in rad/s, in body axes.
    """
    sine, cosine = sine_cosine(clock * time)
    put(values, 0, up[0])
    put(values, 1, up[1])
    put(values, 2, up[2])
    put(values, 3, north[0])
    put(values, 4, north[1])
    put(values, 5, north[2])
    put(values, 6, clip(gyro[0] * (1 / GYRO_SCALE), 1.0))
    put(values, 7, clip(gyro[1] * (1 / GYRO_SCALE), 1.0))
    put(values, 8, clip(gyro[2] * (1 / GYRO_SCALE), 1.0))
    put(values, 9, sine)
    put(values, 10, cosine)


def directions(rpy: Vector) -> tuple[Vector, Vector]:
    """Return the world's z and y in body axes, for roll, pitch, yaw in rad."""
    rs, rc = sine_cosine(rpy[0] * (1 / TAU))
    ps, pc = sine_cosine(rpy[1] * (1 / TAU))
    ys, yc = sine_cosine(rpy[2] * (1 / TAU))
    up = (-pc * rs, ps, pc * rc)
    north = (ys * rc + yc * ps * rs, yc * pc, ys * rs - yc * ps * rc)
    return up, north


def forward(genes: Any, nodes: int, values: Any, group: int, groups: int, like: Number) -> Vector:
    """Return the last three nodes' values, given the inputs in ``values``.

    Parameters
    ----------
    genes
        Flat table whose row r is entry ``r * groups + group``. Row 0 is the clock; then, for
        each node in topological order, follow its bias, its response, and its weights from
        the inputs and from all nodes before it.
    values
        Flat scratch space of ``INPUT_COUNT + nodes`` entries.
    group, groups
        Which robots (see ``engines/kernel.py``); 0 of 1 on plain floats.
    like
        Any number of the arithmetic.
    """
    at = groups + group
    for node in range(INPUT_COUNT, INPUT_COUNT + nodes):
        bias = fetch(genes, at, like)
        response = fetch(genes, at + groups, like)
        at += 2 * groups
        total = 0.0 * like
        for i in range(node):
            total = total + fetch(genes, at, like) * fetch(values, i, like)
            at += groups
        put(values, node, tanh(GAIN * (bias + response * total)))
    last = INPUT_COUNT + nodes
    return (
        fetch(values, last - 3, like),
        fetch(values, last - 2, like),
        fetch(values, last - 1, like),
    )


def steer(
    genes: Any,
    layout: Any,
    scratch: Any,
    group: int,
    groups: int,
    time: float,
    rpy: Vector,
    gyro: Vector,
) -> Vector:
    """Return the servo command in rev/s, rev/s, Hz: the policy of ``engines/kernel.py``.

    ``layout[0]`` is the number of nodes; for the rest see :func:`listen` and :func:`forward`.
    """
    up, north = directions(rpy)
    listen(scratch, fetch(genes, group, rpy[0]), time, up, north, gyro)
    a = forward(genes, layout[0], scratch, group, groups, rpy[0])
    return (
        _MIDDLE[0] + _REACH[0] * a[0],
        _MIDDLE[1] + _REACH[1] * a[1],
        _MIDDLE[2] + _REACH[2] * a[2],
    )
