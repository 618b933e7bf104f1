"""The robot's state, its attitude and its servos.

Frames: ``world`` is inertial; ``body`` turns with the capsule. Straight-line code for any
scalar backend; see ``arithmetic.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from aquafish_gym.physics.arithmetic import (
    TAU,
    Matrix,
    Number,
    Vector,
    arctangent2,
    dot,
    fma,
    small_sine_cosine,
    where_less,
)
from aquafish_gym.plans import BodyPlan, FinPlan

# A robot has diverged once the squares of its velocity (units/s) and spin (rad/s) sum to this,
# though its numbers may stay finite for some steps more. (Bullet cuts speeds off, so that a robot
# that runs away never reaches infinity there.)
RUNAWAY_SQUARE = 1e12

Pair = tuple[Number, Number]
Numbers = tuple[Number, ...]


class State(NamedTuple):
    """Everything that changes from step to step; position and velocity are the hull centre's."""

    orientation: tuple[Number, Number, Number, Number]  # (x, y, z, w) from body to world
    position: Vector  # in the world, units
    velocity: Vector  # in the world, units/s
    spin: Vector  # in body axes, rad/s
    joints: Numbers  # cos and sin of each fin's angle in turn, or of the phase of one that sweeps
    rates: Numbers  # the joints' present speeds, rad/s


class Joints(NamedTuple):
    """How a state's joints stand and turn."""

    joints: Numbers
    rates: Numbers


class Drive(NamedTuple):
    """A command's effect in one step: cos and sin of each servo's turn, and its speed, rad/s."""

    turns: Numbers
    speeds: Numbers


def state_like(plan: BodyPlan) -> State:
    """Return a state of zeros, which has the shape of the plan's."""
    zero = (0.0, 0.0, 0.0)
    fins = len(plan.fins)
    return State((0.0,) * 4, zero, zero, zero, (0.0,) * 2 * fins, (0.0,) * fins)


def drive_like(plan: BodyPlan) -> Drive:
    """Return a drive of zeros, which has the shape of the plan's."""
    fins = len(plan.fins)
    return Drive((0.0,) * 2 * fins, (0.0,) * fins)


def has_diverged(state: State) -> Number:
    """Return 1 where a robot ran away or its numbers are not finite, else 0; see RUNAWAY_SQUARE."""
    square = 0.0 * state.spin[0]  # NaN if a number is infinite or NaN
    for x in state.orientation + state.position + state.joints:
        square = square + 0.0 * x
    for x in state.rates:
        square = square + 0.0 * x
    for x in state.velocity + state.spin:
        square = square + x * x
    return where_less(square, RUNAWAY_SQUARE, 0.0, 1.0)


def pairs(numbers: Numbers) -> list[Pair]:
    """Return the (cos, sin) of each fin of those of all in turn."""
    return list(zip(numbers[::2], numbers[1::2], strict=True))


def joint_angles(joints: Numbers) -> Numbers:
    """Return the angles, and phases of fins that sweep, in (-pi, pi], rad."""
    return tuple(arctangent2(sine, cosine) for cosine, sine in pairs(joints))


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


def drive(command: Iterable[Number], h: Number) -> Drive:
    """Return the drive for a command, rev/s or Hz."""
    speeds = tuple(TAU * x for x in command)
    turns: list[Number] = []
    for speed in speeds:
        sine, cosine = small_sine_cosine(speed * h)
        turns += [cosine, sine]
    return Drive(tuple(turns), speeds)


def turned(pair: Pair, by: Pair) -> Pair:
    """Return (cos, sin) of the sum of two angles, normalised to the unit circle."""
    c = fma(pair[0], by[0], -(pair[1] * by[1]))
    s = fma(pair[0], by[1], pair[1] * by[0])
    pull = fma(-0.5, fma(c, c, s * s), 1.5)
    return (pull * c, pull * s)


def fin_angle(fin: FinPlan, joint: Pair) -> Number:
    """Return the angle of a fin that sweeps, rad, of the (cos, sin) of its phase."""
    return fin.sweep * joint[1]


def fin_joint(fin: FinPlan, joint: Pair) -> Pair:
    """Return (cos, sin) of a fin's angle."""
    if fin.turns:
        return joint
    sine, cosine = small_sine_cosine(fin_angle(fin, joint))
    return (cosine, sine)


def next_joints(plan: BodyPlan, state: State, by: Drive, h: Number) -> Joints:
    """Return the joints one step on, and their speeds over the step."""
    before = pairs(state.joints)
    after = list(map(turned, before, pairs(by.turns)))
    rates = []
    for fin, old, new, speed in zip(plan.fins, before, after, by.speeds, strict=True):
        swept = (fin_angle(fin, new) - fin_angle(fin, old)) * (1.0 / h)
        rates.append(speed if fin.turns else swept)
    return Joints(tuple(x for pair in after for x in pair), tuple(rates))


def joint_accelerations(state: State, joints: Joints, h: Number) -> Numbers:
    """Return the joints' accelerations over the step to ``joints``, rad/s^2."""
    return tuple(
        (1.0 / h) * (after - now) for now, after in zip(state.rates, joints.rates, strict=True)
    )


def at_rest(fin_angles: Iterable[float]) -> State:
    """Return the state every trial starts from, on plain floats: still, upright, facing +y."""
    return resting(tuple(of(angle) for angle in fin_angles for of in (math.cos, math.sin)))


def resting(joints: Numbers) -> State:
    """Return :func:`at_rest` for the cos and sin of each joint in turn."""
    zero = (0.0, 0.0, 0.0)
    rates = (0.0,) * (len(joints) // 2)
    return State((0.0, 0.0, 0.0, 1.0), zero, zero, zero, joints, rates)
