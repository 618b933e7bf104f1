"""The process that reads a log: limits of what it takes, its end, and what comes through it."""

from __future__ import annotations

import shutil
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from aquafish_gym.utils.validation import InvalidArgumentError
from eea import read_log
from eea.logs.child import PROGRAM
from eea.logs.tables import read_recording
from log_files import COMMANDS, RATES, TIME, WRITERS, small_mcap

ROOT = Path(__file__).parents[2]
EXAMPLE = "examples/logs/swim.mcap"


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """Give a busy machine time; the tests of the limit set their own."""
    monkeypatch.setattr("eea.logs.child.most_seconds", lambda _size: 200.0)


@pytest.mark.parametrize("name", WRITERS)
def test_each_format_gives_the_swim_that_was_recorded(name, tmp_path):
    path = tmp_path / f"swim.{name}"
    columns = WRITERS[name](path)
    shutil.copy(path, tmp_path / "log")  # the name says nothing of the format
    log = read_log(tmp_path / "log", columns)
    np.testing.assert_allclose(log.time - log.time[0], TIME, atol=1e-6)
    np.testing.assert_allclose(log.gyro, RATES, atol=1e-6)
    np.testing.assert_allclose(log.commands, COMMANDS, atol=1e-9)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["log", path.name]


CELLS, EFFORT = "at most [0-9]* cells", "at most 0.25 GiB of memory|at most 2 s"


def wide_csv(path):
    path.write_bytes(b"," * 11_999 + b"\n" + b"1\n" * 20_000)


def long_parquet(path):
    zeros = pa.array(np.zeros(7_000_000))
    parquet.write_table(pa.table({f"c{i}": zeros for i in range(10)}), path, compression="zstd")


def lists_parquet(path):
    parquet.write_table(pa.table({"a": pa.array([[0.0] * 64] * 100_000)}), path)


def keys_mcap(path):
    small_mcap(path, (b'{"k%d":1}' % i for i in range(10_000)))


def nested_mcap(path):
    text = "1"
    for _ in range(4):
        text = "[" + ",".join([text] * 60) + "]"
    small_mcap(path, [text.encode()])


def empty_elements_mcap(path):
    kind = b"E[] x\n" + b"=" * 80 + b"\nMSG: p/E\n"
    message = struct.pack("<I", 2**31 - 1) + bytes(8)
    small_mcap(path, [message], kind=kind, encoding="ros1")


def nested_ulog(path):
    def message(kind, body):
        return struct.pack("<HB", len(body), ord(kind)) + body

    content = b"ULog\x01\x12\x35\x01" + bytes(8) + message("B", bytes(40))
    for i in range(40):
        content += message("F", f"t{i}:uint64_t timestamp;t{i + 1}[60] a;t{i + 1}[60] b;".encode())
    content += message("F", b"t40:uint64_t timestamp;float x;") + message("A", bytes(3) + b"t0")
    path.write_bytes(content + message("D", bytes(102)))


BOMBS: dict[Callable[[Path], None], str] = {
    wide_csv: CELLS, long_parquet: CELLS, lists_parquet: EFFORT, keys_mcap: CELLS,
    nested_mcap: "at most 50000 columns", empty_elements_mcap: EFFORT, nested_ulog: EFFORT,
}  # fmt: skip


#: One of each kind of limit.
QUICK = (wide_csv, nested_mcap, lists_parquet)


@pytest.mark.parametrize(
    "write", [pytest.param(one, marks=() if one in QUICK else pytest.mark.slow) for one in BOMBS]
)
def test_a_small_file_that_states_a_large_log_is_refused_with_what_to_do(
    write, tmp_path, monkeypatch
):
    if BOMBS[write] == EFFORT:
        monkeypatch.setattr("eea.logs.child.most_seconds", lambda _size: 2.0)
        monkeypatch.setattr("eea.logs.child.most_memory", lambda _size: 2**28)
        monkeypatch.setattr("eea.logs.tables.most_memory", lambda _size: 2**28)
    path = tmp_path / "swim.log"
    write(path)
    with pytest.raises(InvalidArgumentError, match=f"({BOMBS[write]}).*smaller file") as told:
        read_recording(path)
    assert "damaged" not in str(told.value)


def test_a_file_that_takes_long_is_refused_with_what_to_do(tmp_path, monkeypatch):
    empty_elements_mcap(tmp_path / "swim.mcap")
    monkeypatch.setattr("eea.logs.child.most_seconds", lambda _size: 1.0)
    with pytest.raises(InvalidArgumentError, match="at most 1 s; it takes longer"):
        read_recording(tmp_path / "swim.mcap")


def test_a_large_parent_does_not_count(monkeypatch):
    monkeypatch.setattr("eea.logs.child.most_memory", lambda _size: 2**28)
    large = np.ones(2**26)  # 512 MiB
    assert read_recording(ROOT / EXAMPLE).streams
    assert large[-1] == 1.0


def test_the_process_that_reads_ends_with_its_parent(tmp_path):
    empty_elements_mcap(tmp_path / "swim.mcap")
    places = [str(ROOT / name) for name in ("aquafish_gym", "eea")]
    words = [*places, "MCAP", str(tmp_path / "swim.mcap"), str(2**30), "60", *sys.path]
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        try:
            assert child.stdin is not None
            child.stdin.close()  # as where the parent is killed
            assert child.wait(timeout=20) == 1
        finally:
            child.kill()


def test_a_file_beside_the_log_is_not_taken_for_a_library(tmp_path, monkeypatch):
    for name in ("mcap", "numpy", "json"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert read_recording(ROOT / EXAMPLE).streams


def test_texts_of_a_log_come_through_the_process(tmp_path):
    table = pa.table({
        "mode": ["swim", "rest", None, "swim"], "on": [True, None, False, True],
        "count": pa.array([1, None, 3, 2**40]), "number": ["1.5", "2", "3", "4"],
    })  # fmt: skip
    parquet.write_table(table, tmp_path / "swim.parquet")
    (stream,) = read_recording(tmp_path / "swim.parquet").streams
    assert stream.columns["mode"].tolist() == ["swim", "rest", None, "swim"]
    np.testing.assert_array_equal(stream.columns["count"], [1.0, np.nan, 3.0, 2.0**40])
    assert stream.columns["number"].tolist() == [1.5, 2.0, 3.0, 4.0]
