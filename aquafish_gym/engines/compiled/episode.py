"""State that a closed loop keeps per robot between control steps, and its observations.

An episode's numbers stand in a flat array of one register's robots, row r in entry r; the rows of
the policy's own memory come after ``EPISODE_ROWS``. The functions are straight-line code for any
scalar backend (``physics/arithmetic.py``).
"""

from __future__ import annotations

from itertools import accumulate
from typing import Any

from aquafish_gym.command import reckon
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
    RPY,
    STATE_ROWS,
    fetch_state,
    fetch_vector,
    put_state,
    put_vector,
)
from aquafish_gym.sense import GYRO_RANGE, faulty, up_and_north

_SIZES = {
    "fins": 3,  # where the controller believes the fins to be, in turns
    "gain": 3,  # by which factor it believes each servo to be faster than commanded
    "before": 3,  # where the robot was when the control step began, units
    "action": 3,  # of the control step, in [-1, 1]
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
RECKONED_ROW = EPISODE_FIELDS["fins"].start
GAIN_ROW = EPISODE_FIELDS["gain"].start
BEFORE_ROW = EPISODE_FIELDS["before"].start
ACTION_ROW = EPISODE_FIELDS["action"].start
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
EPISODE_ROWS = _FIRST[-1]
OBSERVED_CHANNELS = _SIZES["observed"]
MEMORY_NUMBERS = _SIZES["memory"]  # of every task, so that a memory is read by index
_FIRST_OF_GYRO = 6


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


def note_action(rows: Any, action: Vector, command: Vector, position: Vector, dt: float) -> None:
    """Store an action and its start position; dead-reckon the fin angles after it."""
    like = action[0]
    fins = fetch_vector(rows, RECKONED_ROW, 0, 1, like)
    gain = fetch_vector(rows, GAIN_ROW, 0, 1, like)
    speeds = (gain[0] * command[0], gain[1] * command[1], gain[2] * command[2])
    put_vector(rows, RECKONED_ROW, 0, 1, reckon(fins, speeds, dt))
    put_vector(rows, ACTION_ROW, 0, 1, action)
    put_vector(rows, BEFORE_ROW, 0, 1, position)


def note_divergence(rows: Any, state: State) -> None:
    """Note whether the robot diverged."""
    alive = fetch(rows, ALIVE_ROW, state.spin[0])
    put(rows, ALIVE_ROW, where_less(0.0, has_diverged(state), 0.0, alive))


def end_action(
    rows: Any, states: Any, group: int, groups: int, state: State, rpy: Vector, scratch: Any
) -> None:
    """Write the states after an action, who diverged in it, and what intact sensors observe.

    Robots that diverged stay in the state before. ``scratch`` is as long as a state.
    """
    like = rpy[0]
    lost = has_diverged(state)
    put(rows, ALIVE_ROW, 1.0 - lost)
    width = scratch.size // STATE_ROWS
    alive = 0
    for lane in range(ALIVE_ROW * width, (ALIVE_ROW + 1) * width):
        alive += int(rows[lane])
    if alive == width:  # mostly: the states before need not be read again
        put_state(states, group, groups, state)
        put_vector(states, RPY, group, groups, rpy)
    else:
        put_state(scratch, 0, 1, state)
        put_vector(scratch, RPY, 0, 1, rpy)
        for row in range(STATE_ROWS):
            i = row * groups + group
            before = fetch(states, i, like)
            put(states, i, where_less(0.0, lost, before, fetch(scratch, row, like)))
        state = fetch_state(states, group, groups, like)
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
