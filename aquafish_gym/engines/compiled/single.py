"""One robot, compiled: the lanes' loop at width one, without what only batches need.

An environment of one robot takes a few steps at a time, so that a call's overhead costs as much as
its steps. The whole robot is therefore one flat array: numba unpacks one argument, and the loop
runs on plain float64, on the same physics as the lanes, to the same bits.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from aquafish_gym.engines.worlds import World
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.compiling import compiled, register, source_stamp
from aquafish_gym.physics.dynamics import step
from aquafish_gym.physics.kinematics import State, drive, has_diverged
from aquafish_gym.physics.layout import (
    ROBOT_ROWS,
    STATE_NUMBERS,
    angles_of_rows,
    fetch_robot,
    fetch_state,
    fetch_vector,
    put_state,
    robot_parameters,
    start_rows,
    state_from_numbers,
)
from aquafish_gym.physics.reactive import step_reactive
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Triple

# Where things stand in the array: the state, the robot, and the current.
STATE_ENTRIES = slice(0, STATE_NUMBERS)
ROBOT_ENTRIES = slice(STATE_ENTRIES.stop, STATE_ENTRIES.stop + ROBOT_ROWS)
CURRENT_ENTRIES = slice(ROBOT_ENTRIES.stop, ROBOT_ENTRIES.stop + 3)
TOTAL_NUMBERS = CURRENT_ENTRIES.stop

_FIRST_OF_ROBOT, _FIRST_OF_CURRENT = ROBOT_ENTRIES.start, CURRENT_ENTRIES.start


@functools.cache
def compile_single(reactive: bool = False) -> Any:
    """Return the compiled loop; compilation itself is lazy.

    It is ``(v, left, right, caudal, steps, h) -> well``: hold a command (rev/s, rev/s, Hz) for
    some steps of ``h`` seconds; return whether the robot has not diverged.
    """
    register()
    stamp = source_stamp(compile_single)
    swim = step_reactive if reactive else step

    def advance(v: Any, left: float, right: float, caudal: float, steps: int, h: float) -> bool:
        stamp  # noqa: B018  # part of the cache's key; see source_stamp
        robot = fetch_robot(v, _FIRST_OF_ROBOT, 0, 1, 0.0)
        current = fetch_vector(v, _FIRST_OF_CURRENT, 0, 1, 0.0)
        by = drive((left, right, caudal), h)
        state = fetch_state(v, 0, 1, 0.0)
        for _ in range(steps):
            state = swim(robot, state, by, current, h)
        put_state(v, 0, 1, state)
        return bool(has_diverged(state) == 0.0)

    # Division by zero is infinity, as in the lanes, and no exception.
    return compiled(advance, slow=True, nogil=True, error_model="numpy")


class CompiledWorld(World):
    """One robot on the compiled engine, in double precision: the robot of the lanes.

    Unlike PyBullet's it can be pickled, copied and carried across a fork.
    """

    def __init__(self, substeps: int = 1) -> None:
        self._substeps = substeps
        # The whole robot. No views of it are kept: a copy's would show the original.
        self._numbers = np.zeros(TOTAL_NUMBERS)
        self._gains = (1.0, 1.0, 1.0)
        self._reactive = False

    def _start(self, scenario: Scenario) -> None:
        start = start_rows(scenario.fin_angles, scenario.velocity, scenario.spin)
        self._numbers[STATE_ENTRIES] = start[STATE_ENTRIES, 0]
        self._reactive = scenario.reactive
        self.diverged = False
        self._update(scenario)

    def _update(self, scenario: Scenario) -> None:
        self._numbers[ROBOT_ENTRIES] = robot_parameters(
            scenario.body, scenario.drag, scenario.fin_density
        )[:, 0]
        self._numbers[CURRENT_ENTRIES] = scenario.current[0]
        left, right, caudal = scenario.servo_gain[0].tolist()
        self._gains = (left, right, caudal)

    def set_current(self, current: Triple) -> None:
        self._numbers[CURRENT_ENTRIES] = current

    def _swim(self, command: Vector, steps: int) -> None:
        (left, right, caudal), (a, b, c) = command, self._gains
        swim = compile_single(self._reactive)
        h, count = TIMESTEP / self._substeps, steps * self._substeps
        self.diverged = not swim(self._numbers, a * left, b * right, c * caudal, count, h)

    def state(self) -> State:
        return state_from_numbers(self._numbers.tolist())

    @property
    def fin_angles(self) -> Vector:
        left, right, phase = angles_of_rows(self._numbers).tolist()
        return (left, right, phase)

    def close(self) -> None:
        """Do nothing: there is nothing to free."""
