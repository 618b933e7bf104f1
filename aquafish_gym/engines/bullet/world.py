"""PyBullet as an engine: one robot in a world of its own, pushed by the one drag law.

Bullet has no water. Its joints are turned by ideal velocity motors, and the water's whole
wrench, from :func:`aquafish_gym.physics.dynamics.wrench`, is applied to the base before every
step: the fins' forces need not go through the links, because the motors prescribe the joints
and Bullet's link frames are one step old when forces are applied.

Bullet accepts NaN, so the wrench is checked before every step, and the motion after it.
"""

from __future__ import annotations

import math
import os
import weakref
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from aquafish_gym.engines.bullet.push import compiled_push
from aquafish_gym.engines.packages import load_pybullet, machine_memory
from aquafish_gym.engines.worlds import World
from aquafish_gym.physics.kinematics import (
    RUNAWAY_SQUARE,
    Numbers,
    State,
    at_rest,
    rotation,
    to_body,
)
from aquafish_gym.physics.law import law
from aquafish_gym.physics.layout import layout, robot_of
from aquafish_gym.physics.robot import hull_numbers
from aquafish_gym.plans import FinPlan
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Triple
from aquafish_gym.utils.validation import EngineUnavailableError, InvalidArgumentError

# A client costs megabytes and connecting leaks, so clients are kept for the next world: one at a
# time, in the process that opened it.
_idle_clients: list[int] = []
MAXIMUM_CLIENTS = 1024  # PyBullet's own limit, of a process
CLIENT_BYTES = 28 * 2**20  # resident memory of a client, measured with PyBullet 3.2.7 on Linux


def check_clients_fit(name: str, count: int) -> None:
    """Raise InvalidArgumentError for more robots than a process can have, or the memory can hold.

    Without enough memory the system might kill the process. ``name`` is the argument's.
    """
    if count > MAXIMUM_CLIENTS:
        raise InvalidArgumentError(
            f'{name} must be at most {MAXIMUM_CLIENTS} with engine="pybullet", whose robots need '
            f"a PyBullet client each; got {count}"
        )
    memory = machine_memory()
    if memory is not None and count * CLIENT_BYTES > memory:
        raise InvalidArgumentError(
            f'{name} must be at most {memory // CLIENT_BYTES} with engine="pybullet" on this '
            f"machine: each robot takes {CLIENT_BYTES / 2**20:.0f} MiB of its "
            f"{memory / 2**30:,.0f} GiB of memory; got {count}"
        )


def take_client() -> int:
    """Return a DIRECT client for this process to use alone until :func:`return_client`."""
    bullet = load_pybullet()
    client = int(_idle_clients.pop() if _idle_clients else bullet.connect(bullet.DIRECT))
    if client < 0:
        raise EngineUnavailableError(
            "PyBullet opens no more clients in this process; close some of the environments "
            'whose engine is "pybullet"'
        )
    return client


def return_client(client: int, process: int) -> None:
    """Keep a client for the next world, if this is still the process that opened it."""
    if os.getpid() == process:
        _idle_clients.append(client)


# A forked child must not touch its parent's clients.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_idle_clients.clear)

# Bullet's defaults are 1000 and 100, and joints would lag behind their servos.
_UNLIMITED = 1e9
# Its default residual threshold of 1e-7 leaves errors of 1e-5 rad.
_SOLVER_ITERATIONS = 50


class BulletWorld(World):
    """One robot in a PyBullet world.

    It belongs to the process that made it: it can be neither pickled nor used after a fork.
    Without pybullet it raises :class:`EngineUnavailableError`.
    """

    def __init__(self, substeps: int = 1) -> None:
        self.timestep = TIMESTEP / substeps
        self._substeps = substeps
        self._bullet = load_pybullet()
        self._process = os.getpid()
        self._client = take_client()
        self._closing = weakref.finalize(self, return_client, self._client, self._process)

    def close(self) -> None:
        """Give the client back; the world refuses to work from then on."""
        self._closing()

    def _check_usable(self) -> None:
        if not self._closing.alive:  # its client may serve another robot by now
            raise RuntimeError(
                'this PyBullet world is closed: make another environment, or use engine="numba"'
            )
        if os.getpid() != self._process:
            raise RuntimeError(
                "this PyBullet world was made before a fork and belongs to the parent process; "
                'make the environment in the child process (start method "spawn", or a '
                'factory such as lambda: gym.make(...)), or use engine="numba"'
            )

    def __reduce__(self) -> Any:
        raise TypeError(
            "a PyBullet world cannot be pickled or copied: its robot lives in this process; "
            'make a new one, or use engine="numba"'
        )

    def _start(self, scenario: Scenario) -> None:
        self._check_usable()
        self._plan = scenario.plan
        self._push = compiled_push(scenario.plan, scenario.reactive)
        rest = at_rest(scenario.fin_angles[0].tolist())
        self._joints = np.array([*rest.joints, *rest.rates])
        self.diverged = False
        self.position, self.orientation = rest.position, rest.orientation
        # It is upright, facing +y: the body's axes are the world's.
        self.velocity = triple(scenario.velocity[0])
        self.world_spin = triple(scenario.spin[0])
        self._set(scenario)
        angles = zip(scenario.plan.fins, self.fin_angles, strict=True)
        self._build([fin.sweep * math.sin(a) if not fin.turns else a for fin, a in angles])
        self._set_velocity()

    def _update(self, scenario: Scenario) -> None:
        self._check_usable()
        was = self._column
        self._set(scenario)
        if self.diverged or np.array_equal(was, self._column):
            return
        p, client = self._bullet, self._client
        turns = [
            p.getJointState(self._robot, i, physicsClientId=client)[:2]
            for i in range(len(self._plan.fins))
        ]
        self._build([angle for angle, _ in turns])
        for joint, (angle, rate) in enumerate(turns):
            p.resetJointState(self._robot, joint, angle, rate, physicsClientId=client)
        p.resetBasePositionAndOrientation(
            self._robot, self.position, self.orientation, physicsClientId=client
        )
        self._set_velocity()

    def _set_velocity(self) -> None:
        self._bullet.resetBaseVelocity(
            self._robot, self.velocity, self.world_spin, physicsClientId=self._client
        )

    def set_current(self, current: Triple) -> None:
        self._current = triple(current)

    def _set(self, scenario: Scenario) -> None:
        """Take over the robot's parameters, its current and its gains."""
        robots = layout(scenario.plan).robots(scenario.body, scenario.drag, scenario.fin_density)
        self._column = np.ascontiguousarray(robots[:, 0])
        self._current = triple(scenario.current[0])
        self._gains = tuple(scenario.servo_gain[0].tolist())
        # A new robot's motors, or other gains, need the command again.
        self._command: Numbers | None = None

    def _build(self, angles: Sequence[float]) -> None:
        """Empty the world and put the robot in, its joints at these angles (rad)."""
        # Building a new robot is quick, leaks nothing and leaves no motor or solver state behind,
        # as restoring a saved state would.
        p, client = self._bullet, self._client
        p.resetSimulation(physicsClientId=client)
        p.setGravity(0.0, 0.0, 0.0, physicsClientId=client)
        p.setPhysicsEngineParameter(
            fixedTimeStep=self.timestep,
            numSolverIterations=_SOLVER_ITERATIONS,
            solverResidualThreshold=0.0,
            physicsClientId=client,
        )
        hull, fins = hull_numbers(self._plan.hull), robot_of(self._column.tolist()).fins
        # Links have the body's axes at angle 0, their principal axes those of the hinge frame.
        frames = [
            _principal(fin, one.inertia) for fin, one in zip(self._plan.fins, fins, strict=True)
        ]
        count = len(fins)
        straight = [(0.0, 0.0, 0.0, 1.0)] * count
        self._robot = robot = p.createMultiBody(
            baseMass=hull.mass,
            baseCollisionShapeIndex=-1,
            baseVisualShapeIndex=-1,
            linkMasses=[fin.mass for fin in fins],
            linkCollisionShapeIndices=[-1] * count,
            linkVisualShapeIndices=[-1] * count,
            linkPositions=[fin.hinge for fin in self._plan.fins],
            linkOrientations=straight,
            linkInertialFramePositions=[
                tuple(-0.5 * one.length * x for x in fin.frame[1])
                for fin, one in zip(self._plan.fins, fins, strict=True)
            ],
            linkInertialFrameOrientations=[orientation for orientation, _ in frames],
            linkParentIndices=[0] * count,
            linkJointTypes=[p.JOINT_REVOLUTE] * count,
            linkJointAxis=[fin.axis for fin in self._plan.fins],
            physicsClientId=client,
        )
        inertias = [*(inertia for _, inertia in frames), hull.inertia]  # the base's, -1, is last
        # Each in a call of its own: some of these arguments, given together, silently move
        # the others to the base.
        for link in range(-1, count):
            for setting in (
                {"localInertiaDiagonal": inertias[link]},
                {"linearDamping": 0.0},
                {"angularDamping": 0.0},
                {"jointDamping": 0.0},
                {"maxJointVelocity": _UNLIMITED},
                {"activationState": p.ACTIVATION_STATE_DISABLE_SLEEPING},
            ):
                p.changeDynamics(robot, link, **setting, physicsClientId=client)
        for joint, angle in enumerate(angles):
            p.resetJointState(robot, joint, angle, 0.0, physicsClientId=client)

    def _turn(self, joint: int, rate: float) -> None:
        self._bullet.setJointMotorControl2(
            self._robot,
            joint,
            self._bullet.VELOCITY_CONTROL,
            targetVelocity=rate,
            force=_UNLIMITED,
            physicsClientId=self._client,
        )

    def _set_motors(self, command: Numbers) -> None:
        """Set the motors that turn at a constant speed; those that sweep are set at every step."""
        self._command = command
        self._drive = law(self._plan).driven(self._gains, command, self.timestep)
        for joint, rate in enumerate(self._drive.speeds):
            if self._plan.fins[joint].turns:
                self._turn(joint, rate)

    def _swim(self, command: Numbers, steps: int) -> None:
        self._check_usable()
        if command != self._command:
            self._set_motors(command)
        p = self._bullet
        client = self._client
        robot = self._robot
        push = self._push
        column = self._column
        joints = self._joints
        current = self._current
        by = self._drive
        h = self.timestep
        sweeping = [i for i, fin in enumerate(self._plan.fins) if not fin.turns]
        for _ in range(steps * self._substeps):
            if self.diverged:
                return
            base = (self.orientation, self.velocity, self.world_spin)
            force, torque, rates = push(column, joints, base, current, by, h)
            if not math.isfinite(sum(force) + sum(torque)):
                self._diverge()
                return
            for joint in sweeping:
                self._turn(joint, rates[joint])
            p.applyExternalForce(
                robot, -1, force, self.position, p.WORLD_FRAME, physicsClientId=client
            )
            p.applyExternalTorque(robot, -1, torque, p.WORLD_FRAME, physicsClientId=client)
            p.stepSimulation(physicsClientId=client)
            self.position, self.orientation = p.getBasePositionAndOrientation(
                robot, physicsClientId=client
            )
            self.velocity, self.world_spin = p.getBaseVelocity(robot, physicsClientId=client)
            (vx, vy, vz), (wx, wy, wz) = self.velocity, self.world_spin
            # Written so that NaN fails it.
            if not vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz < RUNAWAY_SQUARE:
                self._diverge()

    def _diverge(self) -> None:
        self.diverged = True
        self.position = self.velocity = self.world_spin = (math.nan,) * 3
        self.orientation = (math.nan,) * 4

    def state(self) -> State:
        spin = to_body(rotation(self.orientation), self.world_spin)
        numbers, turned = self._joints.tolist(), 2 * len(self._plan.fins)
        joints, rates = tuple(numbers[:turned]), tuple(numbers[turned:])
        return State(self.orientation, self.position, self.velocity, spin, joints, rates)

    @property
    def fin_angles(self) -> Numbers:
        turned = self._joints[: 2 * len(self._plan.fins)].tolist()
        return tuple(map(math.atan2, turned[1::2], turned[::2]))


def _principal(fin: FinPlan, inertia: Triple) -> tuple[tuple[float, float, float, float], Triple]:
    """Return how a fin's principal axes lie in body axes, (x, y, z, w), and the inertia about each.

    For a fin along the body's axes, these are the principal ones.
    """
    if fin.is_along_axes:
        return (0.0, 0.0, 0.0, 1.0), triple((np.array(fin.frame) ** 2).T @ inertia)
    return fin.attitude, inertia


def triple(row: Iterable[float]) -> Triple:
    """Return three plain floats: Bullet and the compiled push take nothing else."""
    x, y, z = row
    return (float(x), float(y), float(z))
