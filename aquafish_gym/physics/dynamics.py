"""One time step of the robot's motion, stated once, in Bullet's scheme.

The servos *prescribe* the joints' motion, so the unknown is the body's motion alone. At the
state (q_n, v_n) the joints' next speeds follow from their angles at t and t + h, the body's
acceleration from Newton's and Euler's equations of the whole robot, and then

    v_{n+1} = v_n + h v'_n        x_{n+1} = x_n + h v_{n+1}

with the attitude by the exponential map. Bullet with ideal motors does the same, to rounding.

Frames: ``world`` is inertial; ``body`` turns with the capsule; each fin's ``hinge`` and
``fin`` frames are those of ``robot.py``. Straight-line code for any scalar backend; see
``arithmetic.py``.
"""

from __future__ import annotations

from typing import NamedTuple

from aquafish_gym.physics.arithmetic import (
    Number,
    Symmetric,
    Vector,
    add,
    add_scaled,
    cross,
    fma,
    inverse,
    scale,
    subtract,
    times,
)
from aquafish_gym.physics.hydrodynamics import body_drag, fin_drag
from aquafish_gym.physics.kinematics import (
    Drive,
    Joints,
    Pair,
    State,
    caudal_joint,
    joint_accelerations,
    next_joints,
    rotation,
    to_body,
    to_world,
    turn,
)
from aquafish_gym.physics.robot import (
    BODY_INERTIA,
    BODY_MASS,
    CAUDAL_Y,
    PECTORAL_X,
    PECTORAL_Y,
    Fin,
    Robot,
)

Wrench = tuple[Vector, Vector]  # force, torque


class Water(NamedTuple):
    """The water's wrench on each part: a fin's in its fin frame, about its hinge; the body's in
    body axes, about its centre.
    """

    left: Wrench
    right: Wrench
    caudal: Wrench
    body: Wrench


class FinInertia(NamedTuple):
    """One fin's rigid-body inertia, for a hinge in the middle plane, and the force on it.

    In the hinge frame's axes and about the body's centre: mass times position of its centre
    (length, normal), inertia (aa, bb, cc, bc), and the water's wrench less the bias force of the
    joint's own motion.
    """

    mass: Number
    moment: Pair
    inertia: tuple[Number, Number, Number, Number]
    force: Vector
    torque: Vector


class CompositeInertia(NamedTuple):
    """The inertia of body and fins as one rigid body, and the force on it.

    In body axes about the capsule's centre. ``moment`` is mass times position of the centre of
    mass. The force is the water's wrench less the fins' bias forces; the rigid body's own
    rotation is not subtracted yet.
    """

    mass: Number
    moment: Vector
    inertia: Symmetric
    force: Vector
    torque: Vector


# The hinges lie at (x, y, 0) of their frames: the pectorals' at (+-PECTORAL_X, PECTORAL_Y), the
# caudal fin's at (0, CAUDAL_Y). The functions of one fin leave x out; the sums over fins add it
# for the pectorals.


def _to_fin(joint: Pair, v: Vector) -> Vector:
    """Turn a vector from the hinge frame to the fin frame; ``joint`` is (cos, sin)."""
    c, s = joint
    return (v[0], fma(c, v[1], s * v[2]), fma(c, v[2], -(s * v[1])))


def _to_hinge(joint: Pair, v: Vector) -> Vector:
    """Turn a vector from the fin frame to the hinge frame."""
    c, s = joint
    return (v[0], fma(c, v[1], -(s * v[2])), fma(s, v[1], c * v[2]))


# The caudal fin's hinge frame has the axes (z, y, -x) of the body.
def _to_caudal(v: Vector) -> Vector:
    return (v[2], v[1], -v[0])


def _from_caudal(v: Vector) -> Vector:
    return (-v[2], v[1], v[0])


def _at_hinge(x: float, velocity: Vector, spin: Vector) -> Vector:
    """Return the velocity of a pectoral's hinge without the term of ``PECTORAL_Y``."""
    return (velocity[0], fma(x, spin[2], velocity[1]), fma(-x, spin[1], velocity[2]))


def _fin_water(
    fin: Fin, y: float, joint: Pair, rate: Number, velocity: Vector, spin: Vector
) -> Wrench:
    """Return the water's wrench on a fin, in its fin frame and about its hinge at (0, y).

    ``velocity`` is the body centre's relative to the water, in the hinge frame's axes.
    """
    at_hinge = (fma(-y, spin[2], velocity[0]), velocity[1], fma(y, spin[0], velocity[2]))
    fin_spin = (spin[0] + rate, spin[1], spin[2])
    return fin_drag(fin, _to_fin(joint, at_hinge), _to_fin(joint, fin_spin))


def _to_centre(y: float, joint: Pair, on_fin: Wrench) -> Wrench:
    """Move a wrench from a fin frame to the hinge frame's axes, about the body's centre."""
    force, torque = _to_hinge(joint, on_fin[0]), _to_hinge(joint, on_fin[1])
    return force, (fma(y, force[2], torque[0]), torque[1], fma(-y, force[0], torque[2]))


def _sum(left: Wrench, right: Wrench, caudal: Wrench, body: Wrench) -> Wrench:
    """Add up wrenches about the body's centre, in body axes; the fins' are of ``_to_centre``."""
    force = add(add(left[0], right[0]), add(_from_caudal(caudal[0]), body[0]))
    torque = add(add(left[1], right[1]), add(_from_caudal(caudal[1]), body[1]))
    apart = subtract(right[0], left[0])
    return force, (
        torque[0],
        fma(-PECTORAL_X, apart[2], torque[1]),
        fma(PECTORAL_X, apart[1], torque[2]),
    )


def _fin_inertia(
    fin: Fin, y: float, joint: Pair, rate: Number, acceleration: Number, spin: Vector, water: Wrench
) -> FinInertia:
    """Return one fin's inertia and force, in the hinge frame's axes, for a hinge at (0, y)."""
    c, s = joint
    half = 0.5 * fin.length
    m = fin.mass
    first = m * half
    ia, ib, ic = fin.inertia

    # The fin's inertia about its own centre at (0, aft, up), then about the body's.
    aft, up = fma(-half, c, y), -half * s
    m_aft, m_up = m * aft, m * up
    lean = c * (ib - ic)
    ibb = fma(c, lean, ic)
    inertia = (
        fma(m_aft, aft, fma(m_up, up, ia)),
        fma(m_up, up, ibb),
        fma(m_aft, aft, (ib + ic) - ibb),
        fma(s, lean, -(m_aft * up)),
    )

    # The bias force, which the joint's motion adds to the inertial forces, in the fin frame and
    # about the hinge: with arm r = (0, -half, 0), joint axis a = (1, 0, 0), its speed and
    # acceleration, the force m (2 w x (speed a x r) + acceleration a x r + speed^2 a x (a x r))
    # and the torque I (acceleration a + w x speed a) + speed a x I W + w x I speed a, where w
    # is the body's spin, W = w + speed a the fin's and I its inertia about the hinge.
    w1, w2 = fma(c, spin[1], s * spin[2]), fma(c, spin[2], -(s * spin[1]))
    about_a, about_c = fma(first, half, ia), fma(first, half, ic)
    swing = first * rate
    force = (-2.0 * swing * w1, swing * fma(2.0, spin[0], rate), -first * acceleration)
    torque = (
        about_a * acceleration,
        rate * w2 * (about_a + ib - about_c),
        -rate * w1 * (about_a + about_c - ib),
    )
    force, torque = _to_centre(y, joint, (subtract(water[0], force), subtract(water[1], torque)))
    return FinInertia(m, (m_aft, m_up), inertia, force, torque)


def forces(robot: Robot, state: State, current: Vector) -> Water:
    """Return the water's wrench on each part; ``current`` is its velocity in the world."""
    velocity = to_body(rotation(state.orientation), subtract(state.velocity, current))
    spin, rates = state.spin, state.rates
    left = _at_hinge(-PECTORAL_X, velocity, spin)
    right = _at_hinge(PECTORAL_X, velocity, spin)
    tail, tail_joint = _to_caudal(velocity), caudal_joint(state.phase)
    force, torque = body_drag(velocity, spin)
    return Water(
        _fin_water(robot.left, PECTORAL_Y, state.left, rates[0], left, spin),
        _fin_water(robot.right, PECTORAL_Y, state.right, rates[1], right, spin),
        _fin_water(robot.caudal, CAUDAL_Y, tail_joint, rates[2], tail, _to_caudal(spin)),
        (scale(robot.drag, force), scale(robot.drag, torque)),
    )


def on_body(state: State, water: Water) -> Wrench:
    """Return the water's whole force and its torque about the capsule's centre, in body axes."""
    return _sum(
        _to_centre(PECTORAL_Y, state.left, water.left),
        _to_centre(PECTORAL_Y, state.right, water.right),
        _to_centre(CAUDAL_Y, caudal_joint(state.phase), water.caudal),
        water.body,
    )


def wrench(robot: Robot, state: State, current: Vector) -> Wrench:
    """Return :func:`on_body` in world axes: the lumped wrench for PyBullet."""
    force, torque = on_body(state, forces(robot, state, current))
    r = rotation(state.orientation)
    return to_world(r, force), to_world(r, torque)


def step(robot: Robot, state: State, by: Drive, current: Vector, h: Number) -> State:
    """Advance one robot in the water by one step of length ``h`` seconds.

    ``by`` is from :func:`drive` with the same ``h``; ``current`` is the water's velocity in the
    world, units/s. The scheme is explicit, so h must be much shorter than the time in which drag
    stops the lightest motion; 0.01 is enough for every body within the limits.
    """
    return move(robot, state, by, forces(robot, state, current), h)


def move(robot: Robot, state: State, by: Drive, water: Water, h: Number) -> State:
    """Advance one robot by one step under given forces: Newton and Euler, then Bullet's scheme."""
    joints = next_joints(state, by, h)
    composite = composite_inertia(robot, state, joint_accelerations(state, joints, h), water)
    return advance(state, joints, accelerations(composite, state.spin), h)


def composite_inertia(robot: Robot, state: State, qdd: Vector, water: Water) -> CompositeInertia:
    """Sum body and fins; ``qdd`` is the joints' accelerations, rad/s^2."""
    spin, now = state.spin, state.rates
    a = _fin_inertia(robot.left, PECTORAL_Y, state.left, now[0], qdd[0], spin, water.left)
    b = _fin_inertia(robot.right, PECTORAL_Y, state.right, now[1], qdd[1], spin, water.right)
    joint, tail_spin = caudal_joint(state.phase), _to_caudal(spin)
    c = _fin_inertia(robot.caudal, CAUDAL_Y, joint, now[2], qdd[2], tail_spin, water.caudal)
    force, torque = _sum((a.force, a.torque), (b.force, b.torque), (c.force, c.torque), water.body)
    # The caudal hinge's axes are the body's (z, y, -x).
    i = a.inertia
    j = b.inertia
    k = c.inertia
    outboard = PECTORAL_X * PECTORAL_X * (a.mass + b.mass)
    return CompositeInertia(
        BODY_MASS + (a.mass + b.mass + c.mass),
        (
            fma(PECTORAL_X, b.mass - a.mass, -c.moment[1]),
            a.moment[0] + b.moment[0] + c.moment[0],
            a.moment[1] + b.moment[1],
        ),
        (
            BODY_INERTIA[0] + (i[0] + j[0] + k[2]),
            BODY_INERTIA[1] + (i[1] + j[1] + k[1] + outboard),
            BODY_INERTIA[2] + (i[2] + j[2] + k[0] + outboard),
            fma(-PECTORAL_X, b.moment[0] - a.moment[0], -k[3]),
            -PECTORAL_X * (b.moment[1] - a.moment[1]),
            i[3] + j[3],
        ),
        force,
        torque,
    )


def accelerations(composite: CompositeInertia, spin: Vector) -> tuple[Vector, Vector]:
    """Return the linear acceleration of the capsule's centre and the angular one, in body axes.

    They solve Newton's and Euler's equations.
    """
    # About the centre of mass the two equations decouple: first the inertia there, ...
    s, per_mass = composite.moment, 1.0 / composite.mass
    centre = scale(per_mass, s)
    xx, yy, zz, xy, xz, yz = composite.inertia
    inertia = (
        fma(-s[1], centre[1], fma(-s[2], centre[2], xx)),
        fma(-s[0], centre[0], fma(-s[2], centre[2], yy)),
        fma(-s[0], centre[0], fma(-s[1], centre[1], zz)),
        fma(s[0], centre[1], xy),
        fma(s[0], centre[2], xz),
        fma(s[1], centre[2], yz),
    )
    # ... then Euler for the whole, and Newton for the capsule's centre.
    torque = subtract(composite.torque, cross(centre, composite.force))
    alpha = times(inverse(inertia), subtract(torque, cross(spin, times(inertia, spin))))
    turning = add(cross(alpha, centre), cross(spin, cross(spin, centre)))
    return subtract(scale(per_mass, composite.force), turning), alpha


def advance(state: State, joints: Joints, accelerations: tuple[Vector, Vector], h: Number) -> State:
    """Return the state after a step of length h: Bullet's scheme."""
    acceleration, alpha = accelerations
    left, right, phase, rates = joints
    velocity = add_scaled(state.velocity, h, to_world(rotation(state.orientation), acceleration))
    spin = add_scaled(state.spin, h, alpha)
    position = add_scaled(state.position, h, velocity)
    orientation = turn(state.orientation, spin, h)
    return State(orientation, position, velocity, spin, left, right, phase, rates)
