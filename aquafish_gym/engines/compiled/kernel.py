"""The compiled time loop: robots side by side in vector registers, their policy included.

A policy is a plain function of straight-line scalar Python that commands the servos;
:func:`compile_kernel` compiles it, the task and the physics into one loop. An open-loop policy is
one of ``policies.py``: so an environment's step is this loop for one action. Any other is

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

from aquafish_gym import command, sense
from aquafish_gym.command import lane_servo_speeds, late_command
from aquafish_gym.engines.compiled import episode, lag, policies, recording
from aquafish_gym.engines.compiled.episode import (
    ACTION_ROW,
    BEFORE_ROW,
    EPISODE_ROWS,
    RECKONED_ROW,
    end_action,
    fetch_memory,
    note_action,
    note_divergence,
    note_reward,
    put_memory,
    put_terms,
    sensed,
)
from aquafish_gym.engines.compiled.lag import arrived, begin_lag, remember
from aquafish_gym.engines.compiled.policies import OPEN_LOOP, act
from aquafish_gym.engines.compiled.recording import (
    BLOCK,
    GYRO_BIT,
    SPECTRUM_BIT,
    put_sample,
    write_blocks,
)
from aquafish_gym.engines.compiled.spectrum import write_spectrum
from aquafish_gym.physics import simd
from aquafish_gym.physics.arithmetic import Vector, cross, scale
from aquafish_gym.physics.attitude import attitude, continue_attitude, directions
from aquafish_gym.physics.compiling import compiled, register, register_module, source_stamp
from aquafish_gym.physics.dynamics import step
from aquafish_gym.physics.kinematics import drive, rotation
from aquafish_gym.physics.layout import (
    CURRENT,
    ROBOT_ROWS,
    RPY,
    SERVO_GAIN,
    STATE_ROWS,
    fetch_robot,
    fetch_state,
    fetch_vector,
    put_state,
    put_vector,
)
from aquafish_gym.physics.reactive import step_reactive
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.sense import way_to

CompiledPolicy = Callable[..., Vector]


def _driven(gain: Vector, command: Vector, h: float) -> Any:
    """Return the drive of servos that follow a command."""
    return drive((gain[0] * command[0], gain[1] * command[1], gain[2] * command[2]), h)


def _no_function(_task: Any, memory: Any, _time: float = 0.0) -> Any:
    return (memory[0], memory[1], memory[2])


@functools.cache
def compile_kernel(
    policy: CompiledPolicy,
    width: int,
    reactive: bool = False,
    functions: Any = None,
    late: bool = False,
) -> Any:
    """Return the compiled loop for a policy at a lane width; it compiles lazily.

    ``reactive`` brings in the terms of ``physics/reactive.py``; ``functions`` are those of the
    task that a closed loop does, if any (``envs.tasks.TaskFunctions``). ``late`` is whether any
    robot's servos have a lag. The loop runs groups ``begin`` to ``end`` and may be called from
    several threads at once.
    """
    register()
    for module in (sys.modules[__name__], episode, lag, recording, command, policies, sense):
        register_module(module)
    register_module(sys.modules[policy.__module__])
    simd.inlined(policy)
    closed = policy not in OPEN_LOOP
    acts = policy is act
    judged = functions is not None
    # An action's water, goal and memory are the caller's.
    flows = closed and judged and functions.current is not None
    aims = closed and judged and functions.goal is not None
    remembers = closed and judged and functions.remember is not None
    current_of = functions.current if flows else _no_function
    goal_of = functions.goal if aims else _no_function
    recall: Any = functions.remember if remembers else _no_function
    rewards: Any = functions.rewards if judged else _no_function
    make_step: Any = functions.make_step if judged else _no_function
    register_module(sys.modules[rewards.__module__])
    for function in functions[:-1] if judged else ():  # methods of a task's class
        if function is not None:
            simd.inlined(function)
    stamp = source_stamp(compile_kernel, policy, rewards)
    swim = step_reactive if reactive else step

    def kernel(
        parameters: Any, states: Any, conditions: Any, given: Any, program: Any, task: Any,
        h: float, clock: Any, output: Any, record: int, begin: int, end: int,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  # part of the cache's key; see source_stamp
        weights, layout, episodes, noises, broken = program
        first_step, steps, substeps, interval, phase = clock
        logs, spectra, roots, unit = output
        zero = simd.zero_lanes(parameters, width)
        groups = parameters.size // (ROBOT_ROWS * width)
        blocks = (
            np.empty(3 * BLOCK * width, parameters.dtype),
            np.empty(3 * BLOCK * width, parameters.dtype),
            np.empty(10 * BLOCK * width, parameters.dtype),
        )
        series = np.empty(3 * steps * width if record & SPECTRUM_BIT else 0, parameters.dtype)
        lag_steps = np.empty(width if late else 0, parameters.dtype)
        scratch = np.empty(3 * width if late else 0, parameters.dtype)
        latest = np.empty(STATE_ROWS * width if acts else 0, parameters.dtype)
        rates_only = not closed and record in (0, GYRO_BIT, SPECTRUM_BIT)
        dt = interval * TIMESTEP
        for group in range(begin, end):
            robot = fetch_robot(parameters, 0, group, groups, zero)
            state = fetch_state(states, group, groups, zero)
            rpy = fetch_vector(states, RPY, group, groups, zero)
            current = fetch_vector(conditions, CURRENT, group, groups, zero)
            gain = fetch_vector(conditions, SERVO_GAIN, group, groups, zero)
            rows, noise = episodes[group], noises[group]
            start = state.position
            if late:
                share = begin_lag(conditions, group, groups, lag_steps, zero)
                older = arrived(given[group], lag_steps, scratch, first_step - 1, zero)
                depth = given[group].size // (3 * width)
            speeds = (zero, zero, zero)
            if closed:  # that of an action which goes on from the call before
                speeds = lane_servo_speeds(fetch_vector(rows, ACTION_ROW, 0, 1, zero))
            by = _driven(gain, speeds, h)
            in_block = 0
            elapsed = phase
            commanded_at = 0
            for t in range(steps):
                # The policy commands the servos, ...
                if elapsed == 0 or (t == 0 and not closed):
                    commanded_at = t
                    time = (first_step + t) * (h * substeps)
                    if closed:
                        memory = fetch_memory(rows, zero)
                        if flows:
                            current = current_of(task, memory, time)
                        goal = (zero, zero, zero)
                        if aims:
                            goal = goal_of(task, memory)
                        up, north = directions(rpy)
                        way = way_to(goal, state.position, cross(north, up), north, up)
                        up, north, gyro = sensed(
                            rows, noise, broken, (first_step + t) // interval, t < interval,
                            up, north, state.spin,
                        )  # fmt: skip
                        fins = fetch_vector(rows, RECKONED_ROW, 0, 1, zero)
                        action = policy(
                            weights, layout, rows[EPISODE_ROWS * width :], group, groups, time,
                            up, north, gyro, fins, way,
                        )  # fmt: skip
                        speeds = lane_servo_speeds(action)
                        note_action(rows, action, speeds, state.position, dt)
                    else:
                        speeds = policy(weights, layout, group, groups, time, zero)
                    if not late:
                        by = _driven(gain, speeds, h)
                # ... which may be late (they are steady once all have followed it), ...
                if late:
                    remember(given[group], first_step + t, speeds, width)
                    if t - commanded_at < depth:
                        newer = arrived(given[group], lag_steps, scratch, first_step + t, zero)
                        by = _driven(gain, late_command(older, newer, share), h)
                        older = newer
                # ... the robot swims, ...
                for _ in range(substeps):
                    state = swim(robot, state, by, current, h)
                if not rates_only:
                    rpy = continue_attitude(rpy, attitude(rotation(state.orientation)))
                # ... the task judges the action once it is over, ...
                elapsed += 1
                if elapsed == interval:
                    elapsed = 0
                if closed and elapsed == 0:
                    note_divergence(rows, state)
                if closed and judged and elapsed == 0:
                    memory = fetch_memory(rows, zero)
                    done = make_step(
                        fetch_vector(rows, BEFORE_ROW, 0, 1, zero),
                        state.position,
                        state.orientation,
                        fetch_vector(rows, ACTION_ROW, 0, 1, zero),
                        memory,
                        dt,
                    )
                    note_reward(rows, rewards(task, done), zero)
                    if remembers:
                        put_memory(rows, recall(task, done))
                # ... and what is asked for is recorded.
                if record & SPECTRUM_BIT:
                    put_vector(series, 0, t, steps, scale(unit, state.spin))
                elif record:
                    put_sample(blocks, record, in_block, rpy, state)
                    in_block += 1
                    if in_block == BLOCK or t == steps - 1:
                        write_blocks(blocks, logs, record, t + 1 - in_block, in_block, group, zero)
                        in_block = 0
            if record & SPECTRUM_BIT:
                write_spectrum(series, roots, steps, spectra, group, zero)
            if rates_only:
                rpy = continue_attitude(rpy, attitude(rotation(state.orientation)))
            if acts:
                end_action(rows, states, group, groups, state, rpy, latest)
                if judged:
                    done = make_step(
                        start,
                        state.position,
                        state.orientation,
                        fetch_vector(weights, 3, group, groups, zero),
                        fetch_memory(rows, zero),
                        dt,
                    )
                    put_terms(rows, rewards(task, done), zero)
            else:
                put_state(states, group, groups, state)
                put_vector(states, RPY, group, groups, rpy)
            if flows:
                put_vector(conditions, CURRENT, group, groups, current)

    return compiled(kernel, slow=True, nogil=True)
