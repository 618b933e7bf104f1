"""A controller as a value: checked where it enters, and the same after a trip through JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aquafish.online.gaits import read_library
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.storage import DamagedFileError, read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.agents import ControllerAgent
from gait.controllers.checks import MAXIMUM_SUM
from gait.controllers.controller import SCHEMA, Controller
from gait.controllers.export import make_vectors
from gait.controllers.network import HEADER_ROWS, forward
from gait.swims.scores import scores
from gait_fakes import INPUT_COUNT, make_controller


@given(st.integers(0, 1000), st.integers(0, 40))
def test_json_gives_back_the_same_controller(seed: int, mutations: int) -> None:
    controller = make_controller(seed, mutations)
    text = json.dumps(controller.to_dict(), allow_nan=False)
    again = Controller.from_dict(json.loads(text))
    assert json.dumps(again.to_dict()) == text
    np.testing.assert_array_equal(again.genes(), controller.genes())


@given(st.integers(0, 1000), st.integers(0, 40), st.integers(0, 5))
def test_padding_changes_no_output(seed: int, mutations: int, padding: int) -> None:
    controller = make_controller(seed, mutations)
    inputs = np.random.default_rng(seed).uniform(-1, 1, INPUT_COUNT).tolist()
    outputs = []
    for nodes in (controller.nodes, controller.nodes + padding):
        genes = controller.genes(nodes)
        # Clock and fins, and each node's bias, response, and weights from all before it.
        assert len(genes) == HEADER_ROWS + sum(2 + INPUT_COUNT + n for n in range(nodes))
        layout = controller.layout(nodes).tolist()
        values = inputs + [0.0] * 2 * nodes
        forward(genes, layout, values, 0, 1, 0.0)
        outputs.append(values[INPUT_COUNT + nodes - 3 : INPUT_COUNT + nodes])
    assert outputs[0] == outputs[1]


@pytest.mark.parametrize(
    ("name", "value"),
    [("weights", 3.4e38), ("weights", 1e300), ("bias", 1e31), ("response", -1e31)],
)
def test_sums_beyond_float32_are_refused(name: str, value: float) -> None:
    """An infinity less an infinity would be a NaN in float32, which steers nothing."""
    controller = make_controller()
    array = np.array(getattr(controller, name))
    array[-1] = value * (array[-1] != 0.0) if name == "weights" else value
    with pytest.raises(InvalidArgumentError, match=f"node {controller.nodes - 1} reaches"):
        replace(controller, **{name: array})


def test_largest_sums_swim() -> None:
    """Finite commands follow in float32, and so does a finite distance."""
    body = Morphology.nominal()
    weights = np.zeros((3, 14))
    weights[:, :11] = 0.39 * MAXIMUM_SUM / 11 * np.sign(np.arange(11) % 2 - 0.5)
    controller = Controller(weights, np.zeros(3), np.ones(3), 0.7, body, 0)
    assert np.isfinite(scores([controller], body, seconds=1.0)).all()
    _, commands = make_vectors(controller, 50)
    assert np.isfinite(commands).all()
    assert np.abs(commands).max() > 0.4


def test_policy_refuses_a_bad_observation() -> None:
    policy = make_controller().policy()
    for observation in ([0.0] * 8, np.zeros((1, 9)), ["0"] * 9):
        with pytest.raises(InvalidArgumentError, match="observation must"):
            policy(observation, 0.0)
    for time in (np.nan, np.inf):
        with pytest.raises(InvalidArgumentError, match="time must be finite"):
            policy(np.zeros(9), time)


@pytest.mark.parametrize("lost", [np.nan, np.inf, 1e6])
def test_a_reading_that_is_lost_is_held_by_policy_and_agent(lost: float) -> None:
    controller = make_controller()
    policy, intact = controller.policy(), controller.policy()
    agent = ControllerAgent(controller)
    agent.reset({"fin_angles": np.zeros(3)})
    first = np.linspace(-1.0, 1.0, 9)
    second = first[::-1].copy()
    broken = second.copy()
    broken[[0, 7]] = lost
    held = second.copy()
    held[[0, 7]] = first[[0, 7]]
    assert (policy(first, 0.0) == intact(first, 0.0)).all()
    action = intact(held, 0.05)
    np.testing.assert_array_equal(policy(broken, 0.05), action)
    agent.act(first)
    np.testing.assert_array_equal(agent.act(broken), action.astype(np.float32))
    assert (action != controller.policy()(second, 0.05)).any()


def test_policy_reads_the_first_nine_entries() -> None:
    policy, senses = make_controller().policy(), np.linspace(-1, 1, 15)
    np.testing.assert_array_equal(policy(senses, 0.3), policy(senses[:9], 0.3))


def change(**values: object) -> dict[str, Any]:
    return {**make_controller().to_dict(), **values}


def without(name: str) -> dict[str, Any]:
    return {k: v for k, v in make_controller().to_dict().items() if k != name}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (without("bias"), "missing or unknown fields: bias"),
        (change(extra=1), "missing or unknown fields: extra"),
        (change(inputs=["roll"]), r"controller\.inputs must be up_x, up_y"),
        (change(bias=[0.0, 1.0]), r"controller\.bias must"),
        (change(morphology={}), r"controller\.morphology has missing"),
        (change(senses={"imu": True, "clock": "x", "fins": False}), r"senses\.clock must"),
        (change(sample=5), r"controller\.sample must"),
    ],
)
def test_bad_field_is_refused_by_name(data: object, message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        Controller.from_dict(data)


def test_feed_forward_order_is_checked() -> None:
    weights = np.zeros((3, INPUT_COUNT + 3))
    weights[1, INPUT_COUNT + 1] = 0.5
    with pytest.raises(InvalidArgumentError, match="zero from a node to itself"):
        Controller(weights, np.zeros(3), np.ones(3), 1.0, Morphology.nominal(), 0)


def test_file_round_trip(tmp_path: Path) -> None:
    controller, path = replace(make_controller(), sample="3 bodies, abc"), tmp_path / "c.json"
    assert "sample" not in make_controller().to_dict()
    controller.save(path)
    assert Controller.load(path).to_dict() == controller.to_dict()


def test_committed_gaits_are_saved_as_they_were(tmp_path: Path) -> None:
    """Those of the agent's library, which another version may have made."""
    for gait in read_library()["gaits"]:
        Controller.from_dict(gait).save(tmp_path / "c.json")
        assert read_document(tmp_path / "c.json", SCHEMA) == gait


def test_unreadable_files_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "fish.json"
    for content in ("{", json.dumps(make_controller().to_dict())):  # the second has no schema
        path.write_text(content)
        with pytest.raises(DamagedFileError, match=r"fish\.json"):
            Controller.load(path)
    write_document(path, {"a": 1}, "gait.controller/2")
    with pytest.raises(InvalidArgumentError, match=r"fish\.json: controller has missing"):
        Controller.load(path)
    with pytest.raises(InvalidArgumentError, match=r"controller must be a file .*none\.json"):
        Controller.load(tmp_path / "none.json")
