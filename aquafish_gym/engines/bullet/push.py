"""What PyBullet does not compute: the water's wrench, the servos' motion, the log.

It is the physics of ``physics/law.py``, compiled, since in plain Python it takes longer than
Bullet's own step.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import Any

from aquafish_gym.physics.arithmetic import Number, Vector
from aquafish_gym.physics.attitude import attitude, continue_attitude
from aquafish_gym.physics.kinematics import State, rotation, to_body
from aquafish_gym.physics.law import law
from aquafish_gym.plans import BodyPlan


@functools.cache
def compiled_push(plan: BodyPlan, reactive: bool) -> Callable[..., Any]:
    """Return the compiled function of a plan: the water's wrench and the joints' motion.

    It is ``(robot, joints, base, current, by, h) -> (force, torque, rates)``: the wrench on the
    hull in world axes now, and the joints' speeds over the next step. ``robot`` is its rows,
    ``joints`` (3 F,) the cos and sin of each joint in turn and then the joints' speeds, which are
    moved one step on, and ``base`` the hull's orientation, velocity and spin in the world.
    """
    from aquafish_gym.physics import compiling  # numba takes a second to load

    compiling.register()
    stamp = compiling.source_stamp(compiled_push) + plan.to_json()
    of, fins = law(plan), len(plan.fins)
    wrench = of.wrench_reactive if reactive else of.wrench
    next_joints = of.next_joints
    fetch_robot = of.fetch_robot
    fetch_fins = of.fetch_fins
    put_fins = of.put_fins
    fetch_joints = of.fetch_joints
    put_joints = of.put_joints
    compiling.register_functions(
        wrench, next_joints, fetch_robot, fetch_fins, put_fins, fetch_joints, put_joints
    )

    def push(
        robot: Any, joints: Any, base: Any, current: Vector, by: Any, h: Number
    ) -> tuple[Vector, Vector, tuple[Number, ...]]:
        stamp  # noqa: B018  # part of the cache's key; see source_stamp
        orientation, velocity, world_spin = base
        spin = to_body(rotation(orientation), world_spin)
        pairs = fetch_joints(joints, 0, 0, 1, 0.0)
        rates = fetch_fins(joints, 2 * fins, 0, 1, 0.0)
        state = State(orientation, (0.0, 0.0, 0.0), velocity, spin, pairs, rates)
        force, torque = wrench(fetch_robot(robot, 0, 0, 1, 0.0), state, by, current, h)
        moved = next_joints(state, by, h)
        put_joints(joints, 0, 0, 1, moved.joints)
        put_fins(joints, 2 * fins, 0, 1, moved.rates)
        return force, torque, moved.rates

    return compiling.compiled(push, slow=True)  # type: ignore[no-any-return]


def follow(orientations: Any, world_spins: Any, rpy: Any, gyro: Any) -> None:
    """Fill rpy (T, 3) and gyro (T, 3) from quaternions (T, 4) and world spins (T, 3)."""
    before: Vector = (0.0, 0.0, 0.0)
    for t in range(len(orientations)):
        q, w = orientations[t], world_spins[t]
        r = rotation((q[0], q[1], q[2], q[3]))
        before = continue_attitude(before, attitude(r))
        rpy[t, 0], rpy[t, 1], rpy[t, 2] = before
        gyro[t, 0], gyro[t, 1], gyro[t, 2] = to_body(r, (w[0], w[1], w[2]))


def compiled_follow() -> Callable[..., None]:
    """Return :func:`follow` compiled, to the same results."""
    from aquafish_gym.physics import compiling

    compiling.register_module(sys.modules[__name__])
    return compiling.compiled_function(follow, slow=True)  # type: ignore[no-any-return]
