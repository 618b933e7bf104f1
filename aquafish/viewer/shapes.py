"""Robots as batched meshes of a viser scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from aquafish.viewer.live import Floats
from aquafish_gym.morphology import FINS, Morphology
from aquafish_gym.physics.layout import FIELDS, angles_of_rows
from aquafish_gym.rendering import scene

POSITION, QUATERNION = FIELDS["position"], FIELDS["orientation"]
BOXES = ("left_mount", "right_mount", *FINS, *(f"{fin}_break" for fin in FINS))


class Shapes:
    """Robots in a viser scene: two batched meshes, of their capsules and of their boxes."""

    def __init__(
        self, api: Any, name: str, count: int, colour: scene.Colour | None, opacity: float | None
    ) -> None:
        import trimesh

        body = scene.robot_parts(Morphology.nominal())[0].size
        capsule = trimesh.creation.capsule(body[1] - body[0], body[0] / 2, count=[24, 24])
        capsule.vertices = capsule.vertices[:, [1, 2, 0]]  # its axis is y
        self.colour, self.count = colour, count
        self._dress: list[tuple[bytes, tuple[str, ...]]] = []

        def add(part: str, mesh: Any, number: int, flat: bool) -> Any:
            return api.add_batched_meshes_simple(
                f"{name}/{part}", mesh.vertices, mesh.faces, opacity=opacity, flat_shading=flat,
                batched_wxyzs=np.tile((1.0, 0.0, 0.0, 0.0), (number, 1)),
                batched_positions=np.zeros((number, 3)), batched_scales=np.ones((number, 3)),
                batched_colors=np.tile(np.array(colour or scene.BODY, np.uint8), (number, 1)),
                cast_shadow=opacity is None, receive_shadow=False, lod="off",
            )  # fmt: skip

        self.capsules = add("capsules", capsule, count, flat=False)
        self.boxes = add("boxes", trimesh.creation.box((1, 1, 1)), count * len(BOXES), flat=True)

    def show(self, bodies: Floats, broken: Sequence[Sequence[str]], states: Floats) -> None:
        """Draw robots of bodies (B, 9) with broken fins in states (25, B)."""
        dress = [(body.tobytes(), tuple(fins)) for body, fins in zip(bodies, broken, strict=True)]
        poses = np.zeros((self.count, len(BOXES), 7))
        sizes = np.full((self.count, len(BOXES), 3), 1e-4)  # of a part that a robot does not have
        colours = np.zeros((self.count, len(BOXES), 3), np.uint8)
        capsules = np.zeros((self.count, 7))
        position, quaternion = states[POSITION].T, states[QUATERNION].T
        angles = angles_of_rows(states).T
        for one in dict.fromkeys(dress):
            rows = np.array([row for row, other in enumerate(dress) if other == one])
            body, fins = Morphology.from_array(bodies[rows[0]]), one[1]
            placed = scene.part_poses(body, position[rows], quaternion[rows], angles[rows], fins)
            parts = scene.robot_parts(body, fins)
            capsules[rows] = placed[:, 0]
            poses[rows] = placed[:, :1]
            for k, part in enumerate(parts[1:], 1):
                box = BOXES.index(part.name)
                poses[rows, box], sizes[rows, box] = placed[:, k], part.size
                colours[rows, box] = self.colour or part.colour
        if dress != self._dress:
            self._dress = dress
            self.boxes.batched_scales = sizes.reshape(-1, 3).astype(np.float32)
            self.boxes.batched_colors = colours.reshape(-1, 3)
        for handle, table in ((self.capsules, capsules), (self.boxes, poses.reshape(-1, 7))):
            handle.batched_positions = table[:, :3].astype(np.float32)
            handle.batched_wxyzs = np.roll(table[:, 3:], 1, axis=1).astype(np.float32)
