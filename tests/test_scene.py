"""The parts of the robot are where the physics has them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aquafish_gym.morphology import FINS, Morphology
from aquafish_gym.rendering import scene

NOMINAL = Morphology.nominal()
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def names(*arguments: object) -> list[str]:
    return [part.name for part in scene.robot_parts(*arguments)]


def test_fins_hang_from_their_hinges() -> None:
    turn = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))  # yaw 90 degrees
    angles = (0.0, math.pi / 2, math.pi / 2)
    poses = scene.part_poses(NOMINAL, [(1.0, 2.0, 3.0)], [turn], [angles])[0]
    left, right, tail = poses[-3:, :3]
    np.testing.assert_allclose(left, (1 - 1.0 + 0.8, 2 - 0.75, 3.0), atol=1e-12)
    np.testing.assert_allclose(right, (1 - 1.0, 2 + 0.75, 3.0 - 0.8), atol=1e-12)
    # The tail's phase of 90 degrees is its full sweep of 30.
    s, c = math.sin(math.pi / 6), math.cos(math.pi / 6)
    np.testing.assert_allclose(tail, (1 + 2 + 0.7 * c, 2 + 0.7 * s, 3.0), atol=1e-12)


def test_fins_agree_with_rotations_of_scipy() -> None:
    rng = np.random.default_rng(0)
    positions, angles = rng.normal(size=(20, 3)), rng.uniform(-4, 4, (20, 3))
    body = Rotation.random(20, rng=rng)
    sizes = Morphology.from_array(rng.uniform(0.1, 0.5, 9))
    poses = scene.part_poses(sizes, positions, body.as_quat(), angles)
    joints = (
        ((-0.75, 1.0, 0.0), np.outer(angles[:, 0], (1, 0, 0)), sizes.left_pectoral[1]),
        ((0.75, 1.0, 0.0), np.outer(angles[:, 1], (1, 0, 0)), sizes.right_pectoral[1]),
        (
            (0.0, -2.0, 0.0),
            np.outer(np.sin(angles[:, 2]) * math.pi / 6, (0, 0, 1)),
            sizes.caudal[1],
        ),
    )
    for pose, (hinge, angle, length) in zip(np.moveaxis(poses, 1, 0)[-3:], joints, strict=True):
        fin = body * Rotation.from_rotvec(angle)
        centre = positions + body.apply(hinge) + fin.apply((0.0, -length / 2, 0.0))
        np.testing.assert_allclose(pose[:, :3], centre, atol=1e-12)
        np.testing.assert_allclose(
            (Rotation.from_quat(pose[:, 3:]).inv() * fin).magnitude(), 0, atol=1e-7
        )


def test_parts_and_poses_match_for_any_body_and_damage() -> None:
    missing = Morphology.coerce({"caudal": (0.0, 0.0, 0.0)})
    plate = Morphology.coerce({"caudal": (0.0, 1.0, 0.5)})
    for body in (NOMINAL, missing, plate):
        for broken in ((), ("caudal",), FINS):
            parts = scene.robot_parts(body, broken)
            poses = scene.part_poses(
                body, np.zeros((4, 3)), [UPRIGHT] * 4, np.zeros((4, 3)), broken
            )
            assert poses.shape == (4, len(parts), 7)
            assert min(min(part.size) for part in parts) > 0
    assert names(missing) == ["body", "left_mount", "right_mount", *FINS[:2]]
    assert names(missing, ("caudal",))[-1] == "caudal_break"
    assert names(plate)[-1] == "caudal"


def test_a_broken_fin_has_another_colour_and_an_edge_at_its_end() -> None:
    whole = {part.name: part for part in scene.robot_parts(NOMINAL)}
    parts = {part.name: part for part in scene.robot_parts(NOMINAL, ("left_pectoral",))}
    assert parts["left_pectoral"].colour != whole["left_pectoral"].colour
    assert parts["right_pectoral"] == whole["right_pectoral"]
    poses = scene.part_poses(NOMINAL, [(0, 0, 0)], [UPRIGHT], [(0, 0, 0)], ("left_pectoral",))[0]
    fin, edge = (list(parts).index(name) for name in ("left_pectoral", "left_pectoral_break"))
    assert poses[fin, 1] - poses[edge, 1] == pytest.approx(NOMINAL.left_pectoral[1] / 2)
