"""Messages and cells of a log's rows, as columns of numbers."""

from __future__ import annotations

import contextlib
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import NoneType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eea.logs.streams import Columns

SECONDS_PER_DAY = 86400.0
LONGEST_ARRAY = 64  # entries of an array in a row; longer ones are pictures or point clouds
TIME_FIELDS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))
UNIT = re.compile(r"\s*[\[(]([^\])]*[^\W\d][^\])]*)[\])]$")  # at the end of a name: gyro_x [deg/s]
ISO_DATE = re.compile(r"\d{4}-\d\d-\d\d")


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


def tabulated(rows: Sequence[Mapping[str, float]]) -> Columns:
    """Return rows as columns, with NaN where a row has no such cell."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}


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
    found = {name: UNIT.search(name) for name in names}
    return {
        name: match[1].strip().replace("\u00b5", "u").replace("\u00b0", "deg")
        for name, match in found.items()
        if match
    }


def without_unit(name: str) -> str:
    """Return a column's name without a unit in brackets."""
    return UNIT.sub("", name)


def numbers(cells: Sequence[Any]) -> NDArray[Any]:
    """Return cells as numbers, dates as s since 1970, or anything else as it is."""
    objects = np.array([*cells, None], dtype=object)[:-1]  # of one axis, whatever the cells are
    if any(cell is None for cell in cells):
        return objects
    with contextlib.suppress(ValueError, TypeError):
        return objects.astype(np.float64)
    if hasattr(cells[0], "year") or ISO_DATE.match(str(cells[0])):
        import pandas as pd

        with contextlib.suppress(ValueError, TypeError):
            dates = pd.to_datetime(list(cells), format="ISO8601", utc=True).as_unit("ns")
            return np.where(dates.isna(), np.nan, dates.asi8 / 1e9)
    return objects


def is_clock(columns: Columns, name: str) -> bool:
    """Return whether a column of an MCAP's topic has stamps, s, of a clock that runs.

    A field "timestamp" may also be a number in other units, as of PX4's messages.
    """
    if name not in columns or not np.ptp(columns[name]) > 0.0:
        return False
    apart = float(np.median(np.abs(columns["log_time"] - columns[name])))
    return name == "header.stamp" or apart < SECONDS_PER_DAY


def decoder(encoding: str, schema: Any, factories: Sequence[Any]) -> Callable[[bytes], Any]:
    """Return the function that decodes the messages of a channel of an MCAP file.

    Raises
    ------
    ValueError
        If none of the factories knows the encoding.
    """
    found = (factory.decoder_for(encoding, schema) for factory in factories)  # each keeps its own
    decode = json.loads if encoding == "json" else next(filter(None, found), None)
    if decode is None:
        by = f" by {schema.encoding}" if schema else ""
        raise ValueError(
            f"{encoding or 'no encoding'}{by}; cdr by ros2msg, ros1, protobuf and json can"
        )
    return decode
