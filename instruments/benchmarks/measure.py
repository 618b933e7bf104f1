"""Timing a group's rows in turn."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import cast

from instruments.benchmarks.rows import Group, Row

LEAST_SECONDS = 0.1  # a short call is repeated for so long in each turn


@dataclass(frozen=True)
class Timing:
    """A row and the seconds that a call of it took, turn by turn."""

    row: Row
    seconds: tuple[float, ...]

    @property
    def rate(self) -> float:
        """Units a second, of the best turn, or of the median one if the row wants that."""
        return self.median_rate if self.row.typical else self.row.amount / min(self.seconds)

    @property
    def median_rate(self) -> float:
        """Units a second of the median turn."""
        return self.row.amount / median(self.seconds)


def measure(
    group: Group,
    turns: int,
    least_seconds: float = LEAST_SECONDS,
    tick: Callable[[], None] = lambda: None,
) -> list[Timing]:
    """Time every row of a group ``turns`` times, one row after another in every turn.

    Parameters
    ----------
    group
        Whose rows.
    turns
        How many for each row that does not ask for fewer.
    least_seconds
        How long a row's turn lasts at least, by repeating its call.
    tick
        Called after each row's warm-up and after each of its turns: ``(turns + 1)`` times a row.
    """
    repeats = []
    for row in group.rows:
        repeats.append(1 if row.own_clock else _warm_up(row, least_seconds))
        tick()
    seconds: list[list[float]] = [[] for _ in group.rows]
    for turn in range(turns):
        for row, times, found in zip(group.rows, repeats, seconds, strict=True):
            if row.most_turns is None or turn < row.most_turns:
                found.append(_time(row, times))
            tick()
    return [Timing(row, tuple(s)) for row, s in zip(group.rows, seconds, strict=True)]


def _warm_up(row: Row, least_seconds: float) -> int:
    """Compile, fill the caches, and return how often to call the row in a turn."""
    row.call()
    return max(1, round(least_seconds / _time(row, 1)))


def _time(row: Row, repeats: int) -> float:
    """Return how long one call takes, over some in a row."""
    if row.own_clock:
        return cast(float, row.call())
    call = row.call
    start = time.perf_counter()
    for _ in range(repeats):
        call()
    return (time.perf_counter() - start) / repeats
