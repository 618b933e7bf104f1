"""Pictures of the robot over a ruled sea floor, on the machine's processor and without a display.

A pose is a position (3,) in units of 5 cm and a quaternion (4,) (x, y, z, w) from body to
world. Fin angles are as everywhere: left and right pectoral angle and caudal *phase*, rad.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.morphology import Morphology
from aquafish_gym.rendering.camera import Camera, Frame
from aquafish_gym.rendering.scene import CLEARANCE, FLOOR, Floats, part_poses, robot_parts
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer


def render_pose(
    morphology: Morphology,
    pose: tuple[ArrayLike, ArrayLike],
    fin_angles: ArrayLike,
    width: int = 640,
    height: int = 480,
    camera: Camera | None = None,
    broken: Collection[str] = (),
) -> Frame:
    """Return a picture of the robot, (height, width, 3) uint8; fins of no area are not drawn.

    Without a camera it is seen from behind, above and its right. Fins named in ``broken`` are
    marked, see :func:`robot_parts`.
    """
    from aquafish_gym.rendering import caster

    integer("width", width, 16, 4096)
    integer("height", height, 16, 4096)
    position, quaternion, angles = _check_pose(pose, fin_angles)
    view = (camera or Camera()).look(position)
    # The floor of a robot that dives is below it.
    floor = min(FLOOR, position[2] - CLEARANCE)
    poses = part_poses(morphology, [position], [quaternion], [angles], broken)[0]
    robot = caster.solid_parts(robot_parts(morphology, broken), poses)
    picture = caster.draw_water(view, floor, [robot], width, height)
    caster.draw_robots(picture, view, [robot])
    return picture


def _check_pose(
    pose: tuple[ArrayLike, ArrayLike], fin_angles: ArrayLike
) -> tuple[Floats, Floats, Floats]:
    try:
        where, how = pose
    except (TypeError, ValueError):
        raise InvalidArgumentError(
            f"pose must be a position and a quaternion; got {pose!r}"
        ) from None
    position = finite_array("pose position", where, (3,), -1e6, 1e6)
    quaternion = finite_array("pose quaternion", how, (4,))
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > 1e-3:
        raise InvalidArgumentError(f"pose quaternion must have length 1; got {length:g}")
    return position, quaternion / length, finite_array("fin_angles", fin_angles, (3,), unit="rad")


def render_motion(
    morphology: Morphology,
    positions: ArrayLike,
    quaternions: ArrayLike,
    fin_angles: ArrayLike,
    width: int = 640,
    height: int = 480,
    camera: Camera | None = None,
) -> list[Frame]:
    """Return :func:`render_pose` of T positions (T, 3), quaternions (T, 4) and fins (T, 3)."""
    where = finite_array("positions", positions, (None, 3))
    count = len(where)
    how = finite_array("quaternions", quaternions, (count, 4))
    angles = finite_array("fin_angles", fin_angles, (count, 3), unit="rad")
    return [
        render_pose(morphology, (here, turn), fins, width, height, camera)
        for here, turn, fins in zip(where, how, angles, strict=True)
    ]
