"""Logs as recorders write them: five formats, one reader, and a sentence for each mistake."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType

from aquafish_gym.utils.validation import InvalidArgumentError, MissingExtraError
from eea import read_log
from eea.__main__ import main
from eea.logs.alignment import align, held_means
from eea.logs.columns import Quantity, gyroscopes, time_columns
from eea.logs.streams import Recording, Stream
from eea.logs.summary import summary
from eea.logs.tables import read_recording
from log_files import (
    COMMANDS,
    RATES,
    SCALED,
    TIME,
    WRITERS,
    small_mcap,
    write_bin,
    write_csv,
    write_mcap,
    write_parquet,
    write_ulog,
)

ROOT = Path(__file__).parents[2]
EXAMPLE = "examples/logs/swim.mcap"
PAGE = (ROOT / "docs" / "howto" / "logs.md").read_text(encoding="utf-8")
pytestmark = pytest.mark.usefixtures("read_here")


def test_a_part_is_read_by_its_time(tmp_path):
    path = tmp_path / "swim.ulg"
    log = read_log(path, write_ulog(path), (0.395, 0.805))
    np.testing.assert_allclose(log.gyro, RATES[40:81], atol=1e-6)
    np.testing.assert_allclose(log.commands, COMMANDS[40:81], atol=1e-9)


def test_messages_of_ros_1_and_of_protobuf_are_read(tmp_path):
    from google.protobuf.timestamp_pb2 import Timestamp
    from mcap.writer import Writer
    from mcap_protobuf.writer import Writer as ProtobufWriter

    path = tmp_path / "ros1.mcap"
    with path.open("wb") as file:
        log = Writer(file)
        log.start()
        schema = log.register_schema("p/Rate", "ros1msg", b"time stamp\nfloat64 x\nstring s")
        channel = log.register_channel("/rate", "ros1", schema)
        data = struct.pack("<IIdI", 3, 500_000_000, 0.25, 2) + b"hi"
        log.add_message(channel, 10**9, data, 10**9)
        log.finish()
    (stream,) = read_recording(path).streams
    assert {name: cells.tolist() for name, cells in stream.columns.items()} == {
        "stamp": [3.5], "x": [0.25], "log_time": [1.0],
    }  # fmt: skip
    path = tmp_path / "protobuf.mcap"
    with path.open("wb") as file, ProtobufWriter(file) as protobuf:
        protobuf.write_message("/time", Timestamp(seconds=2, nanos=5), 10**9, 10**9)
    (stream,) = read_recording(path).streams
    assert stream.columns[""].tolist() == [2.000000005]


def test_commands_are_held_and_averaged_over_time_never_matched_by_row():
    at = np.array([0.0, 0.01, 0.02, 0.03])
    time = np.array([0.0, 0.005, 0.0175, 0.025])
    values = np.array([[0.1], [0.3], [0.3], [0.5]])
    np.testing.assert_allclose(held_means(at, time, values)[:, 0], [0.2, 0.3, 0.4, 0.5])
    steady = np.full((4, 1), 0.1)
    assert (held_means(at, time, steady) == 0.1).all(), "without rounding"


def test_what_was_done_is_said(tmp_path):
    columns = write_mcap(tmp_path / "swim.mcap")
    remarks = read_log(tmp_path / "swim.mcap", columns).remarks
    assert remarks[0].startswith("/camera is left out: its messages cannot be decoded (jpeg by js")
    assert remarks[1] == "the times are those of header.stamp"
    assert remarks[2].startswith("/servos has 10 rows a second: its commands are held until its")


def test_rows_before_the_first_command_are_left_out(tmp_path):
    columns = write_mcap(tmp_path / "swim.mcap", behind=-0.045)
    log = read_log(tmp_path / "swim.mcap", columns)
    assert any(line.startswith("the first 0.04 s have no row of /servos") for line in log.remarks)
    np.testing.assert_allclose(log.gyro, RATES[5:], atol=1e-6)
    changed = int(np.flatnonzero(np.diff(log.commands[:, 0]))[0]) + 1
    assert log.commands[changed, 0] == pytest.approx(
        0.5 * (COMMANDS[0, 0] + COMMANDS[-1, 0]), abs=1e-5
    )


IMU = "IMU.GyrX,IMU.GyrY,IMU.GyrZ"
MISTAKES: dict[str, tuple[str, dict[str, str | None], str]] = {
    "quantity": ("BIN", {"gyros": "IMU.GyrX"}, "map must be one of time, gyro, .*mean 'gyro'"),
    "unit": ("BIN", {"gyro:deg": "IMU.GyrX", "gyro": None}, "gyro must have 3"),
    "other unit": ("BIN", {"gyro:deg/s": IMU, "gyro": None}, "gyro must be in rad/s.*got deg/s"),
    "no unit of it": ("BIN", {"caudal": "RCOU.C3"}, "RCOU.C3 is in us: .*as in caudal=0.5"),
    "twice": ("BIN", {"gyro:rad/s": IMU}, "map must name gyro once"),
    "one column": ("BIN", {"gyro": "IMU.GyrX"}, "gyro must have 3 columns, joined by commas"),
    "comma": ("BIN", {"gyro": "IMU.GyrX,,IMU.GyrZ"}, "gyro must have columns"),
    "mistyped": ("BIN", {"gyro": IMU.replace("GyrX", "GirX")}, r"'IMU.GirX'; .*mean IMU.GyrX\?"),
    "stream": ("BIN", {"gyro": "IMU.GyrX,IMU.GyrY,RCOU.C1"}, "gyro must be of one stream, IMU"),
    "clock": ("mcap", {"time": "/imu.turn.x"}, "time must be a column of each stream.*/servos has"),
    "another's clock": ("BIN", {"time": "MSG.TimeUS"}, "time must be a column of IMU, RCOU, .*MSG"),
    "clock's unit": ("BIN", {"time:ms": "TimeUS"}, "TimeUS is in ticks of 1e-06 s; got ms"),
    "two clocks": ("mcap", {"time": "log_time,header.stamp"}, "time must be one column"),
    "scaled time": ("csv", {"time": "2*t [ms]"}, "time must be a column; got"),
    "no time": ("csv", {"time": None}, "one column time; .*--map 'time=t .ms.'"),
    "text": ("parquet", {"caudal": "note"}, "row 1 must have numbers; note is 'swims'"),
    "rates": ("csv", {"gyro": "s1,s2,s3"}, "at most 10 rad/s, which no such fish"),
    "scale": ("csv", {"caudal": "s3"}, r"row 1: caudal must be in \[0, 1\] Hz; got 1600"),
    "trial": ("BIN", {"trial": "RCOU.C1"}, "trial must be of one stream, IMU"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_wrong_map_is_refused_with_what_to_write(mistake, tmp_path):
    name, changes, message = MISTAKES[mistake]
    path = tmp_path / f"swim.{name}"
    columns = {**WRITERS[name](path), **changes}
    kept = {key: text for key, text in columns.items() if text is not None}
    with pytest.raises(InvalidArgumentError, match=f"log: {path}: .*{message}"):
        read_log(path, kept)


@pytest.mark.parametrize("sensors", [1, 2])
def test_a_map_is_suggested_and_can_be_pasted(sensors, tmp_path, capsys):
    path = tmp_path / "00000001.BIN"
    columns = write_bin(path, sensors)
    assert main(["infer", "--log", str(path)]) == 2
    said = capsys.readouterr().err
    assert "it must have one column gyro_x" in said
    command = shlex.split(said.partition("as in aquafish ")[2])
    words = dict(word.split("=") for word in command[command.index("--map") + 1 :])
    assert words == {"gyro": columns["gyro"], **dict.fromkeys(SCALED, "COLUMN")}
    assert read_log(path, {**columns, "gyro": words["gyro"]}).gyro == pytest.approx(RATES, abs=1e-6)
    if sensors == 2:
        with pytest.raises(InvalidArgumentError, match=r"did you mean IMU\[\d\].GyrX"):
            read_log(path, {**columns, "gyro": "IMU.GyrX,IMU.GyrY,IMU.GyrZ"})


def test_units_that_the_file_states_are_converted(tmp_path):
    columns = write_bin(tmp_path / "swim.BIN", unit="k")
    log = read_log(tmp_path / "swim.BIN", columns)
    np.testing.assert_allclose(log.gyro, np.deg2rad(RATES), atol=1e-6)


def test_streams_of_two_clocks_are_refused(tmp_path):
    columns = write_mcap(tmp_path / "swim.mcap", behind=30.0)
    with pytest.raises(InvalidArgumentError, match=r"header.stamp .* 30 s apart.*time=log_time"):
        read_log(tmp_path / "swim.mcap", columns)
    log = read_log(tmp_path / "swim.mcap", {**columns, "time": "log_time"})
    np.testing.assert_allclose(log.commands, COMMANDS, atol=1e-9)


ONE = {"x": Quantity(("x",), {})}


def stamped(stamps, logged):
    """Return a topic with stamps and the recorder's times after 1.7e9 s."""
    columns = {"header.stamp": np.array(stamps), "x": np.arange(len(logged)) * 1.0}
    columns["log_time"] = 1.7e9 + np.array(logged)
    clocks = {"header.stamp": 1.0, "log_time": 1.0}
    return Recording("MCAP", [Stream("/imu", columns, clocks)], [])


@pytest.mark.parametrize(
    ("stamp", "said"),
    [
        (lambda t: 0.0 if t < 0.3 else 1.7e9 + t, r"at row 31 it goes 1\d{9}\S* s ahead of"),
        (lambda t: 1.7e9 + t + 0.2 * (t > 0.595), r"at row 61 it goes 0\.[12]\d* s ahead of"),
        (lambda t: 1.7e9 + t - 0.2 * (t > 0.595), r"at row 61 it goes 0\.[12]\d* s back of"),
    ],
)
def test_a_clock_that_was_set_while_recording_is_refused_with_the_recorders(stamp, said):
    late = np.abs(np.random.default_rng(0).normal(0.0, 0.02, 120)) + 1e-3  # of each message
    logged = np.maximum.accumulate(TIME + late)
    imu = stamped([stamp(t) for t in TIME], logged)
    with pytest.raises(InvalidArgumentError, match=f"header.stamp of /imu was set .*{said} log_ti"):
        align(imu, ONE, {"x": "x"}, None, 0.25)
    found = align(imu, ONE, {"x": "x", "time": "log_time"}, None, 0.25)
    np.testing.assert_allclose(found.time, logged - logged[0], atol=1e-6)


def test_a_clock_is_not_taken_for_set_by_delays_or_a_pace():
    time = 0.01 * np.arange(3000)
    for logged in (
        1.002 * time,  # a slow clock
        np.ceil((time + 1e-3) / 0.5) * 0.5,  # messages that wait
        time + 3.0 * (np.arange(3000) == 900),  # one that waits long
    ):
        align(stamped(1.7e9 + time, logged), ONE, {"x": "x"}, None, 0.25)


def test_a_hole_names_a_clock_that_has_none():
    columns = {
        "time": TIME + 5.0 * (TIME > 0.595), "elapsed_time [ms]": 1e3 * TIME, "x": np.ones(120),
        "y": np.where(np.arange(120) % 5 == 0, 1.0, np.nan),
    }  # fmt: skip
    log = Recording("CSV", [Stream("", columns, {}, {"elapsed_time [ms]": "ms"})], [])
    wanted = {"x": Quantity(("x",), {}), "y": Quantity(("y",), {})}
    with pytest.raises(
        InvalidArgumentError, match=r"y must have no hole .*time=elapsed_time \[ms]"
    ):
        align(log, wanted, {}, None, 0.25)
    found = align(log, wanted, {"time": "elapsed_time [ms]"}, None, 0.25)
    np.testing.assert_allclose(found.time, TIME, atol=1e-9)


def test_columns_of_another_rate_are_listed_with_it(tmp_path):
    lines = ["time,fast,slow,note"]
    for row in range(200):
        slow = f"{row}" if row % 10 == 0 else ""
        lines.append(f"{0.01 * row:.3f},{row},{slow},{'on' if slow else ''}")
    said = summary(table("\n".join([*lines, ""]), tmp_path))
    assert said[1].split()[:4] == ["the", "table", "200", "100"]
    assert said[2].split()[:6] == ["2", "columns:", "slow,", "note", "20", "10"]


def test_a_hole_is_refused_with_the_parts_beside_it(tmp_path, monkeypatch):
    path = tmp_path / "swim.BIN"
    monkeypatch.setattr("log_files.TIME", TIME + 2.0 * (TIME > 0.595))
    columns = write_bin(path)
    still = {name: text for name, text in columns.items() if name not in SCALED}
    still |= {f"{name}:rad/s": "0*IMU.GyrX" for name in SCALED}
    said = "IMU must have no hole.*from 0.59 to 2.6 s.*between 0 and 0.59 or between 2.6 and 3.19"
    with pytest.raises(InvalidArgumentError, match="RCOU must have no hole of more than"):
        read_log(path, columns)
    with pytest.raises(InvalidArgumentError, match=said):
        read_log(path, still)
    assert len(read_log(path, columns, (2.6, 3.19)).time) == 60
    monkeypatch.setattr("log_files.TIME", np.where(TIME > 0.595, TIME - 0.3, TIME))
    write_bin(path)
    with pytest.raises(InvalidArgumentError, match=r"not go back in time; .*between 0 and 0.59"):
        read_log(path, still)


@pytest.mark.parametrize(
    ("between", "parts"), [((0.0, 0.8), "between 0 and 0.5"), ((0.7, 1.19), "between 1 and 1.19")]
)
def test_a_hole_of_the_commands_counts_where_one_side_of_it_is_read(between, parts, tmp_path):
    path = tmp_path / "swim.csv"
    lines = ["time,gyro_x,gyro_y,gyro_z,left_pectoral,right_pectoral,caudal"]
    for time, rates in zip(TIME, RATES, strict=True):
        command = ",," if 0.505 < time < 0.995 else "0.5,-0.5,1"
        lines.append(",".join([f"{time:.2f}", *map(str, rates), command]))
    path.write_text("\n".join([*lines, ""]))
    with pytest.raises(InvalidArgumentError, match=f"must have no hole .*a part, {parts}$"):
        read_log(path, {}, between)
    assert len(read_log(path, {}, (0.0, 0.5)).time) == 51


def test_a_wrong_part_is_refused(tmp_path):
    columns = write_ulog(tmp_path / "swim.ulg")
    for between, said in (((0.5, 0.5), "the second later"), ((5.0, 9.0), "1.19 s; got 5 to 9")):
        with pytest.raises(InvalidArgumentError, match=f"between.*{said}"):
            read_log(tmp_path / "swim.ulg", columns, between)
    with pytest.raises(InvalidArgumentError, match="None where the log has several"):
        read_log(ROOT / "examples" / "logs" / "swim.csv", between=(0.0, 1.0))


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_that_is_cut_short_is_read_up_to_there_or_refused(name, tmp_path):
    path = tmp_path / f"swim.{name}"
    columns = WRITERS[name](path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.7 * len(whole)) + 9])
    if name == "parquet":
        with pytest.raises(InvalidArgumentError, match="damaged Parquet file: copy it"):
            read_log(path, columns)
        return
    log = read_log(path, columns)
    assert any("the file ends in the middle of a row" in line for line in log.remarks)
    count = len(log.gyro)
    assert 40 < count < len(RATES)
    np.testing.assert_allclose(log.gyro, RATES[:count], atol=1e-6)


@pytest.mark.parametrize("name", WRITERS)
def test_damage_anywhere_gives_one_sentence_and_no_other_output(name, tmp_path, capfd):
    path = tmp_path / f"swim.{name}"
    columns = WRITERS[name](path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    said: list[str] = []
    for _ in range(40):
        damaged = np.frombuffer(whole, np.uint8).copy()
        count = int(rng.choice([1, 3, 20]))
        damaged[rng.integers(len(whole), size=count)] = rng.integers(256, size=count)
        path.write_bytes(damaged.tobytes())
        for call in (lambda: summary(read_recording(path)), lambda: read_log(path, columns)):
            try:
                call()
            except InvalidArgumentError as error:
                said.append(str(error))
    assert not any("\n" in sentence for sentence in said)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "csv"])
def test_a_missing_extra_is_named(name, tmp_path, monkeypatch):
    path = tmp_path / f"swim.{name}"
    columns = WRITERS[name](path)
    for library in ("pyarrow", "pymavlink.DFReader", "pyulog", "mcap.reader", "mcap_ros2.decoder"):
        monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingExtraError, match=r"pip install \"aquafish-gym\[logs\]\""):
        read_log(path, columns)


OTHERS = {
    "a ROS 1 bag": b"#ROSBAG V2.0\n" + bytes(50),
    "a ROS 2 bag in SQLite": b"SQLite format 3\0" + bytes(50),
    "git lfs pull": b"version https://git-lfs.github.com/spec/v1\n",
    "unpack it": b"PK\x03\x04" + bytes(50),
    "an HDF5 file": b"\x89HDF\r\n\x1a\n" + bytes(50),
    "a telemetry log of MAVLink": bytes(8) + b"\xfd" + bytes(50),
    "the BIN of the same flight": b"FMT, 128, 89, FMT, BBnNZ, Type\n",
    "a damaged Parquet file": b"PAR1" + bytes(50),
    "a damaged ArduPilot BIN file|must have one column": b"\xa3\x95" + bytes(50),
    "a damaged PX4 ULog file": b"ULog\x01" + bytes(5),
    "a damaged MCAP file|must have one column": b"\x89MCAP0\r\n" + bytes(50),
    "it is no CSV": b"\xbc\x01\x02\xff",
    "row 1 has 3 cells, and the first line": b"a,b\n1,2,3\n",
}


@pytest.mark.parametrize("message", OTHERS)
def test_other_and_damaged_files_are_refused_with_what_to_do(message, tmp_path):
    path = tmp_path / "swim.log"
    path.write_bytes(OTHERS[message])
    with pytest.raises(InvalidArgumentError, match=f"log: {path}: .*({message})"):
        read_log(path)


def test_columns_without_numbers_or_with_one_name_are_said(tmp_path):
    path = tmp_path / "swim.csv"
    columns = write_csv(path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join(f"{line};{'nan' if i else 'x'}" for i, line in enumerate(lines)))
    with pytest.raises(InvalidArgumentError, match="x must have numbers; all of its cells are nan"):
        read_log(path, {**columns, "caudal": "x"})
    path.write_text("\n".join([lines[0] + ";s1", *(line + ";1500" for line in lines[1:])]) + "\n")
    with pytest.raises(InvalidArgumentError, match="got 's1'"):
        read_log(path, columns)
    assert read_recording(path).remarks == ["2 columns have the name 's1': they are left out"]


def test_the_page_shows_what_the_commands_print(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    assert main(["logs", EXAMPLE]) == 0
    assert f"```text\n{capsys.readouterr().out}```\n" in PAGE


@pytest.mark.parametrize(
    ("step", "unit"),
    [
        (0.01, "in s, by its usual step of 0.01"),
        (1, "in ms, by its usual step of 1; or in 10ms, if it has 100 rows a second"),
        (10, "in ms, by .*; or in 10ms, if it has 10 rows a second; or in 100us, if it has 1e.03"),
        (400, "in 100us, by its usual step of 400"),
        (10_000, "in us, by its usual step of 1e.04$"),
    ],
)
def test_the_unit_of_a_clock_follows_from_its_usual_step(step, unit):
    stream = Stream("", {"time": np.arange(50) * step})
    assert re.match(unit, next(time_columns(stream))[2])


def test_ticks_of_a_number_of_units_are_read(tmp_path):
    path = tmp_path / "swim.csv"
    columns = write_csv(path)
    del columns["time"]
    table = np.loadtxt(path, delimiter=";", skiprows=1)
    table[:, 0] *= 10.0  # 100 us
    names = "ticks;a [deg/s];b [deg/s];c [deg/s];s1;s2;s3"
    np.savetxt(path, table, "%.12g", ";", header=names, comments="")
    columns["gyro"] = "a [deg/s],b [deg/s],c [deg/s]"
    log = read_log(path, {**columns, "time:100us": "ticks"})
    np.testing.assert_allclose(log.time, TIME, atol=1e-9)
    with pytest.raises(InvalidArgumentError, match="the unit of time must be one of s, ms, us, ns"):
        read_log(path, {**columns, "time:ticks": "ticks"})


def table(text, tmp_path):
    """Return a CSV's one stream, as it is read from a file."""
    path = tmp_path / "swim.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_recording(path)


EMPTY = [np.nan, np.nan]
TABLES: dict[str, tuple[Any, dict[str, list[Any]], dict[str, str]]] = {
    "empty cells": ("a,b\n1,\n,2\nnan,n/a\n", {"a": [1, *EMPTY], "b": [np.nan, 2, np.nan]}, {}),
    "short rows": ("a,b,c\n1,2\n1,2,3\n", {"a": [1, 1], "b": [2, 2], "c": [np.nan, 3]}, {}),
    "truths": ("a,b\nTrue,1\nfalse,2\n", {"a": [1, 0], "b": [1, 2]}, {}),
    "decimal commas": ("t;x\n0,01;-1,5e1\n0,02;2\n", {"t": [0.01, 0.02], "x": [-15, 2]}, {}),
    "a comma in a text": ('a,b\n"1,500",2\n', {"a": ["1,500"], "b": [2]}, {}),
    "units": ("t,x\n[ms],°/s\n1,2\n2,3\n", {"t": [1, 2], "x": [2, 3]}, {"t": "ms", "x": "deg/s"}),
    "comments": ("# robot 7\n# of Monday\na,b\n1,2\n", {"a": [1], "b": [2]}, {}),
    "names of NumPy": ("# a b,c\n1,2\n", {"a b": [1], "c": [2]}, {}),
    "a spreadsheet's first line": ("sep=;\na;b\n1;2\n", {"a": [1], "b": [2]}, {}),
    "UTF-16": ("a,b\n1,2\n".encode("utf-16"), {"a": [1], "b": [2]}, {}),
    "old Windows": (
        "a [°/s],b\n1,2\n".encode("cp1252"), {"a [°/s]": [1], "b": [2]}, {"a [°/s]": "deg/s"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_other_programs_are_read(name, tmp_path):
    text, columns, units = TABLES[name]
    (stream,) = table(text, tmp_path).streams
    assert stream.columns.keys() == columns.keys()
    for column, cells in columns.items():
        np.testing.assert_array_equal(stream.columns[column], cells)
    assert stream.units == units


def test_peaks_of_a_spectrum_are_no_gyroscope():
    names = [f"peak_frequencies_{axis}[0]" for axis in "xyz"]
    fft = Stream("sensor_gyro_fft", {name: np.arange(9.0) for name in names})
    assert gyroscopes(Recording("PX4 ULog", [fft], [])) == []


def test_a_stream_is_listed_by_its_columns(tmp_path, capsys):
    write_parquet(tmp_path / "swim.parquet")
    assert main(["logs", str(tmp_path / "swim.parquet")]) == 0
    said = capsys.readouterr().out
    assert "no numbers, such as 'swims'" in said
    assert "gyroscope: gyro[0], gyro[1], gyro[2] in rad/s (at most 0.99" in said
    write_ulog(tmp_path / "swim.ulg")
    assert main(["logs", str(tmp_path / "swim.ulg"), "--stream", "actuator_outputs"]) == 0
    assert "output[0]     -   1300     1500" in capsys.readouterr().out
    assert main(["logs", str(tmp_path / "swim.ulg"), "--stream", "actuator_output"]) == 2
    assert "did you mean 'actuator_outputs'" in capsys.readouterr().err


def held(recording):
    return str([
        (one.name, {name: cells.tolist() for name, cells in one.columns.items()})
        for one in recording.streams
    ])  # fmt: skip


def test_the_example_of_ros_is_written_again_to_the_same_rows(tmp_path):
    write = runpy.run_path(str(ROOT / "examples" / "recorded_ros_swim.py"))["RecordedRosSwim"]
    write(out=tmp_path).execute()
    assert held(read_recording(tmp_path / "swim.mcap")) == held(read_recording(ROOT / EXAMPLE))


@pytest.mark.parametrize(
    "options",
    [
        {"chunk_size": 500, "compression": CompressionType.NONE},
        {"chunk_size": 500, "compression": CompressionType.ZSTD},
        {"use_chunking": False, "enable_data_crcs": True},
    ],
)
def test_a_flipped_bit_of_an_mcap_is_refused_or_said(options, tmp_path):
    path = tmp_path / "swim.mcap"
    small_mcap(path, (b'{"x": %.4f}' % (0.1 + i / 999) for i in range(40)), **options)
    whole = path.read_bytes()
    good = held(read_recording(path))
    assert read_recording(path).remarks == []
    for at in np.random.default_rng(0).permutation(8 * len(whole))[:300].tolist():
        content = bytearray(whole)
        content[at // 8] ^= 1 << at % 8
        path.write_bytes(content)
        try:
            recording = read_recording(path)
        except InvalidArgumentError:
            continue
        assert held(recording) == good or recording.remarks, at


def test_a_csv_that_ends_within_its_last_number_is_read_up_to_the_row_before(tmp_path):
    path = tmp_path / "swim.csv"
    path.write_text("time,x\n0,0.1234\n1,0.1234\n2,0.12")
    recording = read_recording(path)
    assert recording.streams[0].columns["x"].tolist() == [0.1234, 0.1234]
    assert recording.remarks == [
        "the file's last row has no end of line, so that it may be cut: it is left out"
    ]
    path.write_text("time,x\n0,0.1234\n1,0.1234\n")
    assert read_recording(path).remarks == []


TRICKS = "\x1b]0;title\x07", "\x1b[2Knote: all good", "\x9b2K", "\u202elacsuac"


@pytest.mark.parametrize("name", ["csv", "mcap"])
def test_names_of_a_log_reach_the_terminal_without_control_characters(name, tmp_path, capsys):
    path = tmp_path / f"swim\x1b[2K.{name}"
    if name == "csv":
        lines = [",".join(["time", *TRICKS]), *(f"{0.01 * i},1,2,3,4" for i in range(30))]
        path.write_text("\n".join([*lines, ""]), newline="")
    else:
        small_mcap(path, 2 * [json.dumps(dict.fromkeys(TRICKS, 1.0)).encode()])
    known = ["logs"] if name == "csv" else ["logs", "--stream", "/a"]
    for command in (known, ["logs", "--stream", "\x1b[2J"], ["infer", "--log"]):
        assert main([*command, str(path)]) == (0 if command == known else 2)
        said = capsys.readouterr()
        assert (said.out + said.err).replace("\n", "").isprintable()
        assert command != known or "\\x1b" in said.out
