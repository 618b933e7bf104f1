"""Robots as batched meshes of a viser scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.physics.layout import FIELDS, layout
from aquafish_gym.plans import BodyPlan
from aquafish_gym.rendering.scene import BODY, Colour, DrawnRobots, place_robots
from aquafish_gym.utils.array_types import Floats


def robots_in(
    plan: BodyPlan, states: Floats, bodies: Floats, broken: ArrayLike = False
) -> DrawnRobots:
    """Return a plan's robots of bodies (B, S) with broken fins (B, F) in states (R, B)."""
    position, quaternion = (states[FIELDS[name]].T for name in ("position", "orientation"))
    angles = layout(plan).angles(states).T
    marked = np.broadcast_to(broken, angles.shape)
    return place_robots(bodies, marked, position, quaternion, angles, plan)


class Shapes:
    """Robots in a viser scene: two batched meshes, of their capsules and of their boxes.

    With an ``opacity`` they are ghosts, which cast no shadow.
    """

    def __init__(
        self,
        api: Any,
        name: str,
        robots: DrawnRobots,
        colour: Colour | None = None,
        opacity: float | None = None,
    ) -> None:
        import trimesh

        wide, long, _ = robots.sizes[0, 0]
        capsule = trimesh.creation.capsule(long - wide, wide / 2, count=[24, 24])
        capsule.vertices = capsule.vertices[:, [1, 2, 0]]  # its axis is y
        self._colour, count = colour, len(robots.sizes)

        def add(part: str, mesh: Any, parts: int) -> Any:
            return api.add_batched_meshes_simple(
                f"{name}/{part}", mesh.vertices, mesh.faces, flat_shading=part == "boxes",
                batched_wxyzs=np.tile((1.0, 0.0, 0.0, 0.0), (count * parts, 1)),
                batched_positions=np.zeros((count * parts, 3)),
                batched_scales=np.ones((count * parts, 3)),
                batched_colors=np.array(colour or BODY, np.uint8),
                opacity=opacity, cast_shadow=opacity is None, receive_shadow=False, lod="off",
            )  # fmt: skip

        self.capsules = add("capsules", capsule, 1)
        self.boxes = add("boxes", trimesh.creation.box((1, 1, 1)), robots.sizes.shape[1] - 1)
        self._look: Floats = np.zeros(0)

    def show(self, robots: DrawnRobots) -> None:
        """Draw robots, as many as at the start."""
        look = np.stack([robots.sizes[:, 1:], robots.colours[:, 1:]]).reshape(2, -1, 3)
        if not np.array_equal(look, self._look):
            self._look = look
            self.boxes.batched_scales = np.maximum(look[0], 1e-4).astype(np.float32)
            if self._colour is None:
                self.boxes.batched_colors = look[1].astype(np.uint8)
        for handle, parts in ((self.capsules, slice(1)), (self.boxes, slice(1, None))):
            poses = robots.poses[:, parts].reshape(-1, 7).astype(np.float32)
            handle.batched_positions = poses[:, :3]
            handle.batched_wxyzs = np.roll(poses[:, 3:], 1, axis=1)
