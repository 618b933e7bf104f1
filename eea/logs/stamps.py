"""Repair of a log's stamps: the times when rows were taken, and rows with new readings.

A stamp may be the time of a packet's arrival: rows follow each other closely, and then comes a
wait. A driver may repeat a reading until the next one. Neither shows in a single row; both show in
many.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.angles import Floats

BUNCH_GAP_RATIO = 2.5  # ratio of a step between bunches to its shorter neighbour
LONGEST_BUNCH_WAITS = 2.0  # longest bunch, as a multiple of the wait
PACKET_BUNCH_WAITS = 0.5  # bunches above this multiple of the wait are nearly even
FEWEST_BUNCHES = 4  # least number of bunches in a row
FEWEST_ROWS_PER_BUNCH = 1.5  # rows per bunch, on average
# Rows that are missing by chance leave steps of one tick, two, three ..., each this share of the
# ones before or more: the share of rows that are lost. Packets have hardly any of three ticks.
LEAST_THINNED_SHARE = 0.1
TICK_TOLERANCE = 0.25  # of a tick, for a step of whole ticks; most steps are
MOST_TICKS = 1000
# quantile of a signal's squared changes, which selects the fastest motion
FAST_MOTION_QUANTILE = 0.9
# Packets are missing if most of this number in a row are late; a single one may be late.
LASTING_BUNCHES = 9
STALE_JUMP_QUANTA = 4.0  # a repeated reading is stale if the next differs by more


class Bunches(NamedTuple):
    """A stretch of a trial whose times come in bunches. Rows count from the trial's first."""

    starts: NDArray[np.intp]  #: The first row of each bunch.
    last: int  #: The last row of the last bunch.
    #: Whether the stamps of the rows matter little: bunches are nearly as long as the waits, or
    #: the waits are shorter than the resolution.
    loose: bool

    @property
    def first(self) -> int:
        """The first row of the first bunch."""
        return int(self.starts[0])


def bunches_of(time: Floats, resolution: float) -> list[Bunches]:
    """Return the stretches of a trial's times (T,), s, that come in bunches.

    Neither a gap nor a change of rate makes bunches, nor do rows of an even clock of which some are
    lost. A wait of at most half the ``resolution``, s, such as a simulator's step, does not count.

    Examples
    --------
    >>> row = np.arange(60)
    >>> packets = 0.01 * (row - row % 3) + 1e-4 * (row % 3)
    >>> [found.starts[:4].tolist() for found in bunches_of(packets, 0.01)]
    [[0, 3, 6, 9]]
    >>> bunches_of(np.concatenate([0.001 * row, 0.06 + 0.02 * row]), 0.01)
    []
    """
    steps = np.diff(time)
    near = np.minimum(np.append(np.inf, steps[:-1]), np.append(steps[1:], np.inf))
    waits = np.flatnonzero((steps > BUNCH_GAP_RATIO * near) & (steps > 0.5 * resolution))
    if len(waits) < FEWEST_BUNCHES - 1 or _thinned(steps):
        return []
    starts = np.append(0, waits + 1)
    ends = np.append(waits, len(time) - 1)
    wait = np.minimum(np.append(np.inf, steps[waits]), np.append(steps[waits], np.inf))
    length = time[ends] - time[starts]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], length < LONGEST_BUNCH_WAITS * wait, [0]])))
    found = []
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        rows = ends[end - 1] + 1 - starts[begin]
        if end - begin >= FEWEST_BUNCHES and rows >= FEWEST_ROWS_PER_BUNCH * (end - begin):
            long = np.median(length[begin:end] / wait[begin:end]) > PACKET_BUNCH_WAITS
            loose = bool(long or np.median(wait[begin:end]) < resolution)
            found.append(Bunches(starts[begin:end], int(ends[end - 1]), loose))
    return found


def _thinned(steps: Floats) -> bool:
    """Return whether steps between rows are those of an even clock that lost rows by chance."""
    shortest = np.quantile(steps, 0.1, method="lower")
    if shortest <= 0.0:
        return False
    tick = np.median(steps[np.abs(steps - shortest) < 0.5 * shortest])
    ticks = steps / tick
    whole = np.rint(ticks)
    if np.mean(np.abs(ticks - whole) < TICK_TOLERANCE) < 0.95:
        return False
    counts = np.bincount(whole.clip(0, MOST_TICKS).astype(np.intp), minlength=5)
    fewer = counts[2:4] >= LEAST_THINNED_SHARE * counts[1:3]
    return bool(fewer.all() and counts[4:].max() <= counts[2])


def even_times(
    time: Floats,
    signal: Floats,
    resolution: float,
    longest_gap: float,
    name: Callable[[Bunches], str],
) -> tuple[Floats, list[str]]:
    """Return even times where rows were stamped on arrival in packets, and sentences on them.

    Bunches of times are packets if the signal changes as much between the rows of a bunch as from
    one bunch to the next. Otherwise the rows were sampled in bunches, and stay as they are.

    Parameters
    ----------
    time, signal
        (T,), s, increasing, and (T, channels).
    resolution
        Shorter times do not matter, s.
    longest_gap
        A shorter stretch whose signal does not show which case it is stays as it is, s.
    name
        What a message calls a stretch.

    Raises
    ------
    InvalidArgumentError
        If the signal does not show which case it is, or packets are missing.
    """
    found_times = time.copy()
    said = []
    for found in bunches_of(time, resolution):
        place = name(found)
        if not _arrived(found, time, signal, longest_gap, place):
            continue
        even = _even(found, time, resolution)
        if even is None:
            raise InvalidArgumentError(
                f"{place}: the times come in bunches, as of packets stamped on arrival, and "
                "packets are missing or late; restamp the rows evenly, as they were sampled"
            )
        found_times[found.first : found.last + 1] = even
        said.append(
            f"{place}: the times come in bunches, as of packets stamped on arrival; the rows "
            f"are taken as evenly sampled, every {np.diff(even).mean():.4g} s"
        )
    return found_times, said


def _arrived(found: Bunches, time: Floats, readings: Floats, longest_gap: float, name: str) -> bool:
    """Return whether bunches come from arrivals of packets, not from sampling.

    The change over a whole bunch and its wait is as large in either case. It must exceed the change
    from row to row by a ratio that is larger for fewer bunches.
    """
    own = slice(found.first, found.last + 1)
    signal = readings[own]
    size = (found.last + 1 - found.first) / len(found.starts)
    changes = (np.diff(signal, axis=0) ** 2).sum(axis=1)
    waits = np.zeros(len(changes), dtype=np.bool_)
    waits[found.starts[1:] - found.first - 1] = True
    apart = max(1, round(size))
    over = ((signal[apart:] - signal[:-apart]) ** 2).sum(axis=1)
    inside, between, whole = (
        np.quantile(x, FAST_MOTION_QUANTILE) for x in (changes[~waits], changes[waits], over)
    )
    if whole > (1.0 + 40.0 / len(found.starts)) * inside:
        return bool(between < np.sqrt(inside * whole))
    if found.loose or time[own].max() - time[own].min() < longest_gap:
        return False
    raise InvalidArgumentError(
        f"{name}: the times come in bunches, and the motion does not show whether the rows were "
        "sampled so or stamped on arrival in packets; restamp the rows evenly, as they were "
        "sampled, or keep one row of each bunch"
    )


def _even(found: Bunches, time: Floats, resolution: float) -> Floats | None:
    """Return even times of the rows in bunches, or None if no even clock explains the bunches.

    The last row of a bunch was sampled when the bunch arrived, up to a constant delay.
    """
    arrived = time[found.starts] - time[found.first]
    ends = np.append(found.starts[1:] - 1, found.last) - found.first
    pace, begun = np.polyfit(ends[:-1], arrived[:-1], 1)  # the last bunch may be incomplete
    late = arrived[:-1] - (begun + pace * ends[:-1])
    some = min(LASTING_BUNCHES, len(late))
    lasting = np.median(np.lib.stride_tricks.sliding_window_view(late, some), axis=1)
    if np.abs(lasting).max() > 0.5 * max(pace, resolution):
        return None
    even = time[found.first] + begun + pace * np.arange(found.last + 1 - found.first)
    before = time[found.first - 1] if found.first else -np.inf
    after = time[found.last + 1] if found.last + 1 < len(time) else np.inf
    return even if before < even[0] and even[-1] < after else None


def new_rows(signal: Floats, rests: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the rows (T,) of a signal (T, channels) in which a driver does not repeat its last.

    The channels of a moving sensor do not first stay equal, up to its resolution, and then jump.
    Rows before the first motion, or in which the robot ``rests`` (T,), may be equal. All rows are
    new if the repetitions are only the sensor's resolution.
    """
    steps = np.abs(np.diff(signal, axis=0))
    same = (steps == 0.0).all(axis=1)
    quantum = np.where(steps > 0.0, steps, np.inf).min(axis=0, initial=np.inf)
    starts = np.flatnonzero(np.append(True, ~same))
    lengths = np.diff(np.append(starts, len(signal)))
    still = rests[starts] | (starts == 0)
    moving = (lengths[:-1] > 1) & ~still[:-1]
    jumps = (np.abs(signal[starts[1:]] - signal[starts[:-1]]) > STALE_JUMP_QUANTA * quantum).any(
        axis=1
    )
    if 2 * (moving & jumps).sum() <= moving.sum():
        return np.ones(len(signal), np.bool_)
    longest = int(lengths[:-1][moving & jumps].max())
    kept: NDArray[np.bool_] = np.append(True, ~same)
    kept |= np.repeat(still & (lengths > longest), lengths)
    return kept
