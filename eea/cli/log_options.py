"""Options that ``infer`` and ``watch`` share: the log, and its columns."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from aquafish_gym.utils.validation import InvalidArgumentError, brief

LogFile = Annotated[
    Path,
    arg(
        metavar="FILE",
        help="The recorded swim: CSV; or Parquet, ArduPilot BIN, PX4 ULog or MCAP (extra logs).",
    ),
]
ColumnMap = Annotated[
    tuple[str, ...],
    arg(
        name="map",
        metavar="NAME=COLUMN",
        help="Columns with other names: time, gyro (three, joined by commas), a fin's name or "
        "trial, then :UNIT if the file states none, then =COLUMN, =-COLUMN or "
        "=FACTOR*COLUMN+OFFSET. A column is STREAM.NAME where a file has streams. "
        "aquafish logs lists them.",
    ),
]
Between = Annotated[
    tuple[float, ...],
    arg(
        metavar="SECONDS", help="The start and end of the part to read, s after the first reading."
    ),
]


def column_map(items: Sequence[str]) -> dict[str, str]:
    """Return the map of an option's words.

    Raises
    ------
    InvalidArgumentError
        If a word is not NAME=COLUMN, or a name comes twice.
    """
    found: dict[str, str] = {}
    for item in items:
        name, equals, column = item.partition("=")
        if not (name and equals and column):
            raise InvalidArgumentError(
                f"map must be NAME=COLUMN, as in gyro=IMU.GyrX,IMU.GyrY,IMU.GyrZ; got {brief(item)}"
            )
        if name in found:
            raise InvalidArgumentError(f"map must name {name} once; got it twice")
        found[name] = column
    return found
