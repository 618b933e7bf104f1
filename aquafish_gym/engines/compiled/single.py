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
from aquafish_gym.physics.compiling import compiled, register, register_functions, source_stamp
from aquafish_gym.physics.kinematics import Numbers, State, has_diverged
from aquafish_gym.physics.law import law
from aquafish_gym.physics.layout import fetch_vector, layout, state_of
from aquafish_gym.plans import BodyPlan
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Triple


@functools.cache
def compile_single(plan: BodyPlan, reactive: bool = False) -> Any:
    """Return the compiled loop of a plan; compilation itself is lazy.

    It is ``(v, gain, command, steps, h) -> well``: hold a command (rev/s or Hz) for some steps of
    ``h`` seconds; return whether the robot has not diverged. ``v`` is the whole robot: its state,
    its rows, and the current.
    """
    register()
    stamp = source_stamp(compile_single) + plan.to_json()
    of = law(plan)
    swim = of.step_reactive if reactive else of.step
    driven = of.driven
    fetch_robot = of.fetch_robot
    fetch_state = of.fetch_state
    put_state = of.put_state
    register_functions(swim, driven, fetch_robot, fetch_state, put_state)
    first_of_robot = layout(plan).state_numbers
    first_of_current = first_of_robot + layout(plan).robot_rows

    def advance(v: Any, gain: Any, command: Any, steps: int, h: float) -> bool:
        stamp  # noqa: B018  # part of the cache's key; see source_stamp
        robot = fetch_robot(v, first_of_robot, 0, 1, 0.0)
        current = fetch_vector(v, first_of_current, 0, 1, 0.0)
        by = driven(gain, command, h)
        state = fetch_state(v, 0, 0, 1, 0.0)
        for _ in range(steps):
            state = swim(robot, state, by, current, h)
        put_state(v, 0, 0, 1, state)
        return bool(has_diverged(state) == 0.0)

    # Division by zero is infinity, as in the lanes, and no exception.
    return compiled(advance, slow=True, nogil=True, error_model="numpy")


class CompiledWorld(World):
    """One robot on the compiled engine, in double precision: the robot of the lanes.

    Unlike PyBullet's it can be pickled, copied and carried across a fork.
    """

    def __init__(self, substeps: int = 1) -> None:
        self._substeps = substeps
        self._reactive = False

    def _start(self, scenario: Scenario) -> None:
        self._plan = scenario.plan
        self._layout = tables = layout(scenario.plan)
        numbers, robot = tables.state_numbers, tables.robot_rows
        # The whole robot. No views of it are kept: a copy's would show the original.
        self._numbers = np.zeros(numbers + robot + 3)
        self._state = slice(0, numbers)
        self._robot = slice(numbers, numbers + robot)
        self._current = slice(self._robot.stop, None)
        start = tables.start(scenario.fin_angles, scenario.velocity, scenario.spin)
        self._numbers[self._state] = start[self._state, 0]
        self._reactive = scenario.reactive
        self.diverged = False
        self._update(scenario)

    def _update(self, scenario: Scenario) -> None:
        robots = layout(scenario.plan).robots(scenario.body, scenario.drag, scenario.fin_density)
        self._numbers[self._robot] = robots[:, 0]
        self._numbers[self._current] = scenario.current[0]
        self._gains: Numbers = tuple(scenario.servo_gain[0].tolist())

    def set_current(self, current: Triple) -> None:
        self._numbers[self._current] = current

    def _swim(self, command: Numbers, steps: int) -> None:
        swim = compile_single(self._plan, self._reactive)
        h, count = TIMESTEP / self._substeps, steps * self._substeps
        self.diverged = not swim(self._numbers, self._gains, command, count, h)

    def state(self) -> State:
        return state_of(self._numbers[self._state].tolist())

    @property
    def fin_angles(self) -> Numbers:
        return tuple(self._layout.angles(self._numbers).tolist())

    def close(self) -> None:
        """Do nothing: there is nothing to free."""
