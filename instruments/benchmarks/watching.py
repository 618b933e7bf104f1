"""Rows of pictures of the robot: frames, a video of them, and the live viewer."""

from __future__ import annotations

import tempfile
import warnings
from contextlib import ExitStack
from importlib.util import find_spec
from typing import Any

import gymnasium as gym

from aquafish_gym import Morphology  # registers AquaFish-v0
from aquafish_gym.rendering import render_pose
from instruments.benchmarks.rows import Group, Row, Settings

VIDEO = 300  # frames
ROBOTS = 64


def pictures(settings: Settings, cleanup: ExitStack) -> Group:
    """Return frames of 640 x 480, frames of a recorded video, and updates of the viewer's page.

    The viewer simulates its robots and sends all of them, but no browser is there to draw them.
    """
    env = gym.make("AquaFish-v0", engine="numba", render_mode="rgb_array")
    cleanup.callback(env.close)
    env.reset(seed=settings.seed)
    pose = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    rows, notes = [Row("rgb_array, 640 x 480", "numba", "float64", 1, 1, 1, env.render)], []
    rows.append(
        Row("render_pose, 1920 x 1080", "numba", "float64", 1, 1, 1,
            lambda: render_pose(Morphology.nominal(), pose, (0, 0, 0), 1920, 1080), rows[0])
    )  # fmt: skip
    if find_spec("moviepy"):
        frames = 10 if settings.quick else VIDEO
        rows.append(
            Row(f"RecordVideo, {frames} frames", "numba", "float64", 1, 1, frames,
                lambda: _record(frames, settings), rows[0], most_turns=2)
        )  # fmt: skip
    else:
        notes.append("RecordVideo is left out: it needs moviepy, of the extra film")
    if find_spec("viser"):
        update = _viewer(settings, cleanup)
        rows.append(Row("aquafish view", "numba", "float64", ROBOTS, 1, 1, update))
    else:
        notes.append("aquafish view is left out: it needs viser, of the extra view")
    return Group("pictures: frames", "frame", rows, notes)


def _record(frames: int, settings: Settings) -> None:
    """Record steps of 0.2 s until there are so many frames: the first is of the start."""
    env: Any = gym.make("AquaFish-v0", engine="numba", render_mode="rgb_array")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env = gym.wrappers.RecordVideo(
            env, folder, step_trigger=lambda step: step == 0, video_length=frames,
            disable_logger=True,
        )  # fmt: skip
        env.reset(seed=settings.seed)
        for _ in range(frames):
            if env.step(env.action_space.sample())[3]:
                env.reset()
        env.close()


def _viewer(settings: Settings, cleanup: ExitStack) -> Any:
    from aquafish.viewer.command import View
    from aquafish.viewer.live import LiveSwim
    from aquafish.viewer.page import Viewer

    pilots = View(robots=ROBOTS).pilots()
    viewer = Viewer(LiveSwim(pilots["gait"], ROBOTS, seed=settings.seed), pilots, 8360)
    cleanup.callback(viewer.close)
    return viewer.update
