"""Recorded swims in files: a table as CSV, or the arrays of an npz archive."""

from __future__ import annotations

import csv
import difflib
import os
from collections.abc import Callable, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.runs.arrays import read_arrays, write_arrays
from aquafish_gym.runs.storage import DamagedFileError, read_bytes, write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError, brief, one_of
from eea.fish.swim_log import COLUMNS, SwimLog

MOST_BYTES = 64 * 2**20  # of a file: more than an hour at 100 rows a second
SUFFIXES = (".csv", ".npz")
TRIAL = "trial"
SHAPES = {"time": (None,), "gyro": (None, 3), "commands": (None, 3), TRIAL: (None,)}
ALIKE = 0.6  # of names, from 0 to 1: what is more alike was meant


def write_log(path: str | os.PathLike[str], log: SwimLog) -> None:
    """Write a recorded swim, at once or not at all, as CSV or npz by the path's suffix.

    Numbers are read back exactly from either.

    Raises
    ------
    UnknownNameError, CannotWriteError
        If the suffix is another, or the file cannot be written.

    Examples
    --------
    >>> log = SwimLog(0.01 * np.arange(65), np.zeros((65, 3)), np.full((65, 3), 0.4))
    >>> write_log("swim.csv", log)
    >>> print(Path("swim.csv").read_text().splitlines()[0])
    time,gyro_x,gyro_y,gyro_z,left_pectoral,right_pectoral,caudal,trial
    >>> read_log("swim.csv").seconds
    (0.64,)
    """
    if _suffix(path) == ".npz":
        write_arrays(path, {name: getattr(log, name) for name in SHAPES})
        return
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*COLUMNS, TRIAL])
    numbers = np.column_stack([log.time, log.gyro, log.commands]).tolist()
    table.writerows([*row, trial] for row, trial in zip(numbers, log.trial.tolist(), strict=True))
    write_bytes(path, text.getvalue().encode())


def read_log(path: str | os.PathLike[str], argument: str = "log") -> SwimLog:
    """Return the recorded swim in a file, as CSV or npz by its suffix.

    A CSV has the columns time, gyro_x, gyro_y, gyro_z, left_pectoral, right_pectoral and caudal
    in any order, and trial if there are several; others are passed over. Commas, semicolons or
    tabs separate them. An npz has the arrays time (T,), gyro (T, 3), commands (T, 3) and maybe
    trial (T,). What they mean says ``SwimLog``. In messages ``argument`` names the file.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read, or holds no such log; the message names the file, the row,
        from 1, and the column.
    """
    name = f"{argument}: {path}"
    if _suffix(path, argument) == ".npz":
        arrays = read_arrays(path, SHAPES, argument, MOST_BYTES, optional=(TRIAL,))
        return _named(lambda: SwimLog(**arrays), name)
    content = read_bytes(path, argument, MOST_BYTES)
    return _named(lambda: SwimLog(**_table(content)), name)


def _named(make: Callable[[], SwimLog], name: str) -> SwimLog:
    """Return what is made, or say of which file it could not be."""
    try:
        return make()
    except InvalidArgumentError as error:
        raise DamagedFileError(f"{name}: {error}") from None


def _suffix(path: str | os.PathLike[str], argument: str = "path") -> str:
    return one_of(f"the ending of {argument}", Path(path).suffix.lower(), SUFFIXES)


def _table(content: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays that a table in CSV holds."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidArgumentError("it is no text, as a CSV is") from None
    heading = text.partition("\n")[0]
    delimiter = max(",;\t", key=heading.count)
    try:
        names, *rows = [*csv.reader(StringIO(text, newline=""), delimiter=delimiter)] or [[]]
    except (csv.Error, ValueError) as error:
        raise InvalidArgumentError(f"it is no CSV: {error}") from None
    found = _columns([name.strip().lower() for name in names])
    while rows and not any(cell.strip() for cell in rows[-1]):
        rows.pop()
    columns = list(found.values())
    numbers = np.empty((len(rows), len(columns)))
    for number, row in enumerate(rows):
        if len(row) != len(names):
            raise InvalidArgumentError(
                f"row {number + 1} must have {len(names)} cells, as the heading; it has {len(row)}"
            )
        try:
            numbers[number] = [float(row[column]) for column in columns]
        except ValueError:
            raise _no_number(number, row, found) from None
    by_name = dict(zip(found, numbers.T, strict=True))
    arrays = {
        "time": by_name["time"],
        "gyro": np.stack([by_name[name] for name in COLUMNS[1:4]], axis=1),
        "commands": np.stack([by_name[name] for name in COLUMNS[4:]], axis=1),
    }
    return arrays | ({TRIAL: by_name[TRIAL]} if TRIAL in by_name else {})


def _columns(names: Sequence[str]) -> dict[str, int]:
    """Return where each column is, by name; what is missing or twice there is refused."""
    others = [name for name in names if name not in (*COLUMNS, TRIAL)]
    for name in (*COLUMNS, TRIAL):
        close = difflib.get_close_matches(name, others, n=1, cutoff=ALIKE)
        if names.count(name) > 1:
            raise InvalidArgumentError(f"the heading has the column {name} twice")
        if name not in names and (name != TRIAL or close):
            hint = f"; is it what is called {close[0]!r}?" if close else "."
            raise InvalidArgumentError(
                f"the heading must have a column {name}{hint} It has {brief(', '.join(names))}"
            )
    return {name: names.index(name) for name in (*COLUMNS, TRIAL) if name in names}


def _no_number(number: int, row: Sequence[str], found: dict[str, int]) -> InvalidArgumentError:
    for name, column in found.items():
        try:
            float(row[column])
        except ValueError:
            return InvalidArgumentError(
                f"row {number + 1}: {name} must be a number; got {brief(row[column])}"
            )
    raise AssertionError("every cell is a number")
