"""Several bodies, from whatever makes them, and in files."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import aquafish_gym  # noqa: F401  # registers the environments
from aquafish_gym.bodies import BODIES_SCHEMA, body_array, read_bodies, write_bodies
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.runs.command_line import read_morphology
from aquafish_gym.utils.validation import InvalidArgumentError

BODIES = np.random.default_rng(5).uniform(0.0, 1.0, (3, 9)) * AQUAFISH.maxima
TAILLESS = {"caudal": (0.0, 0.0, 0.0)}


def test_bodies_are_whatever_makes_them() -> None:
    nominal = Morphology.nominal().to_array()
    tailless = Morphology.coerce(TAILLESS).to_array()
    for value, expected in (
        (None, [nominal]),
        (TAILLESS, [tailless]),
        (Morphology.nominal(), [nominal]),
        (BODIES[0], BODIES[:1]),
        (BODIES, BODIES),
        (BODIES.tolist(), BODIES),
        (tuple(map(Morphology.from_array, BODIES)), BODIES),
        ([TAILLESS, None, BODIES[0]], [tailless, nominal, BODIES[0]]),
    ):
        np.testing.assert_array_equal(body_array(value), expected)
    with pytest.raises(InvalidArgumentError, match=r"^fish must have shape \(any, 9\)"):
        body_array(np.zeros(8), "fish")
    with pytest.raises(InvalidArgumentError, match=r"^fish\[0, 8\] must lie in \[0, 1\]"):
        body_array([[0.0] * 8 + [1.5]], "fish")


@pytest.mark.parametrize(
    "body", [[1.0, 2.0, 3.0], np.ones((2, 12)), {"dorsal": (1.0, 1.0, 1.0)}, "fish.urdf"]
)
def test_another_body_plan_is_refused_with_what_to_use(body: Any, tmp_path: Path) -> None:
    words = "another fish has a BodyPlan of its own.*eea.Robot .*FaultWrapper"
    with pytest.raises(InvalidArgumentError, match=words):
        gym.make("AquaFish-v0", morphology=body)
    with pytest.raises(InvalidArgumentError, match=words):
        body_array(body)
    path = tmp_path / "robot.json"
    path.write_text(json.dumps({"legs": [0.3, 0.3]}))
    with pytest.raises(InvalidArgumentError, match=words):
        read_bodies(path)
    path = tmp_path / "robot.urdf"
    path.write_text("<robot/>")
    with pytest.raises(InvalidArgumentError, match=words):
        read_bodies(path)


def test_bodies_read_back_exactly(tmp_path: Path) -> None:
    path = tmp_path / "bodies.json"
    write_bodies(path, BODIES)
    back = read_bodies(path)
    np.testing.assert_array_equal([body.to_array() for body in back], BODIES)
    document = json.loads(path.read_text())
    assert document["schema"] == "aquafish.bodies/1" == BODIES_SCHEMA
    assert document["morphologies"][1] == back[1].to_dict()
    changed = path.read_text().replace("caudal", "Caudal", 1)
    path.write_text(changed)
    with pytest.raises(InvalidArgumentError, match=r"body: .*bodies\.json is damaged.*checksum"):
        read_bodies(path, "body")
    path.write_text(re.sub(r'"checksum".*\n', "", changed))
    with pytest.raises(InvalidArgumentError, match=r"body: .*bodies\.json: a body must be"):
        read_bodies(path, "body")
    # By hand, without schema, in either spelling of a body.
    path.write_text(json.dumps({"morphologies": [back[0].to_dict(), BODIES[1].tolist()]}))
    assert read_bodies(path) == back[:2]


def test_a_file_of_one_body_is_a_sample_of_one(tmp_path: Path) -> None:
    path = tmp_path / "morphology.json"
    body = Morphology.from_array(BODIES[0])
    for document in (body.to_dict(), {"morphology": body.to_dict(), "model_fitness": 0.1}):
        path.write_text(json.dumps(document))
        assert read_bodies(path) == (body,) == (read_morphology(path, "body"),)


@pytest.mark.parametrize("read", [read_bodies, read_morphology])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not JSON"),
        ("[1, 2]", "must hold a JSON object"),
        ("{}", "a body must be an object with the keys left_pectoral"),
        ('{"caudal": [0.1, 0.2, 0.3]}', "a body must be an object"),
        ('{"morphology": null}', "a body must be an object"),
        ('{"morphology": [1, 2]}', "morphology must"),
        ('{"morphology": [9, 0, 0, 0, 0, 0, 0, 0, 0]}', "morphology must|must lie in"),
        ('{"morphologies": []}', r"a list of one body or more; got \[\]"),
        ('{"morphologies": null}', "a list of one body or more; got None"),
        ('{"morphologies": [null]}', "a body must be an object"),
        ('{"morphologies": [[0,0,0,0,0,0,0,0,0], [1]]}', "morphology must"),
        ("[" * 10**6, ""),
    ],
)
def test_a_file_without_bodies_is_named(tmp_path: Path, read: Any, text: str, message: str) -> None:
    path = tmp_path / "fish.json"
    path.write_text(text)
    with pytest.raises(InvalidArgumentError, match=rf"^body: .*fish\.json.*({message})") as caught:
        read(path, "body")
    assert len(str(caught.value)) < 500


def test_a_file_that_says_no_plan_is_of_the_papers_fish(tmp_path: Path) -> None:
    """Unless its fins can only be another's: numbers alone would fit several plans."""
    path = tmp_path / "fish.json"
    tail, body = Morphology.nominal("tail-fish"), Morphology.nominal()
    path.write_text(json.dumps(tail.to_dict()))
    assert read_bodies(path, plan="tail-fish") == (tail,)
    twin = replace(AQUAFISH, name="twin")
    both = "twin|tail-fish|four-fins"
    for rows, plan in (
        (tail.to_array().tolist(), "tail-fish"),
        (body.to_dict(), "tail-fish"),
        (body.to_array().tolist(), "four-fins"),
        (body.to_dict(), twin),
        ({**tail.to_dict(), "dorsal": [0.1, 0.1, 0.1]}, "tail-fish"),
    ):
        path.write_text(json.dumps({"morphology": rows}))
        words = rf"fish\.json: its bodies must say .* that they are of ({both}).* of aquafish; got"
        with pytest.raises(InvalidArgumentError, match=words):
            read_bodies(path, plan=plan)
    path.write_text(json.dumps({"morphologies": [body.to_dict(), body.to_array().tolist()]}))
    assert read_bodies(path) == read_bodies(path, plan="aquafish") == (body, body)
    path.write_text(json.dumps({"plan": twin.to_dict(), "morphology": body.to_dict()}))
    assert read_bodies(path, plan=twin) == (replace(body, plan=twin),)


def test_devices_pipes_and_huge_files_are_refused(tmp_path: Path) -> None:
    large, pipe = tmp_path / "large.json", tmp_path / "pipe"
    with large.open("wb") as file:
        file.truncate(100 * 2**20)  # bytes of nothing, and no block of the disk
    os.mkfifo(pipe)
    for path in (Path("/dev/zero"), pipe, tmp_path, large):
        with pytest.raises(InvalidArgumentError, match="body must"):
            read_bodies(path, "body")
