"""Classes of controllers and their senses: batches agree with single swims."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from aquafish_gym import Morphology, simulate
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.config import CLASSES
from gait.controller import Controller
from gait.network import Senses
from gait.rollout import random_poses, swim, swim_all
from gait.search.templates import Template

BODY = Morphology.nominal()
POSES = random_poses(3, 1)
NAMES = sorted({name for names in CLASSES.values() for name in names} - {"feed-forward"})


def make(name: str, seed: int = 0, **changes: Any) -> Controller:
    """Return a random controller of a class."""
    senses = {"fourier": Senses(imu=False, clock=3)}.get(name, Senses(fins=seed % 2 == 1))
    template = Template.of_class(name, senses, 5)
    vector = 0.25 * np.random.default_rng(seed).standard_normal(template.size)
    controller = template.controller(vector, 0.7, BODY, seed).to_dict() | changes
    return Controller.from_dict(controller)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("changes", [{}, {"output": "clip"}, {"interval": 20}])
def test_batch_agrees_with_single_swims(name: str, changes: dict[str, Any]) -> None:
    controllers = [make(name, seed, **changes) for seed in range(3)]
    others = [make("linear"), make("mlp", 1)]
    found = swim_all([*controllers, *others], BODY, POSES, 2.0, "float64", threads=1)
    for controller, row in zip(controllers, found, strict=False):
        alone = [swim(controller, BODY, pose, "numba", 2.0).distance for pose in POSES]
        np.testing.assert_allclose(row, alone, atol=1e-9)
    assert np.ptp(found[:3]) > 1e-3


@pytest.mark.parametrize("name", NAMES)
def test_json_round_trip(name: str) -> None:
    controller = make(name, 1, output="clip", interval=7)
    text = json.dumps(controller.to_dict(), allow_nan=False)
    again = Controller.from_dict(json.loads(text))
    assert json.dumps(again.to_dict()) == text
    np.testing.assert_array_equal(again.genes(), controller.genes())
    np.testing.assert_array_equal(again.layout(), controller.layout())


@pytest.mark.parametrize("gain", [1.0, 0.9])
def test_fins_are_tracked_by_dead_reckoning(gain: float) -> None:
    senses = Senses(imu=False, clock=0, fins=True)
    weights = np.zeros((3, 9))
    weights[np.arange(3), [0, 3, 4]] = 0.1  # the sine of one, the cosine of another
    teller = Controller(weights, np.full(3, 0.1), np.ones(3), 0.7, BODY, 0, senses=senses)
    begin = np.array([0.3, -2.0, 1.0])
    policy = teller.policy(begin, (gain,) * 3)
    told = np.array([policy(np.zeros(9), 0.05 * k) for k in range(40)])
    commands = np.repeat([np.asarray(scaled(action)) for action in told], 5, axis=0)
    log = simulate(
        BODY, commands[None], begin, steps=200, record="pose", interval=1, servo_gain=(gain,) * 3,
        dtype="float64",
    )  # fmt: skip
    assert log.fin_angles is not None
    angles = np.vstack([begin, log.fin_angles[0]])[:200:5]
    waves = np.stack([np.sin(angles[:, 0]), np.cos(angles[:, 1]), np.sin(angles[:, 2])], axis=1)
    np.testing.assert_allclose(told, np.tanh(2.5 * (0.1 + 0.1 * waves)), atol=1e-9)


def scaled(action: Any) -> Any:
    from aquafish_gym.command import scale_action

    return scale_action(action)


def test_controller_uses_the_assumed_fin_angles() -> None:
    controller = make("recurrent", 1)
    right = swim_all([controller], BODY, POSES, 2.0, threads=1)
    wrong = swim_all([controller], BODY, POSES, 2.0, threads=1, believed=POSES + 1.0)
    slow = swim_all([controller], BODY, POSES, 2.0, threads=1, believed_gain=(0.9, 0.9, 0.9))
    assert (right != wrong).all()
    assert (right != slow).all()
    same = swim_all([controller], BODY, POSES, 2.0, threads=1, believed=POSES + 2 * np.pi)
    np.testing.assert_allclose(same, right, atol=1e-3)
    blind = make("recurrent", 2)
    np.testing.assert_array_equal(
        swim_all([blind], BODY, POSES, 2.0, threads=1, believed=POSES + 1.0),
        swim_all([blind], BODY, POSES, 2.0, threads=1),
    )
    told = swim(controller, BODY, POSES[0], "numba", 2.0, believed=POSES[0] + 1.0)
    assert told.distance == pytest.approx(float(wrong[0, 0]), abs=1e-3)


def test_memory_starts_at_zero_in_each_swim() -> None:
    controller = make("recurrent", 2)
    first, second = (swim(controller, BODY, engine="numba", seconds=1.0) for _ in range(2))
    assert first.distance == second.distance
    twice = swim_all([controller], BODY, np.repeat(POSES[:1], 40, axis=0), 1.0, threads=1)
    assert np.ptp(twice) == 0.0


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"believed": np.zeros((2, 3))}, "believed must be one for all swims or 3; got 2"),
        ({"believed": np.zeros(3)}, "believed must have"),
        ({"believed_gain": np.ones((2, 3))}, "believed_gain must be one for all swims or 3"),
        ({"believed": np.full((3, 3), np.nan)}, "believed must be finite"),
    ],
)
def test_bad_assumed_angles_are_refused(wrong: dict[str, Any], says: str) -> None:
    with pytest.raises(InvalidArgumentError, match=says):
        swim_all([make("linear")], BODY, POSES, 1.0, **wrong)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"layers": [5]}, r"controller\.layers must sum to 8 nodes"),
        ({"layers": [6, 2]}, r"controller\.layers must sum to 8 nodes, 3 or more in the last"),
        ({"layers": []}, r"controller\.layers must be a list of node counts"),
        ({"layers": None}, "zero from a node to itself"),
        ({"output": "sign"}, r"controller\.output must be"),
        ({"interval": 0}, r"controller\.interval must be"),
        ({"senses": {"imu": True}}, r"controller\.senses has missing or unknown fields"),
        ({"senses": {"imu": 1, "clock": 1, "fins": False}}, r"controller\.senses\.imu must be"),
    ],
)
def test_bad_network_is_refused(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(InvalidArgumentError, match=says):
        make("recurrent", 0, **changes)
