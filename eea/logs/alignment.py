"""Columns of a log's streams on one clock.

Rows are those of one stream, the sensor. What another stream commands is held from each of its rows
to the next, and averaged over the time from a sensor's row to the next. Nothing is matched by row.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import InvalidArgumentError, brief, one_of
from eea.core.angles import Floats
from eea.logs.cells import TIME_UNITS
from eea.logs.columns import (
    TIME,
    Quantity,
    Term,
    found_columns,
    found_term,
    named_columns,
    time_unit,
    unit_size,
)
from eea.logs.streams import Recording, Stream

RECORDER_CLOCK = "log_time"
ROUNDED_DIGITS = 3  # of a time in s that is given or shown
CLOCKS_AGREE_SECONDS = 0.05  # between the delays of streams from their stamp to the recorder
#: A command's stream has a hole if it is silent for more of its usual steps than this.
SILENT_STEPS = 3.0


class Aligned(NamedTuple):
    """Quantities at the times of the sensor's rows."""

    time: Floats  #: (T,), s.
    values: dict[str, Floats]  #: Quantity -> (T, columns), in its first unit.
    remarks: list[str]  #: Sentences on what was done.


def align(
    recording: Recording,
    quantities: Mapping[str, Quantity],
    columns: Mapping[str, str],
    between: tuple[float, float] | None,
    longest_gap: float,
) -> Aligned:
    """Return the quantities of a log at the rows of the first one that is not held.

    Parameters
    ----------
    recording
        The streams.
    quantities
        What is wanted; the first is the sensor's.
    columns
        Quantity or ``time``, or one of them with ``:UNIT`` -> columns, joined by commas; each is
        ``NAME``, ``-NAME``, or ``FACTOR*NAME+OFFSET``. Quantities that are left out have the
        columns of their own names.
    between
        The part to take, s after the sensor's first row; None for all.
    longest_gap
        The longest time between two rows of the sensor, s, and of a command without its next.

    Raises
    ------
    InvalidArgumentError
        If a column is missing, in another unit, without numbers or on another clock, or a stream
        has a hole or goes back in time. The message says what to do.
    """
    named = named_columns(columns, [TIME, *quantities])
    if TIME not in named and not any(stream.clocks for stream in recording.streams):
        found_term(recording, TIME, TIME, False)
    terms: dict[str, list[Term]] = {}
    units: dict[str, str | None] = {}
    for name, quantity in quantities.items():
        unit, texts = named.get(name, (None, quantity.columns))
        if name not in named and quantity.optional and not found_columns(recording, texts[0]):
            continue
        if len(texts) != len(quantity.columns):
            raise InvalidArgumentError(
                f"map: {name} must have {len(quantity.columns)} columns, joined by commas; got "
                f"{brief(','.join(texts))}"
            )
        terms[name] = [found_term(recording, name, text, name in named) for text in texts]
        units[name] = unit
    sensor = terms[next(iter(quantities))][0].stream
    for name, each in terms.items():
        if not quantities[name].held and any(term.stream is not sensor for term in each):
            raise InvalidArgumentError(
                f"map: the columns of {name} must be of one stream, {sensor.name}, since each "
                "stream has its own times; got "
                f"{brief(', '.join(term.stream.full_name(term.column) for term in each))}"
            )
    streams = {term.stream.name: term.stream for each in terms.values() for term in each}
    times, remarks = _times(recording, sensor, list(streams.values()), named.get(TIME))
    values = {
        name: unit_size(name, quantities[name], units[name], each)
        * np.stack([term.values(quantities[name].advice) for term in each], axis=1)
        for name, each in terms.items()
    }
    time = times[sensor.name]
    if not len(time):
        raise InvalidArgumentError(
            f"{TIME} must have at least one row; {sensor.name or 'it'} has none"
        )
    kept = np.ones(len(time), dtype=np.bool_)
    if sensor.clocks or TIME in named:  # times since 1970, or since the computer's start
        time = time - time[0]
        times = {name: each - times[sensor.name][0] for name, each in times.items()}
    if between is not None:
        begin, end = between
        since = (time - time[0]).round(ROUNDED_DIGITS)
        kept &= (since >= begin) & (since <= end)
        if not kept.any():
            raise InvalidArgumentError(
                f"between must have rows of {sensor.name or 'the log'}, which lasts "
                f"{_short(float(np.ptp(time)))} s; got {between[0]:g} to {between[1]:g}"
            )
    for name, stream in streams.items():
        if stream is not sensor and kept.any():
            kept &= _known(stream, times[name], time, kept, longest_gap, remarks)
    if not kept.any():
        raise InvalidArgumentError(
            f"the streams {', '.join(streams)} must overlap in time; no row of {sensor.name} has "
            "a command: do their clocks differ?"
        )
    if sensor.clocks:
        own = np.column_stack([time, *(v for n, v in values.items() if not quantities[n].held)])
        copies = np.append(False, (own[1:] == own[:-1]).all(axis=1)) & kept
        if copies.any():
            remarks.append(f"{copies.sum()} rows of {sensor.name} were written twice: one is used")
            kept &= ~copies
        _refuse_holes(sensor.name, time[kept], longest_gap)
    for name, each in terms.items():
        if each[0].stream is sensor:
            values[name] = values[name][kept]
        else:
            values[name] = held_means(time[kept], times[each[0].stream.name], values[name])
    return Aligned(time[kept], values, remarks)


def held_means(at: Floats, time: Floats, values: Floats) -> Floats:
    """Return the mean (T, K) of held values from each time ``at`` (T,) to the next.

    Parameters
    ----------
    at
        Times, increasing, none before the first of ``time``; the last has the value held there.
    time, values
        (C,) and (C, K): each value holds until the next time.

    Examples
    --------
    >>> held_means(np.array([0.0, 0.1, 0.2]), np.array([0.0, 0.15]), np.array([[1.0], [3.0]]))
    array([[1.],
           [2.],
           [3.]])
    """
    index = np.searchsorted(time, at, "right") - 1
    until = np.searchsorted(time, at[1:], "left") - 1
    change = np.append(0, np.cumsum((np.diff(values, axis=0) != 0.0).any(axis=1)))
    before = np.zeros(values.shape)
    before[1:] = np.cumsum(values[:-1] * np.diff(time)[:, None], axis=0)
    passed = before[index] + values[index] * (at - time[index])[:, None]
    steps = np.diff(at)[:, None]
    means = np.divide(np.diff(passed, axis=0), steps, out=values[index[:-1]], where=steps > 0.0)
    means = np.clip(means, values.min(axis=0), values.max(axis=0))  # against rounding
    steady = change[index[:-1]] == change[np.maximum(until, index[:-1])]
    found: Floats = values[index]
    found[:-1] = np.where(steady[:, None], found[:-1], means)
    return found


def _times(
    recording: Recording,
    sensor: Stream,
    streams: list[Stream],
    given: tuple[str | None, list[str]] | None,
) -> tuple[dict[str, Floats], list[str]]:
    """Return the times of each stream, s, on one clock."""
    unit, texts = given or (None, [])
    if len(texts) > 1:
        raise InvalidArgumentError(f"map: time must be one column; got {brief(','.join(texts))}")
    if unit is not None and time_unit(unit) is None:
        one_of("map: the unit of time", unit, TIME_UNITS)
    if texts:
        found = found_columns(recording, texts[0])
        if not found:
            found_term(recording, TIME, texts[0], True)  # names the nearest column
            raise InvalidArgumentError(f"map: time must be a column; got {brief(texts[0])}")
        if len(found) == 1 and found[0][0].name not in (stream.name for stream in streams):
            used = ", ".join(stream.name for stream in streams)
            raise InvalidArgumentError(
                f"map: time must be a column of {used}, which are used; got {brief(texts[0])}"
            )
        clock = found[0][1]
        lacking = [stream.name for stream in streams if clock not in stream.columns]
        if lacking:
            raise InvalidArgumentError(
                f"map: time must be a column of each stream that is used; {lacking[0]} has no "
                f"{clock}"
            )
    elif sensor.clocks:
        common = [one for one in sensor.clocks if all(one in each.clocks for each in streams)]
        if not common:
            raise InvalidArgumentError(
                f"the streams {', '.join(each.name for each in streams)} must have a clock in "
                "common, which --map time=COLUMN names"
            )
        clock = common[0]
    else:
        clock = found_term(recording, TIME, TIME, False).column
    times = {}
    for stream in streams:
        tick = stream.clocks.get(clock, time_unit(stream.units.get(clock, "")))
        given_tick = time_unit(unit or "")
        if unit is not None and tick not in (None, given_tick):
            raise InvalidArgumentError(f"map: {clock} is in ticks of {tick:g} s; got {unit}")
        times[stream.name] = stream.numbers(clock) * (tick or given_tick or 1.0)
    remarks = []
    if len(streams) > 1 or len(sensor.clocks) > 1:
        remarks.append(f"the times are those of {clock}")
    if clock != RECORDER_CLOCK and all(RECORDER_CLOCK in each.columns for each in streams):
        late = [
            float(np.median(each.numbers(RECORDER_CLOCK) - times[each.name])) for each in streams
        ]
        if max(late) - min(late) > CLOCKS_AGREE_SECONDS:
            raise InvalidArgumentError(
                f"the {clock} of {', '.join(times)} are of clocks that are "
                f"{_short(max(late) - min(late))} s apart; take the recorder's: --map "
                f"time={RECORDER_CLOCK}"
            )
    return times, remarks


def _known(
    stream: Stream,
    time: Floats,
    at: Floats,
    kept: NDArray[np.bool_],
    longest_gap: float,
    remarks: list[str],
) -> NDArray[np.bool_]:
    """Return at which times (T,) a stream's commands are known, and say how they are used."""
    if not len(time):
        raise InvalidArgumentError(f"{stream.name} must have rows; it has none")
    usual = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    longest = max(SILENT_STEPS * usual, longest_gap)
    inside = time[(time >= at[kept][0] - longest) & (time <= at[kept][-1])]
    _refuse_holes(stream.name, inside, longest)
    early = kept & (at < time[0])
    late = kept & (at > time[-1] + longest)
    for where, word in ((early, "first"), (late, "last")):
        if where.any():
            seconds = _short(float(np.ptp(at[where])))
            remarks.append(
                f"the {word} {seconds} s have no row of {stream.name}: they are left out"
            )
    rate = f"{1.0 / usual:.3g} rows a second" if np.isfinite(usual) and usual else "one row"
    remarks.append(
        f"{stream.name} has {rate}: its commands are held until its next row, and averaged from a "
        "reading to the next"
    )
    known: NDArray[np.bool_] = ~early & ~late
    return known


def _refuse_holes(name: str, time: Floats, longest: float) -> None:
    """Raise InvalidArgumentError for the first hole in a stream's times, or step back."""
    steps = np.diff(time)
    back = np.flatnonzero(steps < 0.0)
    holes = np.flatnonzero(steps > longest + 1e-9)
    if not len(back) and not len(holes):
        return
    row = int(min([*back[:1], *holes[:1]]))
    first = _short(float(time[row]))
    last = _short(float(time[row + 1]))
    begin = _short(float(time[0]))
    if steps[row] > 0.0:
        end = _short(float(time[-1]))
        raise InvalidArgumentError(
            f"{name} must have no hole of more than {longest:.3g} s; it has none of its rows from "
            f"{first} to {last} s: take a part, --between {begin} {first} or --between {last} {end}"
        )
    raise InvalidArgumentError(
        f"{name} must not go back in time; it goes from {first} to {last} s, as after a restart: "
        f"take the part before, --between {begin} {first}"
    )


def _short(seconds: float) -> str:
    return f"{seconds:.{ROUNDED_DIGITS}f}".rstrip("0").rstrip(".")
