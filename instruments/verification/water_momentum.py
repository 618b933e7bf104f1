"""Robot and moved water in momentum form, by RK4: what the reactive terms are held against.

The same water, :class:`ReactiveMomentum`, but no accelerations anywhere.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP, simulate
from aquafish_gym.physics.added_mass import (
    finite_span,
    hull_added_mass,
    plate_inertia,
    plate_mass,
)
from aquafish_gym.physics.hydrodynamics import DENSITY
from aquafish_gym.physics.robot import Fin, Robot
from aquafish_gym.plans import BodyPlan
from instruments.verification.convergence import INTERVAL, WHAT, path_gaps
from instruments.verification.momentum import Momentum, fin_axes
from instruments.verification.rk4 import cross, rotation_matrix
from instruments.verification.trials import Trials, random_trials

Array = NDArray[np.float64]


def _added_by_plates(fin: Fin) -> Array:
    """Return a fin's added masses and inertias, (6,), along and about its frame's axes.

    Each plate brings a mass along its normal, and an inertia about either axis in its plane.
    """
    sizes, found = (fin.width, fin.length, fin.thickness), np.zeros(6)
    for normal in range(3):
        one, other = (axis for axis in range(3) if axis != normal)
        found[normal] += plate_mass(sizes[one], sizes[other])
        found[3 + one] += plate_inertia(sizes[one], sizes[other])
        found[3 + other] += plate_inertia(sizes[other], sizes[one])
    return found


def _skew(v: Array) -> Array:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def water_inertia_and_swing(
    plan: BodyPlan, robot: Robot, angles: Array, rates: Array
) -> tuple[Array, Array]:
    """Return what ``momentum.inertia_and_swing`` does, of the water that is carried along.

    By virtual work: each fin's added masses, in its own frame, seen through the matrix that
    gives its motion from the body's.
    """
    mass, inertias = hull_added_mass(plan.hull)
    inertia = np.diag([*mass, *inertias]).astype(np.float64)
    swing = np.zeros(6)
    for fin_plan, fin, angle, rate in zip(plan.fins, robot.fins, angles, rates, strict=True):
        axes = fin_axes(fin_plan, angle)
        arm = -0.5 * fin.length * axes[:, 1]
        to_fin = np.kron(np.eye(2), axes.T)
        moves = to_fin @ np.block(
            [[np.eye(3), -_skew(fin_plan.hinge + arm)], [np.zeros((3, 3)), np.eye(3)]]
        )
        axis = np.array(fin_plan.axis)
        of_joint = to_fin @ np.concatenate([cross(axis, arm), axis])
        carried = moves.T @ np.diag(_added_by_plates(fin))
        inertia += carried @ moves
        swing += rate * (carried @ of_joint)
    return inertia, swing


class ReactiveMomentum(Momentum):
    """One robot under one command in water with reactive terms; its momenta are the whole's.

    Parameters
    ----------
    robot, command, fin_angles, wet, plan
        As :class:`~instruments.verification.momentum.Momentum` has them; ``wet=False`` leaves
        out the drag and what fins shed that sweep, not the water that is carried along.
    """

    def inertia_and_swing(self, t: float) -> tuple[Array, Array]:
        """Return inertia (6, 6) and swing (6,) of robot and water."""
        a, b = super().inertia_and_swing(t)
        c, d = water_inertia_and_swing(self.plan, self.robot, *self.joints(t))
        return a + c, b + d

    def water(self, t: float, q: Array, velocity: Array, spin: Array) -> tuple[Array, Array]:
        """Return drag's and the shed water's force and torque, in body axes."""
        force, torque = super().water(t, q, velocity, spin)
        flow = rotation_matrix(q).T @ velocity
        each = zip(self.plan.fins, self.robot.fins, *self.joints(t), strict=True)
        for fin_plan, fin, angle, rate in each:
            if fin_plan.turns:
                continue
            _, along, normal = fin_axes(fin_plan, angle).T
            arm = -fin.length * along
            at = fin_plan.hinge + arm
            end = flow + cross(spin, at) + rate * cross(np.array(fin_plan.axis), arm)
            m = DENSITY * math.pi / 4 * fin.width**2 * finite_span(fin.width, fin.length)
            u, w = float(end @ along), float(end @ normal)
            shed = 0.5 * m * w**2 * along - m * max(u, 0.0) * w * normal
            force, torque = force + shed, torque + cross(at, shed)
        return force, torque


SUBSTEPS = (1, 2, 4, 8)


def reactive_reference(trials: Trials, robot: int, samples: int, h: float = TIMESTEP) -> Array:
    """Return position, quaternion and spin (samples, 10) of one robot by RK4."""
    model = ReactiveMomentum.of(trials, robot)
    y, path = model.at_rest(), []
    for i in range(samples):
        y = model.run(y, h, round(INTERVAL / h), i * INTERVAL)
        _, spin = model.velocities((i + 1) * INTERVAL, y)
        path.append(np.concatenate([y[:7], spin]))
    return np.array(path)


def scheme_errors(trials: Trials, samples: int) -> list[dict[str, Array]]:
    """Return each robot's largest gap to RK4 (B,), of each of ``WHAT``, for each ``SUBSTEPS``."""
    truths = np.array([reactive_reference(trials, i, samples) for i in range(len(trials.commands))])
    every, found = round(INTERVAL / TIMESTEP), []
    for substeps in SUBSTEPS:
        log = simulate(
            trials.morphologies, trials.commands, trials.fin_angles, steps=samples * every,
            substeps=substeps, dtype="float64", record="pose", reactive=True,
            plan=trials.plan,
        )  # fmt: skip
        assert log.position is not None
        assert log.quaternion is not None
        assert log.gyro is not None
        paths = np.concatenate([log.position, log.quaternion, log.gyro], axis=2)
        found.append(path_gaps(paths[:, every - 1 :: every], truths))
    return found


def convergence_rows(robots: int, samples: int, seed: int) -> list[dict[str, object]]:
    """Return the scheme's median and largest error at each step, and the order that is seen."""
    found = scheme_errors(random_trials(robots, seed), samples)
    rows: list[dict[str, object]] = []
    for what, unit in WHAT.items():
        medians = [float(np.median(gap[what])) for gap in found]
        for i, substeps in enumerate(SUBSTEPS):
            following = medians[i + 1] if i + 1 < len(medians) else None
            rows.append(
                {
                    "what": what,
                    "unit": unit,
                    "step": TIMESTEP / substeps,
                    "median": medians[i],
                    "maximum": float(found[i][what].max()),
                    "order": None if following is None else math.log2(medians[i] / following),
                }
            )
    return rows
