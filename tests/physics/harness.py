"""Run the physics on each carrier through one door: plain floats, float64 and float32 lanes."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from aquafish_gym.engines.kernel import (
    STATE_ROWS,
    fetch_fin,
    fetch_state,
    fetch_vector,
    put_state,
    put_vector,
)
from aquafish_gym.engines.lanes import lane_width, pack_rows
from aquafish_gym.physics import simd
from aquafish_gym.physics.dynamics import Water, forces, move
from aquafish_gym.physics.hydrodynamics import fin_drag
from aquafish_gym.physics.kinematics import drive
from aquafish_gym.robot import PARAMETERS_PER_FIN, Robot, robot_parameters

simd.register()
Array = NDArray[np.float64]

CARRIERS = ("floats", "float64", "float32")
# What one rounding may do to a number of order one.
ROUNDING = {"floats": 2e-16, "float64": 2e-16, "float32": 1e-7}


def _march(
    parameters: Any, states: Any, commands: Any, current: Any, h: float, steps: int, wet: bool,
    group: int, groups: int, zero: Any,
) -> None:  # fmt: skip
    """Advance one group; runs as it stands on floats, and compiled in lanes."""
    robot = Robot(
        fetch_fin(parameters, 0, group, groups, zero),
        fetch_fin(parameters, PARAMETERS_PER_FIN, group, groups, zero),
        fetch_fin(parameters, 2 * PARAMETERS_PER_FIN, group, groups, zero),
    )
    state = fetch_state(states, group, groups, zero)
    none = (zero, zero, zero)
    dry = Water((none, none), (none, none), (none, none), (none, none))
    by = drive(fetch_vector(commands, 0, group, groups, zero), h)
    for _ in range(steps):
        water = forces(robot, state, current) if wet else dry
        state = move(robot, state, by, water, h)
    put_state(states, group, groups, state, none)


def _fin(fins: Any, motion: Any, out: Any, group: int, groups: int, zero: Any) -> None:
    force, torque = fin_drag(
        fetch_fin(fins, 0, group, groups, zero),
        fetch_vector(motion, 0, group, groups, zero),
        fetch_vector(motion, 3, group, groups, zero),
    )
    put_vector(out, 0, group, groups, force)
    put_vector(out, 3, group, groups, torque)


@functools.cache
def _in_lanes(function: Any, width: int) -> Any:
    from numba.extending import register_jitable

    register_jitable(function)

    @njit
    def march(parameters, states, commands, current, h, steps, wet, groups):  # type: ignore[no-untyped-def]
        for group in range(groups):
            zero = simd.zero_lanes(parameters, width)
            function(parameters, states, commands, current, h, steps, wet, group, groups, zero)

    @njit
    def fin(fins, motion, out, groups):  # type: ignore[no-untyped-def]
        for group in range(groups):
            function(fins, motion, out, group, groups, simd.zero_lanes(fins, width))

    return march if function is _march else fin


def march(
    carrier: str,
    morphologies: Array,
    states: Array,
    commands: Array,
    h: float = 0.01,
    steps: int = 1,
    current: tuple[float, float, float] = (0.0, 0.0, 0.0),
    wet: bool = True,
) -> Array:
    """Return the states (25, B) after ``steps`` of length ``h``; ``wet=False`` has no fluid."""
    parameters, batch = robot_parameters(morphologies), len(morphologies)
    if carrier == "floats":
        rows = [[float(x) for x in column] for column in states.T]
        for b in range(batch):
            _march(
                [float(x) for x in parameters[:, b]], rows[b], [float(x) for x in commands[b]],
                current, h, steps, wet, 0, 1, 0.0,
            )  # fmt: skip
        return np.array(rows).T
    dtype = np.dtype(carrier).type
    width = lane_width(dtype)
    flat = pack_rows(states, dtype, width)
    groups = flat.size // (STATE_ROWS * width)
    _in_lanes(_march, width)(
        pack_rows(parameters, dtype, width), flat, pack_rows(commands.T, dtype, width),
        current, h, steps, wet, groups,
    )  # fmt: skip
    return flat.reshape(STATE_ROWS, -1)[:, :batch].astype(np.float64)


def drag(carrier: str, fins: Array, motion: Array) -> Array:
    """Return fin drag (6, B): force and torque in the fin frame.

    ``fins`` is (3, B) width, length, thickness; ``motion`` (6, B) the hinge's velocity and the
    fin's angular velocity, in the fin frame.
    """
    table = np.concatenate([fins, np.ones((4, fins.shape[1]))])
    if carrier == "floats":
        columns = []
        for b in range(fins.shape[1]):
            out = [0.0] * 6
            _fin([float(x) for x in table[:, b]], [float(x) for x in motion[:, b]], out, 0, 1, 0.0)
            columns.append(out)
        return np.array(columns).T
    dtype = np.dtype(carrier).type
    width = lane_width(dtype)
    flat = pack_rows(np.zeros((6, fins.shape[1])), dtype, width)
    _in_lanes(_fin, width)(
        pack_rows(table, dtype, width), pack_rows(motion, dtype, width), flat,
        flat.size // (6 * width),
    )  # fmt: skip
    return flat.reshape(6, -1)[:, : fins.shape[1]].astype(np.float64)
