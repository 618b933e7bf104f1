"""One time step of the robot's motion, stated once, in Bullet's scheme.

The servos *prescribe* the joints' motion, so the unknown is the body's motion alone. At the
state (q_n, v_n) the joints' next speeds follow from their angles at t and t + h, the body's
acceleration from Newton's and Euler's equations of the whole robot, and then

    v_{n+1} = v_n + h v'_n        x_{n+1} = x_n + h v_{n+1}

with the attitude by the exponential map. Bullet with ideal motors does the same, to rounding.

Frames: ``world`` is inertial; ``body`` turns with the hull; each fin's ``hinge`` and ``fin``
frames are those of ``robot.py``. The law is stated for any plan; what runs is printed for one
(``law.py``). Straight-line code for any scalar backend; see
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
    dot,
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
    Numbers,
    Pair,
    State,
    fin_joint,
    joint_accelerations,
    next_joints,
    pairs,
    rotation,
    to_body,
    to_world,
    turn,
)
from aquafish_gym.physics.robot import Fin, Robot, hull_numbers
from aquafish_gym.plans import BodyPlan, FinPlan

Wrench = tuple[Vector, Vector]  # force, torque


class Water(NamedTuple):
    """The water's wrench on each part: a fin's in its fin frame, about its hinge; the body's in
    body axes, about its centre.
    """

    fins: tuple[Wrench, ...]
    body: Wrench


class Inertia(NamedTuple):
    """The inertia of a fin, or of all parts, as one rigid body, and the force on it.

    In body axes. ``moment`` is mass times position of the centre of mass. A fin's is about the
    point of the body's x axis from which its hinge is y and z away; that of all parts is about the
    hull's centre. The force is the water's wrench less the bias forces of the joints' own motion;
    the rigid body's own rotation is not subtracted yet.
    """

    mass: Number
    moment: Vector
    inertia: Symmetric
    force: Vector
    torque: Vector


def _to_fin(joint: Pair, v: Vector) -> Vector:
    """Turn a vector from the hinge frame to the fin frame; ``joint`` is (cos, sin)."""
    c, s = joint
    return (v[0], fma(c, v[1], s * v[2]), fma(c, v[2], -(s * v[1])))


def _from_fin(joint: Pair, v: Vector) -> Vector:
    """Turn a vector from the fin frame to the hinge frame."""
    c, s = joint
    return (v[0], fma(c, v[1], -(s * v[2])), fma(s, v[1], c * v[2]))


def _to_hinge(fin: FinPlan, v: Vector) -> Vector:
    """Turn a vector from body axes to the hinge frame."""
    width, length, normal = fin.frame
    return (dot(width, v), dot(length, v), dot(normal, v))


def _from_hinge(fin: FinPlan, v: Vector) -> Vector:
    """Turn a vector from the hinge frame to body axes."""
    width, length, normal = fin.frame
    return add_scaled(add_scaled(scale(v[2], normal), v[1], length), v[0], width)


def _at_hinge(fin: FinPlan, velocity: Vector, spin: Vector) -> Vector:
    """Return the velocity of a hinge, in body axes."""
    x, y, z = fin.hinge
    return (
        fma(z, spin[1], fma(-y, spin[2], velocity[0])),
        fma(-z, spin[0], fma(x, spin[2], velocity[1])),
        fma(y, spin[0], fma(-x, spin[1], velocity[2])),
    )


def _fin_water(
    plan: FinPlan, fin: Fin, joint: Pair, rate: Number, velocity: Vector, spin: Vector
) -> Wrench:
    """Return the water's wrench on a fin, in its fin frame and about its hinge.

    ``velocity`` is the body centre's relative to the water, in body axes.
    """
    at_hinge = _to_hinge(plan, _at_hinge(plan, velocity, spin))
    turning = _to_hinge(plan, spin)
    fin_spin = (turning[0] + rate, turning[1], turning[2])
    return fin_drag(fin, _to_fin(joint, at_hinge), _to_fin(joint, fin_spin))


def _to_middle(plan: FinPlan, joint: Pair, on_fin: Wrench) -> Wrench:
    """Move a wrench from a fin frame to body axes, about the point of ``Inertia``."""
    _, y, z = plan.hinge
    force = _from_hinge(plan, _from_fin(joint, on_fin[0]))
    torque = _from_hinge(plan, _from_fin(joint, on_fin[1]))
    return force, (
        fma(-z, force[1], fma(y, force[2], torque[0])),
        fma(z, force[0], torque[1]),
        fma(-y, force[0], torque[2]),
    )


def _sums(
    plan: BodyPlan, parts: list[Numbers]
) -> tuple[Numbers, Numbers, list[tuple[float, Numbers, Numbers]]]:
    """Return the sum over mirrored fins, that over the others, and what each group is.

    A group is two fins that mirror each other, or one: the x of its (second) hinge, the sum of its
    parts, and the second less the first.
    """
    mirrored = others = (0.0,) * len(parts[0])
    groups = []
    for group in plan.groups:
        whole = apart = parts[group[-1]]
        if len(group) == 2:
            first = parts[group[0]]
            whole, apart = (
                _plus(first, apart),
                tuple(b - a for a, b in zip(first, apart, strict=True)),
            )
            mirrored = _plus(mirrored, whole)
        else:
            others = _plus(others, whole)
        groups.append((plan.fins[group[-1]].hinge[0], whole, apart))
    return mirrored, others, groups


def _plus(a: Numbers, b: Numbers) -> Numbers:
    return tuple(x + y for x, y in zip(a, b, strict=True))


def _fin_inertia(
    plan: FinPlan,
    fin: Fin,
    joint: Pair,
    rate: Number,
    acceleration: Number,
    spin: Vector,
    water: Wrench,
) -> Inertia:
    """Return one fin's inertia and force."""
    c, s = joint
    half = 0.5 * fin.length
    m = fin.mass
    first = m * half
    ia, ib, ic = fin.inertia
    width, length, normal = plan.frame

    # The fin's inertia about its own centre, in the hinge frame, ...
    lean = c * (ib - ic)
    ibb = fma(c, lean, ic)
    own = (ia, ibb, (ib + ic) - ibb)
    # ... then in body axes about the point of ``Inertia``, from which its centre is ``at`` away.
    places = (0.0, plan.hinge[1], plan.hinge[2])
    at = [fma(-(normal[k] * half), s, fma(-(length[k] * half), c, places[k])) for k in range(3)]
    moment = (m * at[0], m * at[1], m * at[2])

    def square(k: int) -> Number:
        mixed = (2.0 * length[k] * normal[k]) * (s * lean)
        about = fma(normal[k] * normal[k], own[2], mixed)
        return fma(width[k] * width[k], own[0], fma(length[k] * length[k], own[1], about))

    def product(i: int, k: int) -> Number:
        about = fma(length[i] * length[k], own[1], normal[i] * normal[k] * own[2])
        about = fma(width[i] * width[k], own[0], about)
        mixed = length[i] * normal[k] + length[k] * normal[i]
        return fma(mixed * s, lean, about - moment[i] * at[k])

    inertia = (
        fma(moment[1], at[1], fma(moment[2], at[2], square(0))),
        fma(moment[0], at[0], fma(moment[2], at[2], square(1))),
        fma(moment[1], at[1], fma(moment[0], at[0], square(2))),
        product(1, 0),
        product(0, 2),
        product(1, 2),
    )

    # The bias force, which the joint's motion adds to the inertial forces, in the fin frame and
    # about the hinge: with arm r = (0, -half, 0), joint axis a = (1, 0, 0), its speed and
    # acceleration, the force m (2 w x (speed a x r) + acceleration a x r + speed^2 a x (a x r))
    # and the torque I (acceleration a + w x speed a) + speed a x I W + w x I speed a, where w
    # is the body's spin, W = w + speed a the fin's and I its inertia about the hinge.
    turning = _to_hinge(plan, spin)
    w1 = fma(c, turning[1], s * turning[2])
    w2 = fma(c, turning[2], -(s * turning[1]))
    about_a, about_c = fma(first, half, ia), fma(first, half, ic)
    swing = first * rate
    force = (-2.0 * swing * w1, swing * fma(2.0, turning[0], rate), -first * acceleration)
    torque = (
        about_a * acceleration,
        rate * w2 * (about_a + ib - about_c),
        -rate * w1 * (about_a + about_c - ib),
    )
    left = (subtract(water[0], force), subtract(water[1], torque))
    return Inertia(m, moment, inertia, *_to_middle(plan, joint, left))


def forces(plan: BodyPlan, robot: Robot, state: State, current: Vector) -> Water:
    """Return the water's wrench on each part; ``current`` is its velocity in the world."""
    velocity = to_body(rotation(state.orientation), subtract(state.velocity, current))
    fins = tuple(
        _fin_water(fin_plan, fin, fin_joint(fin_plan, joint), rate, velocity, state.spin)
        for fin_plan, fin, joint, rate in zip(
            plan.fins, robot.fins, pairs(state.joints), state.rates, strict=True
        )
    )
    force, torque = body_drag(plan, velocity, state.spin)
    return Water(fins, (scale(robot.drag, force), scale(robot.drag, torque)))


def on_body(plan: BodyPlan, state: State, water: Water) -> Wrench:
    """Return the water's whole force and its torque about the hull's centre, in body axes."""
    fins: list[Numbers] = []
    for fin, joint, on_fin in zip(plan.fins, pairs(state.joints), water.fins, strict=True):
        force, torque = _to_middle(fin, fin_joint(fin, joint), on_fin)
        fins.append((*force, *torque))
    return _whole_wrench(*_sums(plan, fins), water.body)


def _whole_wrench(
    mirrored: Numbers,
    others: Numbers,
    groups: list[tuple[float, Numbers, Numbers]],
    body: Wrench,
) -> Wrench:
    """Add the fins' wrenches, which end the parts of :func:`_sums`, and the hull's."""
    fx, fy, fz, tx, ty, tz = _plus(mirrored[-6:], _plus(others[-6:], (*body[0], *body[1])))
    for x, _, apart in groups:
        ty = fma(-x, apart[-4], ty)
        tz = fma(x, apart[-5], tz)
    return (fx, fy, fz), (tx, ty, tz)


def wrench(plan: BodyPlan, robot: Robot, state: State, current: Vector) -> Wrench:
    """Return :func:`on_body` in world axes: the lumped wrench for PyBullet."""
    force, torque = on_body(plan, state, forces(plan, robot, state, current))
    r = rotation(state.orientation)
    return to_world(r, force), to_world(r, torque)


def step(
    plan: BodyPlan, robot: Robot, state: State, by: Drive, current: Vector, h: Number
) -> State:
    """Advance one robot in the water by one step of length ``h`` seconds.

    ``by`` is from :func:`drive` with the same ``h``; ``current`` is the water's velocity in the
    world, units/s. The scheme is explicit, so h must be much shorter than the time in which drag
    stops the lightest motion; 0.01 is enough for every body within the limits.
    """
    return move(plan, robot, state, by, forces(plan, robot, state, current), h)


def move(plan: BodyPlan, robot: Robot, state: State, by: Drive, water: Water, h: Number) -> State:
    """Advance one robot by one step under given forces: Newton and Euler, then Bullet's scheme."""
    joints = next_joints(plan, state, by, h)
    whole = whole_inertia(plan, robot, state, joint_accelerations(state, joints, h), water)
    return advance(state, joints, accelerations(whole, state.spin), h)


def whole_inertia(
    plan: BodyPlan, robot: Robot, state: State, qdd: Numbers, water: Water
) -> Inertia:
    """Sum hull and fins; ``qdd`` is the joints' accelerations, rad/s^2."""
    fins: list[Numbers] = []
    joints = pairs(state.joints)
    each = zip(plan.fins, robot.fins, joints, state.rates, qdd, water.fins, strict=True)
    for fin_plan, fin, joint, rate, acceleration, on_fin in each:
        part = _fin_inertia(
            fin_plan, fin, fin_joint(fin_plan, joint), rate, acceleration, state.spin, on_fin
        )
        fins.append((part.mass, *part.moment, *part.inertia, *part.force, *part.torque))
    mirrored, others, groups = _sums(plan, fins)
    mass, mx, my, mz, xx, yy, zz, xy, xz, yz = _plus(mirrored[:10], others[:10])
    # The fins' are of their hinges' own x: Steiner's theorem along the body's x axis.
    for x, whole, apart in groups:
        outboard = x * x * whole[0] + 2.0 * x * apart[1]
        mx = fma(x, apart[0], mx)
        yy, zz = yy + outboard, zz + outboard
        xy, xz = fma(-x, apart[2], xy), fma(-x, apart[3], xz)
    hull = hull_numbers(plan.hull)
    return Inertia(
        hull.mass + mass,
        (mx, my, mz),
        (hull.inertia[0] + xx, hull.inertia[1] + yy, hull.inertia[2] + zz, xy, xz, yz),
        *_whole_wrench(mirrored, others, groups, water.body),
    )


def accelerations(whole: Inertia, spin: Vector) -> tuple[Vector, Vector]:
    """Return the linear acceleration of the hull's centre and the angular one, in body axes.

    They solve Newton's and Euler's equations.
    """
    # About the centre of mass the two equations decouple: first the inertia there, ...
    s, per_mass = whole.moment, 1.0 / whole.mass
    centre = scale(per_mass, s)
    xx, yy, zz, xy, xz, yz = whole.inertia
    inertia = (
        fma(-s[1], centre[1], fma(-s[2], centre[2], xx)),
        fma(-s[0], centre[0], fma(-s[2], centre[2], yy)),
        fma(-s[0], centre[0], fma(-s[1], centre[1], zz)),
        fma(s[0], centre[1], xy),
        fma(s[0], centre[2], xz),
        fma(s[1], centre[2], yz),
    )
    # ... then Euler for the whole, and Newton for the hull's centre.
    torque = subtract(whole.torque, cross(centre, whole.force))
    alpha = times(inverse(inertia), subtract(torque, cross(spin, times(inertia, spin))))
    turning = add(cross(alpha, centre), cross(spin, cross(spin, centre)))
    return subtract(scale(per_mass, whole.force), turning), alpha


def advance(state: State, joints: Joints, accelerations: tuple[Vector, Vector], h: Number) -> State:
    """Return the state after a step of length h: Bullet's scheme."""
    acceleration, alpha = accelerations
    velocity = add_scaled(state.velocity, h, to_world(rotation(state.orientation), acceleration))
    spin = add_scaled(state.spin, h, alpha)
    position = add_scaled(state.position, h, velocity)
    orientation = turn(state.orientation, spin, h)
    return State(orientation, position, velocity, spin, *joints)
