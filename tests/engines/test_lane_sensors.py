"""The lanes' sensors observe what the functions of all other sensors make of the truth."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym.damage.side import Side
from aquafish_gym.engines.compiled.episode import (
    BIAS_ROW,
    DROPPED_ROW,
    EPISODE_ROWS,
    FRESH_ROW,
    STUCK_ROW,
    sensed,
)
from aquafish_gym.scenario import CHANNELS, TIMESTEP
from aquafish_gym.sense import GYRO_RANGE, limits

STEPS = 6
COUNT = len(CHANNELS)
AXES = 3  # of the gyroscope
flags = st.lists(st.booleans(), min_size=COUNT, max_size=COUNT).map(np.array)


class Drawn:
    """Draws numbers that were drawn before."""

    def __init__(self, numbers: np.ndarray) -> None:
        self._numbers = list(numbers)

    def standard_normal(self, count: int) -> np.ndarray:
        found, self._numbers = self._numbers[:count], self._numbers[count:]
        return np.array(found)


@given(
    seed=st.integers(0, 2**32 - 1),
    changes=st.lists(st.tuples(flags, flags), min_size=1, max_size=3),
    noise=st.sampled_from([0.0, 0.3]),
)
@settings(max_examples=60, deadline=None)
def test_lanes_sense_as_the_functions_do(
    seed: int, changes: list[tuple[np.ndarray, np.ndarray]], noise: float
) -> None:
    """In each of some stages sensors are stuck or dropped; all have a bias, the gyroscope noise."""
    rng = np.random.default_rng(seed)
    bias = rng.normal(size=COUNT)
    most = limits()
    side, rows = Side(1, COUNT, TIMESTEP), np.zeros(1, np.intp)
    kept = np.zeros(EPISODE_ROWS)
    deviation = np.r_[np.zeros(COUNT - AXES), np.full(AXES, noise)]
    nothing = {"scale": np.ones((1, COUNT)), "delay": np.zeros((1, COUNT))}
    for stuck, dropped in changes:
        columns = {
            "bias": bias[None], "stuck": stuck[None], "dropped": dropped[None],
            "noise": deviation[None], "hold": nothing["delay"], **nothing,
        }  # fmt: skip
        before = kept[STUCK_ROW : STUCK_ROW + COUNT] > 0.0
        for row, values in (
            (BIAS_ROW, bias), (STUCK_ROW, stuck), (DROPPED_ROW, dropped),
            (FRESH_ROW, stuck & ~before),
        ):  # fmt: skip
            kept[row : row + COUNT] = values
        side.update(rows, columns)
        truth = rng.normal(size=(STEPS, COUNT)) * np.r_[np.full(6, 0.7), np.full(AXES, GYRO_RANGE)]
        white = rng.standard_normal((STEPS, AXES))
        drawn = Drawn(white.ravel() if noise else np.zeros(0))
        for step in range(STEPS):
            want = side.observe(truth[step][None], -most, most, [drawn], rows)[0]  # type: ignore[list-item]
            up, north, gyro = (tuple(part) for part in truth[step].reshape(3, 3).tolist())
            table = (noise * white).ravel() if noise else np.zeros(0)
            found = sensed(kept, table, True, step, step == 0, up, north, gyro)
            np.testing.assert_array_equal(np.concatenate(found), want)
