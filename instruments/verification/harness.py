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
from numpy.typing import NDArray

from aquafish_gym.engines.compiled.lanes import lane_width, pack_rows
from aquafish_gym.physics import compiling, simd
from aquafish_gym.physics.arithmetic import Vector, add
from aquafish_gym.physics.dynamics import Water, forces, move, wrench
from aquafish_gym.physics.hydrodynamics import fin_drag
from aquafish_gym.physics.kinematics import Drive, State, drive_like, state_like
from aquafish_gym.physics.law import law
from aquafish_gym.physics.layout import (
    FIELDS,
    FIN_ROWS,
    fetch_vector,
    layout,
    put_vector,
    robot_of,
)
from aquafish_gym.physics.printing import rows_reader, straight_line
from aquafish_gym.physics.robot import Fin, robot_like
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.utils.validation import one_of

Array = NDArray[np.float64]

BACKENDS = ("floats", "numba", "float64", "float32")
# Rows of a table of states, as ``Layout.start`` makes them.
QUATERNION, POSITION, VELOCITY, SPIN = (
    FIELDS[name] for name in ("orientation", "position", "velocity", "spin")
)
_fetch_fin = rows_reader(Fin(0.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0), 0.0))


@functools.cache
def _pushed_step(plan: BodyPlan, wet: bool) -> Callable[..., State]:
    """Return a step in which a force pushes the hull, with or without water."""
    none = (0.0, 0.0, 0.0)
    dry = Water(((none, none),) * len(plan.fins), (none, none))

    def step(numbers: Any, state: State, by: Drive, current: Vector, push: Vector, h: Any) -> State:
        robot = robot_of(numbers)
        water = forces(plan, robot, state, current) if wet else dry
        force, torque = water.body
        pushed = water._replace(body=(add(force, push), torque))
        return move(plan, robot, state, by, pushed, h)

    robot = (0.0,) * layout(plan).robot_rows
    return straight_line(
        "pushed_step", step, robot, state_like(plan), drive_like(plan), none, none, 0.0
    )


@functools.cache
def _marcher(plan: BodyPlan, wet: bool) -> tuple[Callable[..., None], list[Callable[..., Any]]]:
    """Return the function that advances one group, on floats or compiled, and what it calls."""
    of, step = law(plan), _pushed_step(plan, wet)
    fetch_robot, fetch_state, put_state = of.fetch_robot, of.fetch_state, of.put_state
    fetch_fins, driven = of.fetch_fins, of.driven
    whole = (1.0,) * len(plan.fins)

    def march(
        parameters: Any, states: Any, commands: Any, current: Vector, push: Vector, h: float,
        steps: int, group: int, groups: int, zero: Any,
    ) -> None:  # fmt: skip
        robot = fetch_robot(parameters, 0, group, groups, zero)
        state = fetch_state(states, 0, group, groups, zero)
        by = driven(whole, fetch_fins(commands, 0, group, groups, zero), h)
        for _ in range(steps):
            state = step(robot, state, by, current, push, h)
        put_state(states, 0, group, groups, state)

    return march, [step, fetch_robot, fetch_state, put_state, fetch_fins, driven, march]


def _drag(fins: Any, motion: Any, out: Any, group: int, groups: int, zero: Any) -> None:
    force, torque = fin_drag(
        _fetch_fin(fins, 0, group, groups, zero),
        fetch_vector(motion, 0, group, groups, zero),
        fetch_vector(motion, 3, group, groups, zero),
    )
    put_vector(out, 0, group, groups, force)
    put_vector(out, 3, group, groups, torque)


@functools.cache
def _compiled_march(plan: BodyPlan, wet: bool, width: int) -> Any:
    """Return the loop over all groups, compiled; a width of 0 stands for plain numbers."""
    compiling.register()
    function, called = _marcher(plan, wet)
    compiling.register_functions(*called)
    stamp = compiling.source_stamp(_compiled_march) + plan.to_json()

    def march(
        parameters: Any, states: Any, commands: Any, current: Vector, push: Vector, h: float,
        steps: int, groups: int,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  # part of the cache's key; see compiling.source_stamp
        for group in range(groups):
            zero = simd.zero_lanes(parameters, width) if width else 0.0
            function(parameters, states, commands, current, push, h, steps, group, groups, zero)

    return compiling.compiled(march)


@functools.cache
def _compiled_drag(width: int) -> Any:
    """Return the drag of all groups, compiled; a width of 0 stands for plain numbers."""
    compiling.register()
    compiling.register_functions(_fetch_fin, _drag)
    stamp = compiling.source_stamp(_drag)

    def drag(fins: Any, motion: Any, out: Any, groups: int) -> None:
        stamp  # noqa: B018
        for group in range(groups):
            zero = simd.zero_lanes(fins, width) if width else 0.0
            _drag(fins, motion, out, group, groups, zero)

    return compiling.compiled(drag)


@functools.cache
def compiled_wrench(plan: BodyPlan = AQUAFISH) -> Any:
    """Return the law's wrench compiled for one robot on plain floats: (robot, state, current)."""
    compiling.register()
    templates = robot_like(plan), state_like(plan), (0.0, 0.0, 0.0)
    stated = straight_line("wrench", functools.partial(wrench, plan), *templates)
    compiling.register_functions(stated)
    stamp = compiling.source_stamp() + plan.to_json()

    def call(robot: Any, state: State, current: Vector) -> Any:
        stamp  # noqa: B018  # part of the cache's key; see compiling.source_stamp
        return stated(robot, state, current)

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
    plan: BodyPlan = AQUAFISH,
) -> Array:
    """Return the states (N, B) of B robots after some steps.

    Parameters
    ----------
    backend
        One of ``BACKENDS``.
    morphologies
        (B, S) sizes.
    states
        (N, B) as ``Layout.start`` makes them; left as they are.
    commands
        (B, F) rev/s or Hz.
    h, steps
        Length, s, and number of the steps.
    current
        The water's velocity in the world, units/s.
    push
        A force on the hull's centre, in body axes.
    wet
        False leaves the water out.
    plan
        Of all robots.
    """
    one_of("backend", backend, BACKENDS)
    tables = layout(plan)
    parameters, batch = tables.robots(morphologies), len(morphologies)
    if backend == "floats":
        one, _ = _marcher(plan, wet)
        rows = [[float(x) for x in column] for column in states.T]
        for b, row in enumerate(rows):
            one(
                [float(x) for x in parameters[:, b]], row, [float(x) for x in commands[b]],
                current, push, h, steps, 0, 1, 0.0,
            )  # fmt: skip
        return np.array(rows).T
    dtype, width = _layout(backend)
    flat = pack_rows(states, dtype, width or 1)
    groups = flat.size // (tables.state_rows * (width or 1))
    _compiled_march(plan, wet, width)(
        pack_rows(parameters, dtype, width or 1), flat, pack_rows(commands.T, dtype, width or 1),
        current, push, h, steps, groups,
    )  # fmt: skip
    return flat.reshape(tables.state_rows, -1)[:, :batch].astype(np.float64)


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
    _compiled_drag(width)(
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
