"""Open-loop policies of the compiled time loop: a command that is held, and a series of them.

They return a command in rev/s, rev/s and Hz:

    policy(weights, layout, group, groups, time, like) -> (left, right, caudal)

``weights`` is a flat table of the scalar backend's numbers, of which row r of the robots in group
``group`` of ``groups`` is entry ``r * groups + group``; ``layout`` is an int64 array, ``time`` a
float in s. ``like`` is any number of the backend.
"""

from __future__ import annotations

import math
from typing import Any

from aquafish_gym.physics.arithmetic import Number, Vector, add, fetch, scale, where_less
from aquafish_gym.physics.layout import fetch_vector
from aquafish_gym.scenario import TIMESTEP


def hold(weights: Any, _layout: Any, group: int, groups: int, _time: float, like: Number) -> Vector:
    """Hold the command in the three rows of ``weights``."""
    return fetch_vector(weights, 0, group, groups, like)


def _share(x: Any) -> Any:
    """Return x clipped to [0, 1]."""
    return where_less(x, 0.0, 0.0, where_less(x, 1.0, x, 1.0))


def _obeyed(
    weights: Any, layout: Any, group: int, groups: int, at: int, sample: int, late: Any
) -> Vector:
    """Return what command ``at`` of a series contributes to the servos' speed in a sample."""
    count, held = layout[0], layout[1]
    share = _share(float(sample + 1 - at * held) - late)
    if at < count - 1:
        share = share - _share(float(sample + 1 - (at + 1) * held) - late)
    return scale(share, fetch_vector(weights, 3 * at, group, groups, late))


def perform(
    weights: Any, layout: Any, group: int, groups: int, time: float, like: Number
) -> Vector:
    """Perform a series of commands, each held for some samples, the last to the end.

    ``layout`` holds the number of commands, the samples that each is held, the samples of the
    series that passed before the first step, and how many commands before the present one may
    still be obeyed. ``weights`` has three rows for each command, in turn, and one more: the
    servos' lag in samples. In a sample in which one command follows another, the servos turn at
    the mean of the two, weighted by time, so that their angles are continuous in the lag.
    """
    late = fetch(weights, 3 * layout[0] * groups + group, like)
    sample = math.floor(time / TIMESTEP + 0.5) + layout[2]
    newest = min(sample // layout[1], layout[0] - 1)
    total = _obeyed(weights, layout, group, groups, newest, sample, late)
    for at in range(newest - 1, max(newest - layout[3], 0) - 1, -1):
        total = add(total, _obeyed(weights, layout, group, groups, at, sample, late))
    return total


OPEN_LOOP = (hold, perform)
