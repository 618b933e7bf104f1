"""The robot in other languages: its time step and its senses, printed from the functions here.

Each is straight-line code on flat arrays, for any scalar backend (``physics/printing.py``), and has
the same name and parameters in JavaScript and in C. The rows of ``state`` and ``robot`` are those
of ``physics/layout.py``; a state has no roll, pitch and yaw here. ``current`` is the water's
velocity in the world, units/s. ``command`` is what the servos do, in rev/s, rev/s and Hz: if a
servo has a gain, the command times it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from aquafish_gym.physics import dynamics, reactive
from aquafish_gym.physics.arithmetic import TAU, Number, clip, put, sine_cosine
from aquafish_gym.physics.kinematics import Pair, State, drive, resting
from aquafish_gym.physics.layout import (
    COLUMNS,
    FIN_ROWS,
    ROBOT_ROWS,
    STATE_NUMBERS,
    fetch_robot,
    fetch_state,
    fetch_vector,
    put_fin,
    put_state,
)
from aquafish_gym.physics.printing import JAVASCRIPT, Language, Traced, printed, trace
from aquafish_gym.physics.robot import box
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.sense import beyond_imu, imu, limits

_STEP = {"state": STATE_NUMBERS, "robot": ROBOT_ROWS, "current": 3, "command": 3}
CHANNELS_WITH_GOAL = len(limits(observe_fins=False, has_goal=True))


def robot_rows(sizes: Any, density: Any, drag: Any, robot: Any) -> None:
    """Set a robot's rows from its nine sizes, in the order of ``DIMENSIONS``.

    ``density`` (1,) is the fins', relative to the water's, and ``drag`` (2,) scales the drag of the
    fins and of the body.
    """
    for fin, (width, length, thickness) in enumerate(COLUMNS.tolist()):
        put_fin(
            robot, fin * FIN_ROWS, 0, 1,
            box(sizes[width], sizes[length], sizes[thickness], density[0], drag[0]),
        )  # fmt: skip
    put(robot, 3 * FIN_ROWS, drag[1])


def start(fin_angles: Any, state: Any) -> None:
    """Set the state of a robot at rest, upright and facing +y.

    ``fin_angles`` (3,) are the left and right pectoral angle and the caudal phase, rad.
    """
    put_state(state, 0, 1, resting(*map(_pair, fetch_vector(fin_angles, 0, 0, 1, 0.0))))


def _pair(angle: Number) -> Pair:
    sine, cosine = sine_cosine(angle * (1 / TAU))
    return cosine, sine


def step(state: Any, robot: Any, current: Any, command: Any) -> None:
    """Advance a state by 0.01 s."""
    _advance(dynamics.step, state, robot, current, command)


def step_reactive(state: Any, robot: Any, current: Any, command: Any) -> None:
    """Advance a state by 0.01 s, with the reactive terms."""
    _advance(reactive.step_reactive, state, robot, current, command)


def _advance(
    swim: Callable[..., State], state: Any, robot: Any, current: Any, command: Any
) -> None:
    before = fetch_state(state, 0, 1, 0.0)
    by = drive(fetch_vector(command, 0, 0, 1, 0.0), TIMESTEP)
    water = fetch_vector(current, 0, 0, 1, 0.0)
    put_state(state, 0, 1, swim(fetch_robot(robot, 0, 0, 1, 0.0), before, by, water, TIMESTEP))


def sense(state: Any, goal: Any, observation: Any) -> None:
    """Set the channels of the IMU, then the way to a goal in world axes and units (``sense.py``).

    They are the world's up and north in body axes, the gyroscope in rad/s, and the way to the goal
    in body axes, each saturated.
    """
    now = fetch_state(state, 0, 1, 0.0)
    most = limits(observe_fins=False, has_goal=False).tolist()
    channels = [clip(x, limit) for x, limit in zip(imu(now), most, strict=True)]
    channels += beyond_imu(now, goal=fetch_vector(goal, 0, 0, 1, 0.0))
    for i, x in enumerate(channels):
        put(observation, i, x)


# Each function with the lengths of its arrays.
FUNCTIONS: dict[Callable[..., None], dict[str, int]] = {
    robot_rows: {"sizes": 9, "density": 1, "drag": 2, "robot": ROBOT_ROWS},
    start: {"fin_angles": 3, "state": STATE_NUMBERS},
    step: _STEP,
    step_reactive: _STEP,
    sense: {"state": STATE_NUMBERS, "goal": 3, "observation": CHANNELS_WITH_GOAL},
}


@cache
def traced(function: Callable[..., None]) -> Traced:
    """Return one of ``FUNCTIONS`` as it runs on symbols."""
    return trace(function, **FUNCTIONS[function])


def source(language: Language, *functions: Callable[..., None], prefix: str = "") -> str:
    """Return some of ``FUNCTIONS``, or all, in a language; ``prefix`` begins their names."""
    return "\n".join(
        printed(prefix + function.__name__, traced(function), language)
        for function in functions or FUNCTIONS
    )


def javascript(*functions: Callable[..., None]) -> str:
    """Return some of ``FUNCTIONS``, or all, in JavaScript: plain functions, without ``export``."""
    return source(JAVASCRIPT, *functions)
