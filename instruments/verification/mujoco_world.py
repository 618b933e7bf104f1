"""One robot in MuJoCo, its joints turned as ours are, in MuJoCo's own water."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.worlds import World
from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.attitude import attitude, continue_attitude
from aquafish_gym.physics.kinematics import RUNAWAY_SQUARE, Numbers, State, at_rest, rotation
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Triple
from aquafish_gym.utils.validation import InvalidArgumentError
from instruments.verification.mujoco_model import (
    BASE,
    Water,
    hinge_angles,
    load_mujoco,
    mujoco_model,
)

# MuJoCo's steps in one of 0.01 s. Its scheme is of first order, as ours is, and with these its gyro
# is nearer to its limit than ours with one step: docs/physics_appendix.md has both.
STEPS = 5


class MujocoWorld(World):
    """One robot in MuJoCo, in water whose law is MuJoCo's own: its ellipsoid model.

    It has the engines' robot, whose joints turn as theirs do, and agrees with them in nothing else:
    ``docs/physics_appendix.md`` gives the differences.

    Parameters
    ----------
    substeps
        Each of MuJoCo's ``STEPS`` in 0.01 s is divided into so many.

    Attributes
    ----------
    model, data
        MuJoCo's ``MjModel`` and ``MjData``, from the first start on; others for another body.

    Raises
    ------
    EngineUnavailableError
        If mujoco is not installed.
    InvalidArgumentError
        If a scenario asks for other water: added mass, or drag with a factor.

    Examples
    --------
    >>> world = MujocoWorld()
    >>> world.start(Scenario.create([0.3] * 9, servo_gain=(1.0, 0.5, 1.0)))
    >>> world.advance((0.5, 0.5, 0.0), steps=50)
    >>> [round(angle, 3) for angle in world.fin_angles]
    [1.571, 0.785, 0.0]
    """

    water: Water = "ellipsoid"

    def __init__(self, substeps: int = 1) -> None:
        load_mujoco()
        self._count = STEPS * substeps
        self.model: Any = None
        self.data: Any = None

    def _start(self, scenario: Scenario) -> None:
        self._turned: NDArray[np.float64] = scenario.fin_angles[0].copy()
        self.diverged = False
        self._build(scenario)
        self.data.qpos[BASE + 1 :] = hinge_angles(self._turned, scenario.plan)
        self.data.qvel[:BASE] = [*scenario.velocity[0], *scenario.spin[0]]

    def _update(self, scenario: Scenario) -> None:
        if np.array_equal(scenario.body[0], self._body):
            self._set(scenario)
            return
        before = self.data
        self._build(scenario)
        self.data.qpos[:], self.data.qvel[:] = before.qpos, before.qvel

    def _build(self, scenario: Scenario) -> None:
        """Make the model of the scenario's body, at rest."""
        ours = (*scenario.drag[0].tolist(), scenario.fin_density.item())
        if scenario.reactive or set(ours) != {1.0}:
            raise InvalidArgumentError(
                "MuJoCo's water has a law of its own: reactive must be False and drag and fin "
                f"density 1; got {scenario.reactive} and {ours}"
            )
        self._body = scenario.body[0].copy()
        self._plan = scenario.plan
        body = Morphology.from_array(self._body, self._plan)
        self.model = mujoco_model(body, TIMESTEP / self._count, self.water)
        self.data = load_mujoco().MjData(self.model)
        self._set(scenario)

    def _set(self, scenario: Scenario) -> None:
        self.model.opt.wind[:] = scenario.current[0]
        self._gains = scenario.servo_gain[0].copy()

    def set_current(self, current: Triple) -> None:
        self.model.opt.wind[:] = current

    def _swim(self, command: Vector, steps: int) -> None:
        """Advance; a robot that leaves the finite numbers stays ``diverged`` until it starts."""
        turn = 2 * math.pi * self.model.opt.timestep * self._gains * command
        ahead = np.arange(1, steps * self._count + 1)[:, None]
        path = self._turned + turn * ahead
        step, model, data = load_mujoco().mj_step, self.model, self.data
        control, base = data.ctrl, data.qvel[:BASE]
        for target in hinge_angles(path, self._plan):
            # Looked at before each step, since MuJoCo warns in files. Written so that NaN fails it.
            if not base @ base < RUNAWAY_SQUARE:
                break
            control[:] = target
            step(model, data)
        self._turned = path[-1]
        self.diverged = self.diverged or not base @ base < RUNAWAY_SQUARE
        if self.diverged:
            data.qpos[:] = data.qvel[:] = math.nan

    def state(self) -> State:
        """Return the robot's state on plain floats."""
        x, y, z, qw, qx, qy, qz = self.data.qpos[: BASE + 1].tolist()
        vx, vy, vz, wx, wy, wz, *rates = self.data.qvel.tolist()
        joints = at_rest(self.fin_angles).joints
        return State(
            (qx, qy, qz, qw), (x, y, z), (vx, vy, vz), (wx, wy, wz), joints, tuple(rates)
        )  # fmt: skip

    @property
    def fin_angles(self) -> Numbers:
        """Each fin's angle, or the phase of one that sweeps, in [-pi, pi], rad."""
        return tuple(np.arctan2(np.sin(self._turned), np.cos(self._turned)).tolist())

    def close(self) -> None:
        """Do nothing: there is nothing to free."""


class BoxWorld(MujocoWorld):
    """The same robot in MuJoCo's inertia-box model of water, which has drag and nothing else."""

    water = "box"


def simulate_mujoco(
    body: NDArray[np.float64],
    command: NDArray[np.float64],
    angles: NDArray[np.float64],
    steps: int,
) -> ImuLog:
    """Return the log (1, T, 3) of one robot that holds a command (3,) in MuJoCo's water."""
    world, found = MujocoWorld(), np.empty((1, steps, 13))
    world.start(Scenario.create(body, fin_angles=angles))
    left, right, caudal = command.tolist()
    for t in range(steps):
        world.advance((left, right, caudal))
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
