"""Quantities of a log on one clock.

A quantity has the rows of its stream in which its cells are not empty. Of several rates in a table
that was merged by time, each quantity thus has its own rows, as in a file of streams. What another
quantity commands is held from each of its rows to the next, and averaged over the time from a
sensor's row to the next. Nothing is matched by row.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import InvalidArgumentError, brief, one_of
from eea.core.angles import Floats
from eea.logs.columns import (
    TIME,
    TRIAL,
    Quantity,
    Term,
    found_columns,
    found_term,
    named_columns,
    time_columns,
    time_unit,
    unit_size,
)
from eea.logs.streams import TIME_UNITS, Recording, Stream

RECORDER_CLOCK = "log_time"
ROUNDED_DIGITS = 3  # of a time in s that is given or shown
CLOCKS_AGREE_SECONDS = 0.05  # between the delays of streams from their stamp to the recorder
#: Share of a stream's rows, and number, on either side of the moment at which its clock was set.
SET_SHARE = 0.05
SET_ROWS = 5
#: A command's stream has a hole if it is silent for more of its usual steps than this.
SILENT_STEPS = 3.0
MOST_TRIALS = 1000


class Series(NamedTuple):
    """A quantity at the rows that have it, T of them."""

    label: str  #: The stream, or the columns of a table.
    stream: Stream
    rows: NDArray[np.intp]  #: (T,), of the stream.
    time: Floats  #: (T,), s.
    values: Floats  #: (T, columns), in the quantity's first unit.

    @property
    def usual_step(self) -> float:
        """The median time between two rows, s; infinite for one row."""
        return float(np.median(np.diff(self.time))) if len(self.time) > 1 else np.inf

    @property
    def rate(self) -> str:
        """How many rows a second there are, in words."""
        if 0.0 < self.usual_step < np.inf:
            return f"{1.0 / self.usual_step:.3g} rows a second"
        return "one row" if len(self.time) == 1 else "rows at one time"

    def within(self, begin: float, end: float) -> NDArray[np.bool_]:
        """Return which rows (T,) are ``begin`` to ``end`` s after the first one.

        Raises
        ------
        InvalidArgumentError
            If none is.
        """
        since = (self.time - self.time[0]).round(ROUNDED_DIGITS)
        kept: NDArray[np.bool_] = (since >= begin) & (since <= end)
        if not kept.any():
            raise InvalidArgumentError(
                f"between must have rows of {self.stream.name or 'the log'}, which lasts "
                f"{_short(float(np.ptp(self.time)))} s; got {begin:g} to {end:g}"
            )
        return kept

    def held(self, begin: float, end: float) -> Floats:
        """Return the times (T,), s, with those of rows that do not hold in a part at its edges."""
        since = self.time[self.time <= begin].max(initial=self.time[0])
        return np.clip(self.time, since, max(since, end))

    def only(self, kept: NDArray[np.bool_]) -> Series:
        """Return some of the rows (T,)."""
        return self._replace(rows=self.rows[kept], time=self.time[kept], values=self.values[kept])


def locate(
    recording: Recording, quantities: Mapping[str, Quantity], columns: Mapping[str, str]
) -> tuple[dict[str, Series], list[str]]:
    """Return the quantities of a log on one clock, and sentences on the clock.

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

    Raises
    ------
    InvalidArgumentError
        If a column is missing, in another unit, without numbers or on another clock. The message
        says what to do.
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
            count = len(quantity.columns)
            wanted = "one column" if count == 1 else f"{count} columns, joined by commas"
            raise InvalidArgumentError(f"{name} must have {wanted}; got {brief(','.join(texts))}")
        terms[name] = [found_term(recording, name, text, name in named) for text in texts]
        units[name] = unit
        if any(term.stream is not terms[name][0].stream for term in terms[name]):
            raise _of_streams(name, terms[name][0].stream, terms[name])
    sensor = terms[next(iter(quantities))][0].stream
    for name, each in terms.items():
        if quantities[name].with_sensor and each[0].stream is not sensor:
            raise _of_streams(name, sensor, each)
    streams = {term.stream.name: term.stream for each in terms.values() for term in each}
    times, remarks = _times(recording, sensor, list(streams.values()), named.get(TIME))
    found = {}
    for name, each in terms.items():
        values = unit_size(name, quantities[name], units[name], each) * np.stack(
            [term.values(quantities[name].advice) for term in each], axis=1
        )
        stream = each[0].stream
        time = times[stream.name]
        if not len(time):
            raise InvalidArgumentError(
                f"{TIME} must have at least one row; {stream.name or 'it'} has none"
            )
        there = ~np.isnan(values).any(axis=1) & np.isfinite(time)
        label = stream.name or ", ".join(dict.fromkeys(term.column for term in each))
        if not there.any():
            raise InvalidArgumentError(f"{name} must have a row with a time and all of {label}")
        found[name] = Series(label, stream, np.flatnonzero(there), time[there], values[there])
    return found, remarks


def _of_streams(name: str, stream: Stream, terms: list[Term]) -> InvalidArgumentError:
    return InvalidArgumentError(
        f"the columns of {name} must be of one stream, {stream.name}, since each stream has its "
        f"own times; got {brief(', '.join(term.stream.full_name(term.column) for term in terms))}"
    )


def by_trial(recording: Recording, column: str | None) -> Iterator[Recording]:
    """Yield the rows of each trial of a table; its time may begin again in each.

    A file of streams, or without such a ``column`` of numbers, is one trial.
    """
    found = found_columns(recording, column) if column else []
    if len(recording.streams) == len(found) == 1 and not found[0][0].clocks:
        stream, name = found[0]
        cells = stream.columns[name]
        if cells.dtype != object:
            edges = np.flatnonzero(np.diff(cells)) + 1
            if len(edges) >= MOST_TRIALS:
                raise InvalidArgumentError(
                    f"{TRIAL} must have the rows of each trial in one block, and at most "
                    f"{MOST_TRIALS} trials; {name} changes {len(edges)} times"
                )
            for begin, end in pairwise([0, *edges.tolist(), len(cells)]):
                rows = slice(begin, end)
                own = {each: values[rows] for each, values in stream.columns.items()}
                yield replace(recording, streams=[replace(stream, columns=own)])
            return
    yield recording


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
    """Return the quantities of a log at the rows of the first one; the others are held.

    A table is read trial by trial, by the quantity ``trial``.

    Parameters
    ----------
    recording, quantities, columns
        See :func:`locate`.
    between
        The part to take, s after the sensor's first row; None for all.
    longest_gap
        The longest time between two rows of the sensor, s, and of a command without its next.

    Raises
    ------
    InvalidArgumentError
        As :func:`locate`, or if a stream has a hole or goes back in time. The message says what to
        do.
    """
    parts = []
    for part in by_trial(recording, columns.get(TRIAL, TRIAL if TRIAL in quantities else None)):
        series, remarks = locate(part, quantities, columns)
        sensor = next(iter(series.values()))
        if sensor.stream.clocks or any(name.partition(":")[0] == TIME for name in columns):
            # times since 1970, or since the computer's start
            begin = float(sensor.time[0])
            series = {name: one._replace(time=one.time - begin) for name, one in series.items()}
        parts.append(_aligned(series, between, longest_gap, remarks))
    return Aligned(
        np.concatenate([part.time for part in parts]),
        {name: np.concatenate([part.values[name] for part in parts]) for name in parts[0].values},
        list(dict.fromkeys(remark for part in parts for remark in part.remarks)),
    )


def _aligned(
    series: Mapping[str, Series],
    between: tuple[float, float] | None,
    longest_gap: float,
    remarks: list[str],
) -> Aligned:
    """Return one trial's series at the rows of the first one, and add to the remarks on them."""
    own, sensor = next(iter(series.items()))
    stream = sensor.stream
    time = sensor.time
    if len(time) < len(stream):
        remarks.append(
            f"{len(time)} of {len(stream)} rows of {stream.name or 'the table'} have "
            f"{own if stream.name else sensor.label}: the others are of other rates, or lack a "
            "reading"
        )
    kept = np.ones(len(time), np.bool_) if between is None else sensor.within(*between)
    used = {}
    seen = set()
    for name, one in series.items():
        of_reading = np.isin(one.rows, sensor.rows)
        rows = (one.stream.name, one.rows.tobytes())
        used[name] = one
        if one.stream is stream and of_reading.sum() == len(time):
            used[name] = one.only(of_reading)  # the mean until the next reading is its own value
        elif rows not in seen and kept.any():
            seen.add(rows)
            kept &= _known(one, time, kept, longest_gap, remarks)
    if not kept.any():
        labels = ", ".join(dict.fromkeys(one.label for one in series.values()))
        raise InvalidArgumentError(
            f"the streams {labels} must overlap in time; no row of {sensor.label} has a command: "
            "do their clocks differ?"
        )
    if stream.clocks:
        row = np.column_stack([time, sensor.values])
        copies = np.append(False, (row[1:] == row[:-1]).all(axis=1)) & kept
        if copies.any():
            remarks.append(f"{copies.sum()} rows of {stream.name} were written twice: one is used")
            kept &= ~copies
        refuse_holes(sensor, time[kept], longest_gap)
    values = {name: held_means(time[kept], one.time, one.values) for name, one in used.items()}
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
    steps = np.diff(at)[:, None]
    with np.errstate(over="ignore", invalid="ignore"):  # damaged numbers are refused by their place
        before[1:] = np.cumsum(values[:-1] * np.diff(time)[:, None], axis=0)
        passed = before[index] + values[index] * (at - time[index])[:, None]
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
        raise InvalidArgumentError(f"time must be one column; got {brief(','.join(texts))}")
    if unit is not None and time_unit(unit) is None:
        one_of("the unit of time", unit, TIME_UNITS)
    if texts:
        found = found_columns(recording, texts[0])
        if not found:
            found_term(recording, TIME, texts[0], True)  # names the nearest column
            raise InvalidArgumentError(f"time must be a column; got {brief(texts[0])}")
        if len(found) == 1 and found[0][0].name not in (stream.name for stream in streams):
            used = ", ".join(stream.name for stream in streams)
            raise InvalidArgumentError(
                f"time must be a column of {used}, which are used; got {brief(texts[0])}"
            )
        clock = found[0][1]
        lacking = [stream.name for stream in streams if clock not in stream.columns]
        if lacking:
            raise InvalidArgumentError(
                f"time must be a column of each stream that is used; {lacking[0]} has no {clock}"
            )
    elif sensor.clocks:
        common = [one for one in sensor.clocks if all(one in each.clocks for each in streams)]
        if not common:
            raise InvalidArgumentError(
                f"the streams {', '.join(each.name for each in streams)} must have a clock in "
                "common, which time=COLUMN names"
            )
        clock = common[0]
    else:
        clock = found_term(recording, TIME, TIME, False).column
    times = {}
    for stream in streams:
        tick = stream.clocks.get(clock, time_unit(stream.units.get(clock, "")))
        given_tick = time_unit(unit or "")
        if unit is not None and tick not in (None, given_tick):
            raise InvalidArgumentError(f"{clock} is in ticks of {tick:g} s; got {unit}")
        times[stream.name] = stream.numbers(clock) * (tick or given_tick or 1.0)
    remarks = []
    if len(streams) > 1 or len(sensor.clocks) > 1:
        remarks.append(f"the times are those of {clock}")
    if clock != RECORDER_CLOCK and all(RECORDER_CLOCK in each.columns for each in streams):
        for each in streams:
            _refuse_set_clock(each, clock, times[each.name])
        late = [
            float(np.nanmedian(each.numbers(RECORDER_CLOCK) - times[each.name])) for each in streams
        ]
        if max(late) - min(late) > CLOCKS_AGREE_SECONDS:
            raise InvalidArgumentError(
                f"the {clock} of {', '.join(times)} are of clocks that are "
                f"{_short(max(late) - min(late))} s apart; take the recorder's: "
                f"time={RECORDER_CLOCK}"
            )
    return times, remarks


def _refuse_set_clock(stream: Stream, clock: str, time: Floats) -> None:
    """Raise InvalidArgumentError if a stream's clock was set while the recorder's ran on.

    The shortest delay from a stamp to the recorder is then another from some row on. A delay may be
    long where a message had to wait, so neither the mean nor a single one tells.
    """
    late = stream.numbers(RECORDER_CLOCK) - time
    edge = max(SET_ROWS, int(SET_SHARE * len(late)))
    if len(late) < 2 * edge:
        return
    before = np.fmin.accumulate(late)[edge - 1 : len(late) - edge]
    after = np.fmin.accumulate(late[::-1])[::-1][edge : len(late) - edge + 1]
    apart = np.abs(before - after)
    if not apart.max() > CLOCKS_AGREE_SECONDS:
        return
    far = edge + np.flatnonzero(apart > 0.5 * apart.max())
    later = before[apart.argmax()] < after[apart.argmax()]
    row = int(far[0] if later else far[-1])
    moved = late[row - edge : row].min() - late[row : row + edge].min()
    if abs(moved) > CLOCKS_AGREE_SECONDS:  # otherwise it runs at another pace, a little
        raise InvalidArgumentError(
            f"the {clock} of {stream.name} was set while recording: at row {row + 1} it goes "
            f"{_short(abs(float(moved)))} s {'ahead' if moved > 0.0 else 'back'} of "
            f"{RECORDER_CLOCK}; take the recorder's: time={RECORDER_CLOCK}"
        )


def _known(
    one: Series,
    at: Floats,
    kept: NDArray[np.bool_],
    longest_gap: float,
    remarks: list[str],
) -> NDArray[np.bool_]:
    """Return at which times (T,) a series of commands is known, and say how it is used."""
    longest = max(SILENT_STEPS * one.usual_step, longest_gap)
    begin, end = known_part(one, float(at[kept][0]), float(at[kept][-1]), longest)
    known: NDArray[np.bool_] = (at >= begin) & (at <= end)
    for where, word in ((at < begin, "first"), (at > end, "last")):
        if (kept & where).any():
            seconds = _short(float(np.ptp(at[kept & where])))
            remarks.append(f"the {word} {seconds} s have no row of {one.label}: they are left out")
    remarks.append(
        f"{one.label} has {one.rate}: its commands are held until its next row, and averaged from "
        "a reading to the next"
    )
    return known


def known_part(one: Series, begin: float, end: float, longest: float) -> tuple[float, float]:
    """Return the part of a time, s, in which a series is known, each row for ``longest`` s.

    Raises
    ------
    InvalidArgumentError
        If it has a hole in that part, or goes back in time.
    """
    refuse_holes(one, one.held(begin, end), longest)
    return max(begin, float(one.time[0])), min(end, float(one.time[-1]) + longest)


def refuse_holes(one: Series, time: Floats, longest: float) -> None:
    """Raise InvalidArgumentError for the first hole in a series' times, s, or step back."""
    steps = np.diff(time)
    back = np.flatnonzero(steps < 0.0)
    holes = np.flatnonzero(steps > longest + 1e-9)
    if not len(back) and not len(holes):
        return
    row = int(min([*back[:1], *holes[:1]]))
    begin, first, last, end = (_short(float(time[place])) for place in (0, row, row + 1, -1))
    other = _steady_clock(one, longest)
    hint = f"; or take {other}, which runs on: time={other}" if other else ""
    if steps[row] > 0.0:
        parts = [f"between {a} and {b}" for a, b in ((begin, first), (last, end)) if a != b]
        raise InvalidArgumentError(
            f"{one.label} must have no hole of more than {longest:.3g} s; it has none of its rows "
            f"from {first} to {last} s: take a part, {' or '.join(parts)}{hint}"
        )
    raise InvalidArgumentError(
        f"{one.label} must not go back in time; it goes from {first} to {last} s, as after a "
        f"restart: take the part before, between {begin} and {first}{hint}"
    )


def _steady_clock(one: Series, longest: float) -> str | None:
    """Return a column of times without a step back or a hole in a series' rows, if there is one.

    The clock that has a hole is none of them.
    """
    for name, tick, _ in time_columns(one.stream):
        steps = np.diff(one.stream.numbers(name)[one.rows]) * tick
        if len(steps) and (steps >= 0.0).all() and steps.max() <= longest:
            return name
    return None


def _short(seconds: float) -> str:
    return f"{seconds:.{ROUNDED_DIGITS}f}".rstrip("0").rstrip(".")
