from __future__ import annotations

import json
import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym.runs.arrays import read_arrays, write_arrays
from aquafish_gym.runs.storage import (
    CannotWriteError,
    DamagedFileError,
    decode_document,
    encode_document,
    ensure_writable_directory,
    read_document,
    write_document,
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
    with pytest.raises(CannotWriteError, match=r"cannot write .*a\.json: the disk is full"):
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


@settings(max_examples=30, deadline=None)
@given(st.dictionaries(st.text().filter(lambda key: key not in ("schema", "checksum")), JSON))
def test_a_document_comes_back_as_it_was(content):
    document = encode_document(content, "test/1")
    assert decode_document(document, "a.json", "test/1") == content
    assert encode_document(decode_document(document, "a.json"), "test/1") == document
    raw = json.loads(document)
    assert list(raw)[:2] == ["schema", "checksum"]
    assert {key: value for key, value in raw.items() if key in content} == content


def test_numpy_and_numbers_as_keys_come_back_as_json_has_them(tmp_path):
    path = tmp_path / "a.json"
    write_document(path, {"array": np.eye(2), "by seed": {3: np.float32(0.5)}, "at": tmp_path})
    expected = {"array": [[1, 0], [0, 1]], "by seed": {"3": 0.5}, "at": str(tmp_path)}
    assert read_document(path) == expected


@pytest.mark.parametrize(
    ("content", "error"),
    [
        ({"x": float("nan")}, ValueError),
        ({"x": object()}, TypeError),
        ({"checksum": "mine"}, ValueError),
        ({"schema": "other/1"}, ValueError),
    ],
)
def test_what_no_document_can_hold_is_refused_and_nothing_is_written(tmp_path, content, error):
    path = tmp_path / "a.json"
    with pytest.raises(error):
        write_document(path, content, "test/1")
    assert not path.exists()


def test_a_document_without_checksum_is_for_those_who_take_one(tmp_path):
    path = tmp_path / "by-hand.json"
    path.write_text('{"a": 1}')
    assert read_document(path, "test/1", checksum="optional") == {"a": 1}
    with pytest.raises(DamagedFileError, match=r"body: .*by-hand\.json has no checksum"):
        read_document(path, argument="body")
    write_document(path, {"a": 1}, "test/1")
    path.write_text(path.read_text().replace('"a": 1', '"a": 2'))
    with pytest.raises(DamagedFileError, match="does not match its checksum"):
        read_document(path, checksum="optional")  # where there is one, it counts


def test_a_document_of_another_schema_is_refused(tmp_path):
    path = tmp_path / "a.json"
    for checksum in ("required", "optional"):
        write_document(path, {"a": 1}, "test/2")
        with pytest.raises(DamagedFileError, match="must be of schema test/1; it says 'test/2'"):
            read_document(path, "test/1", checksum=checksum)


def test_arrays_come_back_as_they_were(tmp_path):
    path = tmp_path / "a.npz"
    arrays = {
        "positions": np.arange(6.0).reshape(2, 3),
        "columns": np.asfortranarray(np.arange(6, dtype=np.float32).reshape(3, 2)),
        "truth": np.array([True, False]),
        "number": np.array(3),
        "none": np.zeros((0, 3)),
    }
    write_arrays(path, arrays)
    before = path.read_bytes()
    shapes = {"positions": (None, 3), "columns": (3, 2), "truth": (2,), "number": ()}
    found = read_arrays(path, {**shapes, "none": (None, 3)})
    for name, array in arrays.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)
        found[name][...] = 1  # they may be written
    write_arrays(path, arrays)
    assert path.read_bytes() == before
    with pytest.raises(TypeError, match="names must be an array of numbers"):
        write_arrays(path, {"names": np.array(["a"])})


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


def test_no_name_at_all_is_no_directory():
    for path in ("", None, 3, "a\0b"):
        with pytest.raises(InvalidArgumentError, match=r"^out must be a"):
            ensure_writable_directory(path)
