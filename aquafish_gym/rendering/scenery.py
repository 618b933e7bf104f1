"""The camera, and the background of its pictures: water over a ruled floor."""

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

_WATER, _SAND, _LINE = np.array([(200, 232, 243), (138, 194, 214), (96, 158, 186)], np.float64)
_FLOOR = -3.0  # z; lower under a robot that dives
_SPACING = 2.0  # between the floor's lines; every fifth is a stronger one
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
    """A camera's eye and its right, up and forward axes, (3,) each, in the world.

    ``slope`` is the tangent of half the vertical field of view, ``distance`` the eye's from
    what it looks at.
    """

    eye: Floats
    right: Floats
    up: Floats
    forward: Floats
    slope: float
    distance: float


def multiply(a: Floats, b: Floats) -> Floats:
    """Return the quaternion a b, (x, y, z, w): first b, then a."""
    return np.concatenate(
        [a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3]), [a[3] * b[3] - a[:3] @ b[:3]]]
    )


def rotate(q: Floats, v: Floats) -> Floats:
    """Turn a vector by a quaternion (x, y, z, w)."""
    u = q[:3]
    turned: Floats = v + 2 * np.cross(u, np.cross(u, v) + q[3] * v)
    return turned


def water_and_floor(width: int, height: int, view: View, position: Floats) -> Pixels:
    """Return the water and its floor behind a robot, (height, width, 3) up to 255.

    The floor is a ruled plane that fades with the distance: a plain background shows no motion.
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
    # Size of a pixel on the floor, larger where the floor is seen at a low angle.
    blur = (2 * slope / height) * along / np.sqrt(np.maximum(np.abs(ray[2]), 1e-3)) + 1e-6
    lines = 0.45 * _ruling(x, y, _SPACING, 0.05, blur)
    lines = np.maximum(lines, _ruling(x, y, 5 * _SPACING, 0.12, blur))[..., None]
    fade = np.where(seen, np.exp(-along / (_VISIBILITY * distance)), 0.0)[..., None]
    picture: Pixels = (_WATER + fade * (_SAND + lines * (_LINE - _SAND) - _WATER)).astype(
        np.float32
    )
    return picture


def _ruling(x: Floats, y: Floats, spacing: float, width: float, blur: Floats) -> Floats:
    """Return the share of each pixel that lines every ``spacing`` cover, 0 to 1."""
    u, v = x / spacing, y / spacing
    off = spacing * np.minimum(np.abs(u - np.rint(u)), np.abs(v - np.rint(v)))
    # Lines thinner than a pixel fade instead of flickering.
    cover: Floats = np.clip((width / 2 - off) / blur + 0.5, 0, 1) * np.minimum(1, width / blur)
    return cover
