"""The robot in other languages: its time step and its senses, printed from the functions here.

Each is straight-line code on flat arrays, for any scalar backend (``physics/printing.py``), and has
the same name and parameters in JavaScript and in C. The rows of ``state`` and ``robot`` are those
of ``physics/layout.py``; a state has no roll, pitch and yaw here. ``current`` is the water's
velocity in the world, units/s. ``command`` is what the servos do, in rev/s or Hz: if a servo has a
gain, the command times it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from aquafish_gym.physics import dynamics, reactive
from aquafish_gym.physics.arithmetic import TAU, clip, fetch, put, sine_cosine
from aquafish_gym.physics.kinematics import State, drive, resting
from aquafish_gym.physics.layout import (
    FIN_ROWS,
    fetch_vector,
    layout,
    put_fin,
    robot_of,
    state_numbers,
    state_of,
)
from aquafish_gym.physics.printing import JAVASCRIPT, Language, Traced, printed, trace
from aquafish_gym.physics.robot import box
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.sense import beyond_imu, imu, limits

CHANNELS_WITH_GOAL = len(limits(has_goal=True))
Function = Callable[..., None]


class RobotCode:
    """The functions of a plan's robot on flat arrays."""

    def __init__(self, plan: BodyPlan) -> None:
        self._plan = plan
        tables = layout(plan)
        fins = len(plan.fins)
        step = {
            "state": tables.state_numbers, "robot": tables.robot_rows, "current": 3, "command": fins
        }  # fmt: skip
        #: Each function with the lengths of its arrays.
        self.functions: dict[Function, dict[str, int]] = {
            self.robot_rows: {
                "sizes": len(plan.dimensions), "density": 1, "drag": 2, "robot": tables.robot_rows
            },
            self.start: {"fin_angles": fins, "state": tables.state_numbers},
            self.step: step,
            self.step_reactive: step,
            self.sense: {
                "state": tables.state_numbers, "goal": 3, "observation": CHANNELS_WITH_GOAL
            },
        }  # fmt: skip

    def robot_rows(self, sizes: Any, density: Any, drag: Any, robot: Any) -> None:
        """Set a robot's rows from its sizes, in the order of the plan's ``dimensions``.

        ``density`` (1,) is the fins', relative to the water's, and ``drag`` (2,) scales the drag of
        the fins and of the hull.
        """
        for fin, (width, length, thickness) in enumerate(self._plan.columns.tolist()):
            put_fin(
                robot, fin * FIN_ROWS, 0, 1,
                box(
                    self._plan.hull,
                    sizes[width], sizes[length], sizes[thickness], density[0], drag[0],
                ),
            )  # fmt: skip
        put(robot, len(self._plan.fins) * FIN_ROWS, drag[1])

    def start(self, fin_angles: Any, state: Any) -> None:
        """Set the state of a robot at rest, upright and facing +y.

        ``fin_angles`` (F,) are the fins' angles, or the phases of fins that sweep, rad.
        """
        joints = []
        for fin in range(len(self._plan.fins)):
            sine, cosine = sine_cosine(fetch(fin_angles, fin, 0.0) * (1 / TAU))
            joints += [cosine, sine]
        _put_state(state, resting(tuple(joints)))

    def step(self, state: Any, robot: Any, current: Any, command: Any) -> None:
        """Advance a state by 0.01 s."""
        self._advance(dynamics.step, state, robot, current, command)

    def step_reactive(self, state: Any, robot: Any, current: Any, command: Any) -> None:
        """Advance a state by 0.01 s, with the reactive terms."""
        self._advance(reactive.step_reactive, state, robot, current, command)

    def _advance(
        self, swim: Callable[..., State], state: Any, robot: Any, current: Any, command: Any
    ) -> None:
        by = drive([fetch(command, i, 0.0) for i in range(len(self._plan.fins))], TIMESTEP)
        water = fetch_vector(current, 0, 0, 1, 0.0)
        before = state_of(list(state))
        _put_state(state, swim(self._plan, robot_of(list(robot)), before, by, water, TIMESTEP))

    def sense(self, state: Any, goal: Any, observation: Any) -> None:
        """Set the channels of the IMU, then the way to a goal in world axes, units (``sense.py``).

        They are the world's up and north in body axes, the gyroscope in rad/s, and the way to the
        goal in body axes, each saturated.
        """
        now = state_of(list(state))
        channels = [clip(x, limit) for x, limit in zip(imu(now), limits().tolist(), strict=True)]
        channels += beyond_imu(now, goal=fetch_vector(goal, 0, 0, 1, 0.0))
        for i, x in enumerate(channels):
            put(observation, i, x)

    @cache  # noqa: B019  # of as many robots as there are plans
    def traced(self, function: Function) -> Traced:
        """Return one of ``functions`` as it runs on symbols."""
        return trace(function, **self.functions[function])

    def source(self, language: Language, *functions: Function, prefix: str = "") -> str:
        """Return some of ``functions``, or all, in a language; ``prefix`` begins their names."""
        return "\n".join(
            printed(prefix + function.__name__, self.traced(function), language)
            for function in functions or self.functions
        )

    def javascript(self, *functions: Function) -> str:
        """Return some of ``functions``, or all, in JavaScript: plain ones, without ``export``."""
        return self.source(JAVASCRIPT, *functions)


def _put_state(rows: Any, state: State) -> None:
    for row, number in enumerate(state_numbers(state)):
        put(rows, row, number)


@cache
def robot_code(plan: BodyPlan = AQUAFISH) -> RobotCode:
    """Return the functions of a plan's robot."""
    return RobotCode(plan)
