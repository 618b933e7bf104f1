"""What a controller computes, as straight-line scalar Python.

:func:`steer` is the only statement of the controllers' inputs and of their network. It runs on
plain floats (one robot), and the lane engine compiles the same function objects into its time
loop, where a number is a register of many robots. So nothing here branches on data, and nothing
but ``+ - * /``, ``sqrt`` and the primitives of ``arithmetic.py`` is used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.physics.arithmetic import (
    TAU,
    Number,
    Vector,
    fetch,
    floor,
    fma,
    put,
    small_sine_cosine,
    where_less,
)

OUTPUTS: tuple[str, ...] = ("left_pectoral", "right_pectoral", "caudal")
GYRO_SCALE = 2.0  # rad/s
GOAL_SCALE = 5.0  # units

# neat-python's activation is tanh(2.5 z); its clamp at 60 is far beyond where tanh is 1.
GAIN = 2.5
_TANH_LIMIT = 20.0  # 1 - tanh(20) = 8e-18

_MIDDLE = tuple(float(v) for v in (COMMAND_LOW + COMMAND_HIGH) / 2)
_REACH = tuple(float(v) for v in (COMMAND_HIGH - COMMAND_LOW) / 2)


# Of a controller's layout and genes, see :func:`respond`.
IMU, CLOCK, FINS, GOAL, INPUTS, NODES, MEMORY, CLIPPED, HELD, LAYERS = range(10)
HEADER = 7  # rows: the clock, the fins' turns, the servos' gains


@dataclass(frozen=True)
class Senses:
    """What a controller feels.

    Examples
    --------
    >>> Senses(imu=False, fins=True, clock=0).names[:2]
    ('left_pectoral_sine', 'left_pectoral_cosine')
    """

    imu: bool = True  #: Where is up, where north, and how fast the body turns.
    clock: int = 1  #: Harmonics of a clock, at multiples of its frequency.
    fins: bool = False  #: Where the fins are, from where they stood at first and the commands.
    goal: bool = False  #: The way to a goal in body axes; only an environment with one shows it.

    @property
    def names(self) -> tuple[str, ...]:
        """The inputs, in the order of the weights."""
        axes = [f"{what}_{axis}" for what in ("up", "north", "gyro") for axis in "xyz"]
        waves = [f"{i}" if i > 1 else "" for i in range(1, self.clock + 1)]
        clock = [f"clock{i}_{wave}" for i in waves for wave in ("sine", "cosine")]
        fins = [f"{fin}_{wave}" for fin in OUTPUTS for wave in ("sine", "cosine")]
        goal = ("goal_x", "goal_y", "goal_z")
        return (
            *(axes if self.imu else ()),
            *clock,
            *(fins if self.fins else ()),
            *(goal if self.goal else ()),
        )


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


def directions(rpy: Vector) -> tuple[Vector, Vector]:
    """Return the world's z and y in body axes, for roll, pitch, yaw in rad."""
    rs, rc = sine_cosine(rpy[0] * (1 / TAU))
    ps, pc = sine_cosine(rpy[1] * (1 / TAU))
    ys, yc = sine_cosine(rpy[2] * (1 / TAU))
    up = (-pc * rs, ps, pc * rc)
    north = (ys * rc + yc * ps * rs, yc * pc, ys * rs - yc * ps * rc)
    return up, north


def listen_imu(values: Any, at: int, up: Vector, north: Vector, gyro: Vector) -> None:
    """Put what the IMU says, as AquaFish-v0 observes it, into nine entries of ``values``.

    Attitude comes as direction cosines rather than as angles: they are bounded, never jump, and do
    not depend on which of its two triples (see imu.py) the log is in. They are the world's
    vertical, z, and its y, where the robot faces at the start, in body axes. The gyroscope's rad/s
    about body axes are 1 at ``GYRO_SCALE``.
    """
    for i in range(3):
        put(values, at + i, up[i])
        put(values, at + 3 + i, north[i])
        put(values, at + 6 + i, clip(gyro[i] * (1 / GYRO_SCALE), 1.0))


def listen_clock(values: Any, at: int, harmonics: int, turns: Number) -> None:
    """Put sine and cosine of so many harmonics of a clock that has made ``turns``."""
    first = sine_cosine(turns)
    sine, cosine = first
    for k in range(harmonics):
        put(values, at + 2 * k, sine)
        put(values, at + 2 * k + 1, cosine)
        sine, cosine = (
            sine * first[1] + cosine * first[0],
            cosine * first[1] - sine * first[0],
        )


def listen_fins(values: Any, at: int, turns: int, like: Number) -> None:
    """Put sine and cosine of three fin angles that stand, in turns, from ``turns`` on."""
    for i in range(3):
        sine, cosine = sine_cosine(fetch(values, turns + i, like))
        put(values, at + 2 * i, sine)
        put(values, at + 2 * i + 1, cosine)


def listen_goal(values: Any, at: int, way: Vector) -> None:
    """Put the way to a goal, units in body axes, drawn in to a length of d / sqrt(d^2 + s^2) for a
    distance d and s = ``GOAL_SCALE``: however far it is, it tells where.
    """
    x, y, z = way
    shrink = 1.0 / math.sqrt(fma(x, x, fma(y, y, fma(z, z, GOAL_SCALE * GOAL_SCALE))))
    for i in range(3):
        put(values, at + i, way[i] * shrink)


def forward(genes: Any, layout: Any, values: Any, group: int, groups: int, like: Number) -> Vector:
    """Return the last three nodes' values, given the inputs in ``values``.

    A node hears all inputs, all nodes of the layers before its own, and, where there is memory,
    the nodes of its own layer and of those after as they were the last time.

    Parameters
    ----------
    genes, layout
        See :func:`respond`.
    values
        Flat scratch space: the inputs, the nodes, and as many once more.
    group, groups
        Which robots (see ``engines/kernel.py``); 0 of 1 on plain floats.
    like
        Any number of the arithmetic.
    """
    inputs, nodes, memory, clipped = layout[INPUTS], layout[NODES], layout[MEMORY], layout[CLIPPED]
    at = HEADER * groups + group
    begin = inputs
    for layer in range(layout[LAYERS]):
        end = inputs + layout[LAYERS + 1 + layer]
        heard = inputs + nodes if memory else begin
        for node in range(begin, end):
            bias = fetch(genes, at, like)
            response = fetch(genes, at + groups, like)
            at += 2 * groups
            total = 0.0 * like
            for i in range(heard):
                total = total + fetch(genes, at, like) * fetch(values, i, like)
                at += groups
            z = GAIN * (bias + response * total)
            if clipped and end == inputs + nodes:
                put(values, node + nodes, clip(z, 1.0))
            else:
                put(values, node + nodes, tanh(z))
        for node in range(begin, end):
            put(values, node, fetch(values, node + nodes, like))
        begin = end
    last = inputs + nodes
    return (
        fetch(values, last - 3, like),
        fetch(values, last - 2, like),
        fetch(values, last - 1, like),
    )


def respond(
    genes: Any,
    layout: Any,
    scratch: Any,
    group: int,
    groups: int,
    time: float,
    up: Vector,
    north: Vector,
    gyro: Vector,
    way: Vector,
) -> Vector:
    """Return the action, in [-1, 1], for what is felt ``time`` s after the swim began.

    Parameters
    ----------
    genes
        Flat table whose row r is entry ``r * groups + group``. ``HEADER`` rows say the clock's
        frequency in Hz, where the fins stand at first as far as is known, in turns, and by what
        factor each servo is faster than told; then follow, for each node, its bias, its response,
        and its weights from the inputs and from the nodes that it hears.
    layout
        Whole numbers, in this order: whether the IMU is heard; how many harmonics of the clock;
        whether the fins are; whether the goal is; how many inputs that makes; nodes; whether they
        have a memory; whether the outputs are clipped at 1 instead of tanh; for how many steps of
        0.01 s an action is held; how many layers, and up to which node each goes.
    scratch
        ``scratch_size`` numbers that live through a swim.
    up, north, gyro, way
        See :func:`listen_imu` and :func:`listen_goal`.
    """
    like = gyro[0]
    imu, harmonics, fins, inputs = layout[IMU], layout[CLOCK], layout[FINS], layout[INPUTS]
    turns = inputs + 2 * layout[NODES]
    if time == 0.0:
        for i in range(turns):
            put(scratch, i, 0.0 * like)
        for i in range(3 * fins):
            put(scratch, turns + i, fetch(genes, (1 + i) * groups + group, like))
    at = 0
    if imu:
        listen_imu(scratch, at, up, north, gyro)
        at += 9
    if harmonics:
        listen_clock(scratch, at, harmonics, fetch(genes, group, like) * time)
        at += 2 * harmonics
    if fins:
        listen_fins(scratch, at, turns, like)
        at += 6
    if layout[GOAL]:
        listen_goal(scratch, at, way)
    action = forward(genes, layout, scratch, group, groups, like)
    if fins:
        # The servos do what they are told: who knows where the fins were, knows where they are.
        told = command(action)
        for i in range(3):
            gain = fetch(genes, (4 + i) * groups + group, like)
            turned = gain * told[i] * (layout[HELD] * TIMESTEP)
            put(scratch, turns + i, fetch(scratch, turns + i, like) + turned)
    return action


def command(action: Vector) -> Vector:
    """Return the servo command in rev/s, rev/s, Hz: ``scale_action``, for any arithmetic."""
    return (
        _MIDDLE[0] + _REACH[0] * action[0],
        _MIDDLE[1] + _REACH[1] * action[1],
        _MIDDLE[2] + _REACH[2] * action[2],
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
    """Return the servo command for an attitude, rpy in rad: the policy of ``engines/kernel.py``."""
    up, north = directions(rpy)
    nowhere = (0.0 * gyro[0], 0.0 * gyro[0], 0.0 * gyro[0])  # lanes know no goal
    return command(respond(genes, layout, scratch, group, groups, time, up, north, gyro, nowhere))
