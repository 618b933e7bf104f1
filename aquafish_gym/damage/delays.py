"""Delay lines: channels that deliver numbers late, or seldom."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.utils.array_types import Rows

Numbers = NDArray[Any]
STEP_ROUNDING = 1e-9  # of a step: what rounding may take from a count of steps

#: Steps by which a channel may be late: what it is given in all of them is kept.
MAXIMUM_DELAY_STEPS = 10_000


def delay_steps(seconds: ArrayLike, dt: float) -> NDArray[np.int64]:
    """Return delays in s as whole steps of ``dt`` s, the nearest ones."""
    steps: NDArray[np.int64] = np.floor(np.asarray(seconds) / dt + 0.5).astype(np.int64)
    return steps


class DelayLines:
    """The delay lines of B robots, C channels each.

    A channel first samples and holds, then delays: with a hold of p steps it takes the number of
    the first step at or after each multiple of p steps since the hold began, and repeats it in
    between; with a delay of d steps it delivers the number of d steps before. ``update`` sets both;
    all channels deliver at once at first.

    Parameters
    ----------
    count, channels
        B and C.
    dtype
        Of the numbers.
    first
        (C,) what a delayed channel delivers before the first number arrives; None is the episode's
        first number.
    """

    def __init__(
        self, count: int, channels: int, dtype: Any = np.float64, first: ArrayLike | None = None
    ) -> None:
        self.active = False  #: Whether any channel ever was or will be late or slow.
        self._first = first
        self._delay = np.zeros((count, channels), np.int64)
        self._hold = np.zeros((count, channels))
        self._count = np.zeros(count, np.int64)  # numbers of the episode that came
        self._began = np.zeros((count, channels), np.int64)  # the count at which the hold began
        self._kept = np.zeros((count, channels), dtype)  # the last numbers that were taken
        # The numbers of the last D steps: that with the count n stands in entry n % D.
        self._past = np.zeros((1, count, channels), dtype)
        self._channels = np.arange(channels)

    def reset(self, rows: Rows) -> None:
        """Forget the numbers of these robots: an episode begins, and all deliver at once."""
        self._count[rows] = self._delay[rows] = 0
        self._hold[rows] = 0.0

    def remember(self, steps: int) -> None:
        """Keep the numbers of this many steps, for a delay that comes later in an episode."""
        missing = steps + 1 - len(self._past)
        if steps <= 0:
            return
        self.active = True
        if missing <= 0:
            return
        depth = len(self._past)
        robots = np.arange(len(self._count))
        # By age, youngest first; what is older than all that was kept is the oldest of it.
        by_age = [self._past[(self._count - 1 - age) % depth, robots] for age in range(depth)]
        by_age += [by_age[-1]] * missing
        grown = np.empty((depth + missing, *self._past.shape[1:]), self._past.dtype)
        for age, numbers in enumerate(by_age):
            grown[(self._count - 1 - age) % len(grown), robots] = numbers
        self._past = grown

    def update(self, rows: Rows, delay: ArrayLike, hold: ArrayLike) -> None:
        """Set delays and holds (n, C) of the robots ``rows`` (n,), in steps; 0 is none."""
        delays, holds = np.asarray(delay), np.asarray(hold)
        if not self.active and not delays.any() and not holds.any():
            return
        self.active = True
        self.remember(int(delays.max(initial=0)))
        fresh = holds != self._hold[rows]
        self._began[rows] = np.where(fresh, self._count[rows, None], self._began[rows])
        self._delay[rows], self._hold[rows] = delays, holds

    def carry(self, numbers: Numbers, rows: Rows) -> Numbers:
        """Take a step's numbers (n, C) of the robots ``rows``, and return what is delivered."""
        if not self.active:
            return numbers
        count, hold = self._count[rows, None], self._hold[rows]
        held = hold > 0.0
        if held.any():
            since, period = count - self._began[rows], np.where(held, hold, 1.0)
            turn, before = (np.floor((since - back) / period + STEP_ROUNDING) for back in (0, 1))
            numbers = np.where(held & (turn == before), self._kept[rows], numbers)
        self._kept[rows] = numbers
        depth = len(self._past)
        begins = count[:, 0] == 0
        if begins.any():
            self._past[:, rows[begins]] = numbers[begins] if self._first is None else self._first
        self._past[count[:, 0] % depth, rows] = numbers
        self._count[rows] += 1
        delivered: Numbers = self._past[
            (count - self._delay[rows]) % depth, rows[:, None], self._channels
        ]
        return delivered


def longest(delays: ArrayLike, dt: float) -> int:
    """Return the longest of delays in s, in steps of ``dt`` s."""
    return math.floor(float(np.max(delays, initial=0.0)) / dt + 0.5)
