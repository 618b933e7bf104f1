"""The formats that libraries of the field read (extra ``logs``): Parquet, BIN, ULog and MCAP.

Each function yields the streams of an open file, and adds remarks. A damaged file raises any error
of its library.
"""

from __future__ import annotations

import functools
import io
import json
import os
import struct
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib import import_module
from itertools import islice, repeat
from types import NoneType
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from eea.logs.streams import (
    MOST_COLUMNS,
    Columns,
    Stream,
    most_cells,
    named,
    numbers,
    refuse_cells,
    seconds,
    stated_units,
)

CUT = "the file ends in the middle of a row, which is left out"
ARDUPILOT_CLOCKS = (("TimeUS", 1e-6), ("TimeMS", 1e-3))
BIN_HEADER_BYTES = 3  # of a row
ULOG_HEADER_BYTES = 16
ULOG_DEFINITIONS = frozenset(b"BFIMPQ")  # messages before the first row
ULOG_ROWS = frozenset(b"ACL")  # messages that end the definitions
ULOG_MOST_BYTES = 10_000  # of a message that pyulog does not know, and takes for one
SECONDS_PER_DAY = 86400.0
LONGEST_ARRAY = 64  # entries of an array in a row; longer ones are pictures or point clouds
TIME_FIELDS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))
#: Encoding of an MCAP's messages -> the library that decodes them.
DECODERS = {
    "cdr": "mcap_ros2.decoder",
    "ros1": "mcap_ros1.decoder",
    "protobuf": "mcap_protobuf.decoder",
}


def parquet(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    """Yield the one stream of a Parquet file."""
    from pyarrow.parquet import ParquetFile

    log = ParquetFile(file, page_checksum_verification=True)
    most = most_cells(os.fstat(file.fileno()).st_size)
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
    table = _Table(refuse)
    for cell in cells:
        table.append(dict(_leaves(cell, name)))
    return table.columns()


def ardupilot(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    """Yield a stream for each kind of row, and each sensor of it, in an ArduPilot BIN."""
    rows: dict[tuple[str, Any], tuple[Any, dict[str, Any]]] = {}
    with _dataflash(file.name) as log:
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


def _dataflash(path: str) -> Any:
    """Return pymavlink's reader of a BIN file, a context that closes it.

    A damaged file raises any error of pymavlink, after it has been closed.
    """
    from pymavlink.DFReader import DFReader_binary

    class Layouts(dict[int, Any]):
        """Layouts of rows; pymavlink would read one without bytes forever."""

        def __setitem__(self, kind: int, layout: Any) -> None:
            if layout.len < BIN_HEADER_BYTES:
                raise ValueError(f"rows of {layout.name} have {layout.len} bytes")
            super().__setitem__(kind, layout)

    class Reader(DFReader_binary):  # type: ignore[misc]
        # The index that is made in C prints on damage past Python's own standard error.
        init_arrays_fast = DFReader_binary.init_arrays

        @property
        def formats(self) -> Layouts:
            return self.layouts

        @formats.setter
        def formats(self, layouts: dict[int, Any]) -> None:
            self.layouts = Layouts(layouts)

        def __init__(self) -> None:
            try:
                super().__init__(path, zero_time_base=True)
            except Exception:
                if hasattr(self, "data_map"):
                    self.data_map.close()
                self.filehandle.close()
                raise

    return Reader()


def ulog(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    """Yield a stream for each topic, and each sensor of it, in a PX4 ULog."""
    from pyulog import ULog

    content = file.read()
    if _ends_within_message(content):
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


def _ends_within_message(content: bytes) -> bool:
    """Return whether a ULog file ends in the middle of a message.

    Raises
    ------
    ValueError
        If a definition is damaged, on which pyulog would search forever.
    """
    at = ULOG_HEADER_BYTES
    defining = True
    while at + 3 <= len(content):
        size = int.from_bytes(content[at : at + 2], "little")
        kind = content[at + 2]
        defining = defining and kind not in ULOG_ROWS
        strange = kind == 0 or not 0 < size <= ULOG_MOST_BYTES
        if defining and kind not in ULOG_DEFINITIONS and strange:
            raise ValueError(f"no definition at byte {at}")
        at += 3 + size
    return at != len(content)


def mcap(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    """Yield a stream for each topic in an MCAP file."""
    from mcap.exceptions import McapError

    refuse = partial(refuse_cells, most=most_cells(os.fstat(file.fileno()).st_size))
    tables: dict[str, _Table] = {}
    left_out: dict[str, str] = {}
    try:
        for schema, channel, message in _messages(file, remarks):
            if channel.topic in left_out:
                continue
            try:
                decode = _decoder(channel.message_encoding, schema)
                row = dict(islice(_leaves(decode(message.data)), MOST_COLUMNS + 1))
            except (ImportError, MemoryError):  # not the messages' fault
                raise
            except Exception as error:  # each decoder has its own
                left_out[channel.topic] = f"is left out: its messages cannot be decoded ({error})"
                continue
            table = tables.setdefault(channel.topic, _Table(refuse))
            table.append(row | {"log_time": message.log_time / 1e9})
    except (McapError, struct.error) as error:
        remarks.append(f"{CUT} ({error})" if str(error) else CUT)
    remarks += [f"{topic} {reason}" for topic, reason in left_out.items()]
    for topic in list(tables):
        columns = tables.pop(topic).columns()
        order = np.argsort(columns["log_time"], kind="stable")
        columns = {name: cells[order] for name, cells in columns.items()}
        stamps = [one for one in ("header.stamp", "timestamp") if _is_clock(columns, one)]
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
    whole = _WholeReads(file, os.fstat(file.fileno()).st_size)
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


class _WholeReads:
    """A file for mcap, which would take the short part at a cut file's end for a whole one.

    Parameters
    ----------
    file
        The file, at its start.
    size
        Its bytes.
    """

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file = file
        self._left = size

    def read(self, count: int) -> bytes:
        """Return ``count`` bytes; EndOfFile is raised if there are fewer, before they take memory.

        ``count`` may be damaged, too.
        """
        from mcap.exceptions import EndOfFile

        if not 0 <= count <= self._left:
            raise EndOfFile
        self._left -= count
        return self._file.read(count)


def _decoder(encoding: str, schema: Any) -> Callable[[bytes], Any]:
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


def _is_clock(columns: Columns, name: str) -> bool:
    """Return whether a column of an MCAP's topic has stamps, s, of a clock that runs.

    A field "timestamp" may also be a number in other units, as of PX4's messages.
    """
    if name not in columns or not np.ptp(columns[name]) > 0.0:
        return False
    apart = float(np.median(np.abs(columns["log_time"] - columns[name])))
    return name == "header.stamp" or apart < SECONDS_PER_DAY


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield the names and the numbers in a decoded message; texts and long arrays are left out."""
    if isinstance(value, bool | int | float | np.number | np.bool_):
        yield name, float(value)
        return
    if isinstance(value, str | bytes | NoneType):
        return
    if hasattr(value, "__len__") and not isinstance(value, Mapping):
        if len(value) <= LONGEST_ARRAY:
            for i, entry in enumerate(value):
                yield from _leaves(entry, f"{name}[{i}]")
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
        yield from _leaves(entry, f"{name}.{key}" if name else key)


class _Table:
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
