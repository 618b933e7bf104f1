"""What a log holds, in lines: streams, rates, holes, stamps, clocks, and guesses at the columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import one_of
from eea.core.angles import Floats
from eea.logs.columns import commands, gyroscopes, time_columns
from eea.logs.streams import Recording, Stream

HOLE_STEPS = 3.0  # usual steps between two rows, in a hole
FEWEST_STEADY = 0.5  # share of a stream's steps that are near the usual one, if it has a rate
OTHER_CLOCK_SECONDS = 600.0  # a stream that begins so much earlier than most has another clock
#: Columns of a table have a rate of their own if at most this share of its rows has them.
MERGED_SHARE = 0.9
MOST_MERGED = 20  # rates; in a table with more, cells are missing at random
MOST_COMMANDS = 12  # names in the line of commands
FRAME_WORDS = {
    "FRD": "; x forward, y right, z down by convention",
    "FLU": "; x forward, y left, z up by convention",
}


def summary(recording: Recording, stream: str | None = None) -> list[str]:
    """Return lines on all streams of a log, or on the columns of one.

    Raises
    ------
    UnknownNameError
        If the log has no such stream.
    """
    names = [each.name for each in recording.streams]
    if stream is not None:
        one_of("stream", stream, names)
        return _columns(recording.streams[names.index(stream)])
    lines = _overview(recording)
    if names == [""]:
        lines += ["", *_columns(recording.streams[0])]
    lines += ["", *_guesses(recording), *(f"note: {remark}" for remark in recording.remarks)]
    return lines


def _overview(recording: Recording) -> list[str]:
    clocks = [next(time_columns(stream), None) for stream in recording.streams]
    times = [
        None if clock is None else stream.numbers(clock[0]) * clock[1]
        for stream, clock in zip(recording.streams, clocks, strict=True)
    ]
    starts = [float(time[0]) for time in times if time is not None and len(time)]
    # A stream of another clock, such as a satellite's, is no beginning.
    usual = float(np.median(starts or [0.0]))
    began = min((each for each in starts if usual - each < OTHER_CLOCK_SECONDS), default=usual)
    rows = [["stream", "rows", "a second", "from, s", "to, s", "holes", "longest, s", "twice",
             "back", "clock"]]  # fmt: skip
    for stream, clock, time in zip(recording.streams, clocks, times, strict=True):
        name = stream.name or "the table"
        if clock is None or time is None or not len(time):
            rows.append([name, str(len(stream)), *["?"] * 7, "no column of times"])
        else:
            rows.append([name, str(len(stream)), *_rate(time, began), clock[0]])
            for names, there in merged_rates(stream):
                shown = ", ".join(names[:2]) + (", ..." if len(names) > 2 else "")
                part = f"  {len(names)} column{'s' if len(names) > 1 else ''}: {shown}"
                rows.append([part, str(there.sum()), *_rate(time[there], began), clock[0]])
    lines = _table(rows)
    for stream, clock in zip(recording.streams, clocks, strict=True):
        if clock is not None and not stream.clocks:
            lines.append(f"clock: {clock[0]} {clock[2]}")
        delays = _delays(stream)
        if delays is not None:
            lines.append(
                f"clock: {stream.name} has {next(iter(stream.clocks))}, and log_time "
                f"{np.median(delays):.3g} s later ({delays.min():.3g} to {delays.max():.3g})"
            )
    return lines


def merged_rates(stream: Stream) -> list[tuple[list[str], NDArray[np.bool_]]]:
    """Return the columns of a table that are empty in the same rows, and where they are not.

    They are a stream of their own, as of another rate, if many rows lack them.
    """
    if stream.clocks:
        return []
    groups: dict[bytes, tuple[list[str], NDArray[np.bool_]]] = {}
    for name, cells in stream.columns.items():
        there = _there(cells)
        if 1 < there.sum() <= MERGED_SHARE * len(there):
            groups.setdefault(np.packbits(there).tobytes(), ([], there))[0].append(name)
            if len(groups) > MOST_MERGED:
                return []
    return list(groups.values())


def _there(cells: NDArray[Any]) -> NDArray[np.bool_]:
    """Return where a column has a cell that is not empty."""
    if cells.dtype != object:
        return np.asarray(~np.isnan(cells), np.bool_)
    return np.array([cell is not None and str(cell).strip() != "" for cell in cells], np.bool_)


def _delays(stream: Stream) -> Floats | None:
    """Return how much later the recorder's stamps are, s; None for one clock."""
    if len(stream.clocks) < 2:
        return None
    own, recorder = (stream.numbers(clock) for clock in list(stream.clocks)[:2])
    return recorder - own


def _rate(time: Floats, began: float) -> list[str]:
    """Return the cells on a stream's times, s."""
    steps = np.diff(time)
    forward = steps[steps > 0.0]
    usual = float(np.median(forward)) if len(forward) else 0.0
    steady = len(forward) and np.mean(np.abs(forward - usual) < 0.5 * usual) > FEWEST_STEADY
    holes = forward[forward > HOLE_STEPS * usual] if steady else forward[:0]
    return [
        f"{1.0 / usual:.4g}" if steady else "?",
        f"{time[0] - began:.2f}",
        f"{time[-1] - began:.2f}",
        str(len(holes)) if steady else "?",
        f"{holes.max():.3g}" if len(holes) else "-",
        str(int((steps == 0.0).sum())),
        str(int((steps < 0.0).sum())),
    ]


def _columns(stream: Stream) -> list[str]:
    rows = [["column", "unit", "least", "most", "remark"]]
    for name, cells in stream.columns.items():
        unit = stream.units.get(name) or "-"
        if cells.dtype == object:
            rows.append([name, unit, "-", "-", f"no numbers, such as {str(cells[0])[:30]!r}"])
            continue
        finite = cells[np.isfinite(cells)]
        if not len(finite):
            rows.append([name, unit, "-", "-", "all nan" if len(cells) else "no rows"])
            continue
        missing = len(cells) - len(finite)
        remark = f"{missing} of {len(cells)} nan" if missing else ""
        if finite.min() == finite.max():
            remark = ", ".join(filter(None, [remark, "never changes"]))
        rows.append([name, unit, f"{finite.min():.6g}", f"{finite.max():.6g}", remark])
    return _table(rows)


def _guesses(recording: Recording) -> list[str]:
    lines = []
    for gyro in gyroscopes(recording):
        of = f" of {gyro.stream.name}" if gyro.stream.name else ""
        axes = FRAME_WORDS.get(gyro.frame, "")
        columns = ", ".join(gyro.columns)
        lines.append(f"gyroscope{of}: {columns} in {gyro.unit} ({gyro.reason}){axes}")
    if not lines:
        lines.append("gyroscope: no three columns are named like one")
    names = commands(recording)
    more = f" and {len(names) - MOST_COMMANDS} more" if len(names) > MOST_COMMANDS else ""
    shown = ", ".join(names[:MOST_COMMANDS]) or "no column that changes is named like one"
    lines.append(f"commands: {shown}{more}")
    return lines


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows as lines, with the first column to the left and numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    last = len(widths) - 1
    return [
        "  ".join(
            cell.ljust(width) if i in (0, last) else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
