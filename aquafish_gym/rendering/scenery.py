"""The camera, and the background of its pictures: water over a chequered floor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import finite_array

Floats = NDArray[np.float64]
Pixels = NDArray[np.float32]
Frame = NDArray[np.uint8]

_WATER, _LIGHT, _DARK = np.array([(200, 232, 243), (152, 205, 222), (112, 172, 197)], np.float64)
_FLOOR = -3.0  # z; lower under a robot that dives
_TILE = 2.0
_CLEARANCE = 2.0
_VISIBILITY = 2.5  # of the camera's distance, where the floor has faded to 1/e


@dataclass(frozen=True)
class Camera:
    """The point of view of a picture.

    Attributes
    ----------
    distance
        From the target, in units of 5 cm.
    azimuth, elevation
        Of the camera about the vertical and above the target, degrees: azimuth 0 looks along the
        world's y from behind the robot's start, 90 looks along -x from its right.
    target
        A point to look at, or None to follow the robot.
    field_of_view
        Vertical, degrees.

    Examples
    --------
    >>> Camera(distance=6.0, azimuth=90.0).field_of_view
    40.0
    """

    distance: float = 10.5
    azimuth: float = 35.0
    elevation: float = 30.0
    target: tuple[float, float, float] | None = None
    field_of_view: float = 40.0

    def __post_init__(self) -> None:
        finite_array("camera.distance", self.distance, (), 0.1, 1000.0)
        finite_array("camera.azimuth", self.azimuth, ())
        finite_array("camera.elevation", self.elevation, (), -89.0, 89.0, "degrees")
        finite_array("camera.field_of_view", self.field_of_view, (), 1.0, 120.0, "degrees")
        if self.target is not None:
            finite_array("camera.target", self.target, (3,))

    def look(self, robot: Floats) -> View:
        """Return the view that follows a robot at this position (3,)."""
        target = robot if self.target is None else np.array(self.target)
        a, e = math.radians(self.azimuth), math.radians(self.elevation)
        back = np.array([math.sin(a) * math.cos(e), -math.cos(a) * math.cos(e), math.sin(e)])
        right = np.array([math.cos(a), math.sin(a), 0.0])
        slope = math.tan(math.radians(self.field_of_view) / 2)
        eye, up = target + self.distance * back, np.cross(back, right)
        return View(eye, right, up, -back, slope, self.distance)


class View(NamedTuple):
    """A camera's eye and axes, (3,) each, in the world."""

    eye: Floats
    right: Floats
    up: Floats
    forward: Floats
    slope: float  #: The tangent of half the vertical field of view.
    distance: float  #: From the eye to what it looks at.


def water_and_floor(width: int, height: int, view: View, position: Floats) -> Pixels:
    """Return the water and its floor behind a robot, (height, width, 3) up to 255.

    The floor fades with the distance: a plain background shows no motion.
    """
    eye, right, up, forward, slope, distance = view
    rows = slope * (1 - (2 * np.arange(height) + 1) / height)[:, None]
    columns = slope * (width / height) * ((2 * np.arange(width) + 1) / width - 1)[None, :]
    # The rays through the pixels, one unit forward, and where they meet the floor, which a robot
    # that dives takes along.
    ray = [forward[i] + columns * right[i] + rows * up[i] for i in range(3)]
    depth = min(_FLOOR, position[2] - _CLEARANCE) - eye[2]
    seen = (ray[2] < -1e-6) & (depth < 0)
    along = np.minimum(np.where(seen, depth / np.where(seen, ray[2], 1.0), 1e3), 1e3)
    x, y = eye[0] + along * ray[0], eye[1] + along * ray[1]
    # Smooth tiles neither flicker nor have jagged edges.
    tiles = 0.5 + 0.5 * np.sin(np.pi / _TILE * x) * np.sin(np.pi / _TILE * y)
    floor = _LIGHT + tiles[..., None] * (_DARK - _LIGHT)
    fade = np.where(seen, np.exp(-along / (_VISIBILITY * distance)), 0.0)[..., None]
    picture: Pixels = (_WATER + fade * (floor - _WATER)).astype(np.float32)
    return picture
