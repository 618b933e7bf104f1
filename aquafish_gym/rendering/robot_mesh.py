"""The robot's figure in PyBullet: parts, poses and drawing."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.engines.bullet.world import AXES, HINGES
from aquafish_gym.engines.packages import load_pybullet
from aquafish_gym.morphology import FINS, Morphology
from aquafish_gym.physics import robot
from aquafish_gym.physics.kinematics import caudal_angle
from aquafish_gym.rendering.scenery import Floats, Frame, Pixels, View

_GREY = (0.62, 0.64, 0.67, 1.0)
_DARK = (0.38, 0.40, 0.43, 1.0)
_RED = (0.86, 0.12, 0.10, 1.0)
_THINNEST = 0.02  # a fin of no thickness is drawn this thick
_BODY_HALF = np.array([robot.PECTORAL_X, robot.NOSE, robot.RADIUS])
_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
_NEAREST, _FARTHEST = 0.1, 1200.0  # of the camera's range, units


def fin_poses(
    morphology: Morphology, position: Floats, quaternion: Floats, fin_angles: ArrayLike
) -> list[tuple[Floats, Floats]]:
    """Return the centre and the orientation of each fin in the world."""
    p = load_pybullet()
    left, right, phase = np.asarray(fin_angles, dtype=np.float64)
    angles = (left, right, caudal_angle((math.cos(phase), math.sin(phase))))
    poses = []
    for fin, hinge, axis, angle in zip(FINS, HINGES, AXES, angles, strict=True):
        turn = (*(np.array(axis) * math.sin(angle / 2)), math.cos(angle / 2))
        middle = (0.0, -getattr(morphology, fin)[1] / 2, 0.0)
        at_hinge = p.multiplyTransforms(position, quaternion, hinge, turn)
        place, whole = p.multiplyTransforms(*at_hinge, middle, (0.0, 0.0, 0.0, 1.0))
        poses.append((np.array(place), np.array(whole)))
    return poses


@dataclass
class Figure:
    """The robot's parts in one client: the capsule with its mounts, and the fins that show."""

    client: int
    morphology: Morphology | None = None
    body: int = -1
    fins: list[tuple[int, int]] = field(default_factory=list)  # (which fin, Bullet's body)

    def build(self, morphology: Morphology) -> None:
        """Replace the robot."""
        if morphology == self.morphology:
            return
        p, client = load_pybullet(), self.client
        p.resetSimulation(physicsClientId=client)
        vertices, normals, triangles = _capsule_mesh()
        capsule = p.createVisualShape(
            p.GEOM_MESH, vertices=vertices, normals=normals, indices=triangles, rgbaColor=_GREY,
            specularColor=[0.25] * 3, physicsClientId=client,
        )  # fmt: skip
        mount = self._box((robot.MOUNT_WIDTH, robot.MOUNT_LENGTH, 0.08), _DARK)
        self.body = p.createMultiBody(
            0, -1, capsule,
            linkMasses=[0, 0], linkCollisionShapeIndices=[-1, -1],
            linkVisualShapeIndices=[mount, mount],
            linkPositions=[(x, robot.PECTORAL_Y, 0) for x in (-robot.MOUNT_X, robot.MOUNT_X)],
            linkOrientations=[(0, 0, 0, 1)] * 2, linkInertialFramePositions=[(0, 0, 0)] * 2,
            linkInertialFrameOrientations=[(0, 0, 0, 1)] * 2, linkParentIndices=[0, 0],
            linkJointTypes=[p.JOINT_FIXED] * 2, linkJointAxis=[(0, 0, 1)] * 2,
            physicsClientId=client,
        )  # fmt: skip
        self.fins = []
        for i, fin in enumerate(FINS):
            size = getattr(morphology, fin)
            if sum(v > 0 for v in size) >= 2:
                shape = self._box(tuple(max(v, _THINNEST) for v in size), _RED)
                body = p.createMultiBody(0, -1, shape, physicsClientId=client)
                self.fins.append((i, body))
        self.morphology = morphology

    def _box(self, size: Sequence[float], colour: Sequence[float]) -> Any:
        p = load_pybullet()
        return p.createVisualShape(
            p.GEOM_BOX, halfExtents=[v / 2 for v in size], rgbaColor=colour,
            specularColor=[0.1] * 3, physicsClientId=self.client,
        )  # fmt: skip

    def place(self, position: Floats, quaternion: Floats, fin_angles: ArrayLike) -> Floats:
        """Move the parts; return points (n, 3) whose hull holds them."""
        p = load_pybullet()
        assert self.morphology is not None
        places = fin_poses(self.morphology, position, quaternion, fin_angles)
        parts = [(self.body, position, quaternion, _BODY_HALF)]
        for fin, body in self.fins:
            half = np.maximum(getattr(self.morphology, FINS[fin]), _THINNEST) / 2
            parts.append((body, *places[fin], half))
        corners = []
        for part, where, how, half in parts:
            p.resetBasePositionAndOrientation(
                part, where.tolist(), how.tolist(), physicsClientId=self.client
            )
            matrix = np.reshape(p.getMatrixFromQuaternion(how), (3, 3))
            corners.append(where + (_CORNERS * half) @ matrix.T)
        return np.concatenate(corners)


@functools.cache
def _capsule_mesh(around: int = 40, along: int = 10) -> tuple[Any, Any, Any]:
    """Return vertices, normals and triangles of the capsule, whose axis is y.

    Bullet's own capsule has too few faces.
    """
    polar = np.linspace(0, math.pi / 2, along)
    # From the tail's pole to the nose's: two half spheres, joined by the cylinder.
    ring = np.concatenate([np.sin(polar), np.sin(polar[::-1])])
    axial = np.concatenate([-np.cos(polar), np.cos(polar[::-1])])
    shift = np.repeat([-robot.CYLINDER / 2, robot.CYLINDER / 2], along)
    angle = np.arange(around) * (2 * math.pi / around)
    sides = np.repeat(axial[:, None], around, axis=1)
    normals = np.stack([np.outer(ring, np.cos(angle)), sides, np.outer(ring, np.sin(angle))], -1)
    vertices = robot.RADIUS * normals
    vertices[:, :, 1] += shift[:, None]
    i, j = np.meshgrid(np.arange(2 * along - 1), np.arange(around), indexing="ij")
    here, beside = i * around + j, i * around + (j + 1) % around
    above, across = here + around, beside + around
    triangles = np.stack([here, above, beside, beside, above, across], axis=-1)
    corners, outward = vertices.reshape(-1, 3), normals.reshape(-1, 3)
    return corners.tolist(), outward.tolist(), triangles.ravel().tolist()


def find_window(
    corners: Floats, view: View, width: int, height: int
) -> tuple[int, int, int, int] | None:
    """Return the pixels (left, right, top, bottom) that hold these points, None if none do."""
    from_eye = corners - view.eye
    ahead = from_eye @ view.forward
    if ahead.max() < _NEAREST:
        return None
    if ahead.min() < _NEAREST:
        return (0, width, 0, height)
    scale = height / (2 * view.slope)
    x = width / 2 + scale * (from_eye @ view.right) / ahead
    y = height / 2 - scale * (from_eye @ view.up) / ahead
    left, right = max(0, math.floor(x.min()) - 1), min(width, math.ceil(x.max()) + 1)
    top, bottom = max(0, math.floor(y.min()) - 1), min(height, math.ceil(y.max()) + 1)
    return (left, right, top, bottom) if left < right and top < bottom else None


def draw(
    client: int, view: View, window: tuple[int, int, int, int], width: int, height: int
) -> tuple[Pixels, Pixels]:
    """Draw a client's bodies within a window of the picture.

    Return colours (h, w, 3), black where nothing is, and each pixel's cover (h, w, 1), 0 to 1.
    """
    p = load_pybullet()
    left, right, top, bottom = window
    w, h = 2 * (right - left), 2 * (bottom - top)  # averaged below
    to_eye = np.eye(4)
    to_eye[:3, :3] = (view.right, view.up, -view.forward)
    to_eye[:3, 3] = -to_eye[:3, :3] @ view.eye
    pixel = 2 * view.slope / height * _NEAREST
    across = [(x - width / 2) * pixel for x in (left, right)]
    upward = [(height / 2 - y) * pixel for y in (bottom, top)]
    projection = p.computeProjectionMatrix(*across, *upward, _NEAREST, _FARTHEST)
    light = view.right - 1.2 * view.forward + np.array([0.0, 0.0, 2.2])
    *_, image, _depth, mask = p.getCameraImage(
        w, h, viewMatrix=to_eye.T.reshape(-1).tolist(), projectionMatrix=projection,
        lightDirection=light.tolist(), lightColor=(1.0, 1.0, 1.0), lightAmbientCoeff=0.62,
        lightDiffuseCoeff=0.45, lightSpecularCoeff=0.35, shadow=0, renderer=p.ER_TINY_RENDERER,
        physicsClientId=client,
    )  # fmt: skip
    # By build an array or a flat tuple.
    picture = np.asarray(image, dtype=np.uint8).reshape(h, w, 4)[..., :3]
    covered = (np.asarray(mask).reshape(h, w, 1) >= 0).astype(np.uint8)
    return _shrink(picture * covered), _shrink(covered)


def _shrink(image: Frame) -> Pixels:
    """Average blocks of 2 x 2 pixels, which smooths edges."""
    a, b = image[::2].astype(np.float32), image[1::2]
    rows = a + b
    smooth: Pixels = (rows[:, ::2] + rows[:, 1::2]) * np.float32(0.25)
    return smooth
