"""Repair of a log's stamps: rows with new readings, and the times when they were taken.

A stamp may be the time of a packet's arrival. A driver may repeat a reading until the next one.
Neither shows in a single row; both show in many.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.command import SERVOS
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.angles import Floats
from eea.fish.bunches import Bunches, bunches_of
from eea.fish.swim_log import GYRO_COLUMNS, LONGEST_GAP_SECONDS, SwimLog, shown

# quantile of a signal's squared changes, which selects the fastest motion
FAST_MOTION_QUANTILE = 0.9
# Packets are missing if most of this number in a row are late; a single one may be late.
LASTING_BUNCHES = 9
STALE_JUMP_QUANTA = 4.0  # a repeated reading is stale if the next differs by more


def restamped(log: SwimLog) -> tuple[SwimLog, list[str]]:
    """Return a log with even times where its rows were stamped on arrival in packets.

    Bunches of times are packets if the signal changes as much between the rows of a bunch as from
    one bunch to the next. Otherwise the rows were sampled in bunches, and stay as they are. Also
    return sentences on the changes.

    Raises
    ------
    InvalidArgumentError
        If the signal does not show which case it is, or packets are missing.
    """
    time = log.time.copy()
    said = []
    for index, rows in enumerate(log.blocks):
        for found in bunches_of(log.time[rows]):
            name = f"{log.name(index)}, rows {rows.start + found.first + 1} to "
            name += f"{rows.start + found.last + 1}"
            if not _arrived(found, log.time[rows], log.gyro[rows], name):
                continue
            even = _even(found, log.time[rows])
            if even is None:
                raise InvalidArgumentError(
                    f"{name}: the times come in bunches, as of packets stamped on arrival, and "
                    "packets are missing or late; restamp the rows evenly, as they were sampled"
                )
            time[rows.start + found.first : rows.start + found.last + 1] = even
            said.append(
                f"{name}: the times come in bunches, as of packets stamped on arrival; the rows "
                f"are taken as evenly sampled, every {np.diff(even).mean():.4g} s"
            )
    return (replace(log, time=time), said) if said else (log, said)


def _arrived(found: Bunches, time: Floats, gyro: Floats, name: str) -> bool:
    """Return whether bunches come from arrivals of packets, not from sampling.

    The change over a whole bunch and its wait is as large in either case. It must exceed the change
    from row to row by a ratio that is larger for fewer bunches.
    """
    own = slice(found.first, found.last + 1)
    signal = gyro[own]
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
    if found.loose or time[own].max() - time[own].min() < LONGEST_GAP_SECONDS:
        return False
    raise InvalidArgumentError(
        f"{name}: the times come in bunches, and the motion does not show whether the rows were "
        "sampled so or stamped on arrival in packets; restamp the rows evenly, as they were "
        "sampled, or keep one row of each bunch"
    )


def _even(found: Bunches, time: Floats) -> Floats | None:
    """Return even times of the rows in bunches, or None if no even clock explains the bunches.

    The last row of a bunch was sampled when the bunch arrived, up to a constant delay.
    """
    arrived = time[found.starts] - time[found.first]
    ends = np.append(found.starts[1:] - 1, found.last) - found.first
    pace, begun = np.polyfit(ends[:-1], arrived[:-1], 1)  # the last bunch may be incomplete
    late = arrived[:-1] - (begun + pace * ends[:-1])
    some = min(LASTING_BUNCHES, len(late))
    lasting = np.median(np.lib.stride_tricks.sliding_window_view(late, some), axis=1)
    if np.abs(lasting).max() > 0.5 * max(pace, TIMESTEP):
        return None
    even = time[found.first] + begun + pace * np.arange(found.last + 1 - found.first)
    before = time[found.first - 1] if found.first else -np.inf
    after = time[found.last + 1] if found.last + 1 < len(time) else np.inf
    return even if before < even[0] and even[-1] < after else None


class NewReadings(NamedTuple):
    """The rows of a trial that have a new reading."""

    rows: NDArray[np.intp]  #: Rows of the log.
    repeated: int  #: The number of rows left out.


def new_readings(log: SwimLog, index: int) -> NewReadings:
    """Return the rows of a trial without those in which a driver repeats its last reading.

    The three rates of a moving gyroscope do not first stay equal, up to its resolution, and then
    jump. Rows at rest, before the trial's first motion or without a command, may be equal.

    Raises
    ------
    InvalidArgumentError
        If the reading is repeated for more than 0.25 s while a servo moves.
    """
    block = log.blocks[index]
    gyro = log.gyro[block]
    rows = np.arange(block.start, block.stop)
    steps = np.abs(np.diff(gyro, axis=0))
    same = (steps == 0.0).all(axis=1)
    quantum = np.where(steps > 0.0, steps, np.inf).min(axis=0)
    starts = np.flatnonzero(np.append(True, ~same))
    lengths = np.diff(np.append(starts, len(gyro)))
    still = (log.commands[block][starts] == 0.0).all(axis=1) | (starts == 0)
    moving = (lengths[:-1] > 1) & ~still[:-1]
    jumps = (np.abs(gyro[starts[1:]] - gyro[starts[:-1]]) > STALE_JUMP_QUANTA * quantum).any(axis=1)
    # no repeated readings, or only the gyroscope's resolution
    if 2 * (moving & jumps).sum() <= moving.sum():
        return NewReadings(rows, 0)
    longest = int(lengths[:-1][moving & jumps].max())
    kept = np.append(True, ~same) | np.repeat(still & (lengths > longest), lengths)
    new = rows[kept]
    gaps = np.diff(log.time[new])
    if gaps.max() > LONGEST_GAP_SECONDS:
        last = int(np.argmax(gaps))
        raise InvalidArgumentError(
            f"row {new[last] + 2}: {', '.join(GYRO_COLUMNS)} must be new readings while "
            f"{', '.join(SERVOS)} move; they repeat the row before for {shown(gaps[last])} s: "
            "leave those rows out and make what follows another trial"
        )
    return NewReadings(new, len(rows) - len(new))
