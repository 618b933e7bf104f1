"""The parts of the robot are where the physics has them."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.rendering import scene
from tests.plans import PLANS

NOMINAL = Morphology.nominal()
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def placed(
    body: Morphology,
    broken: Collection[str] = (),
    pose: ArrayLike = (0, 0, 0),
    turn: ArrayLike = UPRIGHT,
    angles: ArrayLike = (0, 0, 0),
) -> dict[str, tuple[Any, Any, Any]]:
    """Return size, colour and pose of each part that is drawn, by name."""
    marked = [fin in broken for fin in AQUAFISH.names]
    robots = scene.place_robots([body.to_array()], [marked], [pose], [turn], [angles])
    parts = zip(scene.drawn_parts(), *(field[0] for field in robots), strict=True)
    return {name: part for name, *part in parts if part[0].any()}


def test_fins_hang_from_their_hinges() -> None:
    turn = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))  # yaw 90 degrees
    angles = (0.0, math.pi / 2, math.pi / 2)
    parts = placed(NOMINAL, (), (1.0, 2.0, 3.0), turn, angles)
    left, right, tail = (parts[fin][2][:3] for fin in AQUAFISH.names)
    np.testing.assert_allclose(left, (1 - 1.0 + 0.8, 2 - 0.75, 3.0), atol=1e-12)
    np.testing.assert_allclose(right, (1 - 1.0, 2 + 0.75, 3.0 - 0.8), atol=1e-12)
    # The tail's phase of 90 degrees is its full sweep of 30.
    s, c = math.sin(math.pi / 6), math.cos(math.pi / 6)
    np.testing.assert_allclose(tail, (1 + 2 + 0.7 * c, 2 + 0.7 * s, 3.0), atol=1e-12)


@pytest.mark.parametrize("plan", PLANS, ids=repr)
def test_fins_agree_with_rotations_of_scipy(plan: BodyPlan) -> None:
    rng = np.random.default_rng(0)
    positions, angles = rng.normal(size=(20, 3)), rng.uniform(-4, 4, (20, len(plan.fins)))
    body = Rotation.random(20, rng=rng)
    sizes = rng.uniform(0.1, 0.5, len(plan.dimensions))
    bodies, whole = np.tile(sizes, (20, 1)), np.zeros(angles.shape, bool)
    robots = scene.place_robots(bodies, whole, positions, body.as_quat(), angles, plan)
    parts = np.moveaxis(robots.poses, 1, 0)[scene.fin_parts(plan)]
    for i, fin in enumerate(plan.fins):
        angle = angles[:, i] if fin.turns else fin.sweep * np.sin(angles[:, i])
        turn = body * Rotation.from_rotvec(np.outer(angle, fin.axis))
        along = fin.order.index("length")
        middle = 0.5 * sizes[3 * i + along] * np.array(fin.direction)
        centre = positions + body.apply(fin.hinge) + turn.apply(middle)
        np.testing.assert_allclose(parts[i, :, :3], centre, atol=1e-12)
        # Its box's own axes are those in which its sizes are stated.
        own = Rotation.from_quat(parts[i, :, 3:]).apply(np.eye(3)[along])
        share = np.sum(own * turn.apply(fin.direction), axis=1)
        np.testing.assert_allclose(np.abs(share), 1.0, atol=1e-12)


def test_a_fin_without_area_is_not_drawn_and_leaves_its_break() -> None:
    missing = Morphology.coerce({"caudal": (0.0, 0.0, 0.0)})
    plate = Morphology.coerce({"caudal": (0.0, 1.0, 0.5)})
    assert list(placed(missing)) == [
        "body",
        "left_pectoral_mount",
        "right_pectoral_mount",
        *AQUAFISH.names[:2],
    ]
    assert min(placed(plate)["caudal"][0]) > 0
    parts = placed(missing, ("caudal",))
    assert list(parts)[-1] == "caudal_break"
    assert parts["caudal_break"][2][:3] == pytest.approx([0, -2, 0])  # at the hinge


def test_a_broken_fin_has_another_colour_and_a_break_at_its_end() -> None:
    whole, parts = placed(NOMINAL), placed(NOMINAL, ("left_pectoral",))
    assert len(parts) == len(whole) + 1 == 7
    assert tuple(parts["left_pectoral"][1]) == scene.BROKEN_FIN
    assert tuple(parts["right_pectoral"][1]) == tuple(whole["right_pectoral"][1]) == scene.FIN
    size, colour, pose = parts["left_pectoral_break"]
    assert tuple(colour) == scene.BREAK
    assert (size > (NOMINAL.left_pectoral[0], 0, NOMINAL.left_pectoral[2])).all()
    assert parts["left_pectoral"][2][1] - pose[1] == pytest.approx(NOMINAL.left_pectoral[1] / 2)
