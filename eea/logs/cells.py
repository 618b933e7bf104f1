"""Messages and cells of a log's rows, as columns of numbers."""

from __future__ import annotations

import contextlib
import functools
import json
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from itertools import repeat
from types import NoneType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eea.logs.streams import Columns

SECONDS_PER_DAY = 86400.0
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LONGEST_ARRAY = 64  # entries of an array in a row; longer ones are pictures or point clouds
TIME_FIELDS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))
#: Encoding of an MCAP's messages -> the library that decodes them.
DECODERS = {
    "cdr": "mcap_ros2.decoder",
    "ros1": "mcap_ros1.decoder",
    "protobuf": "mcap_protobuf.decoder",
}
ISO_DATE = re.compile(r"\d{4}-\d\d-\d\d")
#: A cell without a number; float() reads "nan".
MISSING = frozenset({"", "-", "na", "n/a", "#n/a", "<na>", "none", "null"})
TRUTHS = {"true": 1.0, "false": 0.0}
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield the names and the numbers in a decoded message; texts and long arrays are left out."""
    if isinstance(value, bool | int | float | np.number | np.bool_):
        yield name, float(value)
        return
    if isinstance(value, str | bytes | NoneType):
        return
    if hasattr(value, "__len__") and not isinstance(value, Mapping):
        if len(value) <= LONGEST_ARRAY:
            for i, entry in enumerate(value):
                yield from leaves(entry, f"{name}[{i}]")
        return
    if isinstance(value, Mapping):
        fields = dict(value)
    elif hasattr(value, "DESCRIPTOR"):
        fields = {one.name: getattr(value, one.name) for one in value.DESCRIPTOR.fields}
    else:
        fields = {one: getattr(value, one) for one in getattr(value, "__slots__", ())}
    if tuple(fields) in TIME_FIELDS:
        seconds, nanoseconds = fields.values()
        yield name, seconds + nanoseconds / 1e9
        return
    for key, entry in fields.items():
        yield from leaves(entry, f"{name}.{key}" if name else key)


class Table:
    """Rows of numbers by name, kept as columns; a cell takes 8 bytes.

    Parameters
    ----------
    refuse
        It is called with the numbers of rows and columns after each row that has a new column, and
        after each 1,000 rows; it raises if they are too many.
    """

    def __init__(self, refuse: Callable[[int, int], None]) -> None:
        self._refuse = refuse
        self._columns: dict[str, array[float]] = {}
        self._rows = 0

    def append(self, row: Mapping[str, float]) -> None:
        """Add a row."""
        before = len(self._columns)
        for name, value in row.items():
            column = self._columns.get(name)
            if column is None:
                column = self._columns[name] = array("d")
            _fill(column, self._rows)
            column.append(value)
        self._rows += 1
        if len(self._columns) > before or self._rows % 1000 == 0:
            self._refuse(self._rows, len(self._columns))

    def columns(self) -> Columns:
        """Return the columns, with NaN where a row has no such cell."""
        for column in self._columns.values():
            _fill(column, self._rows)
        return {name: np.frombuffer(column) for name, column in self._columns.items()}


def _fill(column: array[float], rows: int) -> None:
    if len(column) < rows:
        column.extend(repeat(np.nan, rows - len(column)))


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


def is_clock(columns: Columns, name: str) -> bool:
    """Return whether a column of an MCAP's topic has stamps, s, of a clock that runs.

    A field "timestamp" may also be a number in other units, as of PX4's messages.
    """
    if name not in columns or not np.ptp(columns[name]) > 0.0:
        return False
    apart = float(np.median(np.abs(columns["log_time"] - columns[name])))
    return name == "header.stamp" or apart < SECONDS_PER_DAY


def decoder(encoding: str, schema: Any) -> Callable[[bytes], Any]:
    """Return the function that decodes the messages of a channel of an MCAP file.

    Raises
    ------
    ValueError
        If the messages have another encoding than the known ones, or another kind of schema.
    """
    if encoding == "json":
        return json.loads
    decode = encoding in DECODERS and _factory(encoding).decoder_for(encoding, schema)
    if not decode:
        by = f" by {schema.encoding}" if schema else ""
        raise ValueError(
            f"{encoding or 'no encoding'}{by}; cdr by ros2msg, ros1, protobuf and json can"
        )
    found: Callable[[bytes], Any] = decode
    return found


@functools.cache
def _factory(encoding: str) -> Any:
    """Return a library's decoders, which keeps what it has made of each schema."""
    return import_module(DECODERS[encoding]).DecoderFactory()
