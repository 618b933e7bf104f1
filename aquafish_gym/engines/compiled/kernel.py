"""The compiled time loop: robots side by side in vector registers, their policy included.

A policy is a plain function of straight-line scalar Python that commands the servos;
:func:`compile_kernel` compiles it, the task and the physics into one loop. It is

    policy(weights, layout, scratch, group, groups, time, up, north, gyro, fins, way) -> action

``up`` and ``north`` (of the world, in body axes) and ``gyro`` (rad/s) are what the inertial
measurement unit observes, ``fins`` (turns) where the policy believes its fins to be, and ``way``
(units, body axes) leads to the goal, if the task has one. The action has a number in [-1, 1] for
each servo. ``weights`` is a flat array of the scalar backend's numbers, read with
``fetch(weights, i, like)``, ``layout`` an int64 array of the policy's own, ``scratch`` a flat array
to ``put`` to and ``fetch`` from, which lives through an episode, and ``time`` a plain float in
seconds. Robots share the instructions of their vector register, so no branch may depend on lanes
(branches on ``layout`` are fine). The robots of one register are group ``group`` of ``groups``; row
r of the weights is entry ``r * groups + group``. Functions that a policy calls must be registered
with ``simd.inlined``.

On plain floats the same function serves one robot: ``group`` 0 of 1.

Two open loops stand in for a policy, so that an environment's step is this loop for one action:

- ``PERFORM``: a series of commands, in rev/s and Hz, each held for some steps, the last to the end.
  ``layout`` holds the number of commands, the steps that each is held, and the steps of the series
  that passed before the first one. ``weights`` has a row for each servo of each command, in turn.
- ``ACT``: one action. ``weights`` has the action that servos follow, which may be late, and then
  the one that the task judges.
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Callable
from typing import Any, Literal

from aquafish_gym import command, sense
from aquafish_gym.command import servos
from aquafish_gym.engines.compiled import episode, lag, recording
from aquafish_gym.engines.compiled.episode import (
    ALIVE_ROW,
    BEFORE_ROW,
    EPISODE_ROWS,
    episode_fields,
    fetch_memory,
    kept,
    note_divergence,
    note_observation,
    note_reward,
    put_memory,
    put_terms,
    sensed,
    some_diverged,
)
from aquafish_gym.engines.compiled.lag import arrived, begin_lag
from aquafish_gym.engines.compiled.recording import (
    BLOCK,
    POSE_BIT,
    RPY_BIT,
    SPECTRUM_BIT,
    put_sample,
    write_blocks,
)
from aquafish_gym.engines.compiled.spectrum import spectrum_rows, write_spectrum
from aquafish_gym.physics import simd
from aquafish_gym.physics.arithmetic import Number, cross, put, scale
from aquafish_gym.physics.attitude import attitude, continue_attitude, directions
from aquafish_gym.physics.compiling import (
    compiled,
    register,
    register_functions,
    register_module,
    source_stamp,
)
from aquafish_gym.physics.kinematics import has_diverged, rotation
from aquafish_gym.physics.law import law
from aquafish_gym.physics.layout import CURRENT, fetch_vector, layout, put_vector
from aquafish_gym.plans import BodyPlan
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.sense import way_to

CompiledPolicy = Callable[..., tuple[Number, ...]]
OpenLoop = Literal["perform", "act"]
PERFORM: OpenLoop = "perform"
ACT: OpenLoop = "act"


def _command_at(layout: Any, time: float) -> int:
    """Return which command of a series holds at a time."""
    step = math.floor(time / TIMESTEP + 0.5) + layout[2]
    return int(min(step // layout[1], layout[0] - 1))


def _no_function(_task: Any, memory: Any, _time: float = 0.0) -> Any:
    return (memory[0], memory[1], memory[2])


@functools.cache
def compile_kernel(
    plan: BodyPlan,
    policy: CompiledPolicy | OpenLoop,
    width: int,
    reactive: bool = False,
    functions: Any = None,
    late: bool = False,
    recorded: bool = True,
) -> Any:
    """Return the compiled loop of :func:`time_loop`, which compiles lazily.

    It may be called from several threads at once, each with a ``work`` of its own.
    """
    loop, stamp = time_loop(plan, policy, width, reactive, functions, late, recorded)
    return compiled(loop, slow=True, stamp=stamp, nogil=True)


def work_rows(record: int, steps: int, fins: int) -> int:
    """Return how many rows of lanes :func:`time_loop` needs as ``work``."""
    rows = (13 + fins) * BLOCK + 1 + fins
    return rows + spectrum_rows(steps) if record & SPECTRUM_BIT else rows


def time_loop(
    plan: BodyPlan,
    policy: CompiledPolicy | OpenLoop,
    width: int,
    reactive: bool,
    functions: Any,
    late: bool,
    recorded: bool,
) -> tuple[Callable[..., None], str]:
    """Return the loop of a plan for a policy at a lane width, and the stamp of its sources.

    Compiled code can call it. ``reactive`` brings in the terms of ``physics/reactive.py``;
    ``functions`` are those of the task that a closed loop does, if any
    (``envs.tasks.TaskFunctions``). ``late`` is whether any robot's servos have a lag, and
    ``recorded`` whether the loop can record, which takes seconds to compile. The loop runs groups
    ``begin`` to ``end``, one after the other, in ``work``: rows of lanes.
    """
    register()
    for module in (sys.modules[__name__], command, episode, lag, recording, sense):
        register_module(module)
    of = law(plan)
    closed = not isinstance(policy, str)
    acts = policy == ACT
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
    stamped: list[Any] = [compile_kernel, rewards]
    command_of: Any = _no_function
    if not isinstance(policy, str):
        register_module(sys.modules[policy.__module__])
        simd.inlined(policy)
        stamped.append(policy)
        command_of = policy
    stamp = source_stamp(*stamped) + plan.to_json()
    swim = of.step_reactive if reactive else of.step
    driven = of.driven
    joint_angles = of.joint_angles
    choose = of.choose
    fetch_robot = of.fetch_robot
    fetch_state = of.fetch_state
    fetch_fins = of.fetch_fins
    put_state = of.put_state
    put_fins = of.put_fins
    servo_speeds, lane_servo_speeds, late_command, reckon = servos(plan)
    register_functions(
        swim, driven, joint_angles, choose, fetch_robot, fetch_state, fetch_fins, put_state,
        put_fins, servo_speeds, lane_servo_speeds, late_command, reckon,
    )  # fmt: skip
    tables, fins = layout(plan), len(plan.fins)
    robot_rows, first_of_rpy = tables.robot_rows, tables.rpy.start
    first_of_gain, row_of_lag = tables.servo_gain.start, tables.servo_lag
    reckoned_row, gain_row, action_row = (
        episode_fields(fins)[name].start for name in ("fins", "gain", "action")
    )
    episode_rows = EPISODE_ROWS + 3 * fins

    def swim_groups(
        parameters: Any, states: Any, conditions: Any, given: Any, program: Any, task: Any,
        h: float, clock: Any, output: Any, record: int, work: Any, begin: int, end: int,
    ) -> None:  # fmt: skip
        weights, layout, episodes, noises, broken = program
        first_step, steps, substeps, interval, phase = clock
        logs, spectra, roots, unit = output
        zero = simd.zero_lanes(parameters, width)
        groups = parameters.size // (robot_rows * width)
        block = BLOCK * width
        rest = work[(13 + fins) * block :]
        lag_steps, scratch = rest[:width], rest[width : (1 + fins) * width]
        if recorded:
            blocks = (
                work[: 3 * block],
                work[3 * block : 6 * block],
                work[6 * block : (13 + fins) * block],
            )
            series = rest[(1 + fins) * width :]
        rates_only = not closed and not record & RPY_BIT
        dt = interval * TIMESTEP
        for group in range(begin, end):
            robot = fetch_robot(parameters, 0, group, groups, zero)
            state = fetch_state(states, 0, group, groups, zero)
            rpy = fetch_vector(states, first_of_rpy, group, groups, zero)
            current = fetch_vector(conditions, CURRENT, group, groups, zero)
            gain = fetch_fins(conditions, first_of_gain, group, groups, zero)
            rows, noise = episodes[group], noises[group]
            start = state.position
            if late:
                share = begin_lag(conditions, row_of_lag * groups + group, lag_steps, zero)
                arrived(given[group], lag_steps, scratch, first_step - 1, fins, zero)
                older = fetch_fins(scratch, 0, 0, 1, zero)
                depth = given[group].size // (fins * width)
            if closed:  # those of an action which goes on from the call before
                speeds = lane_servo_speeds(fetch_fins(rows, action_row, 0, 1, zero))
            else:
                speeds = fetch_fins(weights, 0, group, groups, zero)
            by = driven(gain, speeds, h)
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
                        angles = fetch_fins(rows, reckoned_row, 0, 1, zero)
                        action = command_of(
                            weights, layout, rows[episode_rows * width :], group, groups, time,
                            up, north, gyro, angles, way,
                        )  # fmt: skip
                        speeds = lane_servo_speeds(action)
                        believed = fetch_fins(rows, gain_row, 0, 1, zero)
                        angles = reckon(angles, believed, speeds, dt)
                        put_fins(rows, reckoned_row, 0, 1, angles)
                        put_fins(rows, action_row, 0, 1, action)
                        put_vector(rows, BEFORE_ROW, 0, 1, state.position)
                    elif acts:
                        speeds = servo_speeds(fetch_fins(weights, 0, group, groups, zero))
                    else:
                        row = fins * _command_at(layout, time)
                        speeds = fetch_fins(weights, row, group, groups, zero)
                    if not late:
                        by = driven(gain, speeds, h)
                # ... which may be late (they are steady once all have followed it), ...
                if late:
                    put_fins(given[group], fins * ((first_step + t) % depth), 0, 1, speeds)
                    if t - commanded_at < depth:
                        arrived(given[group], lag_steps, scratch, first_step + t, fins, zero)
                        newer = fetch_fins(scratch, 0, 0, 1, zero)
                        by = driven(gain, late_command(older, newer, share), h)
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
                        fetch_fins(rows, action_row, 0, 1, zero),
                        memory,
                        dt,
                    )
                    note_reward(rows, rewards(task, done), zero)
                    if remembers:
                        put_memory(rows, recall(task, done))
                # ... and what is asked for is recorded.
                if recorded and record & SPECTRUM_BIT:
                    put_vector(series, 0, t, steps, scale(unit, state.spin))
                elif recorded and record:
                    put_sample(blocks, record, in_block, rpy, state)
                    if record & POSE_BIT:
                        put_fins(blocks[2], 7, in_block, BLOCK, joint_angles(state.joints))
                    in_block += 1
                    if in_block == BLOCK or t == steps - 1:
                        write_blocks(blocks, logs, record, t + 1 - in_block, in_block, group, zero)
                        in_block = 0
            if recorded and record & SPECTRUM_BIT:
                write_spectrum(series, roots, steps, spectra, group, zero)
            if rates_only:
                rpy = continue_attitude(rpy, attitude(rotation(state.orientation)))
            if acts:
                # A robot that diverged stays in the state before the action.
                lost = has_diverged(state)
                put(rows, ALIVE_ROW, 1.0 - lost)
                if some_diverged(rows, width, zero):
                    state = choose(lost, fetch_state(states, 0, group, groups, zero), state)
                    before = fetch_vector(states, first_of_rpy, group, groups, zero)
                    rpy = kept(lost, before, rpy)
                note_observation(rows, state)
                if judged:
                    done = make_step(
                        start,
                        state.position,
                        state.orientation,
                        fetch_fins(weights, fins, group, groups, zero),
                        fetch_memory(rows, zero),
                        dt,
                    )
                    put_terms(rows, rewards(task, done), zero)
            put_state(states, 0, group, groups, state)
            put_vector(states, first_of_rpy, group, groups, rpy)
            if flows:
                put_vector(conditions, CURRENT, group, groups, current)

    simd.inlined(swim_groups)
    return swim_groups, stamp
