"""The one reader of recorders' logs: CSV, Parquet, ArduPilot BIN, PX4 ULog and MCAP.

A file becomes streams of columns, each stream with its own rows. CSV is read here; the libraries of
the field read the others (extra ``logs``), in a process whose memory and time are limited.
"""

from __future__ import annotations

import codecs
import csv
import io
import os
import struct
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.storage import DamagedFileError, open_regular
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    MissingExtraError,
    brief,
    install_advice,
    printable,
)
from eea.logs.cells import (
    DECODERS,
    TIME_UNITS,
    Table,
    ascii_unit,
    decoder,
    is_clock,
    leaves,
    named,
    numbers,
    seconds,
    stated_units,
)
from eea.logs.child import read_in_child
from eea.logs.libraries import WholeReads, ends_within_message, open_dataflash
from eea.logs.limits import (
    ADVICE,
    MOST_COLUMNS,
    bounded,
    most_cells,
    most_memory,
    refuse_cells,
)
from eea.logs.other_formats import refuse_other
from eea.logs.streams import Recording, Stream

LARGEST_CSV_BYTES = 64 * 2**20  # more than an hour at 100 rows a second
#: A CSV of at most this size is read here: its cells, of which ``_csv`` refuses too many, take
#: less than 0.2 GB and 2 s, and starting a process takes longer than reading it.
SMALL_CSV_BYTES = 2**20
LARGEST_LOG_BYTES = 2**31
ARDUPILOT_CLOCKS = (("TimeUS", 1e-6), ("TimeMS", 1e-3))
CUT = "the file ends in the middle of a row, which is left out"
#: Units of which a row of units has at least one.
USUAL_UNITS = frozenset({
    *TIME_UNITS, "rad", "deg", "rad/s", "deg/s", "dps", "m", "m/s", "m/s^2", "m/s2", "g", "V", "A",
    "Hz", "Pa",
})  # fmt: skip
UNENDED = "the file's last row has no end of line, so that it may be cut: it is left out"


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
        refuse_other(begin)
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
        yield from bounded(read(file, remarks), _size(file), remarks)


def _size(file: BinaryIO) -> int:
    return os.fstat(file.fileno()).st_size


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


def _parquet(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    from pyarrow import parquet

    log = parquet.ParquetFile(file, page_checksum_verification=True)
    most = most_cells(_size(file))
    refuse_cells(log.metadata.num_rows, log.metadata.num_columns, most)
    table = log.read(use_threads=False)
    names: list[str] = []
    columns: list[NDArray[Any]] = []
    for name in table.column_names:
        inner = _arrow_columns(name, table.column(0), partial(refuse_cells, most=most))
        table = table.remove_column(0)  # its memory is free once it is converted
        names += inner
        columns += inner.values()
    yield Stream("", named(names, columns, remarks), {}, stated_units(names))


def _arrow_columns(
    name: str, column: Any, refuse: Callable[[int, int], None]
) -> dict[str, NDArray[Any]]:
    """Return a column of Arrow as numbers, or each number in its lists and structs as a column."""
    from pyarrow import compute, types

    if types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    if any(is_kind(column.type) for is_kind in (types.is_floating, types.is_integer)):
        return {name: column.to_numpy().astype(np.float64, copy=False)}
    if any(is_kind(column.type) for is_kind in (types.is_string, types.is_large_string)):
        words = column.unique()  # few, mostly
        return {name: numbers(words.to_pylist())[compute.index_in(column, words).to_numpy()]}
    values = column.to_pandas()
    if values.dtype.kind == "b":
        return {name: values.to_numpy(np.float64)}
    if values.dtype.kind == "M":
        return {name: seconds(values)}
    cells = values.tolist()
    if not any(isinstance(cell, Mapping | np.ndarray) for cell in cells):
        return {name: numbers(cells)}
    table = Table(refuse)
    for cell in cells:
        table.append(dict(leaves(cell, name)))
    return table.columns()


def _ardupilot(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    rows: dict[tuple[str, Any], tuple[Any, dict[str, Any]]] = {}
    with open_dataflash(file.name) as log:
        while (row := log.recv_msg()) is not None:
            sensor = row.fmt.instance_field and getattr(row, row.fmt.instance_field)
            layout, columns = rows.setdefault(
                (row.get_type(), sensor),
                (row.fmt, {one: array("d") for one in row.fmt.columns}),
            )
            for one in layout.columns:
                columns[one] = _appended(columns[one], getattr(row, one))
        if log.offset < log.data_len:
            remarks.append(CUT)
    sensors = Counter(name for name, _ in rows)
    for (name, sensor), (layout, columns) in rows.items():
        clocks = {one: tick for one, tick in ARDUPILOT_CLOCKS if one in layout.columns}
        if clocks:
            yield Stream(
                name if sensors[name] == 1 else f"{name}[{sensor}]",
                {one: numbers(cells) for one, cells in columns.items()},
                clocks,
                dict(zip(layout.columns, layout.units or (), strict=False)),
            )


def _appended(cells: Any, cell: Any) -> Any:
    """Return cells with one more: an array of numbers, or a list from the first text on."""
    try:
        cells.append(cell)
    except TypeError:
        return [*cells, cell]
    return cells


def _ulog(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    from pyulog import ULog

    content = file.read()
    if ends_within_message(content):
        remarks.append(CUT)
    log = ULog(io.BytesIO(content))
    if log.dropouts:
        lost = sum(one.duration for one in log.dropouts) / 1e3
        remarks.append(f"the recorder lost {lost:.3g} s in {len(log.dropouts)} dropouts")
    sensors = Counter(one.name for one in log.data_list)
    for one in log.data_list:
        name = one.name if sensors[one.name] == 1 else f"{one.name}[{one.multi_id}]"
        columns = {key: values.astype(np.float64) for key, values in one.data.items()}
        yield Stream(name, columns, {"timestamp": 1e-6} if "timestamp" in columns else {})


def _mcap(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    from mcap.exceptions import McapError

    refuse = partial(refuse_cells, most=most_cells(_size(file)))
    tables: dict[str, Table] = {}
    left_out: dict[str, str] = {}
    try:
        for schema, channel, message in _messages(file, remarks):
            if channel.topic in left_out:
                continue
            try:
                decode = decoder(channel.message_encoding, schema)
                row = dict(islice(leaves(decode(message.data)), MOST_COLUMNS + 1))
            except (ImportError, MemoryError):  # not the messages' fault
                raise
            except Exception as error:  # each decoder has its own
                left_out[channel.topic] = f"is left out: its messages cannot be decoded ({error})"
                continue
            table = tables.setdefault(channel.topic, Table(refuse))
            table.append(row | {"log_time": message.log_time / 1e9})
    except (McapError, struct.error) as error:
        remarks.append(f"{CUT} ({error})" if str(error) else CUT)
    remarks += [f"{topic} {reason}" for topic, reason in left_out.items()]
    for topic in list(tables):
        columns = tables.pop(topic).columns()
        order = np.argsort(columns["log_time"], kind="stable")
        columns = {name: cells[order] for name, cells in columns.items()}
        stamps = [one for one in ("header.stamp", "timestamp") if is_clock(columns, one)]
        yield Stream(topic, columns, dict.fromkeys([*stamps, "log_time"], 1.0))


def _messages(file: BinaryIO, remarks: list[str]) -> Iterator[tuple[Any, Any, Any]]:
    """Yield the schema, the channel and each message of an MCAP file, in the order of the file.

    The index at the file's end, which a recorder that lost its power did not write, only tells
    whether parts of the file were skipped.

    Raises
    ------
    McapError, struct.error
        If the file ends in the middle, or has other content from there on.
    ValueError
        If a checksum is wrong.
    """
    from mcap.exceptions import McapError
    from mcap.records import Channel, Chunk, ChunkIndex, Message, Schema, Statistics
    from mcap.stream_reader import StreamReader, breakup_chunk

    schemas: dict[int, Any] = {0: None}
    channels: dict[int, Any] = {}
    counts = Counter[str]()
    stated = Counter[str]()
    whole = WholeReads(file, _size(file))
    for part in StreamReader(whole, emit_chunks=True, validate_crcs=True).records:  # type: ignore[arg-type]
        if isinstance(part, Statistics):
            stated["messages"] = part.message_count
        stated["chunks"] += isinstance(part, ChunkIndex)
        counts["chunks"] += isinstance(part, Chunk)
        for record in breakup_chunk(part, True) if isinstance(part, Chunk) else [part]:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                counts["messages"] += 1
                channel = channels.get(record.channel_id)
                if channel is None or channel.schema_id not in schemas:
                    raise McapError(f"channel {record.channel_id} or its schema is missing")
                yield schemas[channel.schema_id], channel, record
    for name, count in stated.items():
        if count and count != counts[name]:
            remarks.append(
                f"the file is damaged: its index counts {count} {name}, and it has {counts[name]}"
            )


class Format(NamedTuple):
    """A format of logs."""

    name: str
    begins: bytes  #: The first bytes of a file.
    read: Callable[[BinaryIO, list[str]], Iterator[Stream]]
    libraries: tuple[str, ...]  #: The modules of the extra ``logs`` that read it.


CSV = Format("CSV", b"", _csv, ())
FORMATS = (
    CSV,
    Format("Parquet", b"PAR1", _parquet, ("pyarrow",)),
    Format("ArduPilot BIN", b"\xa3\x95", _ardupilot, ("pymavlink.DFReader",)),
    Format("PX4 ULog", b"ULog", _ulog, ("pyulog",)),
    Format(
        "MCAP", b"\x89MCAP", _mcap,
        ("mcap.reader", *DECODERS.values()),
    ),
)  # fmt: skip
