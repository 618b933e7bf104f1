"""The scene of frames, films, replays and the viewer: parts, poses, colours, floor.

Lengths are in units of 5 cm. Quaternions are (x, y, z, w). A colour is red, green and blue in
0 to 255.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.morphology import FINS
from aquafish_gym.physics import robot
from aquafish_gym.physics.kinematics import caudal_angle
from aquafish_gym.utils.array_types import Floats

Colour = tuple[int, int, int]

CM_PER_UNIT = 5
BODY: Colour = (158, 163, 171)
MOUNT: Colour = (97, 102, 110)
FIN: Colour = (219, 31, 26)
BROKEN_FIN: Colour = (250, 204, 21)
BREAK: Colour = (20, 20, 24)  # edge of a break
WATER_ABOVE: Colour = (226, 243, 249)
WATER_BELOW: Colour = (165, 214, 233)
SAND: Colour = (146, 199, 217)
GRID: Colour = (96, 158, 186)
INK: Colour = (28, 60, 84)  # start line and text

FLOOR_HEIGHT = -3.0  # height of the floor, z
CLEARANCE = 2.0  # least distance of the floor below a diving robot
GRID_SPACING = 2.0  # 10 cm
MAIN_GRID_SPACING = 10.0  # 50 cm

#: The first part is a capsule along its y axis, the others are boxes.
DRAWN_PARTS = ("body", "left_mount", "right_mount", *FINS, *(f"{fin}_break" for fin in FINS))
FIN_PARTS = slice(3, 6)

_SIZES = np.array(  # sizes of the parts that do not break
    [
        (2 * robot.RADIUS, 2 * robot.NOSE, 2 * robot.RADIUS),
        *[(robot.MOUNT_WIDTH, robot.MOUNT_LENGTH, 0.08)] * 2,
    ]
)
_CENTRES = np.array([(0, 0, 0), *((side * robot.MOUNT_X, robot.PECTORAL_Y, 0) for side in (-1, 1))])
_HINGES = np.array(
    [
        *((side * robot.PECTORAL_X, robot.PECTORAL_Y, 0) for side in (-1, 1)),
        (0, robot.CAUDAL_Y, 0),
    ]
)
_AXES = np.array([(1, 0, 0), (1, 0, 0), (0, 0, 1)])
_THINNEST = 0.02  # thickness at which a fin of no thickness is drawn
_RIM = 0.12  # length of a break, and distance by which it exceeds its fin
_LOST = 0.3  # size of the break where a whole fin is missing


class DrawnRobots(NamedTuple):
    """The ``DRAWN_PARTS`` of N robots, or of one robot at N moments.

    A fin without area and the break of an intact fin have size 0.
    """

    #: (N, 9, 3) extents along each part's own axes; a capsule's radius is half of x.
    sizes: Floats
    colours: Floats  #: (N, 9, 3)
    poses: Floats  #: (N, 9, 7) position and quaternion in the world.


def place_robots(
    bodies: ArrayLike,
    broken: ArrayLike,
    positions: ArrayLike,
    quaternions: ArrayLike,
    fin_angles: ArrayLike,
) -> DrawnRobots:
    """Return the drawn parts of robots.

    Broken fins have another colour and a dark break at their end. A broken fin without area has
    only the break, at the hinge.

    Parameters
    ----------
    bodies
        (N, 9) sizes, in the order of ``Morphology.to_array``.
    broken
        (N, 3) bool, whether each fin is broken.
    positions, quaternions
        (N, 3) and (N, 4), of the bodies.
    fin_angles
        (N, 3): left and right pectoral angle and caudal phase, rad.
    """
    fins = np.array(bodies, float).reshape(-1, 3, 3)
    marked = np.array(broken)[..., None]
    shown = np.count_nonzero(fins > 0, axis=-1, keepdims=True) >= 2
    drawn = np.maximum(fins, _THINNEST)
    ends = np.where(shown, drawn * (1, 0, 1) + _RIM, _LOST)
    whole = [np.broadcast_to(each, (len(fins), 3, 3)) for each in (_SIZES, (BODY, MOUNT, MOUNT))]
    sizes = np.concatenate([whole[0], drawn * shown, ends * marked], axis=1)
    colours = [whole[1], np.where(marked, BROKEN_FIN, FIN), np.broadcast_to(BREAK, fins.shape)]

    left, right, phase = np.array(fin_angles, float).T
    angles = np.array([left, right, caudal_angle((np.cos(phase), np.sin(phase)))]).T[..., None]
    joints = np.concatenate([np.sin(angles / 2) * _AXES, np.cos(angles / 2)], axis=-1)
    along = [_HINGES + _rotate(joints, fins * shown * (0, -share, 0)) for share in (0.5, 1.0)]
    centres = np.concatenate([np.broadcast_to(_CENTRES, fins.shape), *along], axis=1)
    upright = np.broadcast_to((0.0, 0.0, 0.0, 1.0), joints.shape)
    turns = np.concatenate([upright, joints, joints], axis=1)
    position, turn = (np.array(each, float)[:, None] for each in (positions, quaternions))
    poses = [position + _rotate(turn, centres), _multiply(turn, turns)]
    return DrawnRobots(sizes, np.concatenate(colours, axis=1), np.concatenate(poses, axis=-1))


def floor_below(positions: Floats) -> float:
    """Return the height of the floor under robots at positions (N, 3)."""
    return min(FLOOR_HEIGHT, float(positions[:, 2].min()) - CLEARANCE)


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
