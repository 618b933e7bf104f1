"""The drag law, stated once.

At a point of a surface with normal e that moves with velocity V relative to the water, with
vn = V.e and Vt = V - vn e::

    F = -1/2 rho |V| A (C_N vn e + 2 C_f Vt)

It is quadratic, so power is never positive, and scale-free, so only the robot's proportions
matter. It must be quadratic: under a linear law a flipper that turns full circles makes no net
impulse, however its speed varies within the turn.

Each fin is three orthogonal plates through its middle, one two-sided plate for two opposite
faces of the box, so at one quadrature point of a fin the law is anisotropic in the fin's own
axes. Straight-line code for any scalar backend; see ``arithmetic.py``.
"""

from __future__ import annotations

import math

from aquafish_gym.physics.arithmetic import (
    Number,
    Vector,
    add,
    add_scaled,
    dot,
    fma,
    square_root,
    subtract,
)
from aquafish_gym.physics.robot import Fin, Mount, hull_numbers, mount
from aquafish_gym.plans import BodyPlan

DENSITY = 1.0
NORMAL_DRAG = 1.2  # C_N; handbook: square plate 1.17, long plate 1.98
SKIN_FRICTION = 0.013  # C_f, each side; Blasius at Re 1e4
CROSS_FLOW_DRAG = 0.72  # handbook cylinders: length/diameter 2: 0.68, 5: 0.74
AXIAL_DRAG = 0.30  # assumed; a hemisphere facing the flow: 0.34

# Four points a fin, exact to the third degree: Gauss and Legendre's three along its length,
# the middle one split in two. Under 1% rms error in force and torque, as five stations are
# along the capsule; docs/physics.md has the study.
_NEAR = 0.5 - 0.5 * math.sqrt(0.6)
_MIDDLE = 0.5
_FAR = 0.5 + 0.5 * math.sqrt(0.6)
_OUTER_WEIGHT, _MIDDLE_WEIGHT = 5 / 18, 8 / 18
_ASIDE = math.sqrt(3.0) / 4

_HALF = 0.5 * DENSITY
_CROSS = _HALF * CROSS_FLOW_DRAG


def plate_coefficient(face: Number, edges: Number) -> Number:
    """Return the drag coefficient (force per |V| V) along the normal of a plate of area ``face``.

    ``edges`` is the area of the two plates that contain this direction, which only rub.
    """
    return _HALF * (NORMAL_DRAG * face + 2 * SKIN_FRICTION * edges)


def _speed(velocity: Vector) -> Number:
    return square_root(dot(velocity, velocity))


def fin_drag(fin: Fin, velocity: Vector, spin: Vector) -> tuple[Vector, Vector]:
    """Return the water's force on a fin and its torque about the hinge, in the fin frame.

    ``velocity`` is the hinge point's relative to the water and ``spin`` the fin's (rad/s), both
    in the fin frame (width, length, normal).
    """
    near = _NEAR * fin.length
    middle = _MIDDLE * fin.length
    far = _FAR * fin.length
    aside = _ASIDE * fin.width

    # Velocities at (0, -near, 0), (0, -far, 0) and (+-aside, -middle, 0).
    b = velocity[1]
    a1, c1 = fma(spin[2], near, velocity[0]), fma(-spin[0], near, velocity[2])
    a2, c2 = fma(spin[2], middle, velocity[0]), fma(-spin[0], middle, velocity[2])
    a3, c3 = fma(spin[2], far, velocity[0]), fma(-spin[0], far, velocity[2])
    b_plus, b_minus = fma(spin[2], aside, b), fma(-spin[2], aside, b)
    c_plus, c_minus = fma(-spin[1], aside, c2), fma(spin[1], aside, c2)

    # |V| and |V| V there, with their weights.
    k1 = _OUTER_WEIGHT * _speed((a1, b, c1))
    k3 = _OUTER_WEIGHT * _speed((a3, b, c3))
    plus = 0.5 * _MIDDLE_WEIGHT * _speed((a2, b_plus, c_plus))
    minus = 0.5 * _MIDDLE_WEIGHT * _speed((a2, b_minus, c_minus))
    near_a, near_c = k1 * a1, k1 * c1
    middle_a, middle_c = (plus + minus) * a2, fma(plus, c_plus, minus * c_minus)
    far_a, far_c = k3 * a3, k3 * c3

    over_width = fin.length * fin.thickness  # the plate whose normal is the width axis
    over_length = fin.width * fin.thickness
    over_normal = fin.width * fin.length
    ka = -fin.drag * plate_coefficient(over_width, over_length + over_normal)
    kb = -fin.drag * plate_coefficient(over_length, over_width + over_normal)
    kc = -fin.drag * plate_coefficient(over_normal, over_width + over_length)

    force = (
        ka * (near_a + middle_a + far_a),
        kb * fma(k1 + k3, b, fma(plus, b_plus, minus * b_minus)),
        kc * (near_c + middle_c + far_c),
    )
    # r x F with r = (+-aside, -aft, 0).
    lean_b = aside * fma(plus, b_plus, -(minus * b_minus))
    lean_c = aside * fma(plus, c_plus, -(minus * c_minus))
    torque = (
        -kc * fma(near, near_c, fma(middle, middle_c, far * far_c)),
        -kc * lean_c,
        fma(kb, lean_b, ka * fma(near, near_a, fma(middle, middle_a, far * far_a))),
    )
    return force, torque


def _station(y: float, weight: float, velocity: Vector, spin: Vector) -> tuple[Number, Number]:
    """Return the cross-flow force (x, z) on the stretch of capsule around ``y``."""
    x = fma(-y, spin[2], velocity[0])
    z = fma(y, spin[0], velocity[2])
    k = -(_CROSS * weight) * square_root(fma(x, x, z * z))
    return k * x, k * z


def _mount_drag(mount: Mount, velocity: Vector, spin: Vector) -> Vector:
    """Return the force on the plate between hull and hinge."""
    x, y, z = mount.at
    v = (
        fma(z, spin[1], fma(-y, spin[2], velocity[0])),
        fma(-z, spin[0], fma(x, spin[2], velocity[1])),
        fma(-x, spin[1], fma(y, spin[0], velocity[2])),
    )
    speed = _speed(v)
    along, through = dot(mount.aside, v), dot(mount.normal, v)
    rub = -(_HALF * 2 * SKIN_FRICTION * mount.area) * speed
    push = -(_HALF * NORMAL_DRAG * mount.area) * speed
    rubbing = add_scaled((0.0, rub * v[1], 0.0), rub * along, mount.aside)
    return add_scaled(rubbing, push * through, mount.normal)


def body_drag(plan: BodyPlan, velocity: Vector, spin: Vector) -> tuple[Vector, Vector]:
    """Return the water's force on the hull and the fins' mounts, and its torque about the origin.

    In body axes, as the centre's ``velocity`` relative to the water and ``spin`` (rad/s) are.
    """
    hull = hull_numbers(plan.hull)
    axial = _HALF * AXIAL_DRAG * math.pi * hull.radius**2
    roll = _HALF * SKIN_FRICTION * hull.roll_area
    mounts: Vector = (0.0, 0.0, 0.0)
    torque: Vector = (0.0, -roll * abs(spin[1]) * spin[1], 0.0)
    for group in plan.groups:
        plates = [plate for i in group if (plate := mount(plan.hull, plan.fins[i]))]
        if not plates:
            continue
        forces = [_mount_drag(plate, velocity, spin) for plate in plates]
        x, y, z = plates[-1].at
        whole, apart = forces[0], forces[0]
        if len(plates) == 2:
            whole, apart = add(*forces), subtract(forces[1], forces[0])
        mounts = add(mounts, whole)
        torque = (
            fma(-z, whole[1], fma(y, whole[2], torque[0])),
            fma(z, whole[0], fma(-x, apart[2], torque[1])),
            fma(x, apart[1], fma(-y, whole[0], torque[2])),
        )

    (_, w0), (y1, w1), (y2, w2) = hull.stations
    k0 = -(_CROSS * w0) * square_root(fma(velocity[0], velocity[0], velocity[2] * velocity[2]))
    fore1_x, fore1_z = _station(y1, w1, velocity, spin)
    fore2_x, fore2_z = _station(y2, w2, velocity, spin)
    aft1_x, aft1_z = _station(-y1, w1, velocity, spin)
    aft2_x, aft2_z = _station(-y2, w2, velocity, spin)
    force = (
        fma(k0, velocity[0], (fore1_x + aft1_x) + (fore2_x + aft2_x) + mounts[0]),
        fma(-axial * abs(velocity[1]), velocity[1], mounts[1]),
        fma(k0, velocity[2], (fore1_z + aft1_z) + (fore2_z + aft2_z) + mounts[2]),
    )
    return force, (
        fma(y1, fore1_z - aft1_z, fma(y2, fore2_z - aft2_z, torque[0])),
        torque[1],
        fma(-y1, fore1_x - aft1_x, fma(-y2, fore2_x - aft2_x, torque[2])),
    )
