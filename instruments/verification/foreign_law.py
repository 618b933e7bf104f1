"""Our drag law over the whole surface, with MuJoCo's mechanics: another simulator of the robot.

It shares sizes, masses and coefficients with the engines. MuJoCo states the mechanics, ``Surface``
the water's force at hundreds of points, and its step is shorter. Its defects are what a real robot
may have and no model here knows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.kinematics import RUNAWAY_SQUARE
from aquafish_gym.physics.layout import layout, robot_of
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import TIMESTEP
from instruments.verification.mujoco_model import BASE, hinge_angles, load_mujoco, mujoco_model
from instruments.verification.mujoco_world import STEPS
from instruments.verification.surface import Surface

Array = NDArray[np.float64]

POINTS = 6  # along each side of each plate
CAPSULE = 1  # MuJoCo's number of the base; those of the fins follow


@dataclass(frozen=True)
class Defects:
    """How a robot differs from the models' robot; by default in nothing but its simulator."""

    exponent: float = 2.0  #: Drag is proportional to this power of speed.
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: The hull's centre of mass, units.
    hull: float = 1.0  #: A factor on the hull's mass and inertia.
    servo: float = 0.0  #: Time constant of the servos' speed, s.
    fin_density: float = 1.0  #: A factor on the mass and inertia of the fins.
    friction: float = 1.0  #: A factor on the skin friction.


def simulate_law(
    body: Array, command: Array, angles: Array, steps: int, defects: Defects | None = None
) -> Array:
    """Return the gyro (T, 3) of a robot that holds a command (3,) from rest; NaN once diverged."""
    defects = defects or Defects()
    mujoco, step = load_mujoco(), TIMESTEP / STEPS
    model = mujoco_model(body, step)
    model.body_mass[CAPSULE] *= defects.hull
    model.body_inertia[CAPSULE] *= defects.hull
    model.body_ipos[CAPSULE] = defects.centre
    model.body_mass[CAPSULE + 1 :] *= defects.fin_density
    model.body_inertia[CAPSULE + 1 :] *= defects.fin_density
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    robot = robot_of(layout(AQUAFISH).robots(np.asarray(body)[None])[:, 0].tolist())
    surface = Surface(robot, POINTS, defects.exponent, defects.friction)
    # The speed of a servo with time constant tau rises as 1 - exp(-t / tau).
    time = step * np.arange(steps * STEPS + 1)
    tau = defects.servo
    lost = tau * -np.expm1(-time / tau) if tau else 0.0 * time
    path = hinge_angles(angles + 2 * math.pi * np.outer(time - lost, command))
    data.qpos[BASE + 1 :] = path[0]
    gyro = np.full((steps, 3), np.nan)
    centre = np.array(defects.centre)
    mujoco.mj_forward(model, data)
    for i, target in enumerate(path[1:]):
        turned = data.xmat[CAPSULE].reshape(3, 3)
        velocity, spin = turned.T @ data.qvel[:3], data.qvel[3:BASE]
        if not velocity @ velocity + spin @ spin < RUNAWAY_SQUARE:
            break
        force, torque = surface.wrench(velocity, spin, path[i], data.qvel[BASE:])
        data.xfrc_applied[CAPSULE, :3] = turned @ force
        data.xfrc_applied[CAPSULE, 3:] = turned @ (torque - np.cross(centre, force))
        data.ctrl[:] = target
        mujoco.mj_step(model, data)
        if (i + 1) % STEPS == 0:
            gyro[i // STEPS] = data.qvel[3:BASE]
    return gyro
