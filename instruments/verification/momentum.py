"""An independent statement of the robot's motion: momenta in body axes, integrated by RK4.

It shares with the engines only the drag law (``dynamics.wrench``) and the geometry's numbers.
The unknowns are the momenta of the whole, of which the body's velocity is solved at every
evaluation; there are no accelerations anywhere, so neither Coriolis terms nor joint
accelerations can be wrong. With p and l about the body's centre::

    p' = F - w x p          l' = T - w x l - v x p
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.kinematics import State
from aquafish_gym.physics.layout import FIELDS, layout, robot_of
from aquafish_gym.physics.robot import Robot
from aquafish_gym.plans import AQUAFISH
from instruments.verification.harness import compiled_wrench
from instruments.verification.paper_robot import (
    BODY_INERTIA,
    BODY_MASS,
    CAUDAL_Y,
    PECTORAL_X,
    PECTORAL_Y,
    SWEEP,
)
from instruments.verification.rk4 import cross, integrate, quaternion_rate, rotation_matrix

Array = NDArray[np.float64]

HINGES = np.array([[-PECTORAL_X, PECTORAL_Y, 0], [PECTORAL_X, PECTORAL_Y, 0], [0, CAUDAL_Y, 0]])
AXES = np.array([[1.0, 0, 0], [1.0, 0, 0], [0, 0, 1.0]])


def inertia_and_swing(robot: Robot, angles: Array, rates: Array) -> tuple[Array, Array]:
    """Return what the robot's momenta are to its body's velocity, by sums over its parts.

    Parameters
    ----------
    robot
        Sizes and masses.
    angles, rates
        (3,) of the three hinges, rad and rad/s.

    Returns
    -------
    inertia : (6, 6)
        Momenta (p, l) = inertia (v, w) + swing, all in body axes about the capsule's centre.
    swing : (6,)
        The momenta of the fins' motion relative to the body.
    """
    mass, moment, inertia = BODY_MASS, np.zeros(3), np.diag(BODY_INERTIA).astype(np.float64)
    swing = np.zeros(6)
    for i, fin in enumerate(robot.fins):
        turn = about(AXES[i], angles[i])
        arm = turn @ np.array([0.0, -fin.length / 2, 0.0])
        at = HINGES[i] + arm
        across, along, normal = fin.inertia
        own = turn @ np.diag([across, along, normal] if i < 2 else [normal, along, across]) @ turn.T
        mass += fin.mass
        moment += fin.mass * at
        inertia += own + fin.mass * (at @ at * np.eye(3) - np.outer(at, at))
        velocity = rates[i] * cross(AXES[i], arm)
        swing[:3] += fin.mass * velocity
        swing[3:] += own @ (rates[i] * AXES[i]) + fin.mass * cross(at, velocity)
    x, y, z = moment
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    whole: Array = np.block([[mass * np.eye(3), -skew], [skew, inertia]])
    return whole, swing


def about(axis: Array, angle: float) -> Array:
    """Return the matrix (3, 3) of a turn about the x axis or the z axis."""
    c, s = math.cos(angle), math.sin(angle)
    if axis[0]:
        return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


class Momentum:
    """One robot under one command.

    What is integrated is y (13,): position, quaternion (x, y, z, w), p and l about the body's
    centre in body axes.

    Parameters
    ----------
    robot
        Sizes and masses.
    command
        (3,) rev/s, rev/s, Hz.
    fin_angles
        (3,) left and right pectoral angle and caudal phase at t = 0, rad.
    wet
        False leaves the water out.
    """

    def __init__(self, robot: Robot, command: Array, fin_angles: Array, wet: bool = True) -> None:
        self.robot, self.wet = robot, wet
        # What gives the water's force and torque, in body axes, for a velocity relative to the
        # water, a spin, hinge angles and rates; None asks ``dynamics.wrench``.
        self.surface: Callable[[Array, Array, Array, Array], tuple[Array, Array]] | None = None
        self.omega = 2 * math.pi * np.asarray(command, dtype=np.float64)
        self.start = np.asarray(fin_angles, dtype=np.float64)

    @classmethod
    def of(cls, morphology: Array, command: Array, fin_angles: Array, wet: bool = True) -> Momentum:
        """Make one from nine sizes in the order of ``DIMENSIONS``."""
        robot = robot_of(layout(AQUAFISH).robots(np.asarray(morphology)[None])[:, 0].tolist())
        return cls(robot, command, fin_angles, wet)

    def joints(self, t: float) -> tuple[Array, Array, float]:
        """Return the hinges' angles and rates, and the caudal phase."""
        left, right, phase = self.start + self.omega * t
        tail, rate = (
            SWEEP * math.sin(phase),
            SWEEP * self.omega[2] * math.cos(phase),
        )
        return (
            np.array([left, right, tail]),
            np.array([self.omega[0], self.omega[1], rate]),
            float(phase),
        )

    def at_rest(self) -> Array:
        """Return y as the engines' trials start: at the origin, all momenta none.

        The engines' robot is still, and its joints jump to speed within the first step, which
        passes momentum from fins to body but leaves the total.
        """
        return np.array([0.0] * 6 + [1.0] + [0.0] * 6)

    def moving(self, velocity: Array, spin: Array) -> Array:
        """Return y at the origin, upright, with a velocity (3,) and a spin (3,) at t = 0."""
        angles, rates, _ = self.joints(0.0)
        inertia, swing = inertia_and_swing(self.robot, angles, rates)
        y = self.at_rest()
        y[7:] = inertia @ np.concatenate([velocity, spin]) + swing
        return y

    def velocities(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return the body's velocity and spin, both in body axes."""
        angles, rates, _ = self.joints(t)
        inertia, swing = inertia_and_swing(self.robot, angles, rates)
        v = np.asarray(np.linalg.solve(inertia, y[7:] - swing), np.float64)
        return v[:3], v[3:]

    @staticmethod
    def momenta(y: Array) -> tuple[Array, Array]:
        """Return linear momentum and angular momentum about the world's origin."""
        r = rotation_matrix(y[3:7])
        linear: Array = r @ y[7:10]
        angular: Array = r @ y[10:13] + cross(y[:3], linear)
        return linear, angular

    def rate(self, t: float, y: Array) -> Array:
        """Return dy/dt."""
        q = y[3:7] / math.sqrt(y[3:7] @ y[3:7])
        v, w = self.velocities(t, y)
        p, momentum = y[7:10], y[10:13]
        push, turning = -cross(w, p), -cross(w, momentum) - cross(v, p)
        moving = rotation_matrix(q) @ v
        if self.wet:
            force, torque = self.water(t, q, moving, w)
            push, turning = push + force, turning + torque
        return np.concatenate([moving, quaternion_rate(q, w), push, turning])

    def water(self, t: float, q: Array, velocity: Array, spin: Array) -> tuple[Array, Array]:
        """Return the law's force and torque about the body's centre, in body axes."""
        angles, rates, phase = self.joints(t)
        if self.surface is not None:
            return self.surface(rotation_matrix(q).T @ velocity, spin, angles, rates)
        turned = (angles[0], angles[1], phase)
        joints = tuple(of(angle) for angle in turned for of in (math.cos, math.sin))
        # Asked for a robot that is upright, whose body's axes are the world's.
        state = State(
            (0.0, 0.0, 0.0, 1.0),
            (0.0, 0.0, 0.0),
            _triple(rotation_matrix(q).T @ velocity),
            _triple(spin),
            joints,
            _triple(rates),
        )
        force, torque = compiled_wrench()(self.robot, state, (0.0, 0.0, 0.0))
        return np.array(force), np.array(torque)

    def run(self, y: Array, h: float, steps: int, start: float = 0.0) -> Array:
        """Return y after ``steps`` of length ``h``, s, from time ``start``."""
        y = integrate(self.rate, y, h, steps, start)
        y[3:7] /= np.linalg.norm(y[3:7])
        return y


def total_momentum(morphology: Array, row: Array) -> Array:
    """Return the whole robot's linear momentum (3,) in the world.

    ``row`` is a state in the order of :class:`~aquafish_gym.physics.kinematics.State`, 22
    numbers or more.
    """
    inertia, swing, v, r = _resolve(morphology, row)
    momentum: Array = r @ (inertia @ v + swing)[:3]
    return momentum


def angular_momentum(morphology: Array, row: Array) -> Array:
    """Return the whole robot's angular momentum (3,) about the world's origin."""
    inertia, swing, v, r = _resolve(morphology, row)
    momenta = inertia @ v + swing
    momentum: Array = r @ momenta[3:] + cross(row[FIELDS["position"]], r @ momenta[:3])
    return momentum


def kinetic_energy(morphology: Array, row: Array) -> float:
    """Return the kinetic energy of a robot whose joints stand still."""
    inertia, _, v, _ = _resolve(morphology, row)
    return float(0.5 * v @ inertia @ v)


def _resolve(morphology: Array, row: Array) -> tuple[Array, Array, Array, Array]:
    robot = robot_of(layout(AQUAFISH).robots(np.asarray(morphology)[None])[:, 0].tolist())
    angles = np.array(
        [
            math.atan2(row[14], row[13]),
            math.atan2(row[16], row[15]),
            SWEEP * row[18],
        ]
    )
    inertia, swing = inertia_and_swing(robot, angles, row[layout(AQUAFISH).rates])
    r = rotation_matrix(row[FIELDS["orientation"]])
    return inertia, swing, np.concatenate([r.T @ row[FIELDS["velocity"]], row[FIELDS["spin"]]]), r


def _triple(v: Array) -> Vector:
    return (float(v[0]), float(v[1]), float(v[2]))
