"""State that a closed loop keeps per robot between control steps, and its observations.

An episode's numbers stand in a flat array of one register's robots, row r in entry r; those of the
fins come after the others, and then the rows of the policy's own memory. The functions are
straight-line code for any scalar backend (``physics/arithmetic.py``).
"""

from __future__ import annotations

from itertools import accumulate
from typing import Any

from aquafish_gym.physics import simd
from aquafish_gym.physics.arithmetic import (
    Number,
    Vector,
    clip,
    fetch,
    put,
    where_less,
)
from aquafish_gym.physics.kinematics import State, has_diverged
from aquafish_gym.physics.layout import (
    fetch_vector,
    put_vector,
)
from aquafish_gym.sense import GYRO_RANGE, faulty, up_and_north

_SIZES = {
    "before": 3,  # where the robot was when the control step began, units
    "memory": 6,  # the task's
    "total": 1,  # the sum of the rewards
    "alive": 1,  # 1 until the robot diverges, then 0
    "terms": 3,  # of the reward of an action
    # Of the nine channels of the inertial measurement unit:
    "observed": 9,  # what they say now
    "latched": 9,  # what they said when they got stuck
    "bias": 9,
    "fresh": 9,  # 1 where a channel gets stuck with the next observation
    "stuck": 9,  # 1 where it is stuck
    "dropped": 9,  # 1 where it says 0
}
_FIRST = list(accumulate(_SIZES.values(), initial=0))
EPISODE_FIELDS: dict[str, slice] = dict(zip(_SIZES, map(slice, _FIRST, _FIRST[1:]), strict=True))
EPISODE_FIELDS["acted"] = slice(EPISODE_FIELDS["alive"].start, EPISODE_FIELDS["terms"].stop)
# The first row of each.
BEFORE_ROW = EPISODE_FIELDS["before"].start
MEMORY_ROW = EPISODE_FIELDS["memory"].start
TERMS_ROW = EPISODE_FIELDS["terms"].start
TOTAL_ROW = EPISODE_FIELDS["total"].start
ALIVE_ROW = EPISODE_FIELDS["alive"].start
OBSERVED_ROW = EPISODE_FIELDS["observed"].start
LATCHED_ROW = EPISODE_FIELDS["latched"].start
BIAS_ROW = EPISODE_FIELDS["bias"].start
FRESH_ROW = EPISODE_FIELDS["fresh"].start
STUCK_ROW = EPISODE_FIELDS["stuck"].start
DROPPED_ROW = EPISODE_FIELDS["dropped"].start
EPISODE_ROWS = _FIRST[-1]  # without those of the fins
OBSERVED_CHANNELS = _SIZES["observed"]
MEMORY_NUMBERS = _SIZES["memory"]  # of every task, so that a memory is read by index
_FIRST_OF_GYRO = 6
# Of each fin:
_OF_FINS = (
    "fins",  # where the controller believes it to be, in turns
    "gain",  # by which factor it believes its servo to be faster than commanded
    "action",  # of the control step, in [-1, 1]
)


def episode_fields(fins: int) -> dict[str, slice]:
    """Return the rows of each field, for a number of fins."""
    ends = range(EPISODE_ROWS, EPISODE_ROWS + (len(_OF_FINS) + 1) * fins, fins)
    return EPISODE_FIELDS | dict(zip(_OF_FINS, map(slice, ends, ends[1:]), strict=True))


def fetch_memory(rows: Any, like: Number) -> tuple[Number, ...]:
    """Read the task's memory."""
    x, y, z = fetch_vector(rows, MEMORY_ROW, 0, 1, like)
    u, v, w = fetch_vector(rows, MEMORY_ROW + 3, 0, 1, like)
    return (x, y, z, u, v, w)


def put_memory(rows: Any, memory: tuple[Number, ...]) -> None:
    """Write the task's memory."""
    put_vector(rows, MEMORY_ROW, 0, 1, (memory[0], memory[1], memory[2]))
    put_vector(rows, MEMORY_ROW + 3, 0, 1, (memory[3], memory[4], memory[5]))


def sensed(
    rows: Any,
    noise: Any,
    broken: bool,
    step: int,
    first: bool,
    up: Vector,
    north: Vector,
    gyro: Vector,
) -> tuple[Vector, Vector, Vector]:
    """Return up, north and gyro as the sensors observe them: ``transmit.sense`` in any arithmetic.

    ``noise`` has three rows for each control step, or none; ``first`` is whether this is the first
    observation since sensors changed.
    """
    if not broken:
        return up, north, gyro
    like = gyro[0]
    put_vector(rows, OBSERVED_ROW, 0, 1, up)
    put_vector(rows, OBSERVED_ROW + 3, 0, 1, north)
    put_vector(rows, OBSERVED_ROW + 6, 0, 1, gyro)
    fresh = 1.0 if first else 0.0
    for i in range(OBSERVED_CHANNELS):
        x = fetch(rows, OBSERVED_ROW + i, like) + fetch(rows, BIAS_ROW + i, like)
        if i >= _FIRST_OF_GYRO and noise.size > 0:
            x = x + fetch(noise, 3 * step + i - _FIRST_OF_GYRO, like)
        x = clip(x, 1.0 if i < _FIRST_OF_GYRO else GYRO_RANGE)
        x, latched = faulty(
            x,
            fetch(rows, LATCHED_ROW + i, like),
            fresh * fetch(rows, FRESH_ROW + i, like),
            fetch(rows, STUCK_ROW + i, like),
            fetch(rows, DROPPED_ROW + i, like),
        )
        put(rows, LATCHED_ROW + i, latched)
        put(rows, OBSERVED_ROW + i, x)
    return (
        fetch_vector(rows, OBSERVED_ROW, 0, 1, like),
        fetch_vector(rows, OBSERVED_ROW + 3, 0, 1, like),
        fetch_vector(rows, OBSERVED_ROW + 6, 0, 1, like),
    )


def note_divergence(rows: Any, state: State) -> None:
    """Note whether the robot diverged."""
    alive = fetch(rows, ALIVE_ROW, state.spin[0])
    put(rows, ALIVE_ROW, where_less(0.0, has_diverged(state), 0.0, alive))


def some_diverged(rows: Any, width: int, like: Number) -> bool:
    """Return whether any of a register's robots diverged in an action."""
    first, count = ALIVE_ROW * width + simd.first_lane(like), simd.lanes_here(like)
    alive = 0
    for entry in range(first, first + count):
        alive += int(rows[entry])
    return bool(alive < count)


def kept(lost: Number, before: Vector, after: Vector) -> Vector:
    """Return the numbers before an action of robots that diverged in it, else those after it."""
    return (
        where_less(0.0, lost, before[0], after[0]),
        where_less(0.0, lost, before[1], after[1]),
        where_less(0.0, lost, before[2], after[2]),
    )


def note_observation(rows: Any, state: State) -> None:
    """Write what intact sensors observe."""
    up, north = up_and_north(state.orientation)
    for i in range(3):
        put(rows, OBSERVED_ROW + i, clip(up[i], 1.0))
        put(rows, OBSERVED_ROW + 3 + i, clip(north[i], 1.0))
        put(rows, OBSERVED_ROW + 6 + i, clip(state.spin[i], GYRO_RANGE))


def put_terms(rows: Any, terms: tuple[Number, ...], like: Number) -> None:
    """Write the terms of an action's reward, 0 of robots that diverged."""
    alive = fetch(rows, ALIVE_ROW, like)
    for k in range(len(terms)):
        put(rows, TERMS_ROW + k, where_less(0.0, alive, terms[k], 0.0 * like))


def note_reward(rows: Any, terms: tuple[Number, ...], like: Number) -> None:
    """Add the terms of a reward, unless the robot has diverged."""
    alive = fetch(rows, ALIVE_ROW, like)
    total = fetch(rows, TOTAL_ROW, like)
    reward = 0.0 * like
    for term in terms:
        reward = reward + term
    put(rows, TOTAL_ROW, where_less(0.0, alive, total + reward, total))
