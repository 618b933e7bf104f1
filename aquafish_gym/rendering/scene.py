"""The scene that frames, films, the replay and the viewer draw: parts, poses, colours, floor.

Lengths are in units of 5 cm. Quaternions are (x, y, z, w). A colour is red, green and blue in
0 to 255.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.morphology import FINS, Morphology
from aquafish_gym.physics import robot
from aquafish_gym.physics.kinematics import caudal_angle

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]
Triple = tuple[float, float, float]

BODY: Colour = (158, 163, 171)
MOUNT: Colour = (97, 102, 110)
FIN: Colour = (219, 31, 26)
BROKEN_FIN: Colour = (250, 204, 21)
BREAK: Colour = (20, 20, 24)  # the edge where a fin is broken off
WATER_ABOVE: Colour = (226, 243, 249)
WATER_BELOW: Colour = (165, 214, 233)
SAND: Colour = (146, 199, 217)
GRID: Colour = (96, 158, 186)
INK: Colour = (28, 60, 84)  # the start line, and text

FLOOR = -3.0  # height of the floor, z
CLEARANCE = 2.0  # the floor is at least this far below a robot that dives
GRID_SPACING = 2.0  # 10 cm
MAIN_GRID_SPACING = 10.0  # 50 cm

_THINNEST = 0.02  # thickness at which a fin of no thickness is drawn
_RIM = 0.12  # a break stands out of its fin by this much, and is this long
_JOINTS = {  # fin -> hinge and axis, in body axes
    "left_pectoral": ((-robot.PECTORAL_X, robot.PECTORAL_Y, 0.0), (1.0, 0.0, 0.0)),
    "right_pectoral": ((robot.PECTORAL_X, robot.PECTORAL_Y, 0.0), (1.0, 0.0, 0.0)),
    "caudal": ((0.0, robot.CAUDAL_Y, 0.0), (0.0, 0.0, 1.0)),
}


class Part(NamedTuple):
    """A solid with a colour: a capsule along its y axis, or a box.

    ``size`` is the extent along the part's own x, y and z. A capsule's radius is half its x.
    """

    kind: Literal["capsule", "box"]
    size: Triple
    colour: Colour
    name: str


def robot_parts(morphology: Morphology, broken: Collection[str] = ()) -> tuple[Part, ...]:
    """Return the body, its two mounts and the fins that have an area.

    Fins named in ``broken`` have another colour and a dark edge at their end, a part of its own. Of
    a broken fin without area only the edge is drawn, at the hinge.
    """
    return tuple(part for part, _, _ in _placed_parts(morphology, broken))


def part_poses(
    morphology: Morphology,
    positions: ArrayLike,
    quaternions: ArrayLike,
    fin_angles: ArrayLike,
    broken: Collection[str] = (),
) -> Floats:
    """Return position and quaternion (T, n, 7) in the world of each of ``robot_parts``.

    Parameters
    ----------
    positions, quaternions
        (T, 3) and (T, 4), of the body.
    fin_angles
        (T, 3): left and right pectoral angle and caudal phase, rad.
    """
    position, quaternion = np.array(positions, float), np.array(quaternions, float)
    left, right, phase = np.array(fin_angles, float).T
    angles = (left, right, caudal_angle((np.cos(phase), np.sin(phase))))
    poses = []
    for _, fin, centre in _placed_parts(morphology, broken):
        place, turn = np.array(centre), quaternion
        if fin:
            hinge, axis = _JOINTS[fin]
            half = angles[FINS.index(fin)][:, None] / 2
            joint = np.concatenate([np.sin(half) * axis, np.cos(half)], axis=1)
            place, turn = hinge + _rotate(joint, place), _multiply(quaternion, joint)
        poses.append(np.concatenate([position + _rotate(quaternion, place), turn], axis=1))
    return np.stack(poses, axis=1)


def _placed_parts(
    morphology: Morphology, broken: Collection[str]
) -> list[tuple[Part, str, Triple]]:
    """Return each part, the fin whose hinge it turns about or "", and its centre from there."""
    diameter, mount = 2 * robot.RADIUS, (robot.MOUNT_WIDTH, robot.MOUNT_LENGTH, 0.08)
    parts: list[tuple[Part, str, Triple]] = [
        (Part("capsule", (diameter, 2 * robot.NOSE, diameter), BODY, "body"), "", (0, 0, 0))
    ]
    for name, x in (("left_mount", -robot.MOUNT_X), ("right_mount", robot.MOUNT_X)):
        parts.append((Part("box", mount, MOUNT, name), "", (x, robot.PECTORAL_Y, 0)))
    for fin in FINS:
        size = getattr(morphology, fin)
        width, length, thickness = (max(v, _THINNEST) for v in size)
        shows = sum(v > 0 for v in size) >= 2
        if shows:
            colour = BROKEN_FIN if fin in broken else FIN
            part = Part("box", (width, length, thickness), colour, fin)
            parts.append((part, fin, (0, -size[1] / 2, 0)))
        if fin in broken:
            end = (width + _RIM, _RIM, thickness + _RIM) if shows else (0.3, 0.3, 0.3)
            part = Part("box", end, BREAK, f"{fin}_break")
            parts.append((part, fin, (0, -size[1] if shows else 0, 0)))
    return parts


def _multiply(p: Floats, q: Floats) -> Floats:
    """Return the products of quaternions (..., 4)."""
    u, v, a, b = p[..., :3], q[..., :3], p[..., 3:], q[..., 3:]
    real = a * b - np.sum(u * v, axis=-1, keepdims=True)
    return np.concatenate([a * v + b * u + np.cross(u, v), real], axis=-1)


def _rotate(q: Floats, v: Floats) -> Floats:
    """Return vectors (..., 3) turned by unit quaternions (..., 4)."""
    u = q[..., :3]
    turned: Floats = v + 2 * np.cross(u, np.cross(u, v) + q[..., 3:] * v)
    return turned
