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
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.kinematics import State
from aquafish_gym.physics.layout import FIELDS, layout, robot_of
from aquafish_gym.physics.robot import Robot, hull_numbers
from aquafish_gym.plans import AQUAFISH, BodyPlan, FinPlan
from instruments.verification.harness import compiled_wrench
from instruments.verification.rk4 import cross, integrate, quaternion_rate, rotation_matrix
from instruments.verification.trials import Trials

Array = NDArray[np.float64]


def fin_axes(fin: FinPlan, angle: float) -> Array:
    """Return a fin's width, length and normal axis in body axes, as the columns of a matrix."""
    width, length = np.array(fin.axis), -np.array(fin.direction)
    at_zero = np.stack([width, length, cross(width, length)], axis=1)
    axes: Array = about(width, angle) @ at_zero
    return axes


def hinge_motion(plan: BodyPlan, phases: Array, speeds: Array) -> tuple[Array, Array, Array]:
    """Return the angles, rates and accelerations (..., F) of hinges whose servos run steadily.

    ``phases`` (..., F) are the angles, or the phases of fins that sweep, rad, and ``speeds``
    theirs, rad/s.
    """
    turns = np.array([fin.turns for fin in plan.fins])
    sweep = np.array([fin.sweep for fin in plan.fins])
    sine, cosine = np.sin(phases), np.cos(phases)
    return (
        np.where(turns, phases, sweep * sine),
        np.where(turns, speeds, sweep * speeds * cosine),
        np.where(turns, 0.0, -sweep * speeds**2 * sine),
    )


def inertia_and_swing(
    plan: BodyPlan, robot: Robot, angles: Array, rates: Array
) -> tuple[Array, Array]:
    """Return what the robot's momenta are to its body's velocity, by sums over its parts.

    Parameters
    ----------
    plan
        Of the robot.
    robot
        Sizes and masses.
    angles, rates
        (F,) of the hinges, rad and rad/s.

    Returns
    -------
    inertia : (6, 6)
        Momenta (p, l) = inertia (v, w) + swing, all in body axes about the capsule's centre.
    swing : (6,)
        The momenta of the fins' motion relative to the body.
    """
    hull = hull_numbers(plan.hull)
    mass, moment, inertia = hull.mass, np.zeros(3), np.diag(hull.inertia).astype(np.float64)
    swing = np.zeros(6)
    for fin_plan, fin, angle, rate in zip(plan.fins, robot.fins, angles, rates, strict=True):
        axes = fin_axes(fin_plan, angle)
        arm = -fin.length / 2 * axes[:, 1]
        at = np.array(fin_plan.hinge) + arm
        own = axes @ np.diag(fin.inertia) @ axes.T
        mass += fin.mass
        moment += fin.mass * at
        inertia += own + fin.mass * (at @ at * np.eye(3) - np.outer(at, at))
        turning = rate * np.array(fin_plan.axis)
        velocity = cross(turning, arm)
        swing[:3] += fin.mass * velocity
        swing[3:] += own @ turning + fin.mass * cross(at, velocity)
    x, y, z = moment
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    whole: Array = np.block([[mass * np.eye(3), -skew], [skew, inertia]])
    return whole, swing


def about(axis: Array, angle: float) -> Array:
    """Return the matrix (3, 3) of a turn about a unit vector, by Rodrigues' formula."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix: Array = np.eye(3) + math.sin(angle) * skew + (1 - math.cos(angle)) * skew @ skew
    return matrix


class Momentum:
    """One robot under one command.

    What is integrated is y (13,): position, quaternion (x, y, z, w), p and l about the body's
    centre in body axes.

    Parameters
    ----------
    robot
        Sizes and masses.
    command
        (F,) rev/s or Hz.
    fin_angles
        (F,) angles, or phases of fins that sweep, at t = 0, rad.
    wet
        False leaves the water out.
    plan
        Of the robot.
    """

    def __init__(
        self,
        robot: Robot,
        command: Array,
        fin_angles: Array,
        wet: bool = True,
        plan: BodyPlan = AQUAFISH,
    ) -> None:
        self.plan, self.robot, self.wet = plan, robot, wet
        # What gives the water's force and torque, in body axes, for a velocity relative to the
        # water, a spin, hinge angles and rates; None asks ``dynamics.wrench``.
        self.surface: Callable[[Array, Array, Array, Array], tuple[Array, Array]] | None = None
        self.omega = 2 * math.pi * np.asarray(command, dtype=np.float64)
        self.start = np.asarray(fin_angles, dtype=np.float64)

    @classmethod
    def of(cls, trials: Trials, number: int, wet: bool = True) -> Self:
        """Return one of some trials."""
        robot = robot_at(trials.plan, trials.morphologies[number])
        command, angles = trials.commands[number], trials.fin_angles[number]
        return cls(robot, command, angles, wet, trials.plan)

    def phases(self, t: float) -> tuple[Array, Array]:
        """Return each fin's angle, or the phase of one that sweeps, and its speed."""
        return self.start + self.omega * t, self.omega

    def joints(self, t: float) -> tuple[Array, Array]:
        """Return the hinges' angles and rates."""
        angles, rates, _ = hinge_motion(self.plan, *self.phases(t))
        return angles, rates

    def inertia_and_swing(self, t: float) -> tuple[Array, Array]:
        """Return inertia (6, 6) and swing (6,) at time ``t``, s."""
        return inertia_and_swing(self.plan, self.robot, *self.joints(t))

    def at_rest(self) -> Array:
        """Return y as the engines' trials start: at the origin, all momenta none.

        The engines' robot is still, and its joints jump to speed within the first step, which
        passes momentum from fins to body but leaves the total.
        """
        return np.array([0.0] * 6 + [1.0] + [0.0] * 6)

    def moving(self, velocity: Array, spin: Array) -> Array:
        """Return y at the origin, upright, with a velocity (3,) and a spin (3,) at t = 0."""
        inertia, swing = self.inertia_and_swing(0.0)
        y = self.at_rest()
        y[7:] = inertia @ np.concatenate([velocity, spin]) + swing
        return y

    def velocities(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return the body's velocity and spin, both in body axes."""
        inertia, swing = self.inertia_and_swing(t)
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
        angles, rates = self.joints(t)
        if self.surface is not None:
            return self.surface(rotation_matrix(q).T @ velocity, spin, angles, rates)
        phases, _ = self.phases(t)
        joints = tuple(of(phase) for phase in phases for of in (math.cos, math.sin))
        # Asked for a robot that is upright, whose body's axes are the world's.
        state = State(
            (0.0, 0.0, 0.0, 1.0),
            (0.0, 0.0, 0.0),
            _triple(rotation_matrix(q).T @ velocity),
            _triple(spin),
            joints,
            tuple(rates.tolist()),
        )
        force, torque = compiled_wrench(self.plan)(self.robot, state, (0.0, 0.0, 0.0))
        return np.array(force), np.array(torque)

    def run(self, y: Array, h: float, steps: int, start: float = 0.0) -> Array:
        """Return y after ``steps`` of length ``h``, s, from time ``start``."""
        y = integrate(self.rate, y, h, steps, start)
        y[3:7] /= np.linalg.norm(y[3:7])
        return y


def robot_at(plan: BodyPlan, sizes: Array) -> Robot:
    """Return the robot of a plan's sizes (S,)."""
    return robot_of(layout(plan).robots(np.asarray(sizes)[None])[:, 0].tolist())


def total_momentum(morphology: Array, row: Array, plan: BodyPlan = AQUAFISH) -> Array:
    """Return the whole robot's linear momentum (3,) in the world.

    ``row`` is a state in the order of :class:`~aquafish_gym.physics.kinematics.State`, with or
    without roll, pitch and yaw.
    """
    inertia, swing, v, r = _resolve(plan, morphology, row)
    momentum: Array = r @ (inertia @ v + swing)[:3]
    return momentum


def angular_momentum(morphology: Array, row: Array, plan: BodyPlan = AQUAFISH) -> Array:
    """Return the whole robot's angular momentum (3,) about the world's origin."""
    inertia, swing, v, r = _resolve(plan, morphology, row)
    momenta = inertia @ v + swing
    momentum: Array = r @ momenta[3:] + cross(row[FIELDS["position"]], r @ momenta[:3])
    return momentum


def kinetic_energy(morphology: Array, row: Array, plan: BodyPlan = AQUAFISH) -> float:
    """Return the kinetic energy of a robot whose joints stand still."""
    inertia, _, v, _ = _resolve(plan, morphology, row)
    return float(0.5 * v @ inertia @ v)


def _resolve(plan: BodyPlan, morphology: Array, row: Array) -> tuple[Array, Array, Array, Array]:
    angles, _, _ = hinge_motion(plan, layout(plan).angles(row), np.zeros(len(plan.fins)))
    robot = robot_at(plan, morphology)
    inertia, swing = inertia_and_swing(plan, robot, angles, row[layout(plan).rates])
    r = rotation_matrix(row[FIELDS["orientation"]])
    return inertia, swing, np.concatenate([r.T @ row[FIELDS["velocity"]], row[FIELDS["spin"]]]), r


def _triple(v: Array) -> Vector:
    return (float(v[0]), float(v[1]), float(v[2]))
