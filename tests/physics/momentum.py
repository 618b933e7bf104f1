"""An independent statement of the robot's motion: momenta in body axes, integrated by RK4.

It shares with the engines only the drag law and the geometry's numbers. The unknowns are the
momenta of the whole, of which the body's velocity is solved at every evaluation; there are no
accelerations anywhere, so neither Coriolis terms nor joint accelerations can be wrong.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.dynamics import forces
from aquafish_gym.physics.kinematics import State
from aquafish_gym.robot import (
    BODY_INERTIA,
    BODY_MASS,
    CAUDAL_Y,
    PECTORAL_X,
    PECTORAL_Y,
    Robot,
)

Array = NDArray[np.float64]
HINGES = np.array([[-PECTORAL_X, PECTORAL_Y, 0], [PECTORAL_X, PECTORAL_Y, 0], [0, CAUDAL_Y, 0]])
AXES = np.array([[1.0, 0, 0], [1.0, 0, 0], [0, 0, 1.0]])


def _about(axis: Array, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    if axis[0]:
        return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


class Momentum:
    """One robot under one command, from an initial state of the engines."""

    def __init__(self, robot: Robot, command: Array, fin_angles: Array, wet: bool = True) -> None:
        self.robot, self.command, self.start, self.wet = robot, command, fin_angles, wet

    def joints(self, t: float) -> tuple[Array, Array, float]:
        """Return angles, rates and the caudal phase."""
        left, right = self.start[:2] + 2 * math.pi * self.command[:2] * t
        omega = 2 * math.pi * self.command[2]
        phase = self.start[2] + omega * t
        sweep = math.radians(30)
        return (
            np.array([left, right, sweep * math.sin(phase)]),
            np.array([*(2 * math.pi * self.command[:2]), sweep * omega * math.cos(phase)]),
            phase,
        )

    def masses(self, t: float) -> tuple[Array, Array, Array, Array]:
        """Return generalised inertia (6, 6) and the momenta (3,), (3,) of the joints' motion."""
        angles, rates, _ = self.joints(t)
        mass, moment, inertia = BODY_MASS, np.zeros(3), np.diag(BODY_INERTIA).astype(float)
        linear, angular = np.zeros(3), np.zeros(3)
        for i, fin in enumerate((self.robot.left, self.robot.right, self.robot.caudal)):
            turn = _about(AXES[i], angles[i])
            arm = turn @ np.array([0.0, -fin.length / 2, 0.0])
            at = HINGES[i] + arm
            ia, ib, ic = fin.inertia
            own = np.diag([ia, ib, ic] if i < 2 else [ic, ib, ia])
            own = turn @ own @ turn.T
            mass += fin.mass
            moment += fin.mass * at
            inertia += own + fin.mass * (at @ at * np.eye(3) - np.outer(at, at))
            swing = rates[i] * np.cross(AXES[i], arm)
            linear += fin.mass * swing
            angular += own @ (rates[i] * AXES[i]) + fin.mass * np.cross(at, swing)
        s = np.array(
            [[0, -moment[2], moment[1]], [moment[2], 0, -moment[0]], [-moment[1], moment[0], 0]]
        )
        whole = np.block([[mass * np.eye(3), -s], [s, inertia]])
        return whole, linear, angular, angles

    def velocities(self, t: float, p: Array, momentum: Array) -> tuple[Array, Array]:
        whole, linear, angular, _ = self.masses(t)
        v = np.linalg.solve(whole, np.concatenate([p - linear, momentum - angular]))
        return v[:3], v[3:]

    def start_momenta(self, v: Array, w: Array) -> Array:
        """Return p, l (6,) for a body velocity and spin, both in body axes, at t = 0."""
        whole, linear, angular, _ = self.masses(0.0)
        return whole @ np.concatenate([v, w]) + np.concatenate([linear, angular])

    def rate(self, t: float, y: Array) -> Array:
        """y is position, quaternion xyzw, p and l about the body's centre, in body axes."""
        q = y[3:7] / np.linalg.norm(y[3:7])
        v, w = self.velocities(t, y[7:10], y[10:13])
        x, yy, z, s = q
        r = np.array(
            [
                [1 - 2 * (yy * yy + z * z), 2 * (x * yy - z * s), 2 * (x * z + yy * s)],
                [2 * (x * yy + z * s), 1 - 2 * (x * x + z * z), 2 * (yy * z - x * s)],
                [2 * (x * z - yy * s), 2 * (yy * z + x * s), 1 - 2 * (x * x + yy * yy)],
            ]
        )
        force, torque = self.water(t, q, r @ v, w) if self.wet else (np.zeros(3), np.zeros(3))
        spin = np.array([*w, 0.0])
        qdot = 0.5 * np.array(
            [
                s * spin[0] + yy * spin[2] - z * spin[1],
                s * spin[1] + z * spin[0] - x * spin[2],
                s * spin[2] + x * spin[1] - yy * spin[0],
                -x * spin[0] - yy * spin[1] - z * spin[2],
            ]
        )
        return np.concatenate(
            [
                r @ v,
                qdot,
                force - np.cross(w, y[7:10]),
                torque - np.cross(w, y[10:13]) - np.cross(v, y[7:10]),
            ]
        )

    def water(self, t: float, q: Array, velocity: Array, w: Array) -> tuple[Array, Array]:
        """Sum the law's forces over body and fins, in body axes."""
        angles, rates, phase = self.joints(t)
        pairs = [(math.cos(a), math.sin(a)) for a in (angles[0], angles[1], phase)]
        state = State(tuple(q), (0.0, 0.0, 0.0), tuple(velocity), tuple(w), *pairs, tuple(rates))  # type: ignore[arg-type]
        parts = forces(self.robot, state, (0.0, 0.0, 0.0))
        total = np.array(parts.left) + np.array(parts.right) + np.array(parts.body)
        f, m = np.array(parts.caudal)
        tail = np.array([[-f[2], f[1], f[0]], [-m[2], m[1], m[0]]])
        return tuple(total + tail)  # type: ignore[return-value]

    def run(self, y: Array, h: float, steps: int) -> Array:
        """Return y after ``steps`` of classical RK4."""
        t = 0.0
        for _ in range(steps):
            k1 = self.rate(t, y)
            k2 = self.rate(t + h / 2, y + h / 2 * k1)
            k3 = self.rate(t + h / 2, y + h / 2 * k2)
            k4 = self.rate(t + h, y + h * k3)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            t += h
        return y
