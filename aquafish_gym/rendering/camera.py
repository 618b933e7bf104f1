"""The camera: the point of view of a picture, and the projection of points to pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import finite_array

Frame = NDArray[np.uint8]
NEAREST_DEPTH = 0.1  # units; points closer to the camera are not drawn


@dataclass(frozen=True)
class Camera:
    """The point of view of a picture.

    Attributes
    ----------
    distance
        Distance from the target, in units of 5 cm.
    azimuth, elevation
        Angles of the camera about the vertical and above the target, degrees. Azimuth 0 looks
        along the world's y from behind the robot's start, 90 looks along -x from its right.
    target
        A point to look at, or None to follow the robot.
    field_of_view
        Vertical field of view, degrees.

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

    def look(self, robot: Floats) -> CameraView:
        """Return the view that follows a robot at this position (3,)."""
        target = robot if self.target is None else np.array(self.target)
        a = math.radians(self.azimuth)
        e = math.radians(self.elevation)
        back = np.array([math.sin(a) * math.cos(e), -math.cos(a) * math.cos(e), math.sin(e)])
        right = np.array([math.cos(a), math.sin(a), 0.0])
        slope = math.tan(math.radians(self.field_of_view) / 2)
        eye = target + self.distance * back
        up = np.cross(back, right)
        return CameraView(eye, right, up, -back, slope, self.distance)


class CameraView(NamedTuple):
    """A camera's eye and axes, (3,) each, in the world."""

    eye: Floats
    right: Floats
    up: Floats
    forward: Floats
    slope: float  #: The tangent of half the vertical field of view.
    distance: float  #: Distance from the eye to the target.

    def project(self, points: Floats, width: int, height: int) -> Floats:
        """Return the pixels (..., 2), column and row, and the depth (..., 1) of points (..., 3)."""
        x, y, depth = np.moveaxis((points - self.eye) @ np.array(self[1:4]).T, -1, 0)
        scale = height / (2 * self.slope) / np.maximum(depth, NEAREST_DEPTH)
        return np.stack([width / 2 + scale * x, height / 2 - scale * y, depth], axis=-1)
