"""Reactive terms: the water that accelerates with body and fins, and what the tail sheds.

They are an option (``reactive=True``), off by default: drag alone is the paper's kind of law.
Three terms, all after Lighthill's elongated-body theory (Lighthill, 1971):

- **Fins.** The three plates of the drag law, each with a rectangle's added mass along its normal
  and added inertia about its two axes: :func:`plate_mass` and :func:`plate_inertia`.
- **Body.** The added mass and inertia of the ellipsoid of the capsule's length and diameter,
  relative to the capsule's own (Lamb, 1932, Art. 114): ``BODY_ADDED_MASS``.
- **Trailing edge.** Water that leaves the tail's end takes its momentum with it. With m the
  tail's added mass a unit of length, u the end's speed along the fin towards the body and w
  along its normal, the force there is ``1/2 m w^2`` along the fin less ``m u w`` along its
  normal. Lighthill has u > 0; where the end moves backward nothing is shed from it, so u < 0
  counts as 0 in the second term. The power is then ``-1/2 m w^2 |u|``, never positive.

The pectorals, which turn right round, have no trailing edge to speak of and no such term.
Added mass makes the force depend on the acceleration that it causes, so it joins the equations
of motion, which are then six instead of three. Straight-line code for any carrier.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from aquafish_gym.physics.arithmetic import (
    Matrix,
    Number,
    Symmetric,
    Vector,
    add,
    add_scaled,
    cross,
    dot,
    fma,
    inverse,
    scale,
    subtract,
    times,
    where_less,
)
from aquafish_gym.physics.dynamics import (
    Whole,
    Wrench,
    advance,
    forces,
    gather,
    on_body,
)
from aquafish_gym.physics.hydrodynamics import DENSITY
from aquafish_gym.physics.kinematics import (
    Drive,
    State,
    caudal_joint,
    joint_accelerations,
    next_joints,
    rotation,
    to_body,
    to_world,
)
from aquafish_gym.physics.robot import (
    BODY_INERTIA,
    BODY_MASS,
    CAUDAL_Y,
    NOSE,
    PECTORAL_X,
    PECTORAL_Y,
    RADIUS,
    Fin,
    Robot,
)

_STRIP = DENSITY * math.pi / 4  # added mass a unit of length of an endless strip of width 1


def _ellipsoid(length: float, diameter: float) -> tuple[float, float, float]:
    """Return a prolate ellipsoid's added mass along and across, and added inertia across.

    Each relative to its own mass or inertia at the water's density (Lamb, 1932, Art. 114).
    """
    e = math.sqrt(1 - (diameter / length) ** 2)
    log = math.log((1 + e) / (1 - e))
    alpha = 2 * (1 - e**2) / e**3 * (log / 2 - e)
    beta = 1 / e**2 - (1 - e**2) / (2 * e**3) * log
    turning = e**4 * (beta - alpha) / ((2 - e**2) * (2 * e**2 - (2 - e**2) * (beta - alpha)))
    return alpha / (2 - alpha), beta / (2 - beta), turning


_ALONG, _ACROSS, _TURNING = _ellipsoid(2 * NOSE, 2 * RADIUS)
BODY_ADDED_MASS: Vector = (_ACROSS * BODY_MASS, _ALONG * BODY_MASS, _ACROSS * BODY_MASS)
BODY_ADDED_INERTIA: Vector = (_TURNING * BODY_INERTIA[0], 0.0, _TURNING * BODY_INERTIA[2])


class Motion(NamedTuple):
    """How one fin moves, in body axes.

    ``across``, ``along`` and ``normal`` are the unit vectors of its fin frame and ``at`` is its
    centre. That moves with ``velocity`` relative to the water, and the fin turns with ``spin``.
    ``left_over`` and ``twist`` are the accelerations, of the centre and angular, that the
    body's own do not explain.
    """

    across: Vector
    along: Vector
    normal: Vector
    at: Vector
    velocity: Vector
    spin: Vector
    left_over: Vector
    twist: Vector


class Added(NamedTuple):
    """What the accelerated water adds to the equations of motion, in body axes.

    ``linear``, ``coupling`` (its columns: the force that resists an angular acceleration about
    x, y, z) and ``angular`` are its inertia about the capsule's centre; ``force`` and
    ``torque`` are what does not multiply the body's acceleration.
    """

    linear: Symmetric
    coupling: Matrix
    angular: Symmetric
    force: Vector
    torque: Vector


def finite_span(width: Number, length: Number) -> Number:
    """Return the added mass of a rectangle as a share of that of as much of an endless strip.

    In the form of Pabst's formula, with two numbers fitted to a vortex lattice: within 0.2% of
    it from length / width 1/4 to 8 (docs/physics.md). 0 for a plate of no length.
    """
    square = fma(width, width, fma(length, length, 1e-30))
    s = width * length / square
    return length / math.sqrt(square) * (1.0 - s * (0.49 - 0.26 * s))


def plate_mass(width: Number, length: Number) -> Number:
    """Return the added mass of a flat rectangle along its normal; the two sizes may be swapped."""
    return _STRIP * width * width * length * finite_span(width, length)


def plate_inertia(width: Number, length: Number) -> Number:
    """Return the added inertia of a flat rectangle about the axis along its width, in its middle.

    That of a long strip, times a share with the right limits for long and short rectangles and
    two numbers fitted to the same lattice: within 0.6% of it over the same range.
    """
    long = width * width * length * length * length
    top = length * fma(0.49, length, width)
    bottom = fma(8 / 3, width * width, length * fma(0.49, length, 1.71 * width))
    return (_STRIP / 12) * long * top / (bottom + 1e-30)


def fin_added_mass(fin: Fin) -> tuple[Vector, Vector]:
    """Return a fin's added masses and, about its centre, inertias: width, length, normal axis."""
    w, n, t = fin.width, fin.length, fin.thickness
    return (
        (plate_mass(t, n), plate_mass(w, t), plate_mass(w, n)),
        (
            plate_inertia(w, n) + plate_inertia(w, t),
            plate_inertia(n, w) + plate_inertia(n, t),
            plate_inertia(t, n) + plate_inertia(t, w),
        ),
    )


def _motion(
    fin: Fin,
    hinge: Vector,
    axes: Matrix,
    rate: Number,
    push: Number,
    velocity: Vector,
    spin: Vector,
) -> Motion:
    """Return a fin's motion; ``push`` is its joint's acceleration, rad/s^2."""
    across, along, normal = axes
    arm = scale(-0.5 * fin.length, along)
    at = add(hinge, arm)
    swing = scale(rate, cross(across, arm))
    carried = cross(spin, add_scaled(cross(spin, at), 2.0, swing))
    relative = add_scaled(scale(push, cross(across, arm)), rate, cross(across, swing))
    return Motion(
        across,
        along,
        normal,
        at,
        add(velocity, add(cross(spin, at), swing)),
        add_scaled(spin, rate, across),
        add(carried, relative),
        add_scaled(scale(push, across), rate, cross(spin, across)),
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
    """Return what the water does that moves with a fin along its unit vector ``e``.

    Its momentum is P = mass (velocity . e) e; the force is -dP/dt, and the torque about the
    fin's centre -velocity x P.
    """
    turning = cross(motion.spin, e)
    speed = dot(motion.velocity, e)
    growth = dot(motion.left_over, e) + dot(motion.velocity, turning)
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
    """Return minus the growth of inertia (spin . e) e that the body does not explain."""
    growth, turning = dot(motion.twist, e), dot(motion.spin, e)
    return scale(-inertia, add_scaled(scale(growth, e), turning, cross(motion.spin, e)))


def _fin_added(fin: Fin, motion: Motion) -> Added:
    """Return what the water does that moves with a fin."""
    masses, (i, j, k) = fin_added_mass(fin)
    across = _plate(masses[0], motion.across, motion)
    along = _plate(masses[1], motion.along, motion)
    plates = _add(_add(across, along), _plate(masses[2], motion.normal, motion))
    inertia = _add_symmetric(
        _square(i, motion.across),
        _add_symmetric(_square(j, motion.along), _square(k, motion.normal)),
    )
    torque = add(
        _turning_torque(i, motion.across, motion),
        add(
            _turning_torque(j, motion.along, motion),
            _turning_torque(k, motion.normal, motion),
        ),
    )
    return Added(
        plates.linear,
        plates.coupling,
        _add_symmetric(plates.angular, inertia),
        plates.force,
        add(plates.torque, torque),
    )


def _body_added(velocity: Vector, spin: Vector) -> Added:
    """Return what the water does that moves with the capsule (Kirchhoff's equations)."""
    zero = (0.0, 0.0, 0.0)
    mass, inertia = BODY_ADDED_MASS, BODY_ADDED_INERTIA
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


def trailing_edge(fin: Fin, velocity: Vector, along: Vector, normal: Vector) -> Vector:
    """Return the force at the end of a fin that moves with ``velocity`` relative to the water.

    ``along`` (towards the hinge) and ``normal`` are the fin's unit vectors.
    """
    mass = _STRIP * fin.width * fin.width * finite_span(fin.width, fin.length)
    u, w = dot(velocity, along), dot(velocity, normal)
    shed = where_less(u, 0.0, 0.0 * u, u)
    return add_scaled(scale(0.5 * mass * w * w, along), -mass * shed * w, normal)


def added_water(robot: Robot, state: State, push: Vector, current: Vector) -> Added:
    """Return what the accelerated and the shed water add to the equations of motion.

    Parameters
    ----------
    robot
        Fin sizes.
    state
        Of body and joints.
    push
        The joints' accelerations over the step, rad/s^2.
    current
        The water's own velocity in the world, units/s; steady.
    """
    velocity = to_body(rotation(state.orientation), subtract(state.velocity, current))
    spin, rates = state.spin, state.rates
    (lc, ls), (rc, rs) = state.left, state.right
    tc, ts = caudal_joint(state.phase)
    x, z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    left = _motion(
        robot.left, (-PECTORAL_X, PECTORAL_Y, 0.0), (x, (0.0, lc, ls), (0.0, -ls, lc)),
        rates[0], push[0], velocity, spin,
    )  # fmt: skip
    right = _motion(
        robot.right, (PECTORAL_X, PECTORAL_Y, 0.0), (x, (0.0, rc, rs), (0.0, -rs, rc)),
        rates[1], push[1], velocity, spin,
    )  # fmt: skip
    # The caudal hinge's axes are the body's (z, y, -x).
    tail = _motion(
        robot.caudal, (0.0, CAUDAL_Y, 0.0), (z, (-ts, tc, 0.0), (-tc, -ts, 0.0)),
        rates[2], push[2], velocity, spin,
    )  # fmt: skip
    fins = _add(_fin_added(robot.left, left), _fin_added(robot.right, right))
    found = _add(_add(fins, _fin_added(robot.caudal, tail)), _body_added(velocity, spin))
    half = scale(-0.5 * robot.caudal.length, tail.along)
    end = add(tail.velocity, cross(tail.spin, half))
    force = trailing_edge(robot.caudal, end, tail.along, tail.normal)
    return Added(
        found.linear,
        found.coupling,
        found.angular,
        add(found.force, force),
        add(found.torque, cross(add(tail.at, half), force)),
    )


def accelerations_with(whole: Whole, added: Added, spin: Vector) -> tuple[Vector, Vector]:
    """Solve the equations of motion of a robot and the water that it moves, in body axes.

    As :func:`~aquafish_gym.physics.dynamics.accelerations`, but where the mass depends on the
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
    gx, gy, gz = times(inverse_mass, cx), times(inverse_mass, cy), times(inverse_mass, cz)
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


def step_reactive(robot: Robot, state: State, by: Drive, current: Vector, h: Number) -> State:
    """Advance one robot by one step, as :func:`~aquafish_gym.physics.dynamics.step` does."""
    joints = next_joints(state, by, h)
    push = joint_accelerations(state, joints, h)
    whole = gather(robot, state, push, forces(robot, state, current))
    added = added_water(robot, state, push, current)
    return advance(state, joints, accelerations_with(whole, added, state.spin), h)


def reactive_wrench(robot: Robot, state: State, by: Drive, current: Vector, h: Number) -> Wrench:
    """Return the water's whole wrench on the capsule's centre over a step, in world axes.

    What added mass does depends on the acceleration, so this takes the step's own.
    """
    joints = next_joints(state, by, h)
    push = joint_accelerations(state, joints, h)
    water = forces(robot, state, current)
    added = added_water(robot, state, push, current)
    a, alpha = accelerations_with(gather(robot, state, push, water), added, state.spin)
    cx, cy, cz = added.coupling
    force, torque = on_body(state, water)
    resisting = add_scaled(add_scaled(scale(alpha[0], cx), alpha[1], cy), alpha[2], cz)
    force = subtract(add(force, added.force), add(times(added.linear, a), resisting))
    turning = add((dot(cx, a), dot(cy, a), dot(cz, a)), times(added.angular, alpha))
    torque = subtract(add(torque, added.torque), turning)
    r = rotation(state.orientation)
    return to_world(r, force), to_world(r, torque)
