"""Pictures and films of the robot: grey body, red fins, over a chequered sea floor.

PyBullet's software renderer draws the robot, in a client of its own, whatever engine moved it.
``scenery`` draws the background.

A pose is a position (3,) in units of 5 cm and a quaternion (4,) (x, y, z, w) from body to
world. Fin angles are as everywhere: left and right pectoral angle and caudal *phase*, rad.
"""

from __future__ import annotations

import ctypes
import functools
import os
from collections.abc import Iterable
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.engines.bullet.world import take_client
from aquafish_gym.engines.packages import load_pybullet
from aquafish_gym.morphology import Morphology
from aquafish_gym.rendering.robot_mesh import Figure, draw, find_window
from aquafish_gym.rendering.scenery import Camera, Floats, Frame, water_and_floor
from aquafish_gym.runs.storage import write_bytes
from aquafish_gym.utils.validation import (
    EngineUnavailableError,
    InvalidArgumentError,
    finite_array,
    integer,
    one_of,
)

RENDER_MODES = ("human", "rgb_array")


def usable_modes() -> list[str]:
    """Return the render modes that work on this machine."""
    return [mode for mode in RENDER_MODES if mode != "human" or _has_display()]


def check_render_mode(mode: object) -> str | None:
    """Return a render mode that works here; errors name what is missing: a display, or PyBullet."""
    if mode is None:
        return None
    name = one_of("render_mode", mode, RENDER_MODES)
    # Without one, Bullet's window code ends the whole process.
    if name == "human" and not _has_display():
        display = os.environ.get("DISPLAY")
        why = f"no X server answers at DISPLAY={display}" if display else "DISPLAY is not set"
        raise EngineUnavailableError(
            f'render_mode="human" opens a window and there is no display here ({why}); '
            'use render_mode="rgb_array" and save the frames'
        )
    _require_renderer()
    return name


def _require_renderer() -> None:
    """Raise EngineUnavailableError without PyBullet, which draws for every engine."""
    try:
        load_pybullet()
    except EngineUnavailableError:
        raise EngineUnavailableError(
            "drawing the robot needs the package pybullet, with every engine, and it is not "
            "installed here: pip install pybullet==3.2.7 on Linux with Python 3.9 to 3.11, or "
            "leave render_mode out"
        ) from None


def _has_display() -> bool:
    """Return whether a window can be opened, by asking the X server that Bullet would ask."""
    if not os.environ.get("DISPLAY"):
        return False
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError:  # Bullet needs it too
        return False
    x11.XOpenDisplay.restype = ctypes.c_void_p
    x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
    display = x11.XOpenDisplay(None)
    if display is None:
        return False
    x11.XCloseDisplay(display)
    return True


@functools.cache
def _own_figure(_process: int) -> Figure:
    """Return this process's figure for frames; its client is kept: a client is large."""
    return Figure(take_client())


def render_pose(
    morphology: Morphology,
    pose: tuple[ArrayLike, ArrayLike],
    fin_angles: ArrayLike,
    width: int = 640,
    height: int = 480,
    camera: Camera | None = None,
) -> Frame:
    """Return a picture of the robot, (height, width, 3) uint8; fins of no area are not drawn.

    Without a camera it is seen from behind, above and its right. Without PyBullet, which draws,
    EngineUnavailableError is raised.
    """
    _require_renderer()
    integer("width", width, 16, 4096)
    integer("height", height, 16, 4096)
    position, quaternion, angles = _check_pose(pose, fin_angles)
    view = (camera or Camera()).look(position)
    frame = water_and_floor(width, height, view, position)
    figure = _own_figure(os.getpid())
    figure.build(morphology)
    # Drawn at the origin: Bullet draws in single precision, which fails far away.
    corners = figure.place(np.zeros(3), quaternion, angles)
    near = view._replace(eye=view.eye - position)
    window = find_window(corners, near, width, height)
    if window is not None:
        left, right, top, bottom = window
        robot, cover = draw(figure.client, near, window, width, height)
        part = frame[top:bottom, left:right]
        part *= 1 - cover
        part += robot
    return (frame + np.float32(0.5)).clip(0, 255).astype(np.uint8)


def _check_pose(
    pose: tuple[ArrayLike, ArrayLike], fin_angles: ArrayLike
) -> tuple[Floats, Floats, Floats]:
    try:
        where, how = pose
    except (TypeError, ValueError):
        raise InvalidArgumentError(
            f"pose must be a position and a quaternion; got {pose!r}"
        ) from None
    position = finite_array("pose position", where, (3,), -1e6, 1e6)
    quaternion = finite_array("pose quaternion", how, (4,))
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1) > 1e-3:
        raise InvalidArgumentError(f"pose quaternion must have length 1; got {length:g}")
    return position, quaternion / length, finite_array("fin_angles", fin_angles, (3,), unit="rad")


class Window:
    """A window on the robot, for ``render_mode="human"``; it needs a display.

    Examples
    --------
    >>> window = Window()  # doctest: +SKIP
    """

    def __init__(self) -> None:
        check_render_mode("human")
        p = load_pybullet()
        client = p.connect(p.GUI)
        if client < 0:
            raise EngineUnavailableError("PyBullet could not open a window on this display")
        p.configureDebugVisualizer(p.COV_ENABLE_GUI, 0, physicsClientId=client)
        self._figure = Figure(client)

    def show(
        self, morphology: Morphology, pose: tuple[ArrayLike, ArrayLike], fin_angles: ArrayLike
    ) -> None:
        """Draw the robot; see :func:`render_pose`."""
        position, quaternion, angles = _check_pose(pose, fin_angles)
        self._figure.build(morphology)
        self._figure.place(position, quaternion, angles)
        camera = Camera()
        view = (camera.distance, camera.azimuth, -camera.elevation, position.tolist())
        load_pybullet().resetDebugVisualizerCamera(*view, physicsClientId=self._figure.client)

    def close(self) -> None:
        """Close the window; closing twice does no harm."""
        if self._figure.client >= 0:
            load_pybullet().disconnect(physicsClientId=self._figure.client)
            self._figure.client = -1


def render_motion(
    morphology: Morphology,
    positions: ArrayLike,
    quaternions: ArrayLike,
    fin_angles: ArrayLike,
    width: int = 640,
    height: int = 480,
    camera: Camera | None = None,
) -> list[Frame]:
    """Return :func:`render_pose` of T positions (T, 3), quaternions (T, 4) and fins (T, 3)."""
    where = finite_array("positions", positions, (None, 3))
    count = len(where)
    how = finite_array("quaternions", quaternions, (count, 4))
    angles = finite_array("fin_angles", fin_angles, (count, 3), unit="rad")
    return [
        render_pose(morphology, (here, turn), fins, width, height, camera)
        for here, turn, fins in zip(where, how, angles, strict=True)
    ]


def write_gif(frames: Iterable[Frame], path: str | os.PathLike[str], fps: float = 20.0) -> Path:
    """Write frames (H, W, 3) of one size as a GIF that repeats forever; return its path.

    GIF counts hundredths of a second, so only frame rates of 100 / n are exact.
    """
    from PIL import Image

    finite_array("fps", fps, (), 0.1, 240.0)
    pictures = [np.asarray(frame) for frame in frames]
    if not pictures:
        raise InvalidArgumentError("frames must hold at least one picture; got none")
    for picture in pictures:
        if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3:
            found = f"{picture.shape} of {picture.dtype}"
            raise InvalidArgumentError(f"frames must be (H, W, 3) pictures of uint8; got {found}")
        if picture.shape != pictures[0].shape:
            sizes = f"{pictures[0].shape} and {picture.shape}"
            raise InvalidArgumentError(f"frames must all be of one size; got {sizes}")
    pause = 10 * max(2, round(100 / fps))  # ms; viewers slow down anything shorter than 20
    first, *others = (Image.fromarray(picture) for picture in pictures)
    content = BytesIO()
    first.save(content, "GIF", save_all=True, append_images=others, duration=pause, loop=0)
    write_bytes(path, content.getvalue())
    return Path(path)
