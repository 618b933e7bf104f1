"""A replay of swims as one HTML file that needs neither a server nor a network.

The page holds the scene's parts over time as float32, and a bundle of three.js that draws them.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import json
import os
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from string import Template

import numpy as np

from aquafish_gym.rendering import scene
from aquafish_gym.rendering.course import FilmedSwim, lay_out
from aquafish_gym.rendering.scene import CM_PER_UNIT, Colour
from aquafish_gym.utils.storage import write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError, file_path, utf8_text


def write_replay(
    swims: Sequence[FilmedSwim], path: str | os.PathLike[str], title: str = "AquaFish"
) -> Path:
    """Write a replay of swims side by side as one HTML file and return its path.

    Distances in the page are along +y over ground. A swim that diverges ends there.

    Raises
    ------
    InvalidArgumentError
        If there is no swim, or the swims are not sampled at the same times.

    Examples
    --------
    >>> bodies, broken = np.ones((2, 9)), np.zeros((2, 3), bool)
    >>> still = np.zeros((2, 3)), np.tile((0, 0, 0, 1), (2, 1)), np.zeros((2, 3))
    >>> swim = FilmedSwim("rest", np.array([0.0, 1.0]), bodies, broken, *still)
    >>> write_replay([swim], "rest.html").stat().st_size < 500_000
    True
    """
    utf8_text("title", title)
    file_path("path", path)
    write_bytes(path, whole_page(title, replay_fragment(swims)).encode())
    return Path(path)


def replay_fragment(swims: Sequence[FilmedSwim]) -> str:
    """Return the part of a page that replays swims; :func:`whole_page` adds the style."""
    course = lay_out(swims)
    lanes = course.lanes
    if any(len(lane.time) < 2 for lane in lanes):
        raise InvalidArgumentError("swims must have at least two finite samples")
    step = float(lanes[0].time[1])
    if any(np.abs(np.diff(lane.time, prepend=-step) - step).max() > 1e-4 for lane in lanes):
        raise InvalidArgumentError("swims must be sampled at the same times, from 0 on")
    data = {
        "step": step,
        "cmPerUnit": CM_PER_UNIT,
        "floor": course.floor,
        "ends": course.ends,
        "marks": course.marks,
        "grid": (scene.GRID_SPACING, scene.MAIN_GRID_SPACING),
        "colours": {
            "water": css(scene.WATER_ABOVE),
            "sand": css(scene.SAND),
            "grid": css(scene.GRID),
            "ink": css(scene.INK),
        },
        "swimmers": [
            {
                "label": lane.label,
                "colour": css(colour),
                "samples": len(lane.time),
                "columns": _pack(_columns(lane)),
            }
            for lane, colour in zip(lanes, course.colours, strict=True)
        ],
    }
    reached = (
        f"{html.escape(lane.label)} {CM_PER_UNIT * lane.position[-1, 1]:z.0f} cm" for lane in lanes
    )
    return Template(web_file("replay.html")).substitute(
        summary=", ".join(reached),
        note="Yellow: a broken fin" if any(lane.broken.any() for lane in lanes) else "",
        data=json.dumps(data, separators=(",", ":")).replace("<", r"\u003c"),
        library=packed_library(),
        script=_replay_script(),
    )


def _replay_script() -> str:
    return web_file("scene.js") + web_file("replay.js")


def packed_library() -> str:
    """Return three.js as ``loadThree`` of ``scene.js`` reads it."""
    return _pack(web_file("three.min.js").encode())


def whole_page(
    title: str,
    body: str,
    style: str = "",
    scripts: Sequence[str] | None = None,
    worker: bool = False,
) -> str:
    """Return an HTML page with the style of replays, then ``style``.

    Its Content-Security-Policy allows this style, these scripts and three.js, and pictures within
    the page. Nothing else runs or loads.

    Parameters
    ----------
    title, body, style
        Of the page: text, HTML and CSS.
    scripts
        The body's inline scripts; None for those of replays.
    worker
        Whether the page may also run workers that it makes itself, of blobs.
    """
    style = web_file("replay.css") + style
    own = [_replay_script()] if scripts is None else scripts
    allowed = " ".join(map(_digest, (*own, web_file("three.min.js"))))
    policy = (
        f"default-src 'none'; script-src {allowed}; style-src {_digest(style)}; img-src data:; "
        f"{'worker-src blob:; ' if worker else ''}base-uri 'none'; form-action 'none'"
    )
    return Template(web_file("page.html")).substitute(
        title=html.escape(title), body=body, style=style, policy=policy
    )


def _digest(content: str) -> str:
    """Return the source expression that allows an inline script or style in a policy."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()}'"


def css(colour: Colour) -> str:
    """Return a colour in the form ``#0072b2``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _columns(lane: FilmedSwim) -> bytes:
    """Return the body's pose (7) in the world, then pose, size and colour (13) of each part.

    Poses of parts are relative to the body, so most are constant. Stored by column, constant
    numbers take no space.
    """
    count = len(lane.time)
    origin = np.zeros((count, 3))
    upright = np.tile((0.0, 0.0, 0.0, 1.0), (count, 1))
    robots = scene.place_robots(
        lane.bodies, lane.broken, origin, upright, lane.fin_angles, lane.plan
    )
    parts = np.concatenate([robots.poses, robots.sizes, robots.colours / 255], axis=-1)
    table = np.concatenate([lane.position, lane.quaternion, parts.reshape(count, -1)], axis=1)
    return np.ascontiguousarray(table.T, dtype="<f4").tobytes()


def web_file(name: str) -> str:
    """Return a file of ``rendering/web``."""
    return (files("aquafish_gym.rendering") / "web" / name).read_text(encoding="utf-8")


def _pack(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 9, mtime=0)).decode()
