"""Recorded swims in files: CSV, or the arrays of an npz."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
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


def write_log(path: str | os.PathLike[str], log: SwimLog) -> None:
    """Write a recorded swim, whole or not at all, as CSV or npz by the path's suffix.

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
    in any order, and trial if there are several; others are ignored. An npz has the arrays time
    (T,), gyro (T, 3), commands (T, 3) and optionally trial (T,). See ``SwimLog`` for their meaning.
    In messages ``argument`` names the file.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read or has no such log; the message names the file, and the row,
        from 1, and column.
    """
    name = f"{argument}: {path}"
    if _suffix(path, argument) == ".npz":
        arrays = read_arrays(path, SHAPES, argument, MOST_BYTES, optional=(TRIAL,))
        return _named(lambda: SwimLog(**arrays), name)
    content = read_bytes(path, argument, MOST_BYTES)
    return _named(lambda: SwimLog(**_table(content)), name)


def _named(make: Callable[[], SwimLog], name: str) -> SwimLog:
    """Return what ``make`` returns; errors name the file."""
    try:
        return make()
    except InvalidArgumentError as error:
        raise DamagedFileError(f"{name}: {error}") from None


def _suffix(path: str | os.PathLike[str], argument: str = "path") -> str:
    return one_of(f"the ending of {argument}", Path(path).suffix.lower(), SUFFIXES)


def _table(content: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays of a CSV; errors name the column, or the row from 1."""
    try:
        names, *rows = [*csv.reader(StringIO(content.decode("utf-8-sig")))] or [[]]
    except (csv.Error, ValueError) as error:
        raise InvalidArgumentError(f"it is no CSV: {error}") from None
    names = [name.strip().lower() for name in names]
    for name in COLUMNS:
        if names.count(name) != 1:
            raise InvalidArgumentError(
                f"it must have one column {name}; it has {brief(', '.join(names))}"
            )
    used = [*COLUMNS, *([TRIAL] if TRIAL in names else [])]
    while rows and not any(cell.strip() for cell in rows[-1]):
        rows.pop()
    numbers = np.empty((len(rows), len(used)))
    for number, row in enumerate(rows):
        try:
            cells = dict(zip(names, row, strict=True))
            numbers[number] = [float(cells[name]) for name in used]
        except ValueError as error:
            raise InvalidArgumentError(
                f"row {number + 1} must be {len(names)} numbers; {error}"
            ) from None
    arrays = {"time": numbers[:, 0], "gyro": numbers[:, 1:4], "commands": numbers[:, 4:7]}
    return arrays | ({TRIAL: numbers[:, 7]} if TRIAL in used else {})
