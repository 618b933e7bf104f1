"""Files are written whole or not at all; damaged and hostile ones are refused by name."""

from __future__ import annotations

import io
import json
import os
import resource
import zipfile

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
SHAPES = {"time": (None,), "position": (None, 3)}


@settings(max_examples=30, deadline=None)
@given(st.dictionaries(st.text().filter(lambda key: key not in ("schema", "checksum")), JSON))
def test_documents_round_trip(content):
    document = encode_document(content, "test/1")
    assert decode_document(document, "a.json", "test/1") == content
    assert encode_document(decode_document(document, "a.json"), "test/1") == document
    assert next(iter(json.loads(document))) == "schema"


@pytest.mark.parametrize(
    ("content", "error"),
    [
        ({"x": float("nan")}, ValueError),
        ({"x": object()}, TypeError),
    ],
)
def test_content_that_is_no_json_leaves_the_old_file(tmp_path, content, error):
    path = tmp_path / "a.json"
    write_document(path, {"x": 1}, "test/1")
    with pytest.raises(error):
        write_document(path, content, "test/1")
    assert read_document(path, "test/1") == {"x": 1}
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]


def test_a_full_disk_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch):
    path = tmp_path / "a.json"
    write_document(path, {"x": 1})

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(CannotWriteError, match=r"cannot write .*a\.json: No space left"):
        write_document(path, {"x": 2})
    assert json.loads(path.read_text()) == {"x": 1}
    assert [file.name for file in tmp_path.iterdir()] == ["a.json"]


def test_files_have_the_mode_of_the_umask(tmp_path):
    old = os.umask(0o022)
    try:
        write_document(tmp_path / "a.json", {"x": 1})
    finally:
        os.umask(old)
    assert (tmp_path / "a.json").stat().st_mode & 0o777 == 0o644


def test_another_schema_is_refused(tmp_path):
    path = tmp_path / "a.json"
    write_document(path, {"a": 1}, "test/2")
    with pytest.raises(DamagedFileError, match=r"body: .*a\.json must be of schema test/1; it has"):
        read_document(path, "test/1", "body")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[1, 2]",
        b"[" * 1_000_000,
        b'{"n": ' + b"9" * 100_000 + b"}",
        b'{"a": NaN}',
        b'{"a": 1e999}',
        b'{"a": "\xff"}',
        bytes(range(256)),
    ],
)
def test_nonsense_is_refused_by_name(tmp_path, content):
    path = tmp_path / "a.json"
    path.write_bytes(content)
    with pytest.raises(DamagedFileError, match=r"a\.json") as refusal:
        read_document(path)
    assert len(str(refusal.value)) < 400


def test_a_document_of_empty_objects_takes_no_memory(tmp_path):
    """12 MB of them took 346 MB."""
    path = tmp_path / "a.json"
    path.write_bytes(b'{"a": [' + b"{}," * 4_000_000 + b"{}]}")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DamagedFileError, match="lists, objects and strings"):
        read_document(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 60_000  # KiB


def test_arrays_round_trip(tmp_path):
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
    found = read_arrays(path, {**shapes, "none": (None, 3), "more": ()}, optional=["more"])
    for name, array in arrays.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)
    write_arrays(path, arrays)
    assert path.read_bytes() == before
    with pytest.raises(TypeError, match="names must be an array of numbers"):
        write_arrays(path, {"names": np.array(["a"])})


def archive_with(header=None, **arrays):
    """Return an archive, whose member "time" has another header if one is given."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, array, allow_pickle=True)
            whole = member.getvalue()
            if header is not None and name == "time":
                whole = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
            archive.writestr(f"{name}.npy", whole)
    return content.getvalue()


GOOD = {"time": np.arange(5.0), "position": np.ones((5, 3))}
HEADERS = [
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (5,",  # tokenize.TokenError
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (10000000000000,), }",
    b"{'descr': '|O', 'fortran_order': False, 'shape': (5,), }",
    b"",
]


@pytest.mark.parametrize(
    "content",
    [
        *(archive_with(header, **GOOD) for header in HEADERS),
        archive_with(**GOOD, more=np.zeros(1)),
        archive_with(**GOOD | {"position": np.ones((5, 2))}),
        archive_with(**GOOD | {"time": np.array([print], object)}),
        archive_with(**GOOD | {"time": np.array(["a"])}),
        archive_with(**GOOD)[:-100],
        archive_with(**GOOD).replace(b"\x00\x00\xf0?", b"\x00\x00\xf1?", 1),  # a flipped bit
        b"",
    ],
)
def test_damaged_archives_are_refused_by_name(tmp_path, content):
    path = tmp_path / "a.npz"
    path.write_bytes(content)
    with pytest.raises(DamagedFileError, match=r"^log: .*a\.npz"):
        read_arrays(path, SHAPES, "log")


def test_a_small_archive_of_large_arrays_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    write_arrays(path, {"time": np.zeros(2**20)})
    assert path.stat().st_size < 2**20
    with pytest.raises(DamagedFileError, match="at most 1048576 bytes of arrays"):
        read_arrays(path, {"time": (None,)}, most_bytes=2**20)


def test_directories_are_created_or_refused(tmp_path):
    made = ensure_writable_directory(tmp_path / "a" / "b")
    assert made.is_dir()
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "below", "", None, 3, "a\0b"):
        with pytest.raises(InvalidArgumentError, match=r"^folder must be a"):
            ensure_writable_directory(path, "folder")
