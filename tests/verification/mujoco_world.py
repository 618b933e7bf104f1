"""One robot in MuJoCo, its joints turned as ours are, in MuJoCo's own water."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.worlds import RUNAWAY, Triple
from aquafish_gym.imu import ImuLog
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.attitude import attitude, continue_attitude
from aquafish_gym.physics.kinematics import State, at_rest, rotation
from aquafish_gym.scenario import TIMESTEP
from tests.verification.mujoco_model import BASE, hinge_angles, load_mujoco, mujoco_model

# MuJoCo's steps in one of 0.01 s. Its scheme is of first order, as ours is, and with these its gyro
# is nearer to its limit than ours with one step: docs/physics.md has both.
STEPS = 5


class MujocoWorld:
    """One robot in MuJoCo, in water whose law is MuJoCo's own.

    It has the engines' robot, whose joints turn as theirs do, and agrees with them in nothing else:
    ``docs/physics.md`` gives the differences.

    Parameters
    ----------
    substeps
        Each of MuJoCo's ``STEPS`` in 0.01 s is divided into so many.

    Attributes
    ----------
    model, data
        MuJoCo's ``MjModel`` and ``MjData``, from the first reset on.

    Raises
    ------
    EngineUnavailableError
        If mujoco is not installed.

    Examples
    --------
    >>> world = MujocoWorld()
    >>> world.reset(np.full(9, 0.3), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    >>> world.advance((0.5, 0.25, 0.0), steps=50)
    >>> [round(angle, 3) for angle in world.fin_angles]
    [1.571, 0.785, 0.0]
    """

    def __init__(self, substeps: int = 1) -> None:
        load_mujoco()
        self._count = STEPS * substeps
        self.diverged = False
        self.model: Any = None
        self.data: Any = None
        self._turned: NDArray[np.float64] = np.zeros(3)

    def reset(self, morphology: NDArray[np.float64], fin_angles: Triple, current: Triple) -> None:
        """Put a robot of nine sizes at the origin, upright and at rest; angles in rad."""
        self.model = mujoco_model(morphology, TIMESTEP / self._count, wet=True)
        self.model.opt.wind[:] = current
        self.data = load_mujoco().MjData(self.model)
        self._turned = np.array(fin_angles, dtype=np.float64)
        self.data.qpos[BASE + 1 :] = hinge_angles(self._turned)
        self.diverged = False

    def advance(self, command: Vector, steps: int = 1) -> None:
        """Hold a command (rev/s, rev/s, Hz) for some steps of 0.01 s.

        A robot that leaves the finite numbers is ``diverged`` and stays so until it is reset.
        """
        if self.data is None:
            raise RuntimeError("reset the MuJoCo world before advancing it")
        turn = 2 * math.pi * self.model.opt.timestep * np.array(command)
        ahead = np.arange(1, steps * self._count + 1)[:, None]
        path = self._turned + turn * ahead
        step, model, data = load_mujoco().mj_step, self.model, self.data
        control, base = data.ctrl, data.qvel[:BASE]
        for target in hinge_angles(path):
            # Looked at before each step, since MuJoCo warns in files. Written so that NaN fails it.
            if not base @ base < RUNAWAY:
                break
            control[:] = target
            step(model, data)
        self._turned = path[-1]
        self.diverged = self.diverged or not base @ base < RUNAWAY
        if self.diverged:
            data.qpos[:] = data.qvel[:] = math.nan

    def state(self) -> State:
        """Return the robot's state on plain floats."""
        x, y, z, qw, qx, qy, qz = self.data.qpos[: BASE + 1].tolist()
        vx, vy, vz, wx, wy, wz, *rates = self.data.qvel.tolist()
        left, right, phase = at_rest(self.fin_angles)[4:7]
        return State(
            (qx, qy, qz, qw), (x, y, z), (vx, vy, vz), (wx, wy, wz), left, right, phase,
            (rates[0], rates[1], rates[2]),
        )  # fmt: skip

    @property
    def fin_angles(self) -> Vector:
        """Left and right pectoral angle and caudal phase in [-pi, pi], rad."""
        left, right, phase = np.arctan2(np.sin(self._turned), np.cos(self._turned)).tolist()
        return (left, right, phase)

    def close(self) -> None:
        """Do nothing: there is nothing to free."""


def simulate_mujoco(
    body: NDArray[np.float64],
    command: NDArray[np.float64],
    angles: NDArray[np.float64],
    steps: int,
    current: Triple = (0.0, 0.0, 0.0),
) -> ImuLog:
    """Return the log (1, T, 3) of one robot that holds a command (3,) in MuJoCo's water."""
    world, found = MujocoWorld(), np.empty((1, steps, 13))
    world.reset(body, _triple(angles), current)
    for t in range(steps):
        world.advance(_triple(command))
        found[0, t] = sample(world)
    return log_of_samples(found)


def sample(world: MujocoWorld) -> list[float]:
    """Return what :func:`log_of_samples` takes of a moment: 13 numbers, NaN once diverged."""
    if world.diverged:
        return [math.nan] * 13
    state = world.state()
    return [*state.position, *state.orientation, *state.spin, *world.fin_angles]


def log_of_samples(samples: NDArray[np.float64]) -> ImuLog:
    """Return the log of B robots that began upright, from their :func:`sample` s (B, T, 13)."""
    rpy = np.full((len(samples), samples.shape[1] + 1, 3), math.nan)
    lasts = np.isfinite(samples[:, :, 0]).sum(axis=1)
    for log, robot, good in zip(rpy, samples, lasts.tolist(), strict=True):
        now = log[0] = (0.0, 0.0, 0.0)
        for t, q in enumerate(robot[:good, 3:7].tolist(), 1):
            now = log[t] = continue_attitude(now, attitude(rotation(tuple(q))))
    return ImuLog(
        rpy=rpy[:, 1:],
        gyro=samples[:, :, 7:10],
        position=samples[:, :, :3],
        quaternion=samples[:, :, 3:7],
        fin_angles=samples[:, :, 10:],
        diverged=lasts < samples.shape[1],
    )


def _triple(row: NDArray[np.float64]) -> Triple:
    x, y, z = row.tolist()
    return (x, y, z)
