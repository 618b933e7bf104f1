"""The parts of the robot are where the physics has them."""

from __future__ import annotations

import math

import numpy as np
import pytest

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


def test_parts_agree_with_pybullet_transforms() -> None:
    """Bullet multiplies transforms in single precision."""
    fin_poses = pytest.importorskip("aquafish_gym.rendering.robot_mesh").fin_poses
    rng = np.random.default_rng(0)
    positions, angles = rng.normal(size=(20, 3)), rng.uniform(-4, 4, (20, 3))
    quaternions = rng.normal(size=(20, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    body = Morphology.from_array(rng.uniform(0.1, 0.5, 9))
    ours = scene.part_poses(body, positions, quaternions, angles)[:, -3:]
    for row, place, turn, fins in zip(ours, positions, quaternions, angles, strict=True):
        theirs = np.array([np.concatenate(p) for p in fin_poses(body, place, turn, fins)])
        np.testing.assert_allclose(row[:, :3], theirs[:, :3], atol=1e-6)
        same = np.abs(np.sum(row[:, 3:] * theirs[:, 3:], axis=1))  # q and -q are one attitude
        np.testing.assert_allclose(same, 1.0, atol=1e-6)


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
