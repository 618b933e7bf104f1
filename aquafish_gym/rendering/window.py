"""Render modes, and the window of ``render_mode="human"``."""

from __future__ import annotations

import functools
import os
import sys
import time
from typing import Any

from numpy.typing import ArrayLike

from aquafish_gym.morphology import Morphology
from aquafish_gym.rendering.render import render_pose
from aquafish_gym.utils.validation import EngineUnavailableError, one_of

RENDER_MODES = ("human", "rgb_array")


def usable_modes() -> list[str]:
    """Return the render modes that work on this machine."""
    return [mode for mode in RENDER_MODES if mode != "human" or why_no_window() is None]


def check_render_mode(mode: object) -> str | None:
    """Return a render mode that works here; an error states why no window can be opened."""
    if mode is None:
        return None
    name = one_of("render_mode", mode, RENDER_MODES)
    missing = why_no_window() if name == "human" else None
    if missing is not None:
        raise EngineUnavailableError(missing)
    return name


class Window:
    """A window that shows the robot; it needs a display and tkinter.

    ``fps`` limits the frames per second; None shows each at once.

    Examples
    --------
    >>> window = Window()  # doctest: +SKIP
    """

    def __init__(self, fps: float | None = None) -> None:
        check_render_mode("human")
        import tkinter

        self._root: Any = tkinter.Tk(className="AquaFish")
        self._root.protocol("WM_DELETE_WINDOW", self.close)
        self._label = tkinter.Label(self._root, borderwidth=0)
        self._label.pack()
        self._image: Any = None
        self._pause = 1 / fps if fps else 0.0
        self._next = time.monotonic()

    def show(
        self, morphology: Morphology, pose: tuple[ArrayLike, ArrayLike], fin_angles: ArrayLike
    ) -> None:
        """Draw the robot; see :func:`render_pose`. A window that the user closed stays closed."""
        if self._root is None:
            return
        import tkinter

        frame = render_pose(morphology, pose, fin_angles)
        header = f"P6 {frame.shape[1]} {frame.shape[0]} 255 ".encode()
        # The label keeps no reference to its image.
        self._image = tkinter.PhotoImage(master=self._root, data=header + frame.tobytes())
        self._label.configure(image=self._image)
        time.sleep(max(0.0, self._next - time.monotonic()))
        self._next = time.monotonic() + self._pause
        self._root.update()

    def close(self) -> None:
        """Close the window; a closed window stays closed."""
        if self._root is not None:
            self._root.destroy()
            self._root = None


def why_no_window() -> str | None:
    """Return the reason why no window can be opened here, or None."""
    return _why_no_window(os.environ.get("DISPLAY", ""))


@functools.cache  # cached: a test window takes 50 ms, and every new environment asks
def _why_no_window(display: str) -> str | None:
    # Other systems have a display, but only the main thread may open windows.
    screens = not sys.platform.startswith("linux")
    why = "DISPLAY is not set"
    if display or screens:
        try:
            import tkinter

            if not screens:
                tkinter.Tk().destroy()
            return None
        except ImportError as error:
            why = f"Python lacks tkinter, on Debian python3-tk: {error}"
        except tkinter.TclError:
            why = f"no X server answers at DISPLAY={display}"
    return (
        f'render_mode="human" opens a window, which is not possible here ({why}); '
        'use render_mode="rgb_array" and save the frames'
    )
