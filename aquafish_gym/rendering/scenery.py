"""The camera, and what it sees behind the robot: water over a ruled sea floor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.robot import CYLINDER, RADIUS
from aquafish_gym.utils.validation import finite_array

Floats = NDArray[np.float64]
Pixels = NDArray[np.float32]
Frame = NDArray[np.uint8]

_NEAR_WATER = (172.0, 219.0, 236.0)
_FAR_WATER = (226.0, 243.0, 249.0)
_SAND = (138.0, 194.0, 214.0)
_LINE = (96.0, 158.0, 186.0)
_FLOOR = -3.0  # z; lower under a robot that dives
_SPACING = 2.0  # between the floor's lines; every fifth is a stronger one
_CLEARANCE = 2.0
_VISIBILITY = 2.5  # of the camera's distance: what lies there has faded to 1/e


@dataclass(frozen=True)
class Camera:
    """Where the picture is taken from.

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


def _ruling(u: Pixels, v: Pixels, spacing: float, width: float, blur: Pixels) -> Pixels:
    """Return how much of each pixel is covered by lines every ``spacing``, 0 to 1."""
    su, sv = u / spacing, v / spacing
    off = spacing * np.minimum(np.abs(su - np.rint(su)), np.abs(sv - np.rint(sv)))
    # Lines thinner than a pixel fade instead of flickering.
    cover: Pixels = np.clip((width / 2 - off) / blur + 0.5, 0, 1) * np.minimum(1, width / blur)
    return cover


def water_and_floor(
    width: int, height: int, view: View, position: Floats, quaternion: Floats
) -> Pixels:
    """Return the water and its floor, (height, width, 3) up to 255: a ruled plane under fog.

    The robot at ``position`` (3,), turned by ``quaternion`` (4,), shades the floor.
    """
    eye, right, up, forward, slope, distance = view
    rows = slope * (1 - (2 * np.arange(height) + 1) / height)[:, None]
    columns = slope * (width / height) * ((2 * np.arange(width) + 1) / width - 1)[None, :]
    # The rays through the pixels, their fall for each unit forward, and where they land.
    across, ahead, fall = (
        (forward[i] + columns * right[i] + rows * up[i]).astype(np.float32) for i in range(3)
    )
    # A robot that dives takes the floor with it.
    depth = min(_FLOOR, position[2] - _CLEARANCE) - eye[2]
    seen = (fall < -1e-6) & (depth < 0)
    along = np.where(seen, depth / np.where(seen, fall, 1), 1e3).astype(np.float32)
    np.minimum(along, 1e3, out=along)
    # Around the robot, lest single precision fail far from the origin.
    period = 5 * _SPACING
    near = position[:2] - period * np.floor(position[:2] / period)
    u = (eye[0] - position[0]) + along * across
    v = (eye[1] - position[1]) + along * ahead
    length = np.sqrt(1 + columns * columns + rows * rows).astype(np.float32)
    # Size of a pixel on the floor, stretched where the floor is seen at a low angle.
    blur = (2 * slope / height) * along * np.sqrt(length / np.maximum(np.abs(fall), 1e-3)) + 1e-6

    un, vn = u + np.float32(near[0]), v + np.float32(near[1])
    lines = 0.45 * _ruling(un, vn, _SPACING, 0.05, blur)
    np.maximum(lines, _ruling(un, vn, period, 0.12, blur), out=lines)
    light = 1 - 0.28 * _shade(u, v, quaternion)
    fog = np.where(seen, np.exp(along * length * (-1 / (_VISIBILITY * distance))), 0)
    glow = np.clip(0.5 + 0.5 * rows / slope, 0, 1)
    picture = np.empty((height, width, 3), np.float32)
    for i in range(3):
        water = (_NEAR_WATER[i] + glow * (_FAR_WATER[i] - _NEAR_WATER[i])).astype(np.float32)
        floor = (_SAND[i] + lines * (_LINE[i] - _SAND[i])) * light
        picture[:, :, i] = water + fog * (floor - water)
    return picture


def _shade(u: Pixels, v: Pixels, quaternion: Floats) -> Pixels:
    """Return the capsule's soft shadow, 0 to 1, on the floor at (u, v) from under it."""
    x, y = (float(c) for c in rotate(quaternion, np.array([0.0, CYLINDER / 2, 0.0]))[:2])
    t = np.clip((u * x + v * y) / (x * x + y * y + 1e-9), -1, 1)
    away = np.square(u - t * x) + np.square(v - t * y)
    shade: Pixels = np.exp(away * (-0.5 / RADIUS**2))
    return shade
