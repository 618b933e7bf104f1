"""Reactive terms: the added mass of body and fins in the equations of motion.

They are an option (``reactive=True``), off by default: the paper's law is drag alone.
``added_mass.py`` defines the added mass and the shedding at the tail. Added mass makes the force
depend on the acceleration that it causes, so it enters the equations of motion, which are then six
instead of three. Straight-line code for any scalar backend.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

from aquafish_gym.physics.added_mass import fin_added_mass, hull_added_mass, trailing_edge
from aquafish_gym.physics.arithmetic import (
    Matrix,
    Number,
    Symmetric,
    Vector,
    add,
    add_scaled,
    cross,
    dot,
    inverse,
    scale,
    subtract,
    times,
)
from aquafish_gym.physics.dynamics import (
    Inertia,
    Wrench,
    advance,
    forces,
    on_body,
    whole_inertia,
)
from aquafish_gym.physics.kinematics import (
    Drive,
    Numbers,
    State,
    fin_joint,
    joint_accelerations,
    next_joints,
    pairs,
    rotation,
    to_body,
    to_world,
)
from aquafish_gym.physics.robot import Fin, Robot
from aquafish_gym.plans import BodyPlan, Hull


class Motion(NamedTuple):
    """How one fin moves, in body axes.

    Its fin frame's unit vectors, its centre ``at``, the centre's velocity relative to the water,
    its spin, and its bias accelerations: those that do not depend on the body's.
    """

    across: Vector
    along: Vector
    normal: Vector
    at: Vector
    velocity: Vector
    spin: Vector
    bias: Vector
    angular_bias: Vector


class Added(NamedTuple):
    """The accelerated water's terms in the equations of motion, in body axes.

    Its inertia about the capsule's centre (the columns of ``coupling`` are the forces that
    resist angular accelerations about x, y, z), and the terms without an acceleration of the body.
    """

    linear: Symmetric
    coupling: Matrix
    angular: Symmetric
    force: Vector
    torque: Vector


def _motion(
    fin: Fin, hinge: Vector, axes: Matrix, rate: Number, qdd: Number, velocity: Vector, spin: Vector
) -> Motion:
    """Return a fin's motion; ``qdd`` is its joint's acceleration, rad/s^2."""
    across, along, normal = axes
    arm = scale(-0.5 * fin.length, along)
    at = add(hinge, arm)
    swing = scale(rate, cross(across, arm))
    carried = cross(spin, add_scaled(cross(spin, at), 2.0, swing))
    relative = add_scaled(scale(qdd, cross(across, arm)), rate, cross(across, swing))
    return Motion(
        across,
        along,
        normal,
        at,
        add(velocity, add(cross(spin, at), swing)),
        add_scaled(spin, rate, across),
        add(carried, relative),
        add_scaled(scale(qdd, across), rate, cross(spin, across)),
    )


def _outer(k: Number, a: Vector, b: Vector) -> Matrix:
    """Return the columns of k a b^T."""
    return (scale(k * b[0], a), scale(k * b[1], a), scale(k * b[2], a))


def _square(k: Number, a: Vector) -> Symmetric:
    """Return k a a^T."""
    x, y, z = scale(k, a)
    return (x * a[0], y * a[1], z * a[2], x * a[1], x * a[2], y * a[2])


def _add_symmetric(a: Symmetric, b: Symmetric) -> Symmetric:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])


def _add_matrix(a: Matrix, b: Matrix) -> Matrix:
    return (add(a[0], b[0]), add(a[1], b[1]), add(a[2], b[2]))


def _add(a: Added, b: Added) -> Added:
    return Added(
        _add_symmetric(a.linear, b.linear),
        _add_matrix(a.coupling, b.coupling),
        _add_symmetric(a.angular, b.angular),
        add(a.force, b.force),
        add(a.torque, b.torque),
    )


def _plate(mass: Number, e: Vector, motion: Motion) -> Added:
    """Return the terms of the water that moves with a fin along its unit vector ``e``.

    Its momentum is P = mass (velocity . e) e; the force is -dP/dt, and the torque about the
    fin's centre -velocity x P.
    """
    turning = cross(motion.spin, e)
    speed = dot(motion.velocity, e)
    growth = dot(motion.bias, e) + dot(motion.velocity, turning)
    force = scale(-mass, add_scaled(scale(growth, e), speed, turning))
    lever = cross(motion.at, e)
    momentum = scale(mass * speed, e)
    return Added(
        _square(mass, e),
        _outer(mass, e, lever),
        _square(mass, lever),
        force,
        subtract(cross(motion.at, force), cross(motion.velocity, momentum)),
    )


def _turning_torque(inertia: Number, e: Vector, motion: Motion) -> Vector:
    """Return minus the rate of inertia (spin . e) e, without the body's acceleration."""
    growth, turning = dot(motion.angular_bias, e), dot(motion.spin, e)
    return scale(-inertia, add_scaled(scale(growth, e), turning, cross(motion.spin, e)))


def _fin_added(fin: Fin, motion: Motion) -> Added:
    """Return the terms of the water that moves with a fin."""
    (a, b, c), (i, j, k) = fin_added_mass(fin)
    e = motion.across
    f = motion.along
    g = motion.normal
    plates = _add(_add(_plate(a, e, motion), _plate(b, f, motion)), _plate(c, g, motion))
    inertia = _add_symmetric(_square(i, e), _add_symmetric(_square(j, f), _square(k, g)))
    turning = add(_turning_torque(j, f, motion), _turning_torque(k, g, motion))
    return Added(
        plates.linear,
        plates.coupling,
        _add_symmetric(plates.angular, inertia),
        plates.force,
        add(plates.torque, add(_turning_torque(i, e, motion), turning)),
    )


def _body_added(hull: Hull, velocity: Vector, spin: Vector) -> Added:
    """Return the terms of the water that moves with the hull (Kirchhoff's equations)."""
    zero = (0.0, 0.0, 0.0)
    mass, inertia = hull_added_mass(hull)
    slip = cross(spin, velocity)
    p = (mass[0] * velocity[0], mass[1] * velocity[1], mass[2] * velocity[2])
    momentum = (inertia[0] * spin[0], inertia[1] * spin[1], inertia[2] * spin[2])
    carried = (mass[0] * slip[0], mass[1] * slip[1], mass[2] * slip[2])
    turning = add(cross(spin, momentum), cross(velocity, p))
    return Added(
        (mass[0], mass[1], mass[2], 0.0, 0.0, 0.0),
        (zero, zero, zero),
        (inertia[0], inertia[1], inertia[2], 0.0, 0.0, 0.0),
        subtract(carried, cross(spin, p)),
        scale(-1.0, turning),
    )


def added_water(plan: BodyPlan, robot: Robot, state: State, qdd: Numbers, current: Vector) -> Added:
    """Return the terms of the accelerated and the shed water in the equations of motion.

    ``qdd`` are the joints' accelerations over the step, rad/s^2, and ``current`` the water's steady
    velocity in the world, units/s.
    """
    velocity = to_body(rotation(state.orientation), subtract(state.velocity, current))
    spin = state.spin
    terms = []
    shed = []
    joints = pairs(state.joints)
    each = zip(plan.fins, robot.fins, joints, state.rates, qdd, strict=True)
    for fin_plan, fin, joint, rate, acceleration in each:
        c, s = fin_joint(fin_plan, joint)
        width, length, normal = fin_plan.frame
        axes = (
            width,
            add_scaled(scale(s, normal), c, length),
            add_scaled(scale(-s, length), c, normal),
        )
        motion = _motion(fin, fin_plan.hinge, axes, rate, acceleration, velocity, spin)
        terms.append(_fin_added(fin, motion))
        if not fin_plan.turns:
            shed.append(_shed(fin, motion))
    found = _add(functools.reduce(_add, terms), _body_added(plan.hull, velocity, spin))
    for force, torque in shed:
        found = found._replace(force=add(found.force, force), torque=add(found.torque, torque))
    return found


def _shed(fin: Fin, motion: Motion) -> Wrench:
    """Return the wrench of the water that leaves the end of a fin that sweeps."""
    half = scale(-0.5 * fin.length, motion.along)
    end = add(motion.velocity, cross(motion.spin, half))
    force = trailing_edge(fin, end, motion.along, motion.normal)
    return force, cross(add(motion.at, half), force)


def accelerations_with(whole: Inertia, added: Added, spin: Vector) -> tuple[Vector, Vector]:
    """Solve the equations of motion of a robot and its added water, in body axes.

    As :func:`~aquafish_gym.physics.dynamics.accelerations`, with a mass that depends on the
    direction: six equations, the linear three eliminated first.
    """
    m, s = whole.mass, whole.moment
    inverse_mass = inverse(_add_symmetric((m, m, m, 0.0, 0.0, 0.0), added.linear))
    rigid = ((0.0, -s[2], s[1]), (s[2], 0.0, -s[0]), (-s[1], s[0], 0.0))
    cx, cy, cz = _add_matrix(rigid, added.coupling)
    xx, yy, zz, xy, xz, yz = _add_symmetric(whole.inertia, added.angular)
    force = subtract(add(whole.force, added.force), cross(spin, cross(spin, s)))
    torque = subtract(add(whole.torque, added.torque), cross(spin, times(whole.inertia, spin)))

    free = times(inverse_mass, force)
    gx = times(inverse_mass, cx)
    gy = times(inverse_mass, cy)
    gz = times(inverse_mass, cz)
    inertia = (
        xx - dot(cx, gx),
        yy - dot(cy, gy),
        zz - dot(cz, gz),
        xy - dot(cx, gy),
        xz - dot(cx, gz),
        yz - dot(cy, gz),
    )
    torque = subtract(torque, (dot(cx, free), dot(cy, free), dot(cz, free)))
    alpha = times(inverse(inertia), torque)
    yielding = add_scaled(add_scaled(scale(alpha[0], gx), alpha[1], gy), alpha[2], gz)
    return subtract(free, yielding), alpha


def step_reactive(
    plan: BodyPlan, robot: Robot, state: State, by: Drive, current: Vector, h: Number
) -> State:
    """Advance one robot by one step; see :func:`~aquafish_gym.physics.dynamics.step`."""
    joints = next_joints(plan, state, by, h)
    qdd = joint_accelerations(state, joints, h)
    whole = whole_inertia(plan, robot, state, qdd, forces(plan, robot, state, current))
    added = added_water(plan, robot, state, qdd, current)
    return advance(state, joints, accelerations_with(whole, added, state.spin), h)


def reactive_wrench(
    plan: BodyPlan, robot: Robot, state: State, by: Drive, current: Vector, h: Number
) -> Wrench:
    """Return the water's whole wrench on the hull's centre over a step, in world axes.

    The force of the added mass depends on the acceleration, so this computes the step's own.
    """
    joints = next_joints(plan, state, by, h)
    qdd = joint_accelerations(state, joints, h)
    water = forces(plan, robot, state, current)
    added = added_water(plan, robot, state, qdd, current)
    whole = whole_inertia(plan, robot, state, qdd, water)
    a, alpha = accelerations_with(whole, added, state.spin)
    cx, cy, cz = added.coupling
    force, torque = on_body(plan, state, water)
    resisting = add_scaled(add_scaled(scale(alpha[0], cx), alpha[1], cy), alpha[2], cz)
    force = subtract(add(force, added.force), add(times(added.linear, a), resisting))
    turning = add((dot(cx, a), dot(cy, a), dot(cz, a)), times(added.angular, alpha))
    torque = subtract(add(torque, added.torque), turning)
    r = rotation(state.orientation)
    return to_world(r, force), to_world(r, torque)
