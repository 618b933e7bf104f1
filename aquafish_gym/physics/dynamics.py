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

from typing import NamedTuple

from aquafish_gym.physics.carriers import (
    Number,
    Vector,
    add,
    cross,
    scale,
    small_sine_cosine,
)
from aquafish_gym.physics.hydrodynamics import body_drag, fin_drag
from aquafish_gym.physics.kinematics import (
    Drive,
    Pair,
    State,
    caudal_angle,
    next_joints,
    rotation,
    to_body,
    to_world,
    turn,
)
from aquafish_gym.robot import BODY_INERTIA, BODY_MASS, CAUDAL_Y, PECTORAL_X, PECTORAL_Y, Fin, Robot

Wrench = tuple[Vector, Vector]  # force, torque
Symmetric = tuple[Number, Number, Number, Number, Number, Number]  # xx, yy, zz, xy, xz, yz

_LEFT_HINGE = (-PECTORAL_X, PECTORAL_Y, 0.0)
_RIGHT_HINGE = (PECTORAL_X, PECTORAL_Y, 0.0)
_CAUDAL_HINGE = (0.0, CAUDAL_Y, 0.0)


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


class Water(NamedTuple):
    """The water's (force, torque about the body's centre) on each part.

    Each fin's are in its hinge frame's axes, the body's in body axes.
    """

    left: Wrench
    right: Wrench
    caudal: Wrench
    body: Wrench


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
) -> Wrench:
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
    water: Wrench,
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


def forces(robot: Robot, state: State, current: Vector) -> Water:
    """Return what the water does to each part of the robot.

    Parameters
    ----------
    robot
        Fin sizes.
    state
        Of body and joints.
    current
        The water's own velocity in the world, units/s.
    """
    velocity = to_body(rotation(state.orientation), add(state.velocity, scale(-1.0, current)))
    spin, rates = state.spin, state.rates
    sine, cosine = small_sine_cosine(caudal_angle(state.phase))
    return Water(
        _fin_water(robot.left, _LEFT_HINGE, state.left, rates[0], velocity, spin),
        _fin_water(robot.right, _RIGHT_HINGE, state.right, rates[1], velocity, spin),
        _fin_water(
            robot.caudal,
            _to_caudal(_CAUDAL_HINGE),
            (cosine, sine),
            rates[2],
            _to_caudal(velocity),
            _to_caudal(spin),
        ),
        body_drag(velocity, spin),
    )


def wrench(robot: Robot, state: State, current: Vector) -> tuple[Vector, Vector]:
    """Return the water's whole force on the robot and its torque about the capsule's centre.

    This is the one lumped wrench that PyBullet is given: both are in world axes.
    """
    r = rotation(state.orientation)
    left, right, tail, body = forces(robot, state, current)
    force = add(add(left[0], right[0]), add(_from_caudal(tail[0]), body[0]))
    torque = add(add(left[1], right[1]), add(_from_caudal(tail[1]), body[1]))
    return to_world(r, force), to_world(r, torque)


def step(robot: Robot, state: State, by: Drive, current: Vector, h: Number) -> State:
    """Advance one robot in the water by one step of length ``h`` seconds.

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
        Seconds. The scheme is explicit, so h must stay well under the time in which drag stops
        the lightest motion; 0.01 does for every body within the limits.
    """
    return move(robot, state, by, forces(robot, state, current), h)


def move(robot: Robot, state: State, by: Drive, water: Water, h: Number) -> State:
    """Advance one robot by one step under given forces: Newton and Euler, then Bullet's scheme."""
    spin, now = state.spin, state.rates
    left, right, phase, rates = next_joints(state, by, h)
    sine, cosine = small_sine_cosine(caudal_angle(state.phase))
    per_h = 1.0 / h
    push = (
        (rates[0] - now[0]) * per_h,
        (rates[1] - now[1]) * per_h,
        (rates[2] - now[2]) * per_h,
    )
    a = _fin_share(robot.left, _LEFT_HINGE, state.left, now[0], push[0], spin, water.left)
    b = _fin_share(robot.right, _RIGHT_HINGE, state.right, now[1], push[1], spin, water.right)
    c = _caudal_share_to_body(
        _fin_share(
            robot.caudal,
            _to_caudal(_CAUDAL_HINGE),
            (cosine, sine),
            now[2],
            push[2],
            _to_caudal(spin),
            water.caudal,
        )
    )

    # Newton: M a - s x alpha = F. Euler about the centre: s x a + I alpha = T. Eliminating a
    # leaves (I + [s][s] / M) alpha = T - s x F / M.
    force = add(add(a.force, b.force), add(c.force, water.body[0]))
    torque = add(add(a.torque, b.torque), add(c.torque, water.body[1]))
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
    acceleration = scale(per_mass, add(force, cross(s, alpha)))

    velocity = add(state.velocity, scale(h, to_world(rotation(state.orientation), acceleration)))
    new_spin = add(spin, scale(h, alpha))
    return State(
        turn(state.orientation, new_spin, h),
        add(state.position, scale(h, velocity)),
        velocity,
        new_spin,
        left,
        right,
        phase,
        rates,
    )
