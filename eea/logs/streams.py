"""What a log holds: streams of rows, their cells as numbers, and how much there may be of them.

A few kilobytes can state gigabytes, so limits grow with the file.
"""

from __future__ import annotations

import contextlib
import re
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import InvalidArgumentError, brief, printable
from eea.core.angles import Floats

Columns = dict[str, NDArray[Any]]

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ISO_DATE = re.compile(r"\d{4}-\d\d-\d\d")
#: A cell without a number; float() reads "nan".
MISSING = frozenset({"", "-", "na", "n/a", "#n/a", "<na>", "none", "null"})
TRUTHS = {"true": 1.0, "false": 0.0}
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")

MOST_CELLS = 2**26  # of any file: 512 MiB as float64, 10 million rows of six columns
CELLS_PER_BYTE = 0.5  # of the file, besides; recorders write no number into less than two bytes
MOST_COLUMNS = 50_000  # of all streams; a PX4 has some 5,000
LONGEST_NAME = 500  # characters of a column, a stream or a unit
MEMORY_BYTES = 2**30  # of the process that reads; Python and the libraries take a tenth of it
MEMORY_PER_BYTE = 16  # of the file, besides: a table as text takes so much
SECONDS = 15.0  # for any file
SECONDS_PER_BYTE = 4.0 / 2**20  # of the file, besides; the slowest library takes a tenth of it
ADVICE = "write the columns that you need, or a part of the time, as a smaller file"


@dataclass(frozen=True, eq=False)
class Stream:
    """Rows that were recorded together, T of them."""

    name: str  #: "" in a file of one table.
    columns: Columns  #: Name -> (T,) float64, or (T,) objects where a cell is no number.
    #: The columns that the format defines as times -> s per tick; the sensor's own is the first.
    clocks: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)  #: Those that the file states.

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def full_name(self, column: str) -> str:
        """Return the name of a column, with that of its stream."""
        return f"{self.name}.{column}" if self.name else column

    def numbers(self, column: str, hint: str = "") -> Floats:
        """Return a column (T,) of numbers; the error names the first cell that is none."""
        cells = self.columns[column]
        if cells.dtype != object:
            return cells
        for number, cell in enumerate(cells, 1):
            if not _is_number(cell):
                found = brief(cell) if cell else "nothing"
                raise InvalidArgumentError(
                    f"row {number} must have numbers; {self.full_name(column)} is {found}{hint}"
                )
        return cells.astype(np.float64)


@dataclass(frozen=True, eq=False)
class Recording:
    """What a file holds."""

    format: str
    streams: list[Stream]
    remarks: list[str]  #: Sentences on what could not be read.


def _is_number(cell: Any) -> bool:
    try:
        return cell is not None and float(cell) is not None
    except (TypeError, ValueError):
        return False


def named(names: Sequence[str], columns: Sequence[NDArray[Any]], remarks: list[str]) -> Columns:
    """Return columns by name; a name that several have is left out, and a remark says so."""
    found = dict(zip(names, columns, strict=True))
    for name, count in Counter(names).items():
        if count > 1:
            remarks.append(f"{count} columns have the name {name!r}: they are left out")
            del found[name]
    return found


def stated_units(names: Sequence[str]) -> dict[str, str]:
    """Return the units in brackets at the end of columns' names.

    Examples
    --------
    >>> stated_units(["time [\u00b5s]", "gyro_x (\u00b0/s)", "output[0]"])
    {'time [\u00b5s]': 'us', 'gyro_x (\u00b0/s)': 'deg/s'}
    """
    found = {name: ascii_unit(_split_unit(name)[1]) for name in names}
    return {name: unit for name, unit in found.items() if unit}


def ascii_unit(unit: str) -> str:
    """Return a unit with "u" for micro and "deg" for the sign of degrees."""
    return unit.strip().replace("\u00b5", "u").replace("\u03bc", "u").replace("\u00b0", "deg")


def without_unit(name: str) -> str:
    """Return a column's name without a unit in brackets."""
    return _split_unit(name)[0]


def _split_unit(name: str) -> tuple[str, str]:
    """Return a name and its unit, which has a letter; no name takes long, as one of brackets."""
    if not name.endswith(("]", ")")):
        return name, ""
    since = 1 + max(name.rfind(mark, 0, -1) for mark in "])")
    opening = [at for at in (name.find(mark, since) for mark in "[(") if at >= 0]
    unit = name[min(opening) + 1 : -1] if opening else ""
    if not any(one.isalpha() or one == "_" for one in unit):
        return name, ""
    return name[: min(opening)].rstrip(), unit.strip()


def numbers(cells: Sequence[Any], decimal_comma: bool = False) -> NDArray[Any]:
    """Return cells as numbers, dates as s since 1970, or anything else as it is.

    An empty cell, or a word for one, is NaN in a column of numbers.

    Examples
    --------
    >>> numbers(["1.5", "", "n/a", "-2"])
    array([ 1.5,  nan,  nan, -2. ])
    >>> numbers(["true", "false"])
    array([1., 0.])
    """
    if isinstance(cells, array):
        return np.array(cells)
    objects = np.array([*cells, None], dtype=object)[:-1]  # of one axis, whatever the cells are
    with contextlib.suppress(ValueError, TypeError):
        return objects.astype(np.float64)
    try:
        words = {cell: _plain(cell, decimal_comma) for cell in dict.fromkeys(cells)}
    except TypeError:  # a list is no key
        return objects
    plain = [words[cell] for cell in cells]
    with contextlib.suppress(ValueError, TypeError):
        return np.array(plain, dtype=object).astype(np.float64)
    first = next((cell for cell in plain if cell is not None), "")
    if hasattr(first, "year") or ISO_DATE.match(str(first)):
        with contextlib.suppress(ValueError, TypeError):
            return seconds(plain)
    return objects


def _plain(cell: Any, decimal_comma: bool) -> Any:
    """Return a cell as float() reads it; None where it is missing."""
    if not isinstance(cell, str):
        return cell
    word = cell.strip()
    if word.lower() in MISSING:
        return None
    if decimal_comma and DECIMAL_COMMA.fullmatch(word):
        return word.replace(",", ".")
    return TRUTHS.get(word.lower(), word)


def seconds(dates: Any) -> NDArray[np.float64]:
    """Return dates, or texts of dates, as s since 1970; NaN where one is missing."""
    import pandas as pd

    index = pd.DatetimeIndex(pd.to_datetime(dates, format="ISO8601", utc=True)).as_unit("ns")
    return np.where(index.isna(), np.nan, index.asi8 / 1e9)


def most_cells(size: int) -> int:
    """Return how many cells a log of ``size`` bytes may have, in all of its streams."""
    return MOST_CELLS + int(CELLS_PER_BYTE * size)


def most_memory(size: int) -> int:
    """Return how many bytes of memory reading a log of ``size`` bytes may take."""
    return MEMORY_BYTES + MEMORY_PER_BYTE * size


def most_seconds(size: int) -> float:
    """Return for how long a log of ``size`` bytes may be read, s."""
    return SECONDS + SECONDS_PER_BYTE * size


def refuse_cells(rows: int, columns: int, most: int) -> None:
    """Raise InvalidArgumentError for a table of more than ``most`` cells, or too many columns."""
    if columns > MOST_COLUMNS:
        raise InvalidArgumentError(
            f"it must have at most {MOST_COLUMNS} columns; it has more: {ADVICE}"
        )
    if rows * columns > most:
        raise InvalidArgumentError(f"it must have at most {most} cells; it has more: {ADVICE}")


def bounded(streams: Iterator[Stream], size: int, remarks: list[str]) -> Iterator[Stream]:
    """Yield streams whose names a terminal can show, as long as the log is not too large.

    Raises
    ------
    InvalidArgumentError
        If all streams together have too many cells or columns, or a name is too long.
    """
    left = most_cells(size)
    columns = 0
    for stream in streams:
        columns += 1 + len(stream.columns)
        refuse_cells(0, columns, left)
        refuse_cells(len(stream), len(stream.columns), left)
        left -= len(stream) * len(stream.columns)
        for name in (stream.name, *stream.columns, *stream.units.values()):
            if len(name) > LONGEST_NAME:
                raise InvalidArgumentError(
                    f"its names must have at most {LONGEST_NAME} characters; one has {len(name)}"
                )
        yield Stream(
            printable(stream.name),
            named([*map(printable, stream.columns)], [*stream.columns.values()], remarks),
            {printable(name): tick for name, tick in stream.clocks.items()},
            {printable(name): printable(unit) for name, unit in stream.units.items()},
        )
