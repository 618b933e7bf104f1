"""What PyBullet does not compute: the water's wrench, the servos' motion, the log.

It is the physics of ``physics/dynamics.py``, compiled, since in plain Python it takes longer than
Bullet's own step.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from aquafish_gym.physics.arithmetic import Number, Vector
from aquafish_gym.physics.attitude import attitude, continue_attitude
from aquafish_gym.physics.dynamics import wrench
from aquafish_gym.physics.kinematics import Drive, State, next_joints, rotation, to_body
from aquafish_gym.physics.layout import fetch_joints, fetch_robot, put_joints
from aquafish_gym.physics.reactive import reactive_wrench
from aquafish_gym.physics.robot import Robot

Base = tuple[tuple[Number, Number, Number, Number], Vector, Vector]
Push = tuple[Vector, Vector, Number]


def _read(column: Any, joints: Any, base: Base) -> tuple[Robot, State]:
    """Return robot and state; its position is not used."""
    orientation, velocity, world_spin = base
    spin = to_body(rotation(orientation), world_spin)
    left, right, phase, rates = fetch_joints(joints, 0, 0, 1, 0.0)
    state = State(orientation, (0.0, 0.0, 0.0), velocity, spin, left, right, phase, rates)
    return fetch_robot(column, 0, 0, 1, 0.0), state


def _turn_joints(joints: Any, state: State, by: Drive, h: Number) -> Number:
    """Move the joints one step on, and return the tail's speed over it."""
    moved = next_joints(state, by, h)
    put_joints(joints, 0, 0, 1, moved)
    return moved[3][2]


def push(column: Any, joints: Any, base: Base, current: Vector, by: Drive, h: Number) -> Push:
    """Return the water's wrench (world axes) now and the tail's speed over the next step.

    ``column`` (25,) is the robot's of ``robot_parameters``; ``joints`` (9,) is of
    ``fetch_joints``, and is moved one step on. ``base`` is the capsule's orientation, velocity
    and spin in the world.
    """
    robot, state = _read(column, joints, base)
    force, torque = wrench(robot, state, current)
    return force, torque, _turn_joints(joints, state, by, h)


def push_reactive(
    column: Any, joints: Any, base: Base, current: Vector, by: Drive, h: Number
) -> Push:
    """Return :func:`push` with the reactive terms."""
    robot, state = _read(column, joints, base)
    force, torque = reactive_wrench(robot, state, by, current, h)
    return force, torque, _turn_joints(joints, state, by, h)


def follow(orientations: Any, world_spins: Any, rpy: Any, gyro: Any) -> None:
    """Fill rpy (T, 3) and gyro (T, 3) from quaternions (T, 4) and world spins (T, 3)."""
    before: Vector = (0.0, 0.0, 0.0)
    for t in range(len(orientations)):
        q, w = orientations[t], world_spins[t]
        r = rotation((q[0], q[1], q[2], q[3]))
        before = continue_attitude(before, attitude(r))
        rpy[t, 0], rpy[t, 1], rpy[t, 2] = before
        gyro[t, 0], gyro[t, 1], gyro[t, 2] = to_body(r, (w[0], w[1], w[2]))


def compiled_push(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return one of this module's functions compiled, to the same results."""
    from aquafish_gym.physics import compiling  # numba takes a second to load

    compiling.register_module(sys.modules[__name__])
    return compiling.compiled_function(function, slow=True)  # type: ignore[no-any-return]
