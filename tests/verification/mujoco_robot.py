"""The same robot in MuJoCo: an oracle for the multibody mechanics, with no water.

It shares the robot's sizes and masses with the engines and nothing else: MuJoCo states the
kinematics, the inertia matrix and the Coriolis forces. MuJoCo comes with the extra ``bench``.
"""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology, MorphologyLike
from aquafish_gym.physics.kinematics import SWEEP
from aquafish_gym.physics.layout import robot_from_column, robot_parameters
from aquafish_gym.physics.robot import BODY_INERTIA, BODY_MASS, CAUDAL_Y, PECTORAL_X, PECTORAL_Y
from aquafish_gym.utils.validation import EngineUnavailableError, InvalidArgumentError
from tests.verification.rk4 import integrate, quaternion_rate

Array = NDArray[np.float64]

BASE = 6  # degrees of freedom of the free base, before those of the three hinges
# A servo's gain, in torque per rad/s: it brings the heaviest fin to speed within 0.1 ms.
_SERVO = 1e4

_HINGES = (
    ("left_pectoral", (-PECTORAL_X, PECTORAL_Y, 0.0), (1.0, 0.0, 0.0)),
    ("right_pectoral", (PECTORAL_X, PECTORAL_Y, 0.0), (1.0, 0.0, 0.0)),
    ("caudal", (0.0, CAUDAL_Y, 0.0), (0.0, 0.0, 1.0)),
)


def load_mujoco() -> Any:
    """Return the module.

    Raises
    ------
    EngineUnavailableError
        If it is not installed; the message names the extra that brings it.
    """
    try:
        return import_module("mujoco")
    except ImportError as error:
        raise EngineUnavailableError(
            "the comparison with MuJoCo needs the package mujoco, which is not installed here "
            f'({error}): pip install "aquafish-gym[bench]"'
        ) from None


def mujoco_model(morphology: MorphologyLike = None, timestep: float = 0.01) -> Any:
    """Return the robot as an ``MjModel``: a free body and three hinges, no fluid, no gravity.

    ``qpos`` is position, quaternion (w, x, y, z) and the angles of left flipper, right flipper
    and tail in rad; ``qvel`` the base's velocity in the world, its spin in body axes and the
    hinges' rates. ``ctrl`` is what three servos try to make the hinges' rates (rad/s); with the
    model's integrator, ``implicitfast``, their high gain is no hindrance.

    Parameters
    ----------
    morphology
        Whatever ``Morphology.coerce`` takes; None is the nominal body.
    timestep
        Of MuJoCo's own integrator, s.

    Raises
    ------
    EngineUnavailableError
        If mujoco is not installed.
    InvalidArgumentError
        If the timestep is not positive, or the body is not one.
    """
    if not (isinstance(timestep, int | float) and 0 < timestep < math.inf):
        raise InvalidArgumentError(f"timestep must be a positive number of s; got {timestep!r}")
    sizes = Morphology.coerce(morphology).to_array()
    mujoco = load_mujoco()
    robot = robot_from_column(robot_parameters(sizes[None])[:, 0])
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    base = spec.worldbody.add_body(name="capsule")
    base.add_freejoint()
    _set_inertia(base, BODY_MASS, (0.0, 0.0, 0.0), BODY_INERTIA)
    for (name, hinge, axis), fin in zip(_HINGES, robot, strict=True):
        link = base.add_body(name=name, pos=hinge)
        link.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
        across, along, normal = fin.inertia
        upright = axis[2] == 1.0  # a fin turns about its width axis; see ``robot.py``
        inertia = (normal, along, across) if upright else (across, along, normal)
        _set_inertia(link, fin.mass, (0.0, -0.5 * fin.length, 0.0), inertia)
        servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_velocity(kv=_SERVO)
    return spec.compile()


def _set_inertia(
    body: Any, mass: float, centre: tuple[float, float, float], inertia: tuple[float, ...]
) -> None:
    body.explicitinertial = True
    body.mass = mass
    body.ipos = centre
    body.inertia = inertia


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
        Whatever ``Morphology.coerce`` takes.
    command
        (3,) rev/s, rev/s, Hz.
    fin_angles
        (3,) left and right pectoral angle and caudal phase at t = 0, rad.
    """

    def __init__(self, morphology: MorphologyLike, command: Array, fin_angles: Array) -> None:
        self._mujoco = load_mujoco()
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
        angles = self._start + omega * t
        sine, cosine = math.sin(angles[2]), math.cos(angles[2])
        data = self._data
        data.qpos[:3] = y[:3]
        data.qpos[3:7] = y[[6, 3, 4, 5]] / np.linalg.norm(y[3:7])
        data.qpos[7:] = angles[0], angles[1], SWEEP * sine
        data.qvel[:BASE] = y[7:13]
        data.qvel[BASE:] = omega[0], omega[1], SWEEP * omega[2] * cosine
        self._mujoco.mj_fwdPosition(self._model, data)
        self._mujoco.mj_fwdVelocity(self._model, data)
        return np.array([0.0, 0.0, -SWEEP * omega[2] ** 2 * sine])
