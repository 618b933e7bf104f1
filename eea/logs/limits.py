"""How much a log may hold. A few kilobytes can state gigabytes, so limits grow with the file."""

from __future__ import annotations

from collections.abc import Iterator

from aquafish_gym.utils.validation import InvalidArgumentError, printable
from eea.logs.cells import named
from eea.logs.streams import Stream

MOST_CELLS = 2**26  # of any file: 512 MiB as float64, 10 million rows of six columns
CELLS_PER_BYTE = 0.5  # of the file, besides; recorders write no number into less than two bytes
MOST_COLUMNS = 50_000  # of all streams; a PX4 has some 5,000
LONGEST_NAME = 500  # characters of a column, a stream or a unit
MEMORY_BYTES = 2**30  # of the process that reads; Python and the libraries take a tenth of it
MEMORY_PER_BYTE = 16  # of the file, besides: a table as text takes so much
SECONDS = 15.0  # for any file
SECONDS_PER_BYTE = 4.0 / 2**20  # of the file, besides; the slowest library takes a tenth of it
ADVICE = "write the columns that you need, or a part of the time, as a smaller file"


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
