"""The drag law: the only statement of what the water does to the robot.

At a point of a surface with normal e that moves with velocity V relative to the water, with
vn = V.e and Vt = V - vn e::

    F = -1/2 rho |V| A (C_N vn e + 2 C_f Vt)

It is quadratic, so power is never positive, and scale-free, so only the robot's proportions
matter. Quadratic it has to be: under a linear law a flipper that turns full circles makes no
net impulse, however its speed varies within the turn.

Each fin is three orthogonal plates through its middle (two opposite faces of a box give
exactly the wrench of one two-sided plate), so at one quadrature point of a fin the law is
anisotropic in the fin's own axes. Straight-line code for any carrier; see ``carriers.py``.
"""

from __future__ import annotations

import math

from aquafish_gym.physics.carriers import Number, Vector
from aquafish_gym.robot import (
    CAPSULE_STATIONS,
    MOUNT_LENGTH,
    MOUNT_WIDTH,
    MOUNT_X,
    PECTORAL_Y,
    RADIUS,
    ROLL_AREA,
    Fin,
)

DENSITY = 1.0
NORMAL_DRAG = 1.2  # C_N; handbook: square plate 1.17, long plate 1.98
SKIN_FRICTION = 0.013  # C_f, each side; Blasius at Re 1e4
CROSS_FLOW_DRAG = 0.72  # handbook cylinders: length/diameter 2: 0.68, 5: 0.74
AXIAL_DRAG = 0.30  # assumed; a hemisphere facing the flow: 0.34

# Gauss-Legendre on [0, 1], three points, and on [-1/2, 1/2], two points (weight 1/2 each).
# Under 1% rms error in force and torque; tests/physics/test_quadrature.py is the study.
_NEAR, _MIDDLE, _FAR = 0.5 - 0.5 * math.sqrt(0.6), 0.5, 0.5 + 0.5 * math.sqrt(0.6)
_OUTER_WEIGHT, _MIDDLE_WEIGHT = 5 / 18, 8 / 18
_ASIDE = 0.5 / math.sqrt(3.0)

_STATION_1, _WEIGHT_1 = CAPSULE_STATIONS[3]
_STATION_2, _WEIGHT_2 = CAPSULE_STATIONS[2]

_HALF = 0.5 * DENSITY
_CROSS = _HALF * CROSS_FLOW_DRAG
_AXIAL = _HALF * AXIAL_DRAG * math.pi * RADIUS**2
_ROLL = _HALF * SKIN_FRICTION * ROLL_AREA
_MOUNT_NORMAL = _HALF * NORMAL_DRAG * MOUNT_WIDTH * MOUNT_LENGTH
_MOUNT_FRICTION = _HALF * 2 * SKIN_FRICTION * MOUNT_WIDTH * MOUNT_LENGTH

Row = tuple[Number, Number, Number, Number, Number]


def plate_coefficient(face: Number, edges: Number) -> Number:
    """Return the drag coefficient (force per |V| V) along the normal of a plate.

    ``face`` is that plate's area; ``edges`` is the area of the two plates that contain this
    direction, which only rub.
    """
    return _HALF * (NORMAL_DRAG * face + 2 * SKIN_FRICTION * edges)


def _row(aft: Number, aside: Number, velocity: Vector, spin: Vector, weight: float) -> Row:
    """Sum |V| V over the two points (+-aside, -aft, 0) of a fin, and |V| V moments aside."""
    a = velocity[0] + spin[2] * aft
    c = velocity[2] - spin[0] * aft
    b_lean, c_lean = spin[2] * aside, spin[1] * aside
    b_plus, b_minus = velocity[1] + b_lean, velocity[1] - b_lean
    c_plus, c_minus = c - c_lean, c + c_lean
    aa = a * a
    plus = weight * math.sqrt(aa + b_plus * b_plus + c_plus * c_plus)
    minus = weight * math.sqrt(aa + b_minus * b_minus + c_minus * c_minus)
    bp, bm, cp, cm = plus * b_plus, minus * b_minus, plus * c_plus, minus * c_minus
    return ((plus + minus) * a, bp + bm, cp + cm, aside * (bp - bm), aside * (cp - cm))


def fin_drag(fin: Fin, velocity: Vector, spin: Vector) -> tuple[Vector, Vector]:
    """Return the water's force on a fin and its torque about the hinge.

    Parameters
    ----------
    fin
        Sizes in units of 5 cm.
    velocity
        Of the hinge point relative to the water, in the fin frame (width, length, normal).
    spin
        Angular velocity of the fin, rad/s, in the fin frame.

    Returns
    -------
    force, torque
        In the fin frame.
    """
    near, middle, far = _NEAR * fin.length, _MIDDLE * fin.length, _FAR * fin.length
    aside = _ASIDE * fin.width
    r1 = _row(near, aside, velocity, spin, 0.5 * _OUTER_WEIGHT)
    r2 = _row(middle, aside, velocity, spin, 0.5 * _MIDDLE_WEIGHT)
    r3 = _row(far, aside, velocity, spin, 0.5 * _OUTER_WEIGHT)

    over_width = fin.length * fin.thickness  # the plate whose normal is the width axis
    over_length = fin.width * fin.thickness
    over_normal = fin.width * fin.length
    ka = -plate_coefficient(over_width, over_length + over_normal)
    kb = -plate_coefficient(over_length, over_width + over_normal)
    kc = -plate_coefficient(over_normal, over_width + over_length)

    force = (
        ka * (r1[0] + r2[0] + r3[0]),
        kb * (r1[1] + r2[1] + r3[1]),
        kc * (r1[2] + r2[2] + r3[2]),
    )
    # r x F with r = (+-aside, -aft, 0).
    torque = (
        -kc * (near * r1[2] + middle * r2[2] + far * r3[2]),
        -kc * (r1[4] + r2[4] + r3[4]),
        kb * (r1[3] + r2[3] + r3[3]) + ka * (near * r1[0] + middle * r2[0] + far * r3[0]),
    )
    return force, torque


def _station(y: float, weight: float, velocity: Vector, spin: Vector) -> tuple[Number, Number]:
    """Return the cross-flow force (x, z) on the stretch of capsule around ``y``."""
    x = velocity[0] - spin[2] * y
    z = velocity[2] + spin[0] * y
    k = -(_CROSS * weight) * math.sqrt(x * x + z * z)
    return k * x, k * z


def _mount(x: float, velocity: Vector, spin: Vector) -> Vector:
    """Return the force on the plate between body and pectoral hinge, centred at ``x``."""
    vx = velocity[0] - spin[2] * PECTORAL_Y
    vy = velocity[1] + spin[2] * x
    vz = velocity[2] + spin[0] * PECTORAL_Y - spin[1] * x
    speed = math.sqrt(vx * vx + vy * vy + vz * vz)
    rub = -_MOUNT_FRICTION * speed
    return (rub * vx, rub * vy, -_MOUNT_NORMAL * speed * vz)


def body_drag(velocity: Vector, spin: Vector) -> tuple[Vector, Vector]:
    """Return the water's force on capsule and fin mounts, and its torque about the origin.

    Parameters
    ----------
    velocity
        Of the capsule's centre relative to the water, in body axes.
    spin
        Angular velocity, rad/s, in body axes.
    """
    x1, z1 = _station(_STATION_1, _WEIGHT_1, velocity, spin)
    x2, z2 = _station(_STATION_2, _WEIGHT_2, velocity, spin)
    x3, z3 = _station(-_STATION_2, _WEIGHT_2, velocity, spin)
    x4, z4 = _station(-_STATION_1, _WEIGHT_1, velocity, spin)
    left = _mount(-MOUNT_X, velocity, spin)
    right = _mount(MOUNT_X, velocity, spin)
    force = (
        x1 + x2 + x3 + x4 + (left[0] + right[0]),
        -_AXIAL * abs(velocity[1]) * velocity[1] + (left[1] + right[1]),
        z1 + z2 + z3 + z4 + (left[2] + right[2]),
    )
    torque = (
        _STATION_1 * (z1 - z4) + _STATION_2 * (z2 - z3) + PECTORAL_Y * (left[2] + right[2]),
        MOUNT_X * (left[2] - right[2]) - _ROLL * abs(spin[1]) * spin[1],
        _STATION_1 * (x4 - x1)
        + _STATION_2 * (x3 - x2)
        + MOUNT_X * (right[1] - left[1])
        - PECTORAL_Y * (left[0] + right[0]),
    )
    return force, torque
