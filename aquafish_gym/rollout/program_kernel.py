"""The compiled function by which a program acts for robots one after another."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from typing import Any

from aquafish_gym import command
from aquafish_gym.command import lane_servo_speeds, reckon
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.compiling import (
    check_compiler,
    compiled,
    register,
    register_module,
    source_stamp,
)
from aquafish_gym.physics.layout import fetch_vector, put_vector
from aquafish_gym.physics.simd import inlined, zero_lanes
from aquafish_gym.rollout.plan import PROGRAM_CHANNELS


@cache
def compile_program(policy: Callable[..., Vector]) -> Any:
    """Return the compiled function for a policy of ``engines/compiled/kernel.py``.

    It sets actions and carries the dead reckoning on, as the compiled loop does in lanes: here a
    lane has the width 1. All arrays are flat, except ``memory`` (B, scratch).
    """
    check_compiler()
    register()
    register_module(command)
    register_module(sys.modules[policy.__module__])
    inlined(policy)
    stamp = source_stamp(compile_program, policy)

    def act(
        weights: Any, columns: int, layout: Any, memory: Any, turns: Any, gain: Any, seen: Any,
        time: float, seconds: float, actions: Any,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  # part of the cache's key; see source_stamp
        zero = zero_lanes(weights, 1)
        for i in range(len(memory)):
            start = PROGRAM_CHANNELS * i
            up = fetch_vector(seen, start, 0, 1, zero)
            north = fetch_vector(seen, start + 3, 0, 1, zero)
            gyro = fetch_vector(seen, start + 6, 0, 1, zero)
            way = fetch_vector(seen, start + 9, 0, 1, zero)
            fins = fetch_vector(turns, 3 * i, 0, 1, zero)
            action = policy(
                weights, layout, memory[i], i % columns, columns, time, up, north, gyro, fins, way
            )
            put_vector(actions, 3 * i, 0, 1, action)
            left, right, caudal = lane_servo_speeds(action)
            gains = fetch_vector(gain, 3 * i, 0, 1, zero)
            speeds = (gains[0] * left, gains[1] * right, gains[2] * caudal)
            put_vector(turns, 3 * i, 0, 1, reckon(fins, speeds, seconds))

    return compiled(act, slow=True, nogil=True)
