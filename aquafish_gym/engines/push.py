"""What a PyBullet world computes before each step: the water's push, and the servos' next move.

It is the physics of ``physics/dynamics.py``, compiled where numba is installed, since in plain
Python it takes longer than Bullet's own step.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from aquafish_gym.physics.carriers import Number, Vector
from aquafish_gym.physics.dynamics import wrench
from aquafish_gym.physics.kinematics import Drive, State, next_joints, rotation, to_body
from aquafish_gym.robot import PARAMETERS_PER_FIN, Fin, Robot


def _fin(column: Any, first: int) -> Fin:
    c = column
    return Fin(
        c[first],
        c[first + 1],
        c[first + 2],
        c[first + 3],
        (c[first + 4], c[first + 5], c[first + 6]),
    )


def push(
    column: Any,
    joints: Any,
    orientation: tuple[Number, Number, Number, Number],
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
    robot = Robot(
        _fin(column, 0), _fin(column, PARAMETERS_PER_FIN), _fin(column, 2 * PARAMETERS_PER_FIN)
    )
    state = State(
        orientation,
        (0.0, 0.0, 0.0),
        velocity,
        to_body(rotation(orientation), world_spin),
        (joints[0], joints[1]),
        (joints[2], joints[3]),
        (joints[4], joints[5]),
        (joints[6], joints[7], joints[8]),
    )
    force, torque = wrench(robot, state, current)
    left, right, phase, rates = next_joints(state, by, h)
    joints[0], joints[1] = left
    joints[2], joints[3] = right
    joints[4], joints[5] = phase
    joints[6], joints[7], joints[8] = rates
    return force, torque, rates[2]


@functools.cache
def compiled_push() -> Callable[..., Any]:
    """Return ``push`` compiled if numba is here, else itself; the results are the same."""
    try:
        from numba import njit
        from numba.extending import register_jitable

        from aquafish_gym.physics import simd
    except ImportError:
        return push
    simd.register()
    register_jitable(_fin)
    register_jitable(push)
    stamp = simd.source_stamp(push)

    def call(*args: Any) -> Any:
        stamp  # noqa: B018  # part of the cache's key; see simd.source_stamp
        return push(*args)

    try:
        return njit(cache=True)(call)  # type: ignore[no-any-return]
    except RuntimeError:  # nowhere to keep a cache: compile anew in every process
        return njit(call)  # type: ignore[no-any-return]
