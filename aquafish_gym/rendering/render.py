"""Pictures of the robot over a ruled sea floor, drawn by the CPU without a display.

A pose is a position (3,) in units of 5 cm and a quaternion (4,) (x, y, z, w) from body to
world. Fin angles (F,) are each fin's angle, or the *phase* of one that sweeps, rad.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.morphology import Morphology
from aquafish_gym.rendering.camera import Camera, Frame
from aquafish_gym.rendering.scene import fish_room, floor_below, place_robots
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    instance,
    integer,
    one_of,
    sequence,
)

_DISTANCE = 10.5 / 2.4  # of the camera, in rooms of the fish


def render_pose(
    morphology: Morphology,
    pose: tuple[ArrayLike, ArrayLike],
    fin_angles: ArrayLike,
    width: int = 640,
    height: int = 480,
    camera: Camera | None = None,
    broken: Sequence[str] = (),
) -> Frame:
    """Return a picture of the robot, (height, width, 3) uint8; fins of no area are not drawn.

    Without a camera the view is from behind, above and the right, farther from a larger fish.
    Fins named in ``broken`` are marked; see :func:`place_robots`.
    """
    from aquafish_gym.rendering import caster

    body = instance("morphology", morphology, Morphology)
    plan = body.plan
    room = fish_room(plan)
    if camera is None:
        camera = Camera(distance=_DISTANCE * room)
    view = instance("camera", camera, Camera)
    for fin in sequence("broken", broken):
        one_of("broken", fin, plan.names)
    integer("width", width, 16, 4096)
    integer("height", height, 16, 4096)
    if not isinstance(pose, tuple | list) or len(pose) != 2:
        raise InvalidArgumentError(f"pose must be a position and a quaternion; got {brief(pose)}")
    position = finite_array("pose position", pose[0], (3,), -1e6, 1e6)
    quaternion = finite_array("pose quaternion", pose[1], (4,))
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > 1e-3:
        raise InvalidArgumentError(f"pose quaternion must have length 1; got {length:g}")
    angles = finite_array("fin_angles", fin_angles, (len(plan.fins),), unit="rad")
    marked = [fin in broken for fin in plan.names]
    robot = place_robots(
        [body.to_array()], [marked], [position], [quaternion / length], [angles], plan
    )
    floor = floor_below(position[None], room)
    return caster.draw(view.look(position), floor, [robot], width, height)[0]
