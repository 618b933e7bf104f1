"""The law of one plan: what runs, printed as straight-line code from the statement for any plan.

The lanes, PyBullet's push, plain floats and rows of arrays run these functions: one object each.
They take numbers and tuples of any scalar backend. A robot is the tuple of its rows, as of
``layout.py``.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

from aquafish_gym.physics import dynamics, kinematics, reactive
from aquafish_gym.physics.arithmetic import Number, Vector, where_less
from aquafish_gym.physics.hydrodynamics import body_drag
from aquafish_gym.physics.kinematics import Drive, Joints, Numbers, State, drive_like, state_like
from aquafish_gym.physics.layout import layout, robot_of, state_numbers, state_of
from aquafish_gym.physics.printing import rows_reader, rows_writer, straight_line
from aquafish_gym.plans import BodyPlan

_VECTOR = (0.0, 0.0, 0.0)


class Law:
    """The functions of a plan; ``dynamics.py``, ``reactive.py`` and ``kinematics.py`` state them.

    Readers are ``(rows, first, group, groups, like)`` and writers ``(rows, first, group, groups,
    values)``.
    """

    def __init__(self, plan: BodyPlan) -> None:
        self.plan = plan
        self._state, self._drive = state_like(plan), drive_like(plan)
        self._fins = (0.0,) * len(plan.fins)
        self._robot = (0.0,) * layout(plan).robot_rows
        self.fetch_fins: Callable[..., Numbers] = rows_reader(self._fins)
        self.put_fins: Callable[..., None] = rows_writer(self._fins)
        #: The cos and sin of each joint in turn.
        self.fetch_joints: Callable[..., Numbers] = rows_reader(self._state.joints)
        self.put_joints: Callable[..., None] = rows_writer(self._state.joints)
        self.fetch_robot: Callable[..., Numbers] = rows_reader(self._robot)
        #: Without roll, pitch and yaw.
        self.fetch_state: Callable[..., State] = rows_reader(self._state)
        self.put_state: Callable[..., None] = rows_writer(self._state)

    @cached_property
    def step(self) -> Callable[[Numbers, State, Drive, Vector, Number], State]:
        """Advance a robot's state by a drive in a current for a step of h seconds."""
        return self._step("step", dynamics.step)

    @cached_property
    def step_reactive(self) -> Callable[[Numbers, State, Drive, Vector, Number], State]:
        """Do a step with the reactive terms."""
        return self._step("step_reactive", reactive.step_reactive)

    def _step(self, name: str, stated: Callable[..., Any]) -> Callable[..., Any]:
        def step(robot: Numbers, *rest: Any) -> Any:
            return stated(self.plan, robot_of(robot), *rest)

        return straight_line(name, step, self._robot, self._state, self._drive, _VECTOR, 0.0)

    @cached_property
    def wrench(self) -> Callable[[Numbers, State, Drive, Vector, Number], dynamics.Wrench]:
        """The water's wrench on a robot in a state, in world axes; the drive is not used."""

        def wrench(robot: Numbers, state: State, _by: Drive, current: Vector, _h: Number) -> Any:
            return dynamics.wrench(self.plan, robot_of(robot), state, current)

        return straight_line("wrench", wrench, self._robot, self._state, self._drive, _VECTOR, 0.0)

    @cached_property
    def wrench_reactive(self) -> Callable[[Numbers, State, Drive, Vector, Number], dynamics.Wrench]:
        """The water's wrench with the reactive terms, over a step of h seconds."""
        return self._step("wrench_reactive", reactive.reactive_wrench)

    @cached_property
    def body_drag(self) -> Callable[[Vector, Vector], dynamics.Wrench]:
        """The water's wrench on hull and mounts, of the velocity and the spin, in body axes."""
        return straight_line("body_drag", partial(body_drag, self.plan), _VECTOR, _VECTOR)

    @cached_property
    def next_joints(self) -> Callable[[State, Drive, Number], Joints]:
        """Return the joints after a step of h seconds."""
        stated = partial(kinematics.next_joints, self.plan)
        return straight_line("next_joints", stated, self._state, self._drive, 0.0)

    @cached_property
    def driven(self) -> Callable[[Numbers, Numbers, Number], Drive]:
        """Return the drive of servos with gains that follow a command, for a step of h seconds."""

        def driven(gain: Numbers, command: Numbers, h: Number) -> Drive:
            return kinematics.drive([a * b for a, b in zip(gain, command, strict=True)], h)

        return straight_line("driven", driven, self._fins, self._fins, 0.0)

    @cached_property
    def joint_angles(self) -> Callable[[Numbers], Numbers]:
        """Return the angles or phases, rad, of a state's joints."""
        return straight_line("joint_angles", kinematics.joint_angles, self._state.joints)

    @cached_property
    def choose(self) -> Callable[[Number, State, State], State]:
        """Return the first state where a number is above 0, else the second."""

        def choose(number: Number, first: State, second: State) -> State:
            numbers = zip(state_numbers(first), state_numbers(second), strict=True)
            return state_of([where_less(0.0, number, a, b) for a, b in numbers])

        return straight_line("choose", choose, 0.0, self._state, self._state)


@functools.cache
def law(plan: BodyPlan) -> Law:
    """Return the law of a plan."""
    return Law(plan)
