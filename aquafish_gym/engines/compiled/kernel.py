"""The compiled time loop: robots side by side in vector registers, their policy included.

A policy is a plain function of straight-line scalar Python that commands the servos;
:func:`compile_kernel` compiles it, the task and the physics into one loop. An open-loop policy is
one of ``policies.py``. Any other is

    policy(weights, layout, scratch, group, groups, time, up, north, gyro, fins, way) -> action

``up`` and ``north`` (of the world, in body axes) and ``gyro`` (rad/s) are what the inertial
measurement unit observes, ``fins`` (turns) where the policy believes its fins to be, and ``way``
(units, body axes) leads to the goal, if the task has one. The action lies in [-1, 1]. ``weights``
is a flat array of the scalar backend's numbers, read with ``fetch(weights, i, like)``, ``layout``
an int64 array of the policy's own, ``scratch`` a flat array to ``put`` to and ``fetch`` from, which
lives through an episode, and ``time`` a plain float in seconds. Robots share the instructions of
their vector register, so no branch may depend on lanes (branches on ``layout`` are fine). The
robots of one register are group ``group`` of ``groups``; row r of the weights is entry
``r * groups + group``. Functions that a policy calls must be registered with ``simd.inlined``.

On plain floats the same function serves one robot: ``group`` 0 of 1.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from aquafish_gym import command
from aquafish_gym.command import lane_servo_speeds, reckon
from aquafish_gym.engines.compiled import episode, policies
from aquafish_gym.engines.compiled.episode import (
    ACTION,
    ALIVE,
    BEFORE,
    FINS,
    GAIN,
    GOAL,
    ROWS,
    TOTAL,
    faulty,
    fetch_memory,
    put_memory,
    way_to,
)
from aquafish_gym.engines.compiled.policies import OPEN_LOOP
from aquafish_gym.engines.compiled.spectrum import write_spectrum
from aquafish_gym.engines.worlds import RUNAWAY
from aquafish_gym.physics import simd
from aquafish_gym.physics.arithmetic import Vector, dot, fetch, put, scale, where_less
from aquafish_gym.physics.attitude import attitude, continue_attitude, directions
from aquafish_gym.physics.compiling import compiled, register, register_module, source_stamp
from aquafish_gym.physics.dynamics import step
from aquafish_gym.physics.kinematics import drive, joint_angles, rotation
from aquafish_gym.physics.layout import (
    CURRENT,
    ROBOT_ROWS,
    SERVO_GAIN,
    fetch_robot,
    fetch_state,
    fetch_vector,
    put_state,
    put_vector,
)
from aquafish_gym.physics.layout import RPY as RPY_ROWS
from aquafish_gym.physics.reactive import step_reactive
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.utils.validation import InvalidArgumentError

Policy = Callable[..., Vector]

BLOCK = 16  # samples gathered before they are written out, in the fastest cache
WIDTHS = (1, 2, 4, 8, 16)  # a block is transposed in squares, so they divide it

# What to record, as bits. SPECTRUM alone is that of roll, pitch and yaw; with GYRO it is that of
# the rates. Where GYRO alone is recorded, the attitude is computed at the end alone.
RPY, GYRO, POSE, SPECTRUM, COMMANDS = 1, 2, 4, 8, 16


@simd.inlined
def _no_function(_task: Any, memory: Any, _time: float = 0.0) -> Any:
    return (memory[0], memory[1], memory[2])


@simd.inlined
def write_block(buffer: Any, log: Any, first: int, count: int, group: int, zero: Any) -> None:
    """Write ``count`` samples of every channel of a group's robots to log (B, channels, T)."""
    width = buffer.size // (log.shape[1] * BLOCK)
    robot, channels, samples = group * width, log.shape[1], log.shape[2]
    if count == BLOCK and robot + width <= log.shape[0]:
        for channel in range(channels):
            start = (robot * channels + channel) * samples + first
            for k in range(0, BLOCK, width):
                at = channel * BLOCK + k
                simd.put_transposed(buffer, at, log, start + k, channels * samples, zero)
        return
    for lane in range(min(width, log.shape[0] - robot)):
        for channel in range(channels):
            at = channel * BLOCK * width + lane
            for k in range(count):
                log[robot + lane, channel, first + k] = buffer[at + k * width]


@functools.cache
def compile_kernel(
    policy: Policy, width: int, reactive: bool = False, functions: Any = None
) -> Any:
    """Return the compiled loop for a policy at a lane width, of ``WIDTHS``; it compiles lazily.

    ``reactive`` brings in the terms of ``physics/reactive.py``; ``functions`` are those of the
    task that a closed loop does, if any (``envs.tasks.TaskFunctions``). The loop runs groups
    ``begin`` to ``end`` and may be called from several threads at once.
    """
    if width not in WIDTHS:
        raise InvalidArgumentError(f"width must be one of {WIDTHS} robots; got {width!r}")
    register()
    register_module(episode)
    register_module(command)
    register_module(policies)
    register_module(sys.modules[policy.__module__])
    simd.inlined(policy)
    closed, judged = policy not in OPEN_LOOP, functions is not None
    terms = make_step = current_of = goal_of = remember = _no_function
    flows = aims = remembers = False
    if functions is not None:
        make_step, terms = functions.make_step, functions.reward_terms
        current_of, flows = functions.current or _no_function, functions.current is not None
        goal_of, aims = functions.goal or _no_function, functions.goal is not None
        remember = functions.remember or _no_function
        remembers = functions.remember is not None
        register_module(sys.modules[terms.__module__])
    stamp = source_stamp(compile_kernel, policy, terms)
    swim = step_reactive if reactive else step

    def kernel(
        parameters: Any, states: Any, conditions: Any, program: Any, task: Any, h: float,
        clock: Any, output: Any, record: int, begin: int, end: int,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  # part of the cache's key; see source_stamp
        weights, layout, episodes, noises, broken, has_goal = program
        first_step, steps, substeps, interval, early, phase = clock
        logs, spectra, roots, unit = output
        zero = simd.zero_lanes(parameters, width)
        groups = parameters.size // (ROBOT_ROWS * width)
        block_rpy = np.empty(3 * BLOCK * width, parameters.dtype)
        block_gyro = np.empty(3 * BLOCK * width, parameters.dtype)
        block_pose = np.empty(10 * BLOCK * width, parameters.dtype)
        block_commands = np.empty(3 * BLOCK * width, parameters.dtype)
        series = np.empty(3 * steps * width if record & SPECTRUM else 0, parameters.dtype)
        rates_only = record & ~SPECTRUM == GYRO
        dt = interval * TIMESTEP
        for group in range(begin, end):
            robot = fetch_robot(parameters, 0, group, groups, zero)
            state = fetch_state(states, group, groups, zero)
            rpy = fetch_vector(states, RPY_ROWS, group, groups, zero)
            current = fetch_vector(conditions, CURRENT, group, groups, zero)
            gain = fetch_vector(conditions, SERVO_GAIN, group, groups, zero)
            kept = episodes[group]
            told = (zero, zero, zero)
            if closed:
                told = lane_servo_speeds(fetch_vector(kept, ACTION, 0, 1, zero))
            by = drive((gain[0] * told[0], gain[1] * told[1], gain[2] * told[2]), h)
            in_block = 0
            for t in range(steps):
                if (t + phase) % interval == 0 or t < early:
                    time = (first_step + t) * (h * substeps)
                    if closed:
                        up, north = directions(rpy)
                        way = (zero, zero, zero)
                        if judged and flows:
                            current = current_of(task, fetch_memory(kept, zero), time)
                        if judged and aims:
                            goal = goal_of(task, fetch_memory(kept, zero))
                            way = way_to(goal, state.position, up, north)
                        elif has_goal:
                            goal = fetch_vector(kept, GOAL, 0, 1, zero)
                            way = way_to(goal, state.position, up, north)
                        gyro = state.spin
                        if broken:
                            noise = noises[group]
                            up, north, gyro = faulty(
                                kept,
                                noise,
                                (first_step + t) // interval,
                                t < interval,
                                up,
                                north,
                                gyro,
                            )
                        fins = fetch_vector(kept, FINS, 0, 1, zero)
                        action = policy(
                            weights, layout, kept[ROWS * width :], group, groups, time,
                            up, north, gyro, fins, way,
                        )  # fmt: skip
                        told = lane_servo_speeds(action)
                        believed = fetch_vector(kept, GAIN, 0, 1, zero)
                        speeds = (
                            believed[0] * told[0],
                            believed[1] * told[1],
                            believed[2] * told[2],
                        )
                        put_vector(kept, FINS, 0, 1, reckon(fins, speeds, dt))
                        put_vector(kept, ACTION, 0, 1, action)
                        if judged:
                            put_vector(kept, BEFORE, 0, 1, state.position)
                    else:
                        told = policy(weights, layout, group, groups, time, rpy[0])
                    by = drive((gain[0] * told[0], gain[1] * told[1], gain[2] * told[2]), h)
                for _ in range(substeps):
                    state = swim(robot, state, by, current, h)
                if not rates_only:
                    rpy = continue_attitude(rpy, attitude(rotation(state.orientation)))
                if judged and (t + phase + 1) % interval == 0:
                    before = fetch_vector(kept, BEFORE, 0, 1, zero)
                    action = fetch_vector(kept, ACTION, 0, 1, zero)
                    memory = fetch_memory(kept, zero)
                    done = make_step(before, state.position, state.orientation, action, memory, dt)
                    square = dot(state.velocity, state.velocity) + dot(state.spin, state.spin)
                    alive = where_less(square, RUNAWAY, fetch(kept, ALIVE, zero), zero)
                    total = fetch(kept, TOTAL, zero)
                    reward = zero
                    for term in terms(task, done):
                        reward = reward + term
                    put(kept, TOTAL, where_less(zero, alive, total + reward, total))
                    put(kept, ALIVE, alive)
                    if remembers:
                        put_memory(kept, remember(task, done))
                if record & SPECTRUM:
                    felt = state.spin if rates_only else rpy
                    put_vector(series, 0, t, steps, scale(unit, felt))
                elif record:
                    if record & RPY:
                        put_vector(block_rpy, 0, in_block, BLOCK, rpy)
                    if record & GYRO:
                        put_vector(block_gyro, 0, in_block, BLOCK, state.spin)
                    if record & POSE:
                        q = state.orientation
                        put_vector(block_pose, 0, in_block, BLOCK, state.position)
                        put_vector(block_pose, 3, in_block, BLOCK, (q[0], q[1], q[2]))
                        put(block_pose, 6 * BLOCK + in_block, q[3])
                        put_vector(block_pose, 7, in_block, BLOCK, joint_angles(state))
                    if record & COMMANDS:
                        put_vector(block_commands, 0, in_block, BLOCK, told)
                    in_block += 1
                    if in_block == BLOCK or t == steps - 1:
                        first = t + 1 - in_block
                        if record & RPY:
                            write_block(block_rpy, logs[0], first, in_block, group, zero)
                        if record & GYRO:
                            write_block(block_gyro, logs[1], first, in_block, group, zero)
                        if record & POSE:
                            write_block(block_pose, logs[2], first, in_block, group, zero)
                        if record & COMMANDS:
                            write_block(block_commands, logs[3], first, in_block, group, zero)
                        in_block = 0
            if record & SPECTRUM:
                write_spectrum(series, roots, steps, spectra, group, zero)
            if rates_only:
                rpy = continue_attitude(rpy, attitude(rotation(state.orientation)))
            put_state(states, group, groups, state)
            put_vector(states, RPY_ROWS, group, groups, rpy)

    return compiled(kernel, slow=True, nogil=True)
