"""Added mass: the water that moves with each part, and the momentum shed at the tail's edge.

After Lighthill's elongated-body theory (Lighthill, 1971):

- **Fins.** The three plates of the drag law, each with a rectangle's added mass along its normal
  and added inertia about its two axes: :func:`plate_mass` and :func:`plate_inertia`.
- **Hull.** The added mass and inertia of the ellipsoid of its length and diameter, relative to
  its own (Lamb, 1932, Art. 114): :func:`hull_added_mass`.
- **Trailing edge.** Water that leaves the tail's end takes its momentum with it. With m the
  tail's added mass per unit length, u the end's speed along the fin towards the body and w
  along its normal, the force there is ``1/2 m w^2`` along the fin less ``m u w`` along its
  normal. Lighthill has u > 0; where the end moves backward it sheds nothing, so u < 0 counts as
  0 in the second term. The power is then ``-1/2 m w^2 |u|``, never positive.

Fins that turn full circles have no trailing edge and no such term.
Straight-line code for any scalar backend; see ``arithmetic.py``.
"""

from __future__ import annotations

import functools
import math

from aquafish_gym.physics.arithmetic import (
    Number,
    Vector,
    add_scaled,
    dot,
    fma,
    scale,
    square_root,
    where_less,
)
from aquafish_gym.physics.hydrodynamics import DENSITY
from aquafish_gym.physics.robot import Fin, hull_numbers
from aquafish_gym.plans import Hull

_STRIP = DENSITY * math.pi / 4  # added mass per unit length of an infinite strip of width 1


def _ellipsoid(length: float, diameter: float) -> tuple[float, float, float]:
    """Return a prolate ellipsoid's added mass along and across, and added inertia across.

    Each relative to its own mass or inertia at the water's density (Lamb, 1932, Art. 114).
    """
    e = math.sqrt(1 - (diameter / length) ** 2)
    if e < 0.1:  # near a sphere the formulas below are differences of nearly equal numbers
        square = e**2
        share = sum(square**k / (2 * k + 3) for k in range(8))
        gap = sum(6 * square**k / ((2 * k + 3) * (2 * k + 5)) for k in range(8))
        alpha, beta = 2 * (1 - square) * share, 1 - (1 - square) * share
        turning = square**2 * gap / ((2 - square) * (2 - (2 - square) * gap))
        return alpha / (2 - alpha), beta / (2 - beta), turning
    log = math.log((1 + e) / (1 - e))
    alpha = 2 * (1 - e**2) / e**3 * (log / 2 - e)
    beta = 1 / e**2 - (1 - e**2) / (2 * e**3) * log
    turning = e**4 * (beta - alpha) / ((2 - e**2) * (2 * e**2 - (2 - e**2) * (beta - alpha)))
    return alpha / (2 - alpha), beta / (2 - beta), turning


@functools.cache
def hull_added_mass(hull: Hull) -> tuple[Vector, Vector]:
    """Return a hull's added masses and, about its centre, inertias: x, y, z axis."""
    numbers = hull_numbers(hull)
    along, across, turning = _ellipsoid(hull.length, 2 * hull.radius)
    mass, inertia = numbers.mass, numbers.inertia
    return (
        (across * mass, along * mass, across * mass),
        (turning * inertia[0], 0.0, turning * inertia[2]),
    )


def finite_span(width: Number, length: Number) -> Number:
    """Return the added mass of a rectangle as a share of an infinite strip's of equal length.

    Pabst's formula with two numbers fitted to a vortex lattice: within 0.2% of it from length /
    width 1/4 to 8 (docs/physics.md). 0 for a plate of no length.
    """
    square = fma(width, width, fma(length, length, 1e-30))
    s = width * length / square
    return length / square_root(square) * (1.0 - s * (0.49 - 0.26 * s))


def plate_mass(width: Number, length: Number) -> Number:
    """Return the added mass of a flat rectangle along its normal; the two sizes may be swapped."""
    return _STRIP * width * width * length * finite_span(width, length)


def plate_inertia(width: Number, length: Number) -> Number:
    """Return the added inertia of a flat rectangle about the axis along its width, in its middle.

    A long strip's, times a share with the right limits for long and short rectangles and two
    numbers fitted to the same lattice: within 0.6% of it over the same range.
    """
    long = width * width * length * length * length
    top = length * fma(0.49, length, width)
    bottom = fma(8 / 3, width * width, length * fma(0.49, length, 1.71 * width))
    return (_STRIP / 12) * long * top / (bottom + 1e-30)


def fin_added_mass(fin: Fin) -> tuple[Vector, Vector]:
    """Return a fin's added masses and, about its centre, inertias: width, length, normal axis."""
    w = fin.width
    n = fin.length
    t = fin.thickness
    return (
        (plate_mass(t, n), plate_mass(w, t), plate_mass(w, n)),
        (
            plate_inertia(w, n) + plate_inertia(w, t),
            plate_inertia(n, w) + plate_inertia(n, t),
            plate_inertia(t, n) + plate_inertia(t, w),
        ),
    )


def trailing_edge(fin: Fin, velocity: Vector, along: Vector, normal: Vector) -> Vector:
    """Return the force at the end of a fin that moves with ``velocity`` relative to the water.

    ``along`` (towards the hinge) and ``normal`` are the fin's unit vectors.
    """
    mass = _STRIP * fin.width * fin.width * finite_span(fin.width, fin.length)
    u, w = dot(velocity, along), dot(velocity, normal)
    shed = where_less(u, 0.0, 0.0 * u, u)
    return add_scaled(scale(0.5 * mass * w * w, along), -mass * shed * w, normal)
