"""A robot's numbers: its hull's, which follow from the plan, and its fins', which vary.

Axes: x to the right, y forward along the hull, z up; the origin is the hull's centre. One unit of
length is 5 cm and water has density 1. Body and fins are neutrally buoyant, so their density is 1
too and there is no gravity.

Every fin turns about its own *width* axis, so one set of equations serves all. A fin's **hinge
frame** has the axes (width, length, normal), of which ``FinPlan.frame`` has the directions in body
axes. Its **fin frame** is the hinge frame turned by the joint's angle about the width axis; the
fin itself is a box from 0 to -length along its length axis, centred on the other two.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

from aquafish_gym.physics.arithmetic import Number, Vector, where_less
from aquafish_gym.plans import BodyPlan, FinPlan, Hull

MOUNT_LENGTH = 0.5  # units, along the hull

# A fin of no size keeps this share of the hull's mass, so that the equations stay regular; it is
# too small to affect the body's motion.
MINIMUM_FIN_MASS = 1e-6
# The same for its inertia: the radius of gyration is at least 1/1000 of a unit.
MINIMUM_GYRATION = 1e-3


class HullNumbers(NamedTuple):
    """What the dynamics need of a hull: its mass properties and the stations of its drag.

    ``stations`` are the Gauss stations for its own diameter as weight: (y, integral of the diameter
    over its stretch) each, of the middle and the fore half; those of the aft half mirror them.
    ``roll_area`` is the integral of r^4 over the surface's area divided by r^2, for the torque of
    skin friction about the long axis.
    """

    radius: float
    nose: float  # from the centre
    mass: float
    inertia: tuple[float, float, float]
    stations: tuple[tuple[float, float], ...]
    roll_area: float


@functools.cache
def hull_numbers(hull: Hull) -> HullNumbers:
    """Return the numbers of a hull at the water's density."""
    radius, cylinder = hull.radius, hull.length - 2 * hull.radius
    mass = math.pi * radius**2 * cylinder + 4 / 3 * math.pi * radius**3
    middle = math.pi * radius**2 * cylinder
    caps = mass - middle
    along = middle * radius**2 / 2 + caps * 2 / 5 * radius**2
    across = middle * (cylinder**2 / 12 + radius**2 / 4) + caps * (
        2 / 5 * radius**2 + cylinder**2 / 4 + 3 / 8 * cylinder * radius
    )
    roll = 2 * math.pi * radius**4 * cylinder + 2 * math.pi * radius**5 * (3 * math.pi / 8)
    stations = _STATED.get(hull) or _stations(cylinder / 2, radius)
    return HullNumbers(radius, cylinder / 2 + radius, mass, (across, along, across), stations, roll)


# The paper's hull: the rule's own numbers differ by 1e-9, and committed results hold for these.
_STATED = {
    Hull(4.0, 0.5): (
        (0.0, 1.1066861595874569),
        (1.0471065217376876, 0.9296776987009064),
        (1.7563685970482226, 0.4096783043373521),
    )
}


def _stations(half: float, radius: float) -> tuple[tuple[float, float], ...]:
    """Return the five-point Gauss rule of a capsule's diameter, by its moments about the middle.

    ``half`` is half of the cylinder's length. The nodes are the roots of the polynomial
    y (y^4 + a y^2 + b) that is orthogonal to y and y^3 under the diameter.
    """
    m0, m2, m4, m6, m8 = (_moment(k, half, radius) for k in (0, 2, 4, 6, 8))
    determinant = m4 * m4 - m2 * m6
    a = (m2 * m8 - m4 * m6) / determinant
    b = (m6 * m6 - m4 * m8) / determinant
    apart = math.sqrt(a * a / 4 - b)
    near, far = -a / 2 - apart, -a / 2 + apart  # the squares of the nodes
    outer = (m4 - near * m2) / (2 * far * (far - near))
    inner = (m4 - far * m2) / (2 * near * (near - far))
    middle = m0 - 2 * inner - 2 * outer
    return ((0.0, middle), (math.sqrt(near), inner), (math.sqrt(far), outer))


def _moment(k: int, half: float, radius: float) -> float:
    """Return the integral of y^k times a capsule's diameter over its length, for an even k."""
    ends = sum(
        math.comb(k, j) * half ** (k - j) * radius ** (j + 2) * _quarter_circle(j)
        for j in range(k + 1)
    )
    return 4 * (radius * half ** (k + 1) / (k + 1) + ends)


def _quarter_circle(j: int) -> float:
    """Return the integral of u^j sqrt(1 - u^2) from 0 to 1."""
    if j < 2:
        return (math.pi / 4, 1 / 3)[j]
    return (j - 1) / (j + 2) * _quarter_circle(j - 2)


class Mount(NamedTuple):
    """A fixed plate that joins hull and hinge, in the plane of both; massless, with drag only.

    ``aside`` and ``normal`` are its unit vectors across the hull's axis.
    """

    at: Vector
    aside: Vector
    normal: Vector
    area: float


def mount(hull: Hull, fin: FinPlan) -> Mount | None:
    """Return the mount of a fin whose hinge is off the hull's surface; None for one on it."""
    x, y, z = fin.hinge
    away = math.hypot(x, z)
    width = away - hull.radius
    if width <= 0.0:
        return None
    middle = (hull.radius + away) / 2 / away
    across, up = (x / away, z / away) if x >= 0.0 else (-x / away, -z / away)
    at = (x * middle, y, z * middle)
    return Mount(at, (across, 0.0, up), (-up, 0.0, across), width * MOUNT_LENGTH)


class Fin(NamedTuple):
    """One fin's sizes and mass properties, in its fin frame (width, length, normal).

    ``inertia`` is about the fin's centre, and ``drag`` multiplies the drag law's coefficients.
    """

    width: Number
    length: Number
    thickness: Number
    mass: Number
    inertia: tuple[Number, Number, Number]
    drag: Number = 1.0


def box(
    hull: Hull,
    width: Number,
    length: Number,
    thickness: Number,
    density: Number = 1.0,
    drag: Number = 1.0,
) -> Fin:
    """Return the fin of these sizes, units; ``density`` is relative to the water's."""
    least = MINIMUM_FIN_MASS * hull_numbers(hull).mass
    mass = _at_least(least, width * length * thickness * density)
    a = width * width / 12
    b = length * length / 12
    c = thickness * thickness / 12
    inertia = (
        _at_least(MINIMUM_GYRATION**2, b + c) * mass,
        _at_least(MINIMUM_GYRATION**2, a + c) * mass,
        _at_least(MINIMUM_GYRATION**2, a + b) * mass,
    )
    return Fin(width, length, thickness, mass, inertia, drag)


def _at_least(least: float, x: Number) -> Number:
    return where_less(x, least, least, x)


class Robot(NamedTuple):
    """The fins in the plan's order, and a factor on the hull's drag."""

    fins: tuple[Fin, ...]
    drag: Number = 1.0


def robot_like(plan: BodyPlan) -> Robot:
    """Return a robot of zeros, which has the shape of the plan's."""
    zero = (0.0, 0.0, 0.0)
    return Robot((Fin(*zero, 0.0, zero, 0.0),) * len(plan.fins), 0.0)
