"""Run the physics on each backend through one door, from any state and at any step.

The engines start at rest and take steps of 0.01 s or parts of it. Here the same functions,
``dynamics.forces`` and ``dynamics.move``, run from whatever state a question needs: on plain
floats, on numba's float64, and in lanes of float64 and float32.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from aquafish_gym.engines.compiled.lanes import lane_width, pack_rows
from aquafish_gym.physics import compiling, simd
from aquafish_gym.physics.arithmetic import Vector, add
from aquafish_gym.physics.dynamics import Water, forces, move, wrench
from aquafish_gym.physics.hydrodynamics import fin_drag
from aquafish_gym.physics.kinematics import State, drive
from aquafish_gym.physics.layout import (
    FIELDS,
    FIN_ROWS,
    STATE_ROWS,
    fetch_fin,
    fetch_robot,
    fetch_state,
    fetch_vector,
    put_state,
    put_vector,
    robot_parameters,
)
from aquafish_gym.physics.robot import Robot
from aquafish_gym.utils.validation import one_of

Array = NDArray[np.float64]

BACKENDS = ("floats", "numba", "float64", "float32")
# Rows of a table of states, as ``layout.start_rows`` makes them.
QUATERNION, POSITION, VELOCITY, SPIN, RATES = (
    FIELDS[name] for name in ("orientation", "position", "velocity", "spin", "rates")
)


def _march(
    parameters: Any, states: Any, commands: Any, current: Vector, push: Vector, h: float,
    steps: int, wet: bool, group: int, groups: int, zero: Any,
) -> None:  # fmt: skip
    """Advance one group; runs as it stands on floats, and compiled."""
    robot = fetch_robot(parameters, 0, group, groups, zero)
    state = fetch_state(states, group, groups, zero)
    none = (zero, zero, zero)
    dry = Water((none, none), (none, none), (none, none), (none, none))
    by = drive(fetch_vector(commands, 0, group, groups, zero), h)
    for _ in range(steps):
        water = forces(robot, state, current) if wet else dry
        force, torque = water.body
        pushed = Water(water.left, water.right, water.caudal, (add(force, push), torque))
        state = move(robot, state, by, pushed, h)
    put_state(states, group, groups, state)


def _drag(fins: Any, motion: Any, out: Any, group: int, groups: int, zero: Any) -> None:
    force, torque = fin_drag(
        fetch_fin(fins, 0, group, groups, zero),
        fetch_vector(motion, 0, group, groups, zero),
        fetch_vector(motion, 3, group, groups, zero),
    )
    put_vector(out, 0, group, groups, force)
    put_vector(out, 3, group, groups, torque)


@functools.cache
def _compile(function: Callable[..., None], width: int) -> Any:
    """Return the loop over all groups, compiled; a width of 0 stands for plain numbers."""
    compiling.register()
    register_jitable(function)
    stamp = compiling.source_stamp(function)

    def march(
        parameters: Any, states: Any, commands: Any, current: Vector, push: Vector, h: float,
        steps: int, wet: bool, groups: int,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  # part of the cache's key; see compiling.source_stamp
        for group in range(groups):
            zero = simd.zero_lanes(parameters, width) if width else 0.0
            function(
                parameters, states, commands, current, push, h, steps, wet, group, groups, zero
            )

    def drag(fins: Any, motion: Any, out: Any, groups: int) -> None:
        stamp  # noqa: B018
        for group in range(groups):
            zero = simd.zero_lanes(fins, width) if width else 0.0
            function(fins, motion, out, group, groups, zero)

    return compiling.compiled(march if function is _march else drag)


@functools.cache
def compiled_wrench() -> Any:
    """Return ``dynamics.wrench`` compiled for one robot on plain floats."""
    compiling.register()
    stamp = compiling.source_stamp()

    def call(robot: Robot, state: State, current: Vector) -> Any:
        stamp  # noqa: B018  # part of the cache's key; see compiling.source_stamp
        return wrench(robot, state, current)

    return compiling.compiled(call)


def march(
    backend: str,
    morphologies: Array,
    states: Array,
    commands: Array,
    h: float = 0.01,
    steps: int = 1,
    current: Vector = (0.0, 0.0, 0.0),
    push: Vector = (0.0, 0.0, 0.0),
    wet: bool = True,
) -> Array:
    """Return the states (25, B) of B robots after some steps.

    Parameters
    ----------
    backend
        One of ``BACKENDS``.
    morphologies
        (B, 9) sizes.
    states
        (25, B) as ``layout.start_rows`` makes them; left as they are.
    commands
        (B, 3) rev/s, rev/s, Hz.
    h, steps
        Length, s, and number of the steps.
    current
        The water's velocity in the world, units/s.
    push
        A force on the capsule's centre, in body axes.
    wet
        False leaves the water out.
    """
    one_of("backend", backend, BACKENDS)
    parameters, batch = robot_parameters(morphologies), len(morphologies)
    if backend == "floats":
        rows = [[float(x) for x in column] for column in states.T]
        for b, row in enumerate(rows):
            _march(
                [float(x) for x in parameters[:, b]], row, [float(x) for x in commands[b]],
                current, push, h, steps, wet, 0, 1, 0.0,
            )  # fmt: skip
        return np.array(rows).T
    dtype, width = _layout(backend)
    flat = pack_rows(states, dtype, width or 1)
    groups = flat.size // (STATE_ROWS * (width or 1))
    _compile(_march, width)(
        pack_rows(parameters, dtype, width or 1), flat, pack_rows(commands.T, dtype, width or 1),
        current, push, h, steps, wet, groups,
    )  # fmt: skip
    return flat.reshape(STATE_ROWS, -1)[:, :batch].astype(np.float64)


def drag(backend: str, fins: Array, motion: Array) -> Array:
    """Return the drag on B fins (6, B): force and torque about the hinge, in the fin frame.

    Parameters
    ----------
    backend
        One of ``BACKENDS``.
    fins
        (3, B) width, length, thickness.
    motion
        (6, B) the hinge's velocity and the fin's angular velocity, in the fin frame.
    """
    one_of("backend", backend, BACKENDS)
    table = np.concatenate([fins, np.ones((FIN_ROWS - 3, fins.shape[1]))])
    if backend == "floats":
        columns = []
        for sizes, moving in zip(table.T.tolist(), motion.T.tolist(), strict=True):
            out = [0.0] * 6
            _drag(sizes, moving, out, 0, 1, 0.0)
            columns.append(out)
        return np.array(columns).T
    dtype, width = _layout(backend)
    flat = pack_rows(np.zeros((6, fins.shape[1])), dtype, width or 1)
    _compile(_drag, width)(
        pack_rows(table, dtype, width or 1), pack_rows(motion, dtype, width or 1), flat,
        flat.size // (6 * (width or 1)),
    )  # fmt: skip
    return flat.reshape(6, -1)[:, : fins.shape[1]].astype(np.float64)


def _layout(backend: str) -> tuple[type[np.floating], int]:
    """Return a compiled backend's type and how many numbers it holds, 0 for plain numbers."""
    if backend == "numba":
        return np.float64, 0
    dtype = np.dtype(backend).type
    return dtype, lane_width(dtype)
