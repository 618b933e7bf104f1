"""Files are written whole or not at all; damaged and hostile ones are refused by name."""

from __future__ import annotations

import io
import json
import os
import pathlib
import resource
import socket
import zipfile
from collections.abc import Iterator
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym.runs.arrays import read_arrays, write_arrays
from aquafish_gym.utils import storage
from aquafish_gym.utils.storage import (
    CannotWriteError,
    DamagedFileError,
    decode_document,
    encode_document,
    ensure_writable_directory,
    output_file,
    read_document,
    read_packaged,
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


def flips(content: bytes, most: int = 4000) -> Iterator[bytes]:
    """Yield the content with each of its bits flipped, or with so many of them."""
    bits = 8 * len(content)
    for bit in range(0, bits, max(1, bits // most)):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        yield bytes(damaged)


@pytest.mark.parametrize("indent", [1, None])
def test_no_flipped_bit_changes_what_a_document_says(indent):
    content = {"name": "a\u00e9", "rows": [[1.25, -3e-7, 17], [0.1, 1e300, None]], "on": True}
    accepted = 0
    for damaged in flips(encode_document(content, "test/1", indent)):
        try:
            found = decode_document(damaged, "a.json", "test/1")
        except DamagedFileError:
            continue
        accepted += 1
        # A flip of the word checksum itself leaves the content as it was.
        assert {key: found[key] for key in content} == content
    assert accepted < 8 * len('"checksum": "0123456789abcdef"') + 80, "spaces, and that one word"


def test_a_checksum_may_be_dropped_after_a_change_on_purpose(tmp_path):
    path = tmp_path / "a.json"
    write_document(path, {"x": 1.0, "y": [2]}, "test/1")
    lines = path.read_text().replace("1.0", "1.5").splitlines()
    path.write_text("\n".join(lines))
    with pytest.raises(DamagedFileError, match=r'drop the line "checksum" if you changed it'):
        read_document(path, "test/1")
    path.write_text("\n".join(line for line in lines if "checksum" not in line))
    assert read_document(path, "test/1") == {"x": 1.5, "y": [2]}
    assert json.loads(encode_document({"x": 1})) == {"x": 1}, "for people, without a schema"


def test_spaces_and_the_order_of_keys_may_change(tmp_path):
    path = tmp_path / "a.json"
    write_document(path, {"x": 1.0, "y": {"b": 2, "a": 3}}, "test/1")
    path.write_text(json.dumps(json.loads(path.read_text()), sort_keys=True))
    assert read_document(path, "test/1") == {"x": 1.0, "y": {"b": 2, "a": 3}}


@pytest.mark.parametrize(
    "package", [("aquafish.online", "library.json"), ("eea.fish", "discrepancy.json")]
)
def test_packaged_documents_have_a_checksum_that_holds(package, monkeypatch, tmp_path):
    content = (files(package[0]) / package[1]).read_bytes()
    schema = json.loads(content)["schema"]
    assert "checksum" in json.loads(content)
    assert read_packaged(*package, schema)
    (tmp_path / package[1]).write_bytes(content.replace(b"0.3", b"0.4", 1))
    monkeypatch.setattr(storage, "files", lambda _: tmp_path)
    with pytest.raises(DamagedFileError, match="the installation is damaged, install the package"):
        read_packaged(*package, schema)
    (tmp_path / package[1]).unlink()
    with pytest.raises(DamagedFileError, match=r"the installation is damaged.*No such file"):
        read_packaged(*package, schema)


def test_no_flipped_bit_changes_the_arrays_of_an_archive(tmp_path):
    path = tmp_path / "a.npz"
    arrays = {"time": np.arange(50.0), "position": np.ones((50, 3))}
    write_arrays(path, arrays)
    for damaged in flips(path.read_bytes(), 1000):
        path.write_bytes(damaged)
        try:
            found = read_arrays(path, SHAPES)
        except DamagedFileError:
            continue
        for name, array in arrays.items():
            np.testing.assert_array_equal(found[name], array)


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


def test_an_archive_is_refused_by_its_headers_before_it_takes_memory(tmp_path):
    """200 MB of zeros are 200 kB in a file."""
    path = tmp_path / "a.npz"
    write_arrays(path, {"time": np.zeros(2**17), "position": np.zeros((2**23, 3))})
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DamagedFileError, match=r"must have position of shape .*; it is"):
        read_arrays(path, {"time": (None,), "position": (None, 2)})
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 60_000  # KiB


def test_a_folder_is_created_when_a_file_is_written_and_not_before(tmp_path):
    path = tmp_path / "new" / "newer" / "a.json"
    assert output_file(path) == path
    assert list(tmp_path.iterdir()) == []
    write_document(path, {"x": 1})
    assert read_document(path) == {"x": 1}
    with pytest.raises(InvalidArgumentError, match="the folder of out must be a directory that"):
        output_file(path / "under" / "b.json")
    with pytest.raises(CannotWriteError, match=r"cannot write .*b\.json: "):
        write_document(path / "under" / "b.json", {"x": 1})


@pytest.mark.parametrize("kind", ["fifo", "socket", "directory", "device"])
def test_what_is_no_regular_file_is_never_replaced(tmp_path, kind):
    path = tmp_path / "a.json"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "directory":
        path.mkdir()
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(str(path))
    else:
        path = pathlib.Path(os.devnull)
    before = path.stat()
    with pytest.raises(CannotWriteError, match="it exists and is no regular file"):
        write_document(path, {"x": 1})
    with pytest.raises(InvalidArgumentError, match="html must be a file that can be written"):
        output_file(path, "html")
    assert path.stat().st_mode == before.st_mode
    assert path.stat().st_ino == before.st_ino


def test_a_link_stays_and_its_file_is_written(tmp_path):
    (tmp_path / "there").mkdir()
    real, link = tmp_path / "there" / "a.json", tmp_path / "b.json"
    link.symlink_to(real)
    for number in (1, 2):  # a link to nothing, and one to a file
        write_document(link, {"x": number})
        assert link.is_symlink()
        assert read_document(real) == {"x": number}
    link.unlink()
    link.symlink_to(os.devnull)
    with pytest.raises(CannotWriteError, match="no regular file"):
        write_document(link, {"x": 1})
    link.unlink()
    link.symlink_to(link)
    with pytest.raises(CannotWriteError, match="cannot write"):
        write_document(link, {"x": 1})


def test_directories_are_created_or_refused(tmp_path):
    made = ensure_writable_directory(tmp_path / "a" / "b")
    assert made.is_dir()
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "below", "", None, 3, "a\0b"):
        with pytest.raises(InvalidArgumentError, match=r"^folder must be a"):
            ensure_writable_directory(path, "folder")


@pytest.mark.parametrize("long", ["x" * 300, f"{'x' * 300}/a", f"new/{'é' * 200}/a", "d/" * 3000])
def test_a_path_that_no_file_system_takes_is_refused_before_any_work(long, tmp_path, monkeypatch):
    from eea import SwimLog, load_posterior, read_log, write_log
    from eea.study.report import report
    from gait import Controller
    from gait.controllers.c_files import c_file_path

    monkeypatch.chdir(tmp_path)
    log = SwimLog(0.01 * np.arange(65), np.zeros((65, 3)), np.full((65, 3), 0.4))
    doors = [
        lambda path: write_log(path, log), read_log, load_posterior, report, Controller.load,
        lambda path: c_file_path("c", path), storage.ensure_writable_directory, storage.output_file,
        lambda path: storage.write_bytes(path, b""), lambda path: read_document(path),
    ]  # fmt: skip
    sentence = "must be a path of at most|is a letter and"
    for door in doors:
        for path in (long, f"{long}.c"):
            with pytest.raises(InvalidArgumentError, match=sentence):
                door(path)
    assert not list(tmp_path.iterdir())
