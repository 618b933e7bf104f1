"""The robot's state, its attitude and its servos.

Frames: ``world`` is inertial; ``body`` turns with the capsule. Straight-line code for any
scalar backend; see ``arithmetic.py``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from aquafish_gym.physics.arithmetic import (
    TAU,
    Matrix,
    Number,
    Vector,
    arctangent2,
    dot,
    fma,
    scale,
    small_sine_cosine,
    subtract,
    where_less,
)

SWEEP = math.radians(30.0)  # caudal angle = SWEEP sin(phase)
# A robot has diverged once the squares of its velocity (units/s) and spin (rad/s) sum to this,
# though its numbers may stay finite for some steps more. (Bullet cuts speeds off, so that a robot
# that runs away never reaches infinity there.)
RUNAWAY_SQUARE = 1e12

Pair = tuple[Number, Number]
Joints = tuple[Pair, Pair, Pair, Vector]  # left, right, phase, the three speeds


class State(NamedTuple):
    """Everything that changes from step to step; position and velocity are the capsule centre's."""

    orientation: tuple[Number, Number, Number, Number]  # (x, y, z, w) from body to world
    position: Vector  # in the world, units
    velocity: Vector  # in the world, units/s
    spin: Vector  # in body axes, rad/s
    left: Pair  # (cos, sin) of the pectorals' angles, and of the caudal fin's phase
    right: Pair
    phase: Pair
    rates: Vector  # the three joints' present speeds, rad/s


class Drive(NamedTuple):
    """A command's effect in one step: (cos, sin) of each servo's turn, the pectorals' rad/s."""

    left: Pair
    right: Pair
    phase: Pair
    speeds: Pair


def has_diverged(state: State) -> Number:
    """Return 1 where a robot ran away or its numbers are not finite, else 0; see RUNAWAY_SQUARE."""
    square = 0.0 * state.spin[0]  # NaN if a number is infinite or NaN
    for x in state.orientation + state.position + state.left + state.right + state.phase:
        square = square + 0.0 * x
    for x in state.rates:
        square = square + 0.0 * x
    for x in state.velocity + state.spin:
        square = square + x * x
    return where_less(square, RUNAWAY_SQUARE, 0.0, 1.0)


def joint_angles(state: State) -> Vector:
    """Return left and right pectoral angle and caudal phase in (-pi, pi], rad."""
    left = state.left
    right = state.right
    phase = state.phase
    return (
        arctangent2(left[1], left[0]),
        arctangent2(right[1], right[0]),
        arctangent2(phase[1], phase[0]),
    )


def rotation(q: tuple[Number, Number, Number, Number]) -> Matrix:
    """Return the rotation matrix (rows) from body to world of a unit quaternion (x, y, z, w)."""
    x, y, z, w = q
    x2 = x + x
    y2 = y + y
    z2 = z + z
    less_xx, less_yy = fma(-x, x2, 1.0), fma(-y, y2, 1.0)
    wx = w * x2
    wy = w * y2
    wz = w * z2
    return (
        (fma(-z, z2, less_yy), fma(x, y2, -wz), fma(x, z2, wy)),
        (fma(x, y2, wz), fma(-z, z2, less_xx), fma(y, z2, -wx)),
        (fma(x, z2, -wy), fma(y, z2, wx), fma(-y, y2, less_xx)),
    )


def to_world(r: Matrix, v: Vector) -> Vector:
    """Turn a vector from body to world axes."""
    return (dot(r[0], v), dot(r[1], v), dot(r[2], v))


def to_body(r: Matrix, v: Vector) -> Vector:
    """Turn a vector from world to body axes."""
    return (
        fma(r[0][0], v[0], fma(r[1][0], v[1], r[2][0] * v[2])),
        fma(r[0][1], v[0], fma(r[1][1], v[1], r[2][1] * v[2])),
        fma(r[0][2], v[0], fma(r[1][2], v[1], r[2][2] * v[2])),
    )


def turn(
    q: tuple[Number, Number, Number, Number], spin: Vector, h: Number
) -> tuple[Number, Number, Number, Number]:
    """Turn a quaternion by ``spin`` (body axes) for a time h: the exponential map."""
    # sin(a) / a and cos(a) of half the angle by their series in a^2. Spins stay under 100 rad/s at
    # h = 0.01, where the terms kept leave 1e-17.
    half = 0.5 * h
    x = spin[0] * half
    y = spin[1] * half
    z = spin[2] * half
    a = fma(x, x, fma(y, y, z * z))
    s = fma(a, -1 / 39916800, 1 / 362880)
    s = fma(a, s, -1 / 5040)
    s = fma(a, s, 1 / 120)
    s = fma(a, s, -1 / 6)
    s = fma(a, s, 1.0)
    c = fma(a, 1 / 479001600, -1 / 3628800)
    c = fma(a, c, 1 / 40320)
    c = fma(a, c, -1 / 720)
    c = fma(a, c, 1 / 24)
    c = fma(a, c, -1 / 2)
    c = fma(a, c, 1.0)
    x = s * x
    y = s * y
    z = s * z
    n0 = fma(q[3], x, fma(q[0], c, fma(q[1], z, -(q[2] * y))))
    n1 = fma(q[3], y, fma(q[1], c, fma(q[2], x, -(q[0] * z))))
    n2 = fma(q[3], z, fma(q[2], c, fma(q[0], y, -(q[1] * x))))
    n3 = fma(q[3], c, -fma(q[0], x, fma(q[1], y, q[2] * z)))
    # Newton's step to length 1: it removes rounding.
    k = fma(-0.5, fma(n0, n0, fma(n1, n1, fma(n2, n2, n3 * n3))), 1.5)
    return (k * n0, k * n1, k * n2, k * n3)


def drive(command: Vector, h: Number) -> Drive:
    """Return the drive for a command in rev/s, rev/s and Hz."""
    left = TAU * command[0]
    right = TAU * command[1]
    caudal = TAU * command[2]
    sl, cl = small_sine_cosine(left * h)
    sr, cr = small_sine_cosine(right * h)
    sp, cp = small_sine_cosine(caudal * h)
    return Drive((cl, sl), (cr, sr), (cp, sp), (left, right))


def turned(pair: Pair, by: Pair) -> Pair:
    """Return (cos, sin) of the sum of two angles, normalised to the unit circle."""
    c = fma(pair[0], by[0], -(pair[1] * by[1]))
    s = fma(pair[0], by[1], pair[1] * by[0])
    pull = fma(-0.5, fma(c, c, s * s), 1.5)
    return (pull * c, pull * s)


def caudal_angle(phase: Pair) -> Number:
    """Return the caudal fin's angle in rad: +-30 degrees over a cycle of the phase."""
    return SWEEP * phase[1]


def caudal_joint(phase: Pair) -> Pair:
    """Return (cos, sin) of the caudal fin's angle."""
    sine, cosine = small_sine_cosine(caudal_angle(phase))
    return (cosine, sine)


def next_joints(state: State, by: Drive, h: Number) -> Joints:
    """Return the joints one step on: left, right, phase, and the three speeds over the step."""
    phase = turned(state.phase, by.phase)
    sweep = (caudal_angle(phase) - caudal_angle(state.phase)) * (1.0 / h)
    return (
        turned(state.left, by.left),
        turned(state.right, by.right),
        phase,
        (by.speeds[0], by.speeds[1], sweep),
    )


def joint_accelerations(state: State, joints: Joints, h: Number) -> Vector:
    """Return the joints' accelerations over the step to ``joints``, rad/s^2."""
    return scale(1.0 / h, subtract(joints[3], state.rates))


def at_rest(fin_angles: tuple[float, float, float]) -> State:
    """Return the state every trial starts from, on plain floats: still, upright, facing +y."""
    left, right, phase = ((math.cos(a), math.sin(a)) for a in fin_angles)
    return resting(left, right, phase)


def resting(left: Pair, right: Pair, phase: Pair) -> State:
    """Return :func:`at_rest` for the (cos, sin) of the joints."""
    zero = (0.0, 0.0, 0.0)
    return State((0.0, 0.0, 0.0, 1.0), zero, zero, zero, left, right, phase, zero)
