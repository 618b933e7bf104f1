"""The drag law stated anew: every force at a point of the surface, all in body axes.

Nothing is shared with ``hydrodynamics`` and ``dynamics.forces`` but coefficients and sizes. The
engines work in the fins' own frames at a few points of one plane; here each of a fin's three
plates, the capsule's strips and the fin mounts are hundreds of points that move with the robot.
So a wrong frame, lever or sign there shows here, and so does what their few points cost.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.hydrodynamics import (
    AXIAL_DRAG,
    CROSS_FLOW_DRAG,
    DENSITY,
    NORMAL_DRAG,
    SKIN_FRICTION,
)
from aquafish_gym.physics.robot import Robot, hull_numbers
from aquafish_gym.plans import AQUAFISH, BodyPlan
from instruments.verification.momentum import fin_axes
from instruments.verification.quadrature import fine_strips, gauss_rule, mount_plates

Array = NDArray[np.float64]


class Surface:
    """One robot's surface, as points with coefficients.

    Parameters
    ----------
    robot
        Sizes.
    points
        Along each side of each plate; the capsule has six times as many strips.
    exponent
        The power of speed that drag is proportional to; the law's is 2.
    friction
        A factor on the law's skin friction.
    plan
        Of the robot.
    """

    def __init__(
        self,
        robot: Robot,
        points: int = 12,
        exponent: float = 2.0,
        friction: float = 1.0,
        plan: BodyPlan = AQUAFISH,
    ) -> None:
        self._plan = plan
        self._power = exponent - 1.0
        self._friction = friction * SKIN_FRICTION
        self._fins = []
        for fin in robot.fins:
            plates = [
                _plate((fin.width, fin.length, fin.thickness), normal, points)
                for normal in range(3)
            ]
            at, normals, areas = (np.concatenate(part) for part in zip(*plates, strict=True))
            at[:, 1] -= fin.length / 2
            self._fins.append((at, normals, areas))
        self._mounts = []
        for middle, axes, width, length in mount_plates(plan):
            at, normals, areas = _plate((width, length, 0.0), 2, points)
            self._mounts.append((middle + at @ axes.T, normals @ axes.T, areas))
        self._strips = fine_strips(plan.hull, 2 * points)

    def wrench(
        self, velocity: Array, spin: Array, angles: Array, rates: Array
    ) -> tuple[Array, Array]:
        """Return force, and torque about the capsule's centre, in body axes.

        Parameters
        ----------
        velocity
            (3,) of the capsule's centre relative to the water, in body axes.
        spin
            (3,) of the body.
        angles, rates
            (F,) of the hinges.
        """
        places, faces, sizes, moving = [], [], [], []
        for at, normals, areas in self._mounts:
            places.append(at)
            faces.append(normals)
            sizes.append(areas)
            moving.append(velocity + _cross(spin, at))
        for i, (at, normals, areas) in enumerate(self._fins):
            fin = self._plan.fins[i]
            axes = fin_axes(fin, angles[i])  # of (width, length, normal)
            arm = at @ axes.T
            places.append(fin.hinge + arm)
            faces.append(normals @ axes.T)
            sizes.append(areas)
            swing = _cross(rates[i] * np.array(fin.axis), arm)
            moving.append(velocity + _cross(spin, places[-1]) + swing)
        at, v = np.concatenate(places), np.concatenate(moving)
        e, area = np.concatenate(faces), np.concatenate(sizes)
        normal = (v * e).sum(axis=1, keepdims=True) * e
        speed = (v * v).sum(axis=1) ** (0.5 * self._power)
        law = NORMAL_DRAG * normal + 2 * self._friction * (v - normal)
        force = -0.5 * DENSITY * (area * speed)[:, None] * law
        total, torque = force.sum(axis=0), _moment(at, force).sum(axis=0)

        y, areas = self._strips
        at = np.stack([0 * y, y, 0 * y], axis=1)
        v = velocity + _cross(spin, at)
        v[:, 1] = 0.0
        speed = (v * v).sum(axis=1) ** (0.5 * self._power)
        force = -0.5 * DENSITY * CROSS_FLOW_DRAG * (areas * speed)[:, None] * v
        total, torque = total + force.sum(axis=0), torque + _moment(at, force).sum(axis=0)
        axial = 0.5 * DENSITY * AXIAL_DRAG * math.pi * self._plan.hull.radius**2
        total[1] -= axial * abs(velocity[1]) ** self._power * velocity[1]
        rolling = 0.5 * DENSITY * self._friction * hull_numbers(self._plan.hull).roll_area
        torque[1] -= rolling * abs(spin[1]) ** self._power * spin[1]
        return total, torque


def _plate(size: tuple[float, float, float], normal: int, points: int) -> tuple[Array, ...]:
    """Return points (n, 3), unit normals (n, 3) and areas (n,) of a plate around the origin."""
    nodes, weights = gauss_rule(points)
    one, other = (axis for axis in range(3) if axis != normal)
    at = np.zeros((points, points, 3))
    at[..., one] = size[one] * nodes[:, None]
    at[..., other] = size[other] * nodes
    normals = np.zeros_like(at)
    normals[..., normal] = 1.0
    areas = size[one] * size[other] * np.outer(weights, weights)
    return at.reshape(-1, 3), normals.reshape(-1, 3), areas.ravel()


def _cross(a: Array, b: Array) -> Array:
    """Return a x b for one a (3,) and many b (n, 3)."""
    x, y, z = b.T
    return np.stack([a[1] * z - a[2] * y, a[2] * x - a[0] * z, a[0] * y - a[1] * x], axis=1)


def _moment(at: Array, force: Array) -> Array:
    """Return r x F for many (n, 3)."""
    (x, y, z), (fx, fy, fz) = at.T, force.T
    return np.stack([y * fz - z * fy, z * fx - x * fz, x * fy - y * fx], axis=1)
