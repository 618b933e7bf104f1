from __future__ import annotations

import json
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aquafish_gym.runs.storage import (
    DamagedFileError,
    append_record,
    ensure_writable_directory,
    read_records,
    write_json,
)
from aquafish_gym.utils.validation import InvalidArgumentError

JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=10,
)


def test_a_document_is_read_back_with_numpy_as_plain_numbers(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {"array": np.eye(2), "number": np.float32(0.5), "path": tmp_path, "n": 1})
    document = json.loads(path.read_text())
    assert document == {"array": [[1, 0], [0, 1]], "number": 0.5, "path": str(tmp_path), "n": 1}
    write_json(path, [])
    assert json.loads(path.read_text()) == []


@pytest.mark.parametrize(
    ("document", "error"), [({"x": float("nan")}, ValueError), ({"x": object()}, TypeError)]
)
def test_a_document_that_is_not_json_leaves_the_old_one_alone(tmp_path, document, error):
    path = tmp_path / "a.json"
    write_json(path, {"x": 1})
    with pytest.raises(error):
        write_json(path, document)
    assert json.loads(path.read_text()) == {"x": 1}
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]


def test_a_write_that_fails_leaves_the_old_document_and_no_litter(tmp_path, monkeypatch):
    path = tmp_path / "a.json"
    write_json(path, 1)

    def fail(*_):
        raise OSError("the disk is full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(OSError, match="the disk is full"):
        write_json(path, 2)
    assert json.loads(path.read_text()) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]


def test_documents_are_readable_as_the_umask_says(tmp_path):
    old = os.umask(0o022)
    try:
        write_json(tmp_path / "a.json", 1)
    finally:
        os.umask(old)
    assert (tmp_path / "a.json").stat().st_mode & 0o777 == 0o644


@given(st.lists(JSON, max_size=5))
def test_records_are_read_back_in_order(tmp_path_factory, records):
    path = tmp_path_factory.mktemp("log") / "log.jsonl"
    path.touch()
    for record in records:
        append_record(path, record)
    assert read_records(path) == records


@given(st.data())
def test_any_torn_line_is_found_and_what_came_before_is_kept(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("log") / "log.jsonl"
    for i in range(3):
        append_record(path, {"round": i, "value": 0.1 * i})
    content = path.read_bytes()
    last = content.rstrip(b"\n").rfind(b"\n") + 1
    path.write_bytes(content[: data.draw(st.integers(last + 1, len(content) - 2))])
    with pytest.raises(DamagedFileError, match=r"log\.jsonl, line 3: the line is torn") as caught:
        read_records(path)
    assert caught.value.line == 3
    assert [record["round"] for record in caught.value.records] == [0, 1]
    # What is appended later is not joined to the torn line.
    append_record(path, {"round": 3})
    assert json.loads(path.read_bytes().splitlines()[-1])["record"] == {"round": 3}
    with pytest.raises(DamagedFileError, match="line 3"):
        read_records(path)


@given(st.data())
def test_any_changed_digit_is_found(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("log") / "log.jsonl"
    for i in range(3):
        append_record(path, {"value": [1234567 + i, 0.7654321]})
    content = bytearray(path.read_bytes())
    digits = [i for i, byte in enumerate(content) if chr(byte).isdigit()]
    where = data.draw(st.sampled_from(digits))
    # Cycling the digits 1 to 9 makes no leading zero, which JSON would not read.
    content[where] = ord("1") if content[where] in b"09" else content[where] + 1
    path.write_bytes(bytes(content))
    line = bytes(content[:where]).count(b"\n") + 1
    with pytest.raises(DamagedFileError, match=f"line {line}: the record does not match"):
        read_records(path)


@pytest.mark.parametrize("line", ["", "{}", "[]", "null", "3", '{"checksum": "x"}', "nonsense"])
def test_a_line_that_is_no_record_is_named(tmp_path, line):
    path = tmp_path / "log.jsonl"
    append_record(path, 1)
    path.write_text(path.read_text() + line + "\n")
    with pytest.raises(DamagedFileError, match="line 2: the line is not a record"):
        read_records(path)


def test_a_record_of_nan_is_refused_and_nothing_is_written(tmp_path):
    path = tmp_path / "log.jsonl"
    with pytest.raises(ValueError, match="JSON compliant"):
        append_record(path, float("nan"))
    assert not path.exists()


def test_a_directory_is_made(tmp_path):
    made = ensure_writable_directory(tmp_path / "a" / "b")
    assert made.is_dir()
    assert not list(made.iterdir())
    assert ensure_writable_directory(made) == made


def test_a_directory_that_cannot_be_is_refused_by_name(tmp_path):
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InvalidArgumentError, match="folder must be a directory that can be"):
            ensure_writable_directory(path, "folder")
