"""Comparison of a gait on its own body and on another."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.rollout.plan import Act
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.swims.scores import scores
from gait.swims.swim import swim
from gait.swims.transfer import TransferConfig, transfer
from gait_fakes import make_controller
from tests.pictures import is_drawn

QUICK = TransferConfig(poses=3, seconds=2.0)


def test_distances_are_those_of_single_swims() -> None:
    controller = make_controller()
    half = Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal())
    result = transfer(controller, half, QUICK)
    assert result.target.distance == swim(controller, half, seconds=2.0).distance
    expected = scores([controller], half, result.poses, 2.0, dtype="float64")[0]
    np.testing.assert_allclose(result.target.random_distances, expected, atol=1e-9)
    assert result.target.random_distance == result.target.random_distances.mean()
    assert result.native.distance != result.target.distance
    document = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert document["target"]["distance"] == result.target.distance
    assert len(document["native"]["random_distances"]) == len(document["poses"]) == 3


def constant(*action: float) -> Act:
    """Return a policy that hears nothing."""
    return lambda _observation, _time: action


class Wakeful:
    """A user's controller: it has a memory, so each swim needs a new policy."""

    made = 0

    def policy(self) -> Act:
        self.made += 1
        asked = []

        def act(observation: NDArray[np.float64], time: float) -> tuple[float, float, float]:
            assert observation.shape == (9,)
            asked.append(time)
            return (0.5 * (-1) ** len(asked), 0.2, 1.0)

        return act


def test_custom_controller_is_transferred() -> None:
    config = TransferConfig(poses=2, seconds=1.0, target_engine="numba")
    controller, half = (
        Wakeful(),
        Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal()),
    )
    both = transfer(controller, half, config, native=Morphology.nominal())
    assert controller.made == 2 * 3
    assert both.native.distance == swim(Wakeful(), None, engine="numba", seconds=1.0).distance
    assert both.target.distance == swim(Wakeful(), half, engine="numba", seconds=1.0).distance
    assert both.native.distance != both.target.distance
    far = [swim(Wakeful(), half, pose, "numba", 1.0).distance for pose in both.poses]
    np.testing.assert_array_equal(both.target.random_distances, far)


@pytest.mark.parametrize(
    ("controller", "message"),
    [
        (constant(0.0, 1.0), r"action must have shape \(3,\)"),
        (constant(0.0, 1.0, np.nan), "action must be finite"),
        (lambda _observation, _time: "left", "action must be numbers"),
    ],
)
def test_bad_policy_is_refused(controller: Any, message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        swim(controller, None, engine="numba", seconds=0.1)


def test_native_body_is_required() -> None:
    with pytest.raises(InvalidArgumentError, match="native must be given"):
        transfer(constant(0.0, 0.0, 1.0), None, QUICK)


def test_paths_are_drawn_from_above(tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    from gait.plots import draw_trajectories, plot_progress

    config = TransferConfig(poses=2, seconds=0.5, target_engine="numba")
    both = transfer(make_controller(), {"caudal": (0, 0, 0)}, config)
    assert f"{both.target.distance:.2f}" in str(both)
    axes = Figure().add_subplot()
    draw_trajectories({"native": both.native.swim, "target": both.target.swim}, axes)
    path = both.native.swim.position[:, :2]
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), path)
    labels = ("final", "mean", "generation")
    plot_progress(tmp_path / "history.png", [0, 1, 2], [0.0, 1.0, 2.0], [0.0, 0.0, 0.0], labels)
    assert is_drawn(tmp_path / "history.png")


def test_diverged_distance_is_null_in_json() -> None:
    from gait.swims.swim import Swim
    from gait.swims.transfer import Scored, Transfer

    path = Swim(np.zeros(1), np.full((1, 3), np.nan), np.zeros((1, 4)), np.zeros((1, 3)))
    lost = Scored(path, np.array([1.0, np.nan]))
    document = Transfer(lost, lost, np.zeros((2, 3))).to_dict()
    assert document["native"] == {
        "distance": None,
        "random_distance": None,
        "random_distances": [1.0, None],
    }
