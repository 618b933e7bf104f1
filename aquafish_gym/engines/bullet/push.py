"""What PyBullet's engine computes itself: the water's push, the servos' next move, the log.

It is the physics of ``physics/dynamics.py``, compiled where numba is installed, since in plain
Python it takes longer than Bullet's own step.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from aquafish_gym.imu import attitude, continue_attitude
from aquafish_gym.physics.arithmetic import Number, Vector
from aquafish_gym.physics.dynamics import wrench
from aquafish_gym.physics.kinematics import Drive, State, next_joints, rotation, to_body
from aquafish_gym.physics.reactive import reactive_wrench
from aquafish_gym.physics.robot import PARAMETERS_PER_FIN, Fin, Robot

Quaternion = tuple[Number, Number, Number, Number]


def _fin(column: Any, first: int) -> Fin:
    c = column
    return Fin(
        c[first],
        c[first + 1],
        c[first + 2],
        c[first + 3],
        (c[first + 4], c[first + 5], c[first + 6]),
    )


def _unpack(
    column: Any,
    joints: Any,
    orientation: Quaternion,
    velocity: Vector,
    world_spin: Vector,
) -> tuple[Robot, State]:
    robot = Robot(
        _fin(column, 0), _fin(column, PARAMETERS_PER_FIN), _fin(column, 2 * PARAMETERS_PER_FIN)
    )
    return robot, State(
        orientation,
        (0.0, 0.0, 0.0),
        velocity,
        to_body(rotation(orientation), world_spin),
        (joints[0], joints[1]),
        (joints[2], joints[3]),
        (joints[4], joints[5]),
        (joints[6], joints[7], joints[8]),
    )


def _turn_joints(joints: Any, state: State, by: Drive, h: Number) -> Number:
    """Move the joints one step on, and return the tail's speed over it."""
    left, right, phase, rates = next_joints(state, by, h)
    joints[0], joints[1] = left
    joints[2], joints[3] = right
    joints[4], joints[5] = phase
    joints[6], joints[7], joints[8] = rates
    return rates[2]


def push(
    column: Any,
    joints: Any,
    orientation: Quaternion,
    velocity: Vector,
    world_spin: Vector,
    current: Vector,
    by: Drive,
    h: Number,
) -> tuple[Vector, Vector, Number]:
    """Return the water's wrench (world axes) now and the tail's speed over the next step.

    ``column`` (21,) is the robot's of ``robot_parameters``; ``joints`` (9,) holds the (cos, sin)
    of left, right and phase and the three rates, and is moved one step on.
    """
    robot, state = _unpack(column, joints, orientation, velocity, world_spin)
    force, torque = wrench(robot, state, current)
    return force, torque, _turn_joints(joints, state, by, h)


def push_reactive(
    column: Any,
    joints: Any,
    orientation: Quaternion,
    velocity: Vector,
    world_spin: Vector,
    current: Vector,
    by: Drive,
    h: Number,
) -> tuple[Vector, Vector, Number]:
    """Do as :func:`push` does, for a law with reactive terms."""
    robot, state = _unpack(column, joints, orientation, velocity, world_spin)
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


@functools.cache
def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return one of this module's functions compiled if numba is here, else itself.

    The results are the same.
    """
    try:
        from numba import njit

        from aquafish_gym.physics import simd
    except ImportError:
        return function
    simd.register()
    for part in (_fin, _unpack, _turn_joints, function):
        simd.inlined(part)
    stamp = simd.source_stamp(function)

    def call(*args: Any) -> Any:
        stamp  # noqa: B018  # part of the cache's key; see simd.source_stamp
        return function(*args)

    try:
        return njit(cache=True)(call)  # type: ignore[no-any-return]
    except RuntimeError:  # nowhere to keep a cache: compile anew in every process
        return njit(call)  # type: ignore[no-any-return]
