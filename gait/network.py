"""What a controller computes, as straight-line scalar Python.

These few functions are the only statement of the controller's inputs and of its forward
pass. They run on plain floats (one robot), and the lane engine compiles the same function
objects into its time loop, where a number is a register of many robots. So nothing here
branches on data, and nothing but ``+ - * /`` and the carriers' primitives is used.
"""

from __future__ import annotations

import math
from typing import Any

from aquafish_gym.physics.carriers import Number, fetch, floor, where_less

# What the IMU gives, and a clock; in this order in every controller's weights.
INPUTS: tuple[str, ...] = (
    "roll",
    "pitch",
    "yaw",
    "gyro_x",
    "gyro_y",
    "gyro_z",
    "clock_sine",
    "clock_cosine",
)
OUTPUTS: tuple[str, ...] = ("left_pectoral", "right_pectoral", "caudal")

# Angles come as shares of half a turn; body rates as shares of GYRO_RANGE rad/s, clipped.
GYRO_RANGE = 2.0

# neat-python's activation is tanh(2.5 z); its clamp at 60 is far beyond where tanh is 1.
GAIN = 2.5
_TANH_LIMIT = 20.0  # 1 - tanh(20) = 8e-18
_TURN = 2 * math.pi


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


def store(array: Any, index: int, value: Number) -> None:
    """Set entry ``index`` of a flat array; of all robots side by side, in lanes."""
    array[index] = value


def half_turns(angle: Number) -> Number:
    """Return an angle in rad as a share of half a turn in [-1, 1), unwrapped or not."""
    turns = angle * (1 / _TURN)
    return 2 * (turns - floor(turns + 0.5))


def gene_count(nodes: int) -> int:
    """Return how many numbers describe a network of ``nodes`` nodes to :func:`act`."""
    return nodes * (2 + len(INPUTS)) + nodes * (nodes - 1) // 2


def act(
    genes: Any,
    values: Any,
    nodes: int,
    roll: Number,
    pitch: Number,
    yaw: Number,
    gyro_x: Number,
    gyro_y: Number,
    gyro_z: Number,
    sine: Number,
    cosine: Number,
) -> tuple[Number, Number, Number]:
    """Return the three actions in [-1, 1] for what the IMU and the clock say.

    Parameters
    ----------
    genes
        Flat, :func:`gene_count` entries: for each node in topological order its bias, its
        response, and its weights from the inputs and from all nodes before it.
    values
        Flat scratch space of ``len(INPUTS) + nodes`` entries.
    nodes
        How many nodes there are; the last three are the outputs.
    roll, pitch, yaw
        rad.
    gyro_x, gyro_y, gyro_z
        rad/s, in body axes.
    sine, cosine
        Of the clock's phase.
    """
    store(values, 0, half_turns(roll))
    store(values, 1, half_turns(pitch))
    store(values, 2, half_turns(yaw))
    store(values, 3, clip(gyro_x * (1 / GYRO_RANGE), 1.0))
    store(values, 4, clip(gyro_y * (1 / GYRO_RANGE), 1.0))
    store(values, 5, clip(gyro_z * (1 / GYRO_RANGE), 1.0))
    store(values, 6, sine)
    store(values, 7, cosine)
    k = 0
    for node in range(8, 8 + nodes):
        total = fetch(values, 0, roll) * fetch(genes, k + 2, roll)
        for i in range(1, node):
            total = total + fetch(values, i, roll) * fetch(genes, k + 2 + i, roll)
        total = fetch(genes, k, roll) + fetch(genes, k + 1, roll) * total
        store(values, node, tanh(GAIN * total))
        k += 2 + node
    last = 8 + nodes
    return (
        fetch(values, last - 3, roll),
        fetch(values, last - 2, roll),
        fetch(values, last - 1, roll),
    )
