"""Pictures of the robot over a ruled sea floor, on the machine's processor and without a display.

A pose is a position (3,) in units of 5 cm and a quaternion (4,) (x, y, z, w) from body to
world. Fin angles are as everywhere: left and right pectoral angle and caudal *phase*, rad.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.morphology import Morphology
from aquafish_gym.rendering.camera import Camera, Frame
from aquafish_gym.rendering.scene import CLEARANCE, FLOOR, Floats, part_poses, robot_parts
from aquafish_gym.runs.storage import write_bytes
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


def write_gif(frames: Iterable[Frame], path: str | os.PathLike[str], fps: float = 20.0) -> Path:
    """Write frames (H, W, 3) of one size as a GIF that repeats forever; return its path.

    GIF counts hundredths of a second, so only frame rates of 100 / n are exact.
    """
    from PIL import Image

    finite_array("fps", fps, (), 0.1, 240.0)
    pictures = [np.asarray(frame) for frame in frames]
    if not pictures:
        raise InvalidArgumentError("frames must hold at least one picture; got none")
    for picture in pictures:
        if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3:
            found = f"{picture.shape} of {picture.dtype}"
            raise InvalidArgumentError(f"frames must be (H, W, 3) pictures of uint8; got {found}")
        if picture.shape != pictures[0].shape:
            sizes = f"{pictures[0].shape} and {picture.shape}"
            raise InvalidArgumentError(f"frames must all be of one size; got {sizes}")
    pause = 10 * max(2, round(100 / fps))  # ms; viewers slow down anything shorter than 20
    first, *others = (Image.fromarray(picture) for picture in pictures)
    content = BytesIO()
    first.save(content, "GIF", save_all=True, append_images=others, duration=pause, loop=0)
    write_bytes(path, content.getvalue())
    return Path(path)
