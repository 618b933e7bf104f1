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
from collections.abc import Collection, Sequence
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any, NamedTuple, Protocol

import numpy as np

from aquafish_gym.morphology import FINS, Morphology
from aquafish_gym.physics.robot import RADIUS
from aquafish_gym.rendering import scene
from aquafish_gym.rendering.scene import Floats, Part
from aquafish_gym.runs.storage import write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError

CM_PER_UNIT = 5
LANE = 3.0  # between the start places of two swimmers, units
COLOURS = ("#0072b2", "#d55e00", "#009e73")  # healthy, damaged, recovered; for the colour-blind
_BAND: Any = (2 * RADIUS + 0.04, 2 * RADIUS + 0.14, 2 * RADIUS + 0.04)


class SwimLike(Protocol):
    """A swim, such as ``gait.Swim``: time (T,), pose (T, 3) and (T, 4), fin angles (T, 3)."""

    @property
    def time(self) -> Floats: ...
    @property
    def position(self) -> Floats: ...
    @property
    def quaternion(self) -> Floats: ...
    @property
    def fin_angles(self) -> Floats: ...


class Swimmer(NamedTuple):
    """One fish of a replay."""

    label: str
    colour: str  #: Of its trail, label and band, as ``#0072b2``.
    morphology: Morphology
    swim: SwimLike
    broken: Collection[str] = ()  #: Names of the fins that are marked as broken.


def changed_fins(before: Morphology, after: Morphology) -> tuple[str, ...]:
    """Return the names of the fins whose sizes differ."""
    return tuple(fin for fin in FINS if getattr(before, fin) != getattr(after, fin))


def write_replay(
    swimmers: Sequence[Swimmer], path: str | os.PathLike[str], title: str = "AquaFish"
) -> Path:
    """Write a replay of swims side by side as one HTML file and return its path.

    Distances in the page are along +y over ground. A swim that diverged ends where it does.

    Raises
    ------
    InvalidArgumentError
        If there is no swimmer, or the swims are not sampled at the same times.

    Examples
    --------
    >>> from gait import swim
    >>> still = swim(lambda observation, time: (0.0, 0.0, 0.0), None, engine="numba", seconds=1)
    >>> fish = Swimmer("still", COLOURS[0], Morphology.nominal(), still)
    >>> write_replay([fish], "still.html").stat().st_size < 500_000
    True
    """
    write_bytes(path, whole_page(title, replay_fragment(swimmers)).encode())
    return Path(path)


def replay_fragment(swimmers: Sequence[Swimmer]) -> str:
    """Return the part of a page that replays swims; :func:`whole_page` has its style."""
    if not swimmers:
        raise InvalidArgumentError("swimmers must hold at least one swimmer; got none")
    tables = [_samples(one) for one in swimmers]
    step = tables[0][1, 0]
    if any(np.abs(np.diff(table[:, 0]) - step).max() > 1e-4 for table in tables):
        raise InvalidArgumentError("swims must be sampled at the same times, from 0 on")
    deepest = min(float(table[:, 3].min()) for table in tables)
    data = {
        "step": step,
        "cmPerUnit": CM_PER_UNIT,
        "lane": LANE,
        "floor": min(scene.FLOOR, deepest - scene.CLEARANCE),
        "grid": (scene.GRID_SPACING, scene.MAIN_GRID_SPACING),
        "colours": {
            "water": _css(scene.WATER_ABOVE),
            "sand": _css(scene.SAND),
            "grid": _css(scene.GRID),
            "ink": _css(scene.INK),
        },
        "swimmers": [_encode(*each) for each in zip(swimmers, tables, strict=True)],
    }
    reached = (
        f"{html.escape(one.label)} {CM_PER_UNIT * (table[-1, 2] - table[0, 2]):.0f} cm"
        for one, table in zip(swimmers, tables, strict=True)
    )
    return Template(_web_file("replay.html")).substitute(
        summary=", ".join(reached),
        note="Yellow: a broken fin" if any(one.broken for one in swimmers) else "",
        data=json.dumps(data, separators=(",", ":")).replace("<", r"\u003c"),
        library=_pack(_web_file("three.min.js").encode()),
        script=_web_file("replay.js"),
    )


def whole_page(title: str, body: str, style: str = "") -> str:
    """Return an HTML page with the style of replays, then ``style``."""
    return Template(_web_file("page.html")).substitute(
        title=html.escape(title), body=body, style=_web_file("replay.css") + style
    )


def local_poses(swimmer: Swimmer, fin_angles: Floats) -> Floats:
    """Return the poses (T, n, 7) of the scene's parts in the body's frame."""
    count = len(fin_angles)
    at_rest = np.zeros((count, 3)), np.tile((0.0, 0.0, 0.0, 1.0), (count, 1))
    return scene.part_poses(swimmer.morphology, *at_rest, fin_angles, swimmer.broken)


def _samples(swimmer: Swimmer) -> Floats:
    """Return time, position, quaternion and fin angles (T, 11) until a sample is not finite."""
    swim = swimmer.swim
    table = np.column_stack([swim.time, swim.position, swim.quaternion, swim.fin_angles])
    bad = ~np.isfinite(table).all(axis=1)
    table = table[: int(bad.argmax())] if bad.any() else table
    if len(table) < 2:
        raise InvalidArgumentError(f"the swim {swimmer.label!r} must have two finite samples")
    return table


def _encode(swimmer: Swimmer, table: Floats) -> dict[str, Any]:
    """Return what the page draws of a swimmer: the scene's parts, and a band of its colour."""
    parts = scene.robot_parts(swimmer.morphology, swimmer.broken)
    poses = local_poses(swimmer, table[:, 8:])
    poses = np.concatenate([poses, poses[:, :1]], axis=1)  # the band is where the body is
    columns = np.concatenate([table[:, 1:8], poses.reshape(len(poses), -1)], axis=1)
    return {
        "label": swimmer.label,
        "colour": swimmer.colour,
        "parts": [
            *(_solid(part, _css(part.colour)) for part in parts),
            _solid(Part("capsule", _BAND, scene.BODY, "band"), swimmer.colour),
        ],
        "samples": len(table),
        # Column by column: a part that does not move takes no room.
        "columns": _pack(np.ascontiguousarray(columns.T, dtype="<f4").tobytes()),
    }


def _solid(part: Part, colour: str) -> dict[str, Any]:
    return {"kind": part.kind, "size": part.size, "colour": colour}


def _web_file(name: str) -> str:
    return (files("aquafish_gym.rendering") / "web" / name).read_text(encoding="utf-8")


def _pack(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()


def _css(colour: Sequence[int]) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
