"""MuJoCo's robot without water: an oracle for the multibody mechanics.

It shares the robot's sizes and masses with the other engines and nothing else: MuJoCo states the
kinematics, the inertia matrix and the Coriolis forces.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology
from instruments.verification.momentum import hinge_motion
from instruments.verification.mujoco_model import BASE, load_mujoco, mujoco_model
from instruments.verification.rk4 import integrate, quaternion_rate

Array = NDArray[np.float64]


class DryRobot:
    """One robot without water whose joints are prescribed, its motion by RK4.

    At every evaluation MuJoCo gives the inertia matrix M and the bias forces c at the present
    angles and rates. The hinges' accelerations are prescribed, nothing pushes the base, and so
    its acceleration a solves the first six rows of M (a, hinges') + c = 0.

    A state is (13,): position, quaternion (x, y, z, w), velocity in the world, spin in body
    axes; the first of :class:`~aquafish_gym.physics.kinematics.State`.

    Parameters
    ----------
    morphology
        Of any plan.
    command
        (F,) rev/s or Hz.
    fin_angles
        (F,) angles, or phases of fins that sweep, at t = 0, rad.
    """

    def __init__(self, morphology: Morphology, command: Array, fin_angles: Array) -> None:
        self._mujoco = load_mujoco()
        self._plan = morphology.plan
        self._model = mujoco_model(morphology)
        self._data = self._mujoco.MjData(self._model)
        self._start = np.asarray(fin_angles, dtype=np.float64)
        self._omega = 2 * math.pi * np.asarray(command, dtype=np.float64)
        self._columns = np.eye(self._model.nv)[:BASE]

    def rate(self, t: float, y: Array) -> Array:
        """Return dy/dt at time ``t``, s."""
        accelerations = self._place(t, y)
        model, data = self._model, self._data
        inertia = np.empty((BASE, BASE))
        product = np.empty(model.nv)
        for i, unit in enumerate(self._columns):
            self._mujoco.mj_mulM(model, data, product, unit)
            inertia[:, i] = product[:BASE]
        self._mujoco.mj_mulM(model, data, product, np.concatenate([np.zeros(BASE), accelerations]))
        base = np.linalg.solve(inertia, -data.qfrc_bias[:BASE] - product[:BASE])
        q = y[3:7] / np.linalg.norm(y[3:7])
        return np.concatenate([y[7:10], quaternion_rate(q, y[10:13]), base])

    def run(self, y: Array, h: float, steps: int, start: float = 0.0) -> Array:
        """Return the state after ``steps`` of length ``h``, s, from time ``start``."""
        y = integrate(self.rate, y, h, steps, start)
        y[3:7] /= np.linalg.norm(y[3:7])
        return y

    def momenta(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return the whole robot's linear momentum and its angular about the world's origin."""
        self._place(t, y)
        self._mujoco.mj_subtreeVel(self._model, self._data)
        linear = self._model.body_subtreemass[1] * self._data.subtree_linvel[1]
        centre = self._data.subtree_com[1]
        return linear, self._data.subtree_angmom[1] + np.cross(centre, linear)

    def _place(self, t: float, y: Array) -> Array:
        """Put MuJoCo's robot there, and return the hinges' accelerations."""
        omega = self._omega
        angles, rates, accelerations = hinge_motion(self._plan, self._start + omega * t, omega)
        data = self._data
        data.qpos[:3] = y[:3]
        data.qpos[3:7] = y[[6, 3, 4, 5]] / np.linalg.norm(y[3:7])
        data.qpos[7:] = angles
        data.qvel[:BASE] = y[7:13]
        data.qvel[BASE:] = rates
        self._mujoco.mj_fwdPosition(self._model, data)
        self._mujoco.mj_fwdVelocity(self._model, data)
        return accelerations
