"""The scene of frames, films, replays and the viewer: parts, poses, colours, floor.

Lengths are in units of 5 cm. Quaternions are (x, y, z, w). A colour is red, green and blue in
0 to 255.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.physics.arithmetic import (
    Number,
    Vector,
    add,
    cosine_sine,
    cross,
    dot,
    scale,
    where_less,
)
from aquafish_gym.physics.kinematics import fin_angle
from aquafish_gym.physics.robot import MOUNT_LENGTH, Mount, mount
from aquafish_gym.plans import AQUAFISH, BodyPlan, FinPlan
from aquafish_gym.utils.array_types import Floats

Colour = tuple[int, int, int]
Quaternion = tuple[Number, Number, Number, Number]

CM_PER_UNIT = 5
BODY: Colour = (158, 163, 171)
MOUNT: Colour = (97, 102, 110)
FIN: Colour = (219, 31, 26)
BROKEN_FIN: Colour = (250, 204, 21)
BREAK: Colour = (20, 20, 24)  # edge of a break
BELIEF: Colour = (120, 70, 200)  # a robot as it believes itself to be
WATER_ABOVE: Colour = (226, 243, 249)
WATER_BELOW: Colour = (165, 214, 233)
SAND: Colour = (146, 199, 217)
GRID: Colour = (96, 158, 186)
INK: Colour = (28, 60, 84)  # start line and text

FLOOR_DEPTH = 1.25  # of the floor below the start, in rooms of the fish
CLEARANCE = 1 / 1.2  # least distance of the floor below a diving fish, in its rooms
GRID_SPACING = 2.0  # 10 cm
MAIN_GRID_SPACING = 10.0  # 50 cm

PART_NUMBERS = 13  # of a ``DrawnPart``

_MOUNT_THICKNESS = 0.08
_UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
_THINNEST = 0.02  # thickness at which a fin of no thickness is drawn
_RIM = 0.12  # length of a break, and distance by which it exceeds its fin
_LOST = 0.16  # size of the break where a whole fin is missing: too small to pass for a fin


def drawn_parts(plan: BodyPlan = AQUAFISH) -> tuple[str, ...]:
    """Return the names of what is drawn of a fish.

    The first part is a capsule along its y axis, the others are boxes: mounts, fins, and the break
    of each fin.
    """
    mounts = [f"{fin.name}_mount" for fin in plan.fins if mount(plan.hull, fin)]
    return ("body", *mounts, *plan.names, *(f"{fin}_break" for fin in plan.names))


def fin_parts(plan: BodyPlan = AQUAFISH) -> slice:
    """Return where the fins stand among the drawn parts."""
    first = len(drawn_parts(plan)) - 2 * len(plan.fins)
    return slice(first, first + len(plan.fins))


def fish_room(plan: BodyPlan) -> float:
    """Return the radius of the room that pictures give a fish around its centre, units."""
    fins = (math.hypot(fin.hinge[0], fin.hinge[2]) + fin.nominal.length for fin in plan.fins)
    return max(0.6 * plan.hull.length, *fins)


class DrawnPart(NamedTuple):
    """One of the :func:`drawn_parts` of a robot, in body axes."""

    centre: Vector
    turn: Quaternion
    size: Vector  #: Extents along its own axes; a capsule's radius is half of x.
    colour: Vector


class DrawnRobots(NamedTuple):
    """The P :func:`drawn_parts` of N robots, or of one robot at N moments.

    A fin without area and the break of an intact fin have size 0.
    """

    #: (N, P, 3) extents along each part's own axes; a capsule's radius is half of x.
    sizes: Floats
    colours: Floats  #: (N, P, 3)
    poses: Floats  #: (N, P, 7) position and quaternion in the world.


def place_robots(
    bodies: ArrayLike,
    broken: ArrayLike,
    positions: ArrayLike,
    quaternions: ArrayLike,
    fin_angles: ArrayLike,
    plan: BodyPlan = AQUAFISH,
) -> DrawnRobots:
    """Return the drawn parts of robots.

    Broken fins have another colour and a dark break at their end. A broken fin without area has
    only the break, at the hinge.

    Parameters
    ----------
    bodies
        (N, S) sizes, in the order of ``Morphology.to_array``.
    broken
        (N, F) bool, whether each fin is broken.
    positions, quaternions
        (N, 3) and (N, 4), of the bodies.
    fin_angles
        (N, F): each fin's angle, or the phase of one that sweeps, rad.
    plan
        Of all robots.
    """
    sizes, marked, angles = (list(np.array(each, float).T) for each in (bodies, broken, fin_angles))
    parts = place_parts(sizes, marked, angles, plan)
    table = [np.broadcast_arrays(sizes[0], *field) for part in parts for field in part]
    centre, turn, size, colour = (
        np.stack([np.stack(rows[1:], axis=-1) for rows in table[first::4]], axis=1)
        for first in range(4)
    )
    position, attitude = (np.array(each, float)[:, None] for each in (positions, quaternions))
    poses = [position + _rotate(attitude, centre), _multiply(attitude, turn)]
    return DrawnRobots(size, colour, np.concatenate(poses, axis=-1))


def place_parts(
    sizes: Any, broken: Any, fin_angles: Any, plan: BodyPlan = AQUAFISH
) -> list[DrawnPart]:
    """Return the drawn parts of a robot in body axes; see :func:`place_robots`.

    Straight-line code for rows and for symbols (``physics/arithmetic.py``), by which a page of
    ``aquafish.page`` places the same parts in JavaScript. ``broken`` holds 0 and 1.
    """
    hull = plan.hull
    capsule = (2 * hull.radius, hull.length, 2 * hull.radius)
    plates = [_plate(plate) for fin in plan.fins if (plate := mount(hull, fin))]
    fins = []
    breaks = []
    for i, fin in enumerate(plan.fins):
        angle = fin_angles[i] if fin.turns else fin_angle(fin, cosine_sine(fin_angles[i]))
        size = sizes[3 * i], sizes[3 * i + 1], sizes[3 * i + 2]
        along = fin.order.index("length")
        marked = broken[i]
        drawn = tuple(where_less(extent, _THINNEST, _THINNEST, extent) for extent in size)
        count = sum(where_less(0.0, extent, 1.0, 0.0) for extent in size)
        shown = where_less(1.5, count, 1.0, 0.0)
        cosine, sine = cosine_sine(angle * 0.5)
        axis = scale(sine, fin.axis)
        # From the hinge to the fin's middle and to its end.
        length = size[along] * shown
        middle, end = (
            add(fin.hinge, _turned(axis, cosine, scale(share * length, fin.direction)))
            for share in (0.5, 1.0)
        )
        colour = tuple(
            where_less(0.5, marked, float(one), float(other))
            for one, other in zip(BROKEN_FIN, FIN, strict=True)
        )
        rim = tuple(
            marked * where_less(0.5, shown, (0.0 * x if k == along else x) + _RIM, _LOST)
            for k, x in enumerate(drawn)
        )
        turn = _after(axis, cosine, fin)
        fins.append(DrawnPart(middle, turn, scale(shown, drawn), colour))
        breaks.append(DrawnPart(end, turn, rim, BREAK))
    return [DrawnPart((0.0, 0.0, 0.0), _UPRIGHT, capsule, BODY), *plates, *fins, *breaks]


def _plate(plate: Mount) -> DrawnPart:
    """Return the drawn plate between hull and hinge."""
    half = 0.5 * math.atan2(-plate.aside[2], plate.aside[0])
    size = (plate.area / MOUNT_LENGTH, MOUNT_LENGTH, _MOUNT_THICKNESS)
    return DrawnPart(plate.at, (0.0, math.sin(half), 0.0, math.cos(half)), size, MOUNT)


def _after(axis: Vector, cosine: Number, fin: FinPlan) -> Quaternion:
    """Return the turn of a fin's box, whose own axes are those in which its sizes are stated."""
    if fin.is_along_axes:
        return (*axis, cosine)
    x, y, z, w = fin.attitude
    own = (x, y, z)
    turned = add(add(scale(w, axis), scale(cosine, own)), cross(axis, own))
    return (*turned, cosine * w - dot(axis, own))


def _turned(axis: Vector, cosine: Number, v: Vector) -> Vector:
    """Return a vector turned by the unit quaternion (``axis``, ``cosine``)."""
    return add(v, scale(2.0, cross(axis, add(cross(axis, v), scale(cosine, v)))))


def floor_below(positions: Floats, room: float) -> float:
    """Return the height of the floor under robots at positions (N, 3), of a :func:`fish_room`."""
    return min(-FLOOR_DEPTH * room, float(positions[:, 2].min()) - CLEARANCE * room)


def _multiply(p: Floats, q: Floats) -> Floats:
    """Return the products of quaternions (..., 4)."""
    u = p[..., :3]
    v = q[..., :3]
    a = p[..., 3:]
    b = q[..., 3:]
    real = a * b - np.sum(u * v, axis=-1, keepdims=True)
    return np.concatenate([a * v + b * u + np.cross(u, v), real], axis=-1)


def _rotate(q: Floats, v: Floats) -> Floats:
    """Return vectors (..., 3) turned by unit quaternions (..., 4)."""
    u = q[..., :3]
    turned: Floats = v + 2 * np.cross(u, np.cross(u, v) + q[..., 3:] * v)
    return turned
