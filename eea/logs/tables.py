"""The one reader of recorders' logs: CSV, Parquet, ArduPilot BIN, PX4 ULog and MCAP.

A file becomes streams of columns, each stream with its own rows. CSV is read here; the libraries of
the field read the others (extra ``logs``) and are loaded when a file needs them.
"""

from __future__ import annotations

import csv
import io
import os
import struct
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.storage import DamagedFileError, open_regular
from aquafish_gym.utils.validation import MissingExtraError, brief, install_advice
from eea.logs.cells import decoder, is_clock, leaves, named, numbers, stated_units, tabulated
from eea.logs.libraries import ends_within_message, open_dataflash
from eea.logs.other_formats import refuse_other
from eea.logs.streams import Recording, Stream

LARGEST_CSV_BYTES = 64 * 2**20  # more than an hour at 100 rows a second
LARGEST_LOG_BYTES = 2**31
ARDUPILOT_CLOCKS = (("TimeUS", 1e-6), ("TimeMS", 1e-3))
CUT = "the file ends in the middle of a row, which is left out"


def read_recording(path: str | os.PathLike[str]) -> Recording:
    """Return the streams of a log; its first bytes tell the format.

    A file that ends in the middle of a row is read up to there, and a remark says so.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read, is damaged, or has another format; it says how to convert it.
    MissingExtraError
        If the extra ``logs`` is needed and not installed.
    """
    remarks: list[str] = []
    with open_regular(path, "log", LARGEST_LOG_BYTES) as file:
        begin = file.read(32)
        file.seek(0)
        name, read = next((RECORDERS[one] for one in RECORDERS if begin.startswith(one)), CSV)
        try:
            refuse_other(begin)
            # The libraries print what they skip.
            with redirect_stdout(io.StringIO()) as said, redirect_stderr(said):
                streams = sorted(read(file, remarks), key=lambda stream: stream.name)
        except DamagedFileError as error:
            raise DamagedFileError(f"log: {path}: {error}") from None
        except ImportError as error:
            raise MissingExtraError(
                f"log: {path}: {name} needs the extra logs ({error}): {install_advice('logs')}"
            ) from None
        except Exception as error:  # each library has its own for a damaged file
            raise DamagedFileError(
                f"log: {path}: it is a damaged {name} file: copy it from its recorder again "
                f"({brief(str(error)) if str(error) else type(error).__name__})"
            ) from None
    if said.getvalue():
        remarks.append(f"its library says: {said.getvalue().splitlines()[0]}")
    return Recording(name, streams, remarks)


def _csv(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    content = file.read(LARGEST_CSV_BYTES + 1)
    if len(content) > LARGEST_CSV_BYTES:
        raise DamagedFileError(f"it has more than {LARGEST_CSV_BYTES} bytes: write it as Parquet")
    try:
        text = content.decode("utf-8-sig")
        delimiter = max(",;\t", key=text.partition("\n")[0].count)
        rows = [row for row in csv.reader(io.StringIO(text), delimiter=delimiter) if row]
    except (csv.Error, UnicodeDecodeError) as error:
        raise DamagedFileError(f"it is no CSV, Parquet, BIN, ULog or MCAP file: {error}") from None
    names = [name.strip() for name in rows.pop(0)] if rows else []
    if rows and len(rows[-1]) < len(names) and not text.endswith("\n"):
        rows.pop()
        remarks.append(CUT)
    for number, row in enumerate(rows, 1):
        if any(row[len(names) :]):
            raise DamagedFileError(
                f"row {number} has {len(row)} cells, and the first line of the file names "
                f"{len(names)} columns: it must name all"
            )
    filled = [[*row, *[None] * (len(names) - len(row))] for row in rows]
    columns = [numbers([row[i] for row in filled]) for i in range(len(names))]
    yield Stream("", named(names, columns, remarks), {}, stated_units(names))


def _parquet(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    from pyarrow import parquet

    table = parquet.read_table(file)
    names: list[str] = []
    columns: list[NDArray[Any]] = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        values = column.to_pandas().tolist()
        if any(isinstance(value, Mapping | np.ndarray) for value in values):
            inner = tabulated([dict(leaves(value, name)) for value in values])
        else:
            inner = {name: numbers(values)}
        names += inner
        columns += inner.values()
    yield Stream("", named(names, columns, remarks), {}, stated_units(names))


def _ardupilot(file: BinaryIO, remarks: list[str]) -> Iterator[Stream]:
    with open_dataflash(file.name) as log:
        rows: dict[tuple[str, Any], list[Any]] = defaultdict(list)
        while (row := log.recv_msg()) is not None:
            sensor = row.fmt.instance_field and getattr(row, row.fmt.instance_field)
            rows[row.get_type(), sensor].append(row)
        if log.offset < log.data_len:
            remarks.append(CUT)
    sensors = Counter(name for name, _ in rows)
    for (name, sensor), messages in rows.items():
        layout = messages[0].fmt
        clocks = {one: tick for one, tick in ARDUPILOT_CLOCKS if one in layout.columns}
        if clocks:
            yield Stream(
                name if sensors[name] == 1 else f"{name}[{sensor}]",
                {one: numbers([getattr(row, one) for row in messages]) for one in layout.columns},
                clocks,
                dict(zip(layout.columns, layout.units or (), strict=False)),
            )


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
    import mcap_protobuf.decoder
    import mcap_ros1.decoder
    import mcap_ros2.decoder
    from mcap.exceptions import McapError
    from mcap.reader import NonSeekingReader

    factories = [one.decoder.DecoderFactory() for one in (mcap_ros2, mcap_ros1, mcap_protobuf)]
    rows: dict[str, list[dict[str, float]]] = defaultdict(list)
    left_out: dict[str, str] = {}
    # Without the index at the file's end, which a recorder that lost its power did not write.
    messages = NonSeekingReader(file)
    try:
        for schema, channel, message in messages.iter_messages(log_time_order=False):
            if channel.topic in left_out:
                continue
            try:
                decode = decoder(channel.message_encoding, schema, factories)
                row = dict(leaves(decode(message.data)))
            except Exception as error:  # each decoder has its own
                left_out[channel.topic] = f"is left out: its messages cannot be decoded ({error})"
                continue
            rows[channel.topic].append(row | {"log_time": message.log_time / 1e9})
    except (McapError, struct.error) as error:
        remarks.append(f"{CUT} ({error})")
    remarks += [f"{topic} {reason}" for topic, reason in left_out.items()]
    for topic, each in rows.items():
        columns = tabulated(sorted(each, key=lambda row: row["log_time"]))
        stamps = [one for one in ("header.stamp", "timestamp") if is_clock(columns, one)]
        yield Stream(topic, columns, dict.fromkeys([*stamps, "log_time"], 1.0))


Reader = Callable[[BinaryIO, list[str]], Iterator[Stream]]
CSV: tuple[str, Reader] = ("CSV", _csv)
#: The first bytes of a file -> its format.
RECORDERS: dict[bytes, tuple[str, Reader]] = {
    b"PAR1": ("Parquet", _parquet),
    b"\xa3\x95": ("ArduPilot BIN", _ardupilot),
    b"ULog": ("PX4 ULog", _ulog),
    b"\x89MCAP": ("MCAP", _mcap),
}
