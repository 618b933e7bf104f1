"""The robot's motion: the only statement of one time step, in Bullet's scheme.

The servos *prescribe* the joints' motion, so the unknown is the body's motion alone. At the
state (q_n, v_n) the joints' next speeds follow from their angles at t and t + h, the body's
acceleration from Newton's and Euler's equations of the whole, and then

    v_{n+1} = v_n + h v'_n        x_{n+1} = x_n + h v_{n+1}

with the attitude by the exponential map: what Bullet does with ideal motors, to rounding.

Frames: ``world`` is inertial; ``body`` turns with the capsule; each fin's ``hinge`` and
``fin`` frames are those of ``robot.py``. Straight-line code for any carrier; see
``carriers.py``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from aquafish_gym.physics.carriers import (
    TAU,
    Number,
    Vector,
    add,
    cross,
    scale,
    small_sine_cosine,
)
from aquafish_gym.physics.hydrodynamics import body_drag, fin_drag
from aquafish_gym.robot import BODY_INERTIA, BODY_MASS, CAUDAL_Y, PECTORAL_X, PECTORAL_Y, Fin, Robot

SWEEP = math.radians(30.0)  # caudal angle = SWEEP sin(phase)

Pair = tuple[Number, Number]
Matrix = tuple[Vector, Vector, Vector]  # rows
Symmetric = tuple[Number, Number, Number, Number, Number, Number]  # xx, yy, zz, xy, xz, yz

_LEFT_HINGE = (-PECTORAL_X, PECTORAL_Y, 0.0)
_RIGHT_HINGE = (PECTORAL_X, PECTORAL_Y, 0.0)
_CAUDAL_HINGE = (0.0, CAUDAL_Y, 0.0)


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


class Share(NamedTuple):
    """What one fin brings to the body's equations of motion, in body axes about the centre.

    ``moment`` is mass times position of its centre and ``inertia`` its own about the body's
    centre; ``force`` and ``torque`` are the water's less the terms of inertia that do not
    multiply the body's acceleration.
    """

    mass: Number
    moment: Vector
    inertia: Symmetric
    force: Vector
    torque: Vector


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


def _to_fin(joint: Pair, v: Vector) -> Vector:
    """Turn a vector from the hinge frame to the fin frame; ``joint`` is (cos, sin)."""
    return (v[0], joint[0] * v[1] + joint[1] * v[2], joint[0] * v[2] - joint[1] * v[1])


def _to_hinge(joint: Pair, v: Vector) -> Vector:
    """Turn a vector from the fin frame to the hinge frame."""
    return (v[0], joint[0] * v[1] - joint[1] * v[2], joint[1] * v[1] + joint[0] * v[2])


# The caudal fin's hinge frame has the axes (z, y, -x) of the body.
def _to_caudal(v: Vector) -> Vector:
    return (v[2], v[1], -v[0])


def _from_caudal(v: Vector) -> Vector:
    return (-v[2], v[1], v[0])


def _fin_water(
    fin: Fin, hinge: Vector, joint: Pair, rate: Number, velocity: Vector, spin: Vector
) -> tuple[Vector, Vector]:
    """Return the water's force on a fin and its torque about the body's centre.

    All vectors are in the hinge frame's axes; ``velocity`` is the body centre's relative to
    the water.
    """
    at_hinge = add(velocity, cross(spin, hinge))
    fin_spin = (spin[0] + rate, spin[1], spin[2])
    force, torque = fin_drag(fin, _to_fin(joint, at_hinge), _to_fin(joint, fin_spin))
    force = _to_hinge(joint, force)
    return force, add(_to_hinge(joint, torque), cross(hinge, force))


def _fin_share(
    fin: Fin,
    hinge: Vector,
    joint: Pair,
    rate: Number,
    acceleration: Number,
    spin: Vector,
    water: tuple[Vector, Vector],
) -> Share:
    """Return one fin's share, in the hinge frame's axes (still about the body's centre)."""
    c, s = joint
    half = 0.5 * fin.length
    arm = (0.0 * half, -half * c, -half * s)  # hinge to the fin's centre
    at = add(hinge, arm)

    # The fin's inertia about its own centre, then about the body's (parallel axes).
    ia, ib, ic = fin.inertia
    ibb = c * c * ib + s * s * ic
    icc = s * s * ib + c * c * ic
    ibc = c * s * (ib - ic)
    m = fin.mass
    squares = (at[0] * at[0], at[1] * at[1], at[2] * at[2])
    inertia = (
        ia + m * (squares[1] + squares[2]),
        ibb + m * (squares[0] + squares[2]),
        icc + m * (squares[0] + squares[1]),
        -m * at[0] * at[1],
        -m * at[0] * at[2],
        ibc - m * at[1] * at[2],
    )

    # Acceleration of the fin's centre that the body's own acceleration does not explain:
    # w x (w x r) + 2 w x u + joint terms, where u = rate a x arm and a = (1, 0, 0).
    swing = (arm[0], -rate * arm[2], rate * arm[1])
    spin_at = cross(spin, at)
    carried = cross(spin, (spin_at[0], spin_at[1] + 2.0 * swing[1], spin_at[2] + 2.0 * swing[2]))
    rr = rate * rate
    left_over = (
        carried[0],
        carried[1] - acceleration * arm[2] - rr * arm[1],
        carried[2] + acceleration * arm[1] - rr * arm[2],
    )
    inertial = scale(m, left_over)

    # Rate of change of the fin's own angular momentum, likewise: I (w x rate a + acc a)
    # + W x (I W) with W = w + rate a.
    whole = (spin[0] + rate, spin[1], spin[2])
    twist = (acceleration, rate * spin[2], -rate * spin[1])
    momentum = (
        ia * whole[0],
        ibb * whole[1] + ibc * whole[2],
        ibc * whole[1] + icc * whole[2],
    )
    gyroscopic = cross(whole, momentum)
    turning = (
        ia * twist[0] + gyroscopic[0],
        ibb * twist[1] + ibc * twist[2] + gyroscopic[1],
        ibc * twist[1] + icc * twist[2] + gyroscopic[2],
    )
    torque = add(turning, cross(at, inertial))
    return Share(
        m,
        scale(m, at),
        inertia,
        add(water[0], scale(-1.0, inertial)),
        add(water[1], scale(-1.0, torque)),
    )


def _caudal_share_to_body(share: Share) -> Share:
    """Turn a share from the caudal hinge frame's axes (z, y, -x) to the body's."""
    zz, yy, xx, zy, zx, yx = share.inertia
    return Share(
        share.mass,
        _from_caudal(share.moment),
        (xx, yy, zz, -yx, -zx, zy),
        _from_caudal(share.force),
        _from_caudal(share.torque),
    )


def solve_symmetric(a: Symmetric, b: Vector) -> Vector:
    """Solve a x = b for a positive definite 3 x 3 matrix (its cofactors)."""
    xx, yy, zz, xy, xz, yz = a
    c00 = yy * zz - yz * yz
    c01 = xz * yz - xy * zz
    c02 = xy * yz - xz * yy
    c11 = xx * zz - xz * xz
    c12 = xy * xz - xx * yz
    c22 = xx * yy - xy * xy
    k = 1.0 / (xx * c00 + xy * c01 + xz * c02)
    return (
        k * (c00 * b[0] + c01 * b[1] + c02 * b[2]),
        k * (c01 * b[0] + c11 * b[1] + c12 * b[2]),
        k * (c02 * b[0] + c12 * b[1] + c22 * b[2]),
    )


def _water_on_fins(
    robot: Robot, state: State, caudal: Pair, velocity: Vector
) -> tuple[tuple[Vector, Vector], tuple[Vector, Vector], tuple[Vector, Vector]]:
    """Return each fin's (force, torque) from the water, each in its hinge frame's axes."""
    spin, rates = state.spin, state.rates
    return (
        _fin_water(robot.left, _LEFT_HINGE, state.left, rates[0], velocity, spin),
        _fin_water(robot.right, _RIGHT_HINGE, state.right, rates[1], velocity, spin),
        _fin_water(
            robot.caudal,
            _to_caudal(_CAUDAL_HINGE),
            caudal,
            rates[2],
            _to_caudal(velocity),
            _to_caudal(spin),
        ),
    )


def wrench(robot: Robot, state: State, current: Vector) -> tuple[Vector, Vector]:
    """Return the water's whole force on the robot and its torque about the capsule's centre.

    This is the one lumped wrench that PyBullet is given.

    Parameters
    ----------
    current
        The water's own velocity in the world, units/s.

    Returns
    -------
    force, torque
        In world axes.
    """
    r = rotation(state.orientation)
    velocity = to_body(r, add(state.velocity, scale(-1.0, current)))
    sine, cosine = small_sine_cosine(caudal_angle(state.phase))
    left, right, tail = _water_on_fins(robot, state, (cosine, sine), velocity)
    body = body_drag(velocity, state.spin)
    force = add(add(left[0], right[0]), add(_from_caudal(tail[0]), body[0]))
    torque = add(add(left[1], right[1]), add(_from_caudal(tail[1]), body[1]))
    return to_world(r, force), to_world(r, torque)


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


def step(robot: Robot, state: State, by: Drive, current: Vector, h: Number) -> State:
    """Advance one robot by one step of length ``h`` seconds.

    Parameters
    ----------
    robot
        Fin sizes and mass properties.
    state
        At the step's beginning.
    by
        The servos' motion over the step, from :func:`drive` with the same ``h``.
    current
        The water's own velocity in the world, units/s.
    h
        Seconds. Explicit, so h = 0.01 is needed: the fastest drag rate seen is 51/s.
    """
    r = rotation(state.orientation)
    spin = state.spin
    velocity = to_body(r, add(state.velocity, scale(-1.0, current)))
    left, right, phase, rates = next_joints(state, by, h)
    sine, cosine = small_sine_cosine(caudal_angle(state.phase))
    caudal = (cosine, sine)
    water = _water_on_fins(robot, state, caudal, velocity)
    body_force, body_torque = body_drag(velocity, spin)

    now = state.rates
    one_over_h = 1.0 / h
    a = _fin_share(
        robot.left,
        _LEFT_HINGE,
        state.left,
        now[0],
        (rates[0] - now[0]) * one_over_h,
        spin,
        water[0],
    )
    b = _fin_share(
        robot.right,
        _RIGHT_HINGE,
        state.right,
        now[1],
        (rates[1] - now[1]) * one_over_h,
        spin,
        water[1],
    )
    c = _caudal_share_to_body(
        _fin_share(
            robot.caudal,
            _to_caudal(_CAUDAL_HINGE),
            caudal,
            now[2],
            (rates[2] - now[2]) * one_over_h,
            _to_caudal(spin),
            water[2],
        )
    )

    # Newton: M a - s x alpha = F. Euler about the centre: s x a + I alpha = T. Eliminating a
    # leaves (I + [s][s] / M) alpha = T - s x F / M.
    force = add(add(a.force, b.force), add(c.force, body_force))
    torque = add(add(a.torque, b.torque), add(c.torque, body_torque))
    capsule_momentum = (
        BODY_INERTIA[0] * spin[0],
        BODY_INERTIA[1] * spin[1],
        BODY_INERTIA[2] * spin[2],
    )
    torque = add(torque, cross(capsule_momentum, spin))
    s = add(add(a.moment, b.moment), c.moment)
    per_mass = 1.0 / (BODY_MASS + (a.mass + b.mass + c.mass))
    i, j, k = a.inertia, b.inertia, c.inertia
    xx, yy, zz = s[0] * s[0] * per_mass, s[1] * s[1] * per_mass, s[2] * s[2] * per_mass
    whole = (
        BODY_INERTIA[0] + (i[0] + j[0] + k[0]) - (yy + zz),
        BODY_INERTIA[1] + (i[1] + j[1] + k[1]) - (xx + zz),
        BODY_INERTIA[2] + (i[2] + j[2] + k[2]) - (xx + yy),
        i[3] + j[3] + k[3] + s[0] * s[1] * per_mass,
        i[4] + j[4] + k[4] + s[0] * s[2] * per_mass,
        i[5] + j[5] + k[5] + s[1] * s[2] * per_mass,
    )
    alpha = solve_symmetric(whole, add(torque, scale(-per_mass, cross(s, force))))
    acceleration = to_world(r, scale(per_mass, add(force, cross(s, alpha))))

    new_velocity = add(state.velocity, scale(h, acceleration))
    new_spin = add(spin, scale(h, alpha))
    return State(
        turn(state.orientation, new_spin, h),
        add(state.position, scale(h, new_velocity)),
        new_velocity,
        new_spin,
        left,
        right,
        phase,
        rates,
    )


def at_rest(fin_angles: tuple[float, float, float]) -> State:
    """Return the state every trial starts from, on plain floats: still, upright, facing +y."""
    left, right, phase = ((math.cos(a), math.sin(a)) for a in fin_angles)
    zero = (0.0, 0.0, 0.0)
    return State((0.0, 0.0, 0.0, 1.0), zero, zero, zero, left, right, phase, zero)
