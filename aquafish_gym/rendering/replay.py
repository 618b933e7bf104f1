"""A replay of swims as one HTML file that opens by itself, without a server or a network.

The page holds the scene's parts, the body's poses in the world and the parts' poses in the body,
as float32, and a bundle of three.js that draws them.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
import os
from collections.abc import Sequence
from importlib.resources import files
from itertools import cycle, pairwise
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from aquafish_gym.physics.robot import RADIUS
from aquafish_gym.rendering import scene
from aquafish_gym.rendering.films import CM_PER_UNIT, TRAILS, FilmedSwim, side_by_side
from aquafish_gym.rendering.scene import Colour, Floats, Part
from aquafish_gym.runs.storage import write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError

_BAND = (2 * RADIUS + 0.04, 2 * RADIUS + 0.14, 2 * RADIUS + 0.04)


def write_replay(
    swims: Sequence[FilmedSwim], path: str | os.PathLike[str], title: str = "AquaFish"
) -> Path:
    """Write a replay of swims side by side as one HTML file and return its path.

    Distances in the page are along +y over ground. A swim that diverged ends where it does.

    Raises
    ------
    InvalidArgumentError
        If there is no swim, or the swims are not sampled at the same times.

    Examples
    --------
    >>> from aquafish_gym import Morphology
    >>> from aquafish_gym.rendering import Stage
    >>> still = np.zeros((2, 3)), np.tile((0, 0, 0, 1), (2, 1)), np.zeros((2, 3))
    >>> swim = FilmedSwim("rest", (Stage(0.0, Morphology.nominal()),), np.array([0, 1]), *still)
    >>> write_replay([swim], "rest.html").stat().st_size < 500_000
    True
    """
    write_bytes(path, whole_page(title, replay_fragment(swims)).encode())
    return Path(path)


def replay_fragment(swims: Sequence[FilmedSwim]) -> str:
    """Return the part of a page that replays swims; :func:`whole_page` has its style."""
    if not swims:
        raise InvalidArgumentError("swims must be at least one; got none")
    lanes = side_by_side(swims)
    if any(len(lane.time) < 2 for lane in lanes):
        raise InvalidArgumentError("swims must have at least two finite samples")
    step = float(lanes[0].time[1])
    if any(np.abs(np.diff(lane.time, prepend=-step) - step).max() > 1e-4 for lane in lanes):
        raise InvalidArgumentError("swims must be sampled at the same times, from 0 on")
    deepest = min(float(lane.position[:, 2].min()) for lane in lanes)
    data = {
        "step": step,
        "cmPerUnit": CM_PER_UNIT,
        "floor": min(scene.FLOOR, deepest - scene.CLEARANCE),
        "grid": (scene.GRID_SPACING, scene.MAIN_GRID_SPACING),
        "colours": {
            "water": css(scene.WATER_ABOVE),
            "sand": css(scene.SAND),
            "grid": css(scene.GRID),
            "ink": css(scene.INK),
        },
        "swimmers": [_encode(*each) for each in zip(lanes, cycle(TRAILS), strict=False)],
    }
    reached = (
        f"{html.escape(lane.label)} {CM_PER_UNIT * lane.position[-1, 1]:.0f} cm" for lane in lanes
    )
    broken = any(stage.broken for swim in swims for stage in swim.stages)
    return Template(_web_file("replay.html")).substitute(
        summary=", ".join(reached),
        note="Yellow: a broken fin" if broken else "",
        data=json.dumps(data, separators=(",", ":")).replace("<", r"\u003c"),
        library=_pack(_web_file("three.min.js").encode()),
        script=_web_file("replay.js"),
    )


def whole_page(title: str, body: str, style: str = "") -> str:
    """Return an HTML page with the style of replays, then ``style``."""
    return Template(_web_file("page.html")).substitute(
        title=html.escape(title), body=body, style=_web_file("replay.css") + style
    )


def css(colour: Colour) -> str:
    """Return a colour as in ``#0072b2``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _encode(lane: FilmedSwim, colour: Colour) -> dict[str, Any]:
    """Return what the page draws of a swim: the parts of each stage, and a band of its colour."""
    count = len(lane.time)
    in_the_body = (np.zeros((count, 3)), np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)), lane.fin_angles)
    solids = [_solid(Part("capsule", _BAND, colour, "band"), 0.0, None)]
    poses = [np.concatenate(in_the_body[:2], axis=1)]
    for stage, after in pairwise([*lane.stages, None]):
        assert stage is not None
        end = None if after is None else after.begin
        parts = scene.robot_parts(stage.morphology, stage.broken)
        solids += [_solid(part, stage.begin, end) for part in parts]
        local = scene.part_poses(stage.morphology, *in_the_body, stage.broken)
        poses.append(local.reshape(count, -1))
    columns: Floats = np.concatenate([lane.position, lane.quaternion, *poses], axis=1)
    return {
        "label": lane.label,
        "colour": css(colour),
        "parts": solids,
        "samples": count,
        # Column by column: a part that does not move takes no room.
        "columns": _pack(np.ascontiguousarray(columns.T, dtype="<f4").tobytes()),
    }


def _solid(part: Part, begin: float, end: float | None) -> dict[str, Any]:
    """Return a part that shows from a time until another, in s."""
    solid = {"kind": part.kind, "size": part.size, "colour": css(part.colour)}
    return solid | {"begin": begin, "end": end}


def _web_file(name: str) -> str:
    return (files("aquafish_gym.rendering") / "web" / name).read_text(encoding="utf-8")


def _pack(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()
