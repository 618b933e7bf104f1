"""State that a closed loop keeps per robot between control steps, and its observations.

An episode's numbers stand in a flat array of one register's robots, row r in entry r; the rows of
the policy's own memory come after ``ROWS``. The functions are straight-line code for any scalar
backend (``physics/arithmetic.py``).
"""

from __future__ import annotations

from itertools import accumulate
from typing import Any

from aquafish_gym.command import reckon
from aquafish_gym.engines.worlds import RUNAWAY
from aquafish_gym.physics.arithmetic import (
    Number,
    Vector,
    clip,
    dot,
    fetch,
    put,
    where_less,
)
from aquafish_gym.physics.layout import fetch_vector, put_vector
from aquafish_gym.sense import GYRO_RANGE, faulty

_SIZES = {
    "fins": 3,  # where the controller believes the fins to be, in turns
    "gain": 3,  # by which factor it believes each servo to be faster than commanded
    "before": 3,  # where the robot was when the control step began, units
    "action": 3,  # of the control step, in [-1, 1]
    "memory": 6,  # the task's
    "total": 1,  # the sum of the rewards
    "alive": 1,  # 1 until the robot diverges, then 0
    # Of the nine channels of the inertial measurement unit:
    "observed": 9,  # what they say now
    "held": 9,  # what they said when they got stuck
    "bias": 9,
    "fresh": 9,  # 1 where a channel gets stuck with the next observation
    "stuck": 9,  # 1 where it is stuck
    "dropped": 9,  # 1 where it says 0
}
_FIRST = list(accumulate(_SIZES.values(), initial=0))
FIELDS: dict[str, slice] = dict(zip(_SIZES, map(slice, _FIRST, _FIRST[1:]), strict=True))
FINS, GAIN, BEFORE, ACTION, MEMORY, TOTAL, ALIVE, OBSERVED, HELD = _FIRST[:9]
BIAS, FRESH, STUCK, DROPPED, ROWS = _FIRST[9:]
CHANNELS = _SIZES["observed"]
_FIRST_OF_GYRO = 6


def fetch_memory(kept: Any, like: Number) -> tuple[Number, ...]:
    """Read the task's memory."""
    x, y, z = fetch_vector(kept, MEMORY, 0, 1, like)
    u, v, w = fetch_vector(kept, MEMORY + 3, 0, 1, like)
    return (x, y, z, u, v, w)


def put_memory(kept: Any, memory: tuple[Number, ...]) -> None:
    """Write the task's memory."""
    put_vector(kept, MEMORY, 0, 1, (memory[0], memory[1], memory[2]))
    put_vector(kept, MEMORY + 3, 0, 1, (memory[3], memory[4], memory[5]))


def sensed(
    kept: Any,
    noise: Any,
    broken: bool,
    step: int,
    first: bool,
    up: Vector,
    north: Vector,
    gyro: Vector,
) -> tuple[Vector, Vector, Vector]:
    """Return up, north and gyro as the sensors observe them: ``Sensors.observe`` in any arithmetic.

    ``noise`` has three rows for each control step, or none; ``first`` is whether this is the first
    observation since sensors changed.
    """
    if not broken:
        return up, north, gyro
    like = gyro[0]
    put_vector(kept, OBSERVED, 0, 1, up)
    put_vector(kept, OBSERVED + 3, 0, 1, north)
    put_vector(kept, OBSERVED + 6, 0, 1, gyro)
    fresh = 1.0 if first else 0.0
    for i in range(CHANNELS):
        x = fetch(kept, OBSERVED + i, like) + fetch(kept, BIAS + i, like)
        if i >= _FIRST_OF_GYRO and noise.size > 0:
            x = x + fetch(noise, 3 * step + i - _FIRST_OF_GYRO, like)
        x = clip(x, 1.0 if i < _FIRST_OF_GYRO else GYRO_RANGE)
        x, held = faulty(
            x,
            fetch(kept, HELD + i, like),
            fresh * fetch(kept, FRESH + i, like),
            fetch(kept, STUCK + i, like),
            fetch(kept, DROPPED + i, like),
        )
        put(kept, HELD + i, held)
        put(kept, OBSERVED + i, x)
    return (
        fetch_vector(kept, OBSERVED, 0, 1, like),
        fetch_vector(kept, OBSERVED + 3, 0, 1, like),
        fetch_vector(kept, OBSERVED + 6, 0, 1, like),
    )


def note_action(kept: Any, action: Vector, command: Vector, position: Vector, dt: float) -> None:
    """Keep an action and where it begins, and reckon the fins at its end by the believed gains."""
    like = action[0]
    fins, gain = fetch_vector(kept, FINS, 0, 1, like), fetch_vector(kept, GAIN, 0, 1, like)
    speeds = (gain[0] * command[0], gain[1] * command[1], gain[2] * command[2])
    put_vector(kept, FINS, 0, 1, reckon(fins, speeds, dt))
    put_vector(kept, ACTION, 0, 1, action)
    put_vector(kept, BEFORE, 0, 1, position)


def note_reward(kept: Any, terms: tuple[Number, ...], velocity: Vector, spin: Vector) -> None:
    """Add the terms of a reward, unless the robot has diverged."""
    like = velocity[0]
    square = dot(velocity, velocity) + dot(spin, spin)
    alive = where_less(square, RUNAWAY, fetch(kept, ALIVE, like), 0.0)
    total = fetch(kept, TOTAL, like)
    reward = 0.0 * like
    for term in terms:
        reward = reward + term
    put(kept, TOTAL, where_less(0.0, alive, total + reward, total))
    put(kept, ALIVE, alive)
