"""The robot's geometry, and the masses, inertias and quadrature stations that follow from it.

Axes: x to the right, y forward along the capsule, z up; the origin is the capsule's centre.
One unit of length is 5 cm and water has density 1. Body and fins are neutrally buoyant, so
their density is 1 too and there is no gravity.

Every fin turns about its own *width* axis, so one set of equations serves all three. A fin's
**hinge frame** has the axes (width, length, normal): for the pectorals these are the body's
(x, y, z), for the caudal fin (z, y, -x). Its **fin frame** is the hinge frame turned by the
joint's angle about the width axis; the fin itself is a box from 0 to -length along its length
axis, centred on the other two.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from aquafish_gym.physics.arithmetic import Number, where_less

RADIUS = 0.5  # camera fit of the paper's Fig. 4: 0.491
CYLINDER = 3.0  # the same fit: 3.07; with its two caps the capsule is 4 long
NOSE = CYLINDER / 2 + RADIUS

PECTORAL_X = 0.75  # the same fit: 0.749
PECTORAL_Y = NOSE - 1.0  # the same fit: 0.997 behind the nose
CAUDAL_Y = -NOSE

# A fixed plate joins body and pectoral hinge; it is massless and has drag only.
MOUNT_X = (RADIUS + PECTORAL_X) / 2
MOUNT_WIDTH = PECTORAL_X - RADIUS
MOUNT_LENGTH = 0.5

BODY_MASS = math.pi * RADIUS**2 * CYLINDER + 4 / 3 * math.pi * RADIUS**3

# A fin of no size keeps this mass, so that the equations stay regular; it is too small to
# affect the body's motion.
MINIMUM_FIN_MASS = 1e-6 * BODY_MASS
# The same for its inertia: the radius of gyration is at least 1/1000 of a unit.
MINIMUM_GYRATION = 1e-3


def _capsule_inertia() -> tuple[float, float, float]:
    cylinder = math.pi * RADIUS**2 * CYLINDER
    caps = BODY_MASS - cylinder
    along = cylinder * RADIUS**2 / 2 + caps * 2 / 5 * RADIUS**2
    across = cylinder * (CYLINDER**2 / 12 + RADIUS**2 / 4) + caps * (
        2 / 5 * RADIUS**2 + CYLINDER**2 / 4 + 3 / 8 * CYLINDER * RADIUS
    )
    return (across, along, across)


BODY_INERTIA = _capsule_inertia()


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
    width: Number, length: Number, thickness: Number, density: Number = 1.0, drag: Number = 1.0
) -> Fin:
    """Return the fin of these sizes, units; ``density`` is relative to the water's."""
    mass = _at_least(MINIMUM_FIN_MASS, width * length * thickness * density)
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
    """The three fins, and a factor on the body's drag; the capsule is constant."""

    left: Fin
    right: Fin
    caudal: Fin
    drag: Number = 1.0


# The capsule's Gauss stations for its own diameter as weight: (y, integral of the diameter over
# its stretch) each, of the middle and the fore half; those of the aft half mirror them. Strip
# theory needs integrals of D(y) g(y) dy over its length. The nodes are the eigenvalues of the
# Jacobi matrix of the polynomials orthogonal under D (Golub and Welsch, 1969).
CAPSULE_STATIONS = (
    (0.0, 1.1066861595874569),
    (1.0471065217376876, 0.9296776987009064),
    (1.7563685970482226, 0.4096783043373521),
)
# The integral of r^4 over the surface's area divided by r^2, for the torque of skin friction
# about the long axis.
ROLL_AREA = 2 * math.pi * RADIUS**4 * CYLINDER + 2 * math.pi * RADIUS**5 * (3 * math.pi / 8)
