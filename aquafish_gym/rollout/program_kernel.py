"""The compiled function by which a program acts for robots one after another."""

from __future__ import annotations

import sys
from functools import cache
from typing import Any

from aquafish_gym.command import servos
from aquafish_gym.engines.compiled.kernel import CompiledPolicy
from aquafish_gym.physics.compiling import (
    check_compiler,
    compiled,
    register,
    register_functions,
    register_module,
    source_stamp,
)
from aquafish_gym.physics.law import law
from aquafish_gym.physics.layout import fetch_vector
from aquafish_gym.physics.simd import inlined, zero_lanes
from aquafish_gym.plans import BodyPlan
from aquafish_gym.rollout.plan import PROGRAM_CHANNELS


@cache
def compile_program(plan: BodyPlan, policy: CompiledPolicy) -> Any:
    """Return the compiled function of a plan for a policy of ``engines/compiled/kernel.py``.

    It sets actions and carries the dead reckoning on, as the compiled loop does in lanes: here a
    lane has the width 1. All arrays are flat, except ``memory`` (B, scratch).
    """
    check_compiler()
    register()
    register_module(sys.modules[policy.__module__])
    inlined(policy)
    fetch_fins, put_fins = law(plan).fetch_fins, law(plan).put_fins
    lane_servo_speeds, reckon = servos(plan).lane_speeds, servos(plan).reckon
    register_functions(fetch_fins, put_fins, lane_servo_speeds, reckon)
    count = len(plan.fins)
    stamp = source_stamp(compile_program, policy) + plan.to_json()

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
            fins = fetch_fins(turns, count * i, 0, 1, zero)
            action = policy(
                weights, layout, memory[i], i % columns, columns, time, up, north, gyro, fins, way
            )
            put_fins(actions, count * i, 0, 1, action)
            gains = fetch_fins(gain, count * i, 0, 1, zero)
            after = reckon(fins, gains, lane_servo_speeds(action), seconds)
            put_fins(turns, count * i, 0, 1, after)

    return compiled(act, slow=True, nogil=True)
