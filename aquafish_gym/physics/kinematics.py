"""Where the robot is and how its parts move: state, attitude, servos.

Frames: ``world`` is inertial; ``body`` turns with the capsule. Straight-line code for any
carrier; see ``carriers.py``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from aquafish_gym.physics.carriers import TAU, Number, Vector, arctangent2, small_sine_cosine

SWEEP = math.radians(30.0)  # caudal angle = SWEEP sin(phase)

Pair = tuple[Number, Number]
Matrix = tuple[Vector, Vector, Vector]  # rows


class State(NamedTuple):
    """Everything that changes from step to step.

    ``orientation`` is a quaternion (x, y, z, w) from body to world, ``position`` and
    ``velocity`` are the capsule centre's in the world (units, units/s), ``spin`` is the
    angular velocity in body axes (rad/s). ``left`` and ``right`` are (cos, sin) of the
    pectorals' angles, ``phase`` (cos, sin) of the caudal fin's phase, and ``rates`` the three
    joints' present speeds (rad/s).
    """

    orientation: tuple[Number, Number, Number, Number]
    position: Vector
    velocity: Vector
    spin: Vector
    left: Pair
    right: Pair
    phase: Pair
    rates: Vector


class Drive(NamedTuple):
    """A servo command as what it does in one step of length h.

    (cos, sin) of each servo's turn, and the pectorals' speeds in rad/s.
    """

    left: Pair
    right: Pair
    phase: Pair
    speeds: Pair


def joint_angles(state: State) -> Vector:
    """Return left and right pectoral angle and caudal phase in (-pi, pi], rad."""
    left, right, phase = state.left, state.right, state.phase
    return (
        arctangent2(left[1], left[0]),
        arctangent2(right[1], right[0]),
        arctangent2(phase[1], phase[0]),
    )


def rotation(q: tuple[Number, Number, Number, Number]) -> Matrix:
    """Return the rotation matrix (rows) from body to world of a unit quaternion (x, y, z, w)."""
    x, y, z, w = q
    x2, y2, z2 = x + x, y + y, z + z
    xx, yy, zz = x * x2, y * y2, z * z2
    xy, xz, yz = x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    return (
        (1.0 - (yy + zz), xy - wz, xz + wy),
        (xy + wz, 1.0 - (xx + zz), yz - wx),
        (xz - wy, yz + wx, 1.0 - (xx + yy)),
    )


def to_world(r: Matrix, v: Vector) -> Vector:
    """Turn a vector from body to world axes."""
    return (
        r[0][0] * v[0] + r[0][1] * v[1] + r[0][2] * v[2],
        r[1][0] * v[0] + r[1][1] * v[1] + r[1][2] * v[2],
        r[2][0] * v[0] + r[2][1] * v[1] + r[2][2] * v[2],
    )


def to_body(r: Matrix, v: Vector) -> Vector:
    """Turn a vector from world to body axes."""
    return (
        r[0][0] * v[0] + r[1][0] * v[1] + r[2][0] * v[2],
        r[0][1] * v[0] + r[1][1] * v[1] + r[2][1] * v[2],
        r[0][2] * v[0] + r[1][2] * v[1] + r[2][2] * v[2],
    )


def turn(
    q: tuple[Number, Number, Number, Number], spin: Vector, h: Number
) -> tuple[Number, Number, Number, Number]:
    """Turn a quaternion by ``spin`` (body axes) for a time h: the exponential map."""
    # sin(a/2) / a and cos(a/2) by their series in a^2: spins of 100 rad/s are out of the
    # question at h = 0.01, and below that eight terms leave 1e-17.
    half = 0.5 * h
    x, y, z = spin[0] * half, spin[1] * half, spin[2] * half
    a = x * x + y * y + z * z
    s = 1 - a * (1 / 42) * (1 - a * (1 / 72) * (1 - a * (1 / 110)))
    s = 1 - a * (1 / 6) * (1 - a * (1 / 20) * s)
    c = 1 - a * (1 / 30) * (1 - a * (1 / 56) * (1 - a * (1 / 90) * (1 - a * (1 / 132))))
    c = 1 - a * (1 / 2) * (1 - a * (1 / 12) * c)
    x, y, z = s * x, s * y, s * z
    turned_q = (
        q[3] * x + q[0] * c + q[1] * z - q[2] * y,
        q[3] * y - q[0] * z + q[1] * c + q[2] * x,
        q[3] * z + q[0] * y - q[1] * x + q[2] * c,
        q[3] * c - q[0] * x - q[1] * y - q[2] * z,
    )
    n = turned_q
    k = 1.0 / math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2] + n[3] * n[3])
    return (k * n[0], k * n[1], k * n[2], k * n[3])


def drive(command: Vector, h: Number) -> Drive:
    """Return the drive for a command in rev/s, rev/s and Hz."""
    left, right, caudal = TAU * command[0], TAU * command[1], TAU * command[2]
    sl, cl = small_sine_cosine(left * h)
    sr, cr = small_sine_cosine(right * h)
    sp, cp = small_sine_cosine(caudal * h)
    return Drive((cl, sl), (cr, sr), (cp, sp), (left, right))


def turned(pair: Pair, by: Pair) -> Pair:
    """Return (cos, sin) of the sum of two angles, pulled back to the unit circle."""
    c = pair[0] * by[0] - pair[1] * by[1]
    s = pair[0] * by[1] + pair[1] * by[0]
    pull = 1.5 - 0.5 * (c * c + s * s)
    return (pull * c, pull * s)


def caudal_angle(phase: Pair) -> Number:
    """Return the caudal fin's angle in rad: +-30 degrees over a cycle of the phase."""
    return SWEEP * phase[1]


def next_joints(state: State, by: Drive, h: Number) -> tuple[Pair, Pair, Pair, Vector]:
    """Return the joints one step on: left, right, phase, and the three speeds over the step."""
    phase = turned(state.phase, by.phase)
    sweep = (caudal_angle(phase) - caudal_angle(state.phase)) / h
    return (
        turned(state.left, by.left),
        turned(state.right, by.right),
        phase,
        (by.speeds[0], by.speeds[1], sweep),
    )


def at_rest(fin_angles: tuple[float, float, float]) -> State:
    """Return the state every trial starts from, on plain floats: still, upright, facing +y."""
    left, right, phase = ((math.cos(a), math.sin(a)) for a in fin_angles)
    zero = (0.0, 0.0, 0.0)
    return State((0.0, 0.0, 0.0, 1.0), zero, zero, zero, left, right, phase, zero)
