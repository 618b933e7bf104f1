"""Open-loop policies of the compiled time loop: a command or an action that is held, and a series.

They return a command in rev/s, rev/s and Hz:

    policy(weights, layout, group, groups, time, like) -> (left, right, caudal)

``weights`` is a flat table of the scalar backend's numbers, of which row r of the robots in group
``group`` of ``groups`` is entry ``r * groups + group``; ``layout`` is an int64 array, ``time`` a
float in s. ``like`` is any number of the backend.
"""

from __future__ import annotations

import math
from typing import Any

from aquafish_gym.command import servo_speeds
from aquafish_gym.physics.arithmetic import Number, Vector
from aquafish_gym.physics.layout import fetch_vector
from aquafish_gym.scenario import TIMESTEP


def hold(weights: Any, _layout: Any, group: int, groups: int, _time: float, like: Number) -> Vector:
    """Hold the command in the three rows of ``weights``."""
    return fetch_vector(weights, 0, group, groups, like)


def perform(
    weights: Any, layout: Any, group: int, groups: int, time: float, like: Number
) -> Vector:
    """Perform a series of commands, each held for some steps, the last to the end.

    ``layout`` holds the number of commands, the steps that each is held, and the steps of the
    series that passed before the first one. ``weights`` has three rows for each command, in turn.
    """
    step = math.floor(time / TIMESTEP + 0.5) + layout[2]
    command = min(step // layout[1], layout[0] - 1)
    return fetch_vector(weights, 3 * command, group, groups, like)


def act(weights: Any, _layout: Any, group: int, groups: int, _time: float, like: Number) -> Vector:
    """Follow the action in the first three rows of ``weights``.

    It may be late. The action that the task judges is in the next three rows.
    """
    return servo_speeds(fetch_vector(weights, 0, group, groups, like))


OPEN_LOOP = (hold, perform, act)
