"""The one reader of recorders' logs: CSV, Parquet, ArduPilot BIN, PX4 ULog and MCAP.

A file becomes streams of columns, each stream with its own rows. CSV is read here; the libraries of
the field read the others (extra ``logs``), in a process whose memory and time are limited.
"""

from __future__ import annotations

import codecs
import csv
import io
import os
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import BinaryIO, NamedTuple

from aquafish_gym.utils.storage import DamagedFileError, open_regular
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    MissingExtraError,
    brief,
    install_advice,
    printable,
)
from eea.logs.child import read_in_child
from eea.logs.libraries import CUT, DECODERS, ardupilot, mcap, parquet, ulog
from eea.logs.streams import (
    ADVICE,
    TIME_UNITS,
    Recording,
    Stream,
    ascii_unit,
    bounded,
    most_memory,
    named,
    numbers,
    refuse_cells,
    stated_units,
)

LARGEST_CSV_BYTES = 64 * 2**20  # more than an hour at 100 rows a second
#: A CSV of at most this size is read here: its cells, of which ``_csv`` refuses too many, take
#: less than 0.2 GB and 2 s, and starting a process takes longer than reading it.
SMALL_CSV_BYTES = 2**20
LARGEST_LOG_BYTES = 2**31
#: Units of which a row of units has at least one.
USUAL_UNITS = frozenset({
    *TIME_UNITS, "rad", "deg", "rad/s", "deg/s", "dps", "m", "m/s", "m/s^2", "m/s2", "g", "V", "A",
    "Hz", "Pa",
})  # fmt: skip
UNENDED = "the file's last row has no end of line, so that it may be cut: it is left out"
PACKED = "it is packed: unpack it first"
TABLE = "write the columns as CSV or Parquet"
#: The first bytes of a file -> what it is, and what to do.
BEGINNINGS = {
    b"#ROSBAG": "it is a ROS 1 bag: convert it by `mcap convert swim.bag swim.mcap`",
    b"SQLite format 3": (
        "it is a ROS 2 bag in SQLite: convert it by `mcap convert swim.db3 swim.mcap`"
    ),
    b"version https://git-lfs": "it is a pointer of Git LFS: get the file by `git lfs pull`",
    b"PK\x03\x04": PACKED,
    b"\x1f\x8b": PACKED,
    b"\x28\xb5\x2f\xfd": PACKED,
    b"BZh": PACKED,
    b"\x89HDF": f"it is an HDF5 file: {TABLE}",
    b"MATLAB 5": f"it is a MATLAB file: {TABLE}",
    b"FMT, 128": "it is an ArduPilot log as text: download the BIN of the same flight",
    b"H Product:Blackbox": "it is a Blackbox log: convert it by `blackbox_decode`, to CSV",
}
TLOG_MAGIC = (0xFD, 0xFE)  # the first byte of a MAVLink packet, after 8 bytes of time


def read_recording(path: str | os.PathLike[str]) -> Recording:
    """Return the streams of a log; its first bytes tell the format.

    A file that ends in the middle of a row is read up to there, and a remark says so.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read, is damaged, holds or takes too much, or has another format; it
        says what to do.
    MissingExtraError
        If the extra ``logs`` is needed and not installed.
    """
    with open_regular(path, "log", LARGEST_LOG_BYTES) as file:
        begin = file.read(32)
        size = os.fstat(file.fileno()).st_size
    kind = next((one for one in FORMATS if one.begins and begin.startswith(one.begins)), CSV)
    remarks: list[str] = []
    try:
        _refuse_other(begin)
        for library in kind.libraries:
            if find_spec(library) is None:
                raise ImportError(f"No module named {library!r}")
        if kind is CSV and size <= SMALL_CSV_BYTES:
            streams = list(read_streams(path, kind.name, remarks))
        else:
            streams = read_in_child(os.fspath(path), kind.name, size, remarks)
    except InvalidArgumentError as error:
        raise type(error)(f"log: {path}: {error}") from None
    except ImportError as error:
        raise MissingExtraError(
            f"log: {path}: {kind.name} needs the extra logs ({error}): {install_advice('logs')}"
        ) from None
    except MemoryError:
        raise InvalidArgumentError(
            f"log: {path}: reading it must take at most {most_memory(size) / 2**30:.3g} GiB of "
            f"memory, and what is free; it takes more: {ADVICE}"
        ) from None
    except Exception as error:  # each library has its own for a damaged file
        raise DamagedFileError(
            f"log: {path}: it is a damaged {kind.name} file: copy it from its recorder again "
            f"({brief(str(error)) if str(error) else type(error).__name__})"
        ) from None
    streams.sort(key=lambda stream: stream.name)
    return Recording(kind.name, streams, [printable(remark) for remark in remarks])


def read_streams(
    path: str | os.PathLike[str], format_name: str, remarks: list[str]
) -> Iterator[Stream]:
    """Yield the streams of a log in this process, and add to the remarks on it.

    A damaged file raises any error of its library. See :func:`read_recording`, which limits the
    memory and the time.
    """
    read = next(one.read for one in FORMATS if one.name == format_name)
    with Path(path).open("rb") as file:
        yield from bounded(read(file, remarks), os.fstat(file.fileno()).st_size, remarks)


def _refuse_other(begin: bytes) -> None:
    """Raise DamagedFileError if the first bytes of a file are those of a known other format."""
    for beginning, advice in BEGINNINGS.items():
        if begin.startswith(beginning):
            raise DamagedFileError(advice)
    if len(begin) > 8 and begin[0] == 0 and begin[8] in TLOG_MAGIC:
        raise DamagedFileError(
            "it is a telemetry log of MAVLink: take the BIN of the vehicle, whose rates are higher,"
            " or convert it by `mavlogdump.py --format csv --types RAW_IMU swim.tlog`"
        )


def _csv(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    content = file.read(LARGEST_CSV_BYTES + 1)
    if len(content) > LARGEST_CSV_BYTES:
        raise DamagedFileError(f"it has more than {LARGEST_CSV_BYTES} bytes: write it as Parquet")
    try:
        text = _decoded(content)
        delimiter, text = _table(text)
        rows = [row for row in csv.reader(io.StringIO(text), delimiter=delimiter) if row]
    except (csv.Error, UnicodeDecodeError) as error:
        raise DamagedFileError(f"it is no CSV, Parquet, BIN, ULog or MCAP file: {error}") from None
    names = [name.strip() for name in rows.pop(0)] if rows else []
    if rows and not text.endswith("\n"):  # a number without its last digits is another number
        remarks.append(CUT if len(rows.pop()) < len(names) else UNENDED)
    # Each cell has its delimiter: in a table of twice as many, most rows lack most of their cells.
    refuse_cells(len(rows), len(names), 2 * len(content))
    for number, row in enumerate(rows, 1):
        if any(row[len(names) :]):
            raise DamagedFileError(
                f"row {number} has {len(row)} cells, and the first line of the file names "
                f"{len(names)} columns: it must name all"
            )
    units = stated_units(names)
    if below := _units_below(names, rows):
        del rows[0]
        units |= below
        remarks.append("the row below the names is taken for units")
    filled = [[*row, *[None] * (len(names) - len(row))] for row in rows]
    comma = delimiter != ","
    columns = [numbers([row[i] for row in filled], comma) for i in range(len(names))]
    yield Stream("", named(names, columns, remarks), {}, units)


def _decoded(content: bytes) -> str:
    """Return the text of a file in UTF-8, in UTF-16 with its mark, or as old Windows writes it."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        if any(byte < ord(" ") and byte not in b"\t\r\n" for byte in content):
            raise
        return content.decode("cp1252")


def _table(text: str) -> tuple[str, str]:
    """Return the delimiter of a text, and the table in it: comments may come before the names.

    NumPy writes the names themselves as a comment, before a row of numbers.
    """
    while True:
        line, _, rest = text.partition("\n")
        if line.lower().startswith("sep=") and rest:  # for spreadsheets
            text = rest
            continue
        delimiter = max(",;\t", key=line.count)
        if not line.startswith(("#", "//")):
            return delimiter, text
        following = rest.partition("\n")[0]
        cells = following.split(delimiter)
        if not rest or (len(cells) == line.count(delimiter) + 1 and _is_number(cells[0])):
            return delimiter, text.lstrip("#/ ")
        text = rest


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _units_below(names: list[str], rows: list[list[str]]) -> dict[str, str]:
    """Return the units in the first row, if it has words where the second one has numbers."""
    if len(rows) < 2 or not len(rows[0]) == len(rows[1]) == len(names):
        return {}
    units = [ascii_unit(cell.strip(" []()")) for cell in rows[0]]
    there = [(unit, cell) for unit, cell in zip(units, rows[1], strict=True) if unit]
    if USUAL_UNITS.isdisjoint(units) or not all(
        _is_number(cell) and not _is_number(unit) for unit, cell in there
    ):
        return {}
    return {name: unit for name, unit in zip(names, units, strict=True) if unit}


class Format(NamedTuple):
    """A format of logs."""

    name: str
    begins: bytes  #: The first bytes of a file.
    read: Callable[[BinaryIO, list[str]], Iterator[Stream]]
    libraries: tuple[str, ...]  #: The modules of the extra ``logs`` that read it.


CSV = Format("CSV", b"", _csv, ())
FORMATS = (
    CSV,
    Format("Parquet", b"PAR1", parquet, ("pyarrow",)),
    Format("ArduPilot BIN", b"\xa3\x95", ardupilot, ("pymavlink.DFReader",)),
    Format("PX4 ULog", b"ULog", ulog, ("pyulog",)),
    Format(
        "MCAP", b"\x89MCAP", mcap,
        ("mcap.reader", *DECODERS.values()),
    ),
)  # fmt: skip
