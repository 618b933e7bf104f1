"""The compiled time loop: robots side by side in vector registers, their policy included.

A **policy** is a plain function of straight-line scalar Python that says what the servos
shall do; :func:`compile_kernel` compiles it, and the physics, into one loop. Its signature is

    policy(weights, layout, scratch, group, groups, time, rpy, gyro) -> (left, right, caudal)

``rpy`` (continuous roll, pitch, yaw, rad) and ``gyro`` (body axes, rad/s) are what the IMU
says now, and the answer is a command in rev/s, rev/s and Hz, which each servo multiplies by its
gain. ``weights`` is a flat array of the scalar backend's numbers, read with
``fetch(weights, i, like)``, ``layout`` an int64 array of the policy's own, ``scratch`` a flat
array to ``put`` to and ``fetch`` from, and ``time`` a plain float in seconds. Robots share the
instructions of their vector register, so no branch may depend on lanes (branches on ``layout``
are fine). The robots of one register are group ``group`` of ``groups``; row r of a table of P
rows is entry ``r * groups + group``. Functions that a policy calls must be registered with
``simd.inlined``.

On plain floats the same function serves one robot: ``group`` 0 of 1.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.engines.compiled.spectrum import write_spectrum
from aquafish_gym.physics import simd
from aquafish_gym.physics.arithmetic import Vector, add, fetch, put, scale, where_less
from aquafish_gym.physics.attitude import attitude, continue_attitude
from aquafish_gym.physics.compiling import compiled, register, source_stamp
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
from aquafish_gym.utils.validation import InvalidArgumentError

Policy = Callable[..., Vector]

BLOCK = 16  # samples gathered before they are written out, in the fastest cache
WIDTHS = (1, 2, 4, 8, 16)  # a block is transposed in squares, so they divide it

# What to record, as bits. SPECTRUM alone is that of roll, pitch and yaw; with GYRO it is that of
# the rates. Where GYRO is all that is asked for, the attitude is worked out at the end alone.
RPY, GYRO, POSE, SPECTRUM = 1, 2, 4, 8


@simd.inlined
def hold(
    weights: Any, _layout: Any, _scratch: Any, group: int, groups: int, _time: float, rpy: Vector,
    _gyro: Vector,
) -> Vector:  # fmt: skip
    """Hold the command that stands in the three rows of ``weights``: the open-loop policy."""
    return fetch_vector(weights, 0, group, groups, rpy[0])


@simd.inlined
def _share(x: Any) -> Any:
    """Return x cut off at 0 and 1."""
    return where_less(x, 0.0, 0.0, where_less(x, 1.0, x, 1.0))


@simd.inlined
def _obeyed(
    weights: Any, layout: Any, group: int, groups: int, at: int, sample: int, late: Any
) -> Vector:
    """Return what command ``at`` of a series adds to the servos' speed in a sample."""
    count, held = layout[0], layout[1]
    share = _share(float(sample + 1 - at * held) - late)
    if at < count - 1:
        share = share - _share(float(sample + 1 - (at + 1) * held) - late)
    return scale(share, fetch_vector(weights, 3 * at, group, groups, late))


@simd.inlined
def perform(
    weights: Any, layout: Any, _scratch: Any, group: int, groups: int, time: float, rpy: Vector,
    _gyro: Vector,
) -> Vector:  # fmt: skip
    """Perform a series of commands, each held for some samples, the last to the end.

    ``layout`` is how many there are, how many samples each is held, how many samples of them
    passed before the first step, and how many before the one that is given now may still be
    obeyed. ``weights`` has three rows for each, in turn, and one more: how many samples late they
    are obeyed. In a sample in which one follows another, the servos turn at the mean of what they
    are told, so that their angles are continuous in the lag.
    """
    late = fetch(weights, 3 * layout[0] * groups + group, rpy[0])
    sample = math.floor(time / TIMESTEP + 0.5) + layout[2]
    newest = min(sample // layout[1], layout[0] - 1)
    told = _obeyed(weights, layout, group, groups, newest, sample, late)
    for at in range(newest - 1, max(newest - layout[3], 0) - 1, -1):
        told = add(told, _obeyed(weights, layout, group, groups, at, sample, late))
    return told


# Policies that do not ask for the attitude.
OPEN_LOOP = (hold, perform)


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
def compile_kernel(policy: Policy, width: int, reactive: bool = False) -> Any:
    """Return the compiled loop for a policy at a lane width, of ``WIDTHS``; it compiles lazily.

    ``reactive`` brings in the terms of ``physics/reactive.py``. The loop runs groups ``begin``
    to ``end`` and may be called from several threads at once.
    """
    if width not in WIDTHS:
        raise InvalidArgumentError(f"width must be one of {WIDTHS} robots; got {width!r}")
    register()
    simd.inlined(policy)
    stamp = source_stamp(compile_kernel, policy)
    swim = step_reactive if reactive else step

    def kernel(
        parameters: Any, states: Any, conditions: Any, program: Any, h: float, clock: Any,
        output: Any, record: int, begin: int, end: int,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  # part of the cache's key; see source_stamp
        weights, layout, scratch_size = program
        first_step, steps, substeps, interval, early = clock
        logs, spectra, roots, unit = output
        zero = simd.zero_lanes(parameters, width)
        groups = parameters.size // (ROBOT_ROWS * width)
        scratch = np.empty(scratch_size * width, parameters.dtype)
        block_rpy = np.empty(3 * BLOCK * width, parameters.dtype)
        block_gyro = np.empty(3 * BLOCK * width, parameters.dtype)
        block_pose = np.empty(10 * BLOCK * width, parameters.dtype)
        series = np.empty(3 * steps * width if record & SPECTRUM else 0, parameters.dtype)
        rates_only = record & ~SPECTRUM == GYRO
        for group in range(begin, end):
            robot = fetch_robot(parameters, 0, group, groups, zero)
            state = fetch_state(states, group, groups, zero)
            rpy = fetch_vector(states, RPY_ROWS, group, groups, zero)
            current = fetch_vector(conditions, CURRENT, group, groups, zero)
            gain = fetch_vector(conditions, SERVO_GAIN, group, groups, zero)
            by = drive((zero, zero, zero), h)
            in_block = 0
            for t in range(steps):
                if t % interval == 0 or t < early:
                    time = (first_step + t) * (h * substeps)
                    told = policy(weights, layout, scratch, group, groups, time, rpy, state.spin)
                    by = drive((gain[0] * told[0], gain[1] * told[1], gain[2] * told[2]), h)
                for _ in range(substeps):
                    state = swim(robot, state, by, current, h)
                if not rates_only:
                    rpy = continue_attitude(rpy, attitude(rotation(state.orientation)))
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
                    in_block += 1
                    if in_block == BLOCK or t == steps - 1:
                        first = t + 1 - in_block
                        if record & RPY:
                            write_block(block_rpy, logs[0], first, in_block, group, zero)
                        if record & GYRO:
                            write_block(block_gyro, logs[1], first, in_block, group, zero)
                        if record & POSE:
                            write_block(block_pose, logs[2], first, in_block, group, zero)
                        in_block = 0
            if record & SPECTRUM:
                write_spectrum(series, roots, steps, spectra, group, zero)
            if rates_only:
                rpy = continue_attitude(rpy, attitude(rotation(state.orientation)))
            put_state(states, group, groups, state)
            put_vector(states, RPY_ROWS, group, groups, rpy)

    return compiled(kernel, seconds=30, nogil=True)
