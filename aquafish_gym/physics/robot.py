"""The robot's geometry, and the masses, inertias and quadrature stations that follow from it.

Axes: x to the right, y forward along the capsule, z up; the origin is the capsule's centre.
One unit of length is 5 cm and water has density 1. Body and fins are neutrally buoyant, so
their density is 1 too and there is no gravity.

Every fin turns about its own *width* axis, which makes all three the same machine. A fin's
**hinge frame** has the axes (width, length, normal): for the pectorals these are the body's
(x, y, z), for the caudal fin (z, y, -x). Its **fin frame** is the hinge frame turned by the
joint's angle about the width axis; the fin itself is a box from 0 to -length along its length
axis, centred on the other two.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

RADIUS = 0.5  # camera fit of the paper's Fig. 4: 0.491
CYLINDER = 3.0  # the same fit: 3.07; with its two caps the capsule is 4 long
NOSE = CYLINDER / 2 + RADIUS

PECTORAL_X = 0.75  # the same fit: 0.749
PECTORAL_Y = NOSE - 1.0  # the same fit: 0.997 behind the nose
CAUDAL_Y = -NOSE

# A fixed plate joins body and pectoral hinge; it is massless and only drags.
MOUNT_X = (RADIUS + PECTORAL_X) / 2
MOUNT_WIDTH = PECTORAL_X - RADIUS
MOUNT_LENGTH = 0.5

BODY_MASS = math.pi * RADIUS**2 * CYLINDER + 4 / 3 * math.pi * RADIUS**3

# A fin of no size keeps this mass, so that the equations stay regular; it is too little to
# show in the body's motion.
MINIMUM_FIN_MASS = 1e-6 * BODY_MASS
# Likewise for its inertia: the radius of gyration is never under 1/1000 of a unit.
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

    Each entry is a number, or a SIMD lane of numbers where the lanes call. ``inertia`` is
    about the fin's centre.
    """

    width: Any
    length: Any
    thickness: Any
    mass: Any
    inertia: tuple[Any, Any, Any]


class Robot(NamedTuple):
    """The three fins; the capsule is the same for every robot."""

    left: Fin
    right: Fin
    caudal: Fin


PARAMETERS_PER_FIN = 7
# Where (width, length, thickness) of each fin stand among the nine dimensions.
_COLUMNS: NDArray[np.intp] = np.array([(0, 1, 2), (3, 4, 5), (8, 7, 6)])


def robot_parameters(morphologies: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what each body is to the equations of motion.

    Parameters
    ----------
    morphologies
        (B, 9) sizes in the order of ``DIMENSIONS``.

    Returns
    -------
    ndarray
        (21, B): for each fin width, length, thickness, mass and the three inertias, in the
        order of :class:`Fin`.
    """
    sizes = morphologies.T[_COLUMNS]  # (fin, width or length or thickness, B)
    squares = sizes**2 / 12
    mass = np.maximum(sizes[:, 0] * sizes[:, 1] * sizes[:, 2], MINIMUM_FIN_MASS)
    rows = np.empty((len(sizes), PARAMETERS_PER_FIN, sizes.shape[2]))
    rows[:, 0:3] = sizes
    rows[:, 3] = mass
    rows[:, 4] = squares[:, 1] + squares[:, 2]
    rows[:, 5] = squares[:, 0] + squares[:, 2]
    rows[:, 6] = squares[:, 0] + squares[:, 1]
    rows[:, 4:7] = mass[:, None] * np.maximum(rows[:, 4:7], MINIMUM_GYRATION**2)
    return rows.reshape(len(sizes) * PARAMETERS_PER_FIN, sizes.shape[2])


def robot_from_column(column: NDArray[np.float64]) -> Robot:
    """Return one robot on plain floats from a column (21,) of :func:`robot_parameters`."""
    v = [float(x) for x in column]
    fins = (Fin(a[0], a[1], a[2], a[3], (a[4], a[5], a[6])) for a in (v[0:7], v[7:14], v[14:21]))
    return Robot(*fins)


def _capsule_stations(count: int) -> tuple[tuple[float, float], ...]:
    """Gauss stations along the capsule for its own diameter as weight: (y, weight) each.

    Strip theory needs integrals of D(y) g(y) dy over the capsule's length. The nodes are the
    eigenvalues of the Jacobi matrix of the polynomials orthogonal under D (Golub and Welsch,
    1969), found here by the Stieltjes procedure on a fine reference rule.
    """
    u, w = np.polynomial.legendre.leggauss(400)
    half = CYLINDER / 2
    cap_y, cap_w = half + RADIUS * (u + 1) / 2, w * RADIUS / 2
    y = np.concatenate([-cap_y, half * u, cap_y])
    diameter = np.concatenate(
        [d := 2 * np.sqrt(RADIUS**2 - (cap_y - half) ** 2), np.full(400, 2 * RADIUS), d]
    )
    weight = np.concatenate([cap_w, half * w, cap_w]) * diameter
    # The weight is even, so the Jacobi matrix has a zero diagonal.
    previous, current, norms = np.zeros_like(y), np.ones_like(y), [float(weight.sum())]
    betas: list[float] = []
    for _ in range(count - 1):
        following = y * current - (betas[-1] if betas else 0.0) * previous
        norms.append(float((weight * following**2).sum()))
        betas.append(norms[-1] / norms[-2])
        previous, current = current, following
    off = np.sqrt(betas)
    nodes, vectors = np.linalg.eigh(np.diag(off, 1) + np.diag(off, -1))
    # Exactly mirror-symmetric, which rounding would otherwise spoil in the last digit.
    nodes = (nodes - nodes[::-1]) / 2
    shares = (vectors[0] ** 2 + vectors[0, ::-1] ** 2) / 2
    return tuple((float(n), float(norms[0] * s)) for n, s in zip(nodes, shares, strict=True))


# (y, integral of the diameter over its stretch), and the integral of r^4 over the surface's
# area divided by r^2: what skin friction's torque about the long axis needs.
CAPSULE_STATIONS = _capsule_stations(5)
ROLL_AREA = 2 * math.pi * RADIUS**4 * CYLINDER + 2 * math.pi * RADIUS**5 * (3 * math.pi / 8)
