"""Files that were damaged or made to harm, and machines that refuse to write: one sentence each.

Each attack is written out. None may be believed, run, or take the memory that it asks for.
"""

from __future__ import annotations

import io
import json
import os
import pickle
import random
import shutil
import subprocess
import zipfile
import zlib

import numpy as np
import pytest
from run_jobs_here import COMMAND

from aquafish_gym.runs.arrays import read_arrays, write_arrays
from aquafish_gym.runs.folder import claim, described, held
from aquafish_gym.runs.storage import (
    CannotWriteError,
    DamagedFileError,
    read_document,
    write_bytes,
    write_document,
)
from aquafish_gym.utils.validation import InvalidArgumentError, integer, parse_json

CONTENT = {
    "treatment": "none",
    "seed": 3,
    "share": 1.3125,
    "distances": [0.5, -12.25, 1e-7],
    "nested": {"done": True, "why": None, "text": "ein Fisch, größer"},
}
SHAPES = {"time": (None,), "position": (None, 3)}
FLIPS = 500


@pytest.fixture
def document(tmp_path):
    path = tmp_path / "outcome.json"
    write_document(path, CONTENT, "test/1")
    return path


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / "swims.npz"
    write_arrays(path, {"time": np.arange(50.0), "position": np.ones((50, 3))})
    return path


@pytest.mark.parametrize("checksum", ["required", "optional"])
def test_no_flipped_bit_of_a_document_is_believed(document, checksum):
    content = document.read_bytes()
    rng = random.Random(1)
    refusals = []
    for _ in range(FLIPS):
        flipped = bytearray(content)
        flipped[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        document.write_bytes(flipped)
        try:
            read = read_document(document, "test/1", checksum=checksum)
        except InvalidArgumentError as error:
            refusals.append(str(error))
        else:  # white space, or the word "checksum" itself
            assert {key: read.get(key) for key in CONTENT} == CONTENT
    assert len(refusals) > FLIPS * 0.5
    assert all(str(document) in refusal and len(refusal) < 400 for refusal in refusals)


def test_no_flipped_bit_of_an_archive_is_believed(archive):
    content, expected = archive.read_bytes(), read_arrays(archive, SHAPES)
    rng = random.Random(2)
    refusals = []
    for _ in range(FLIPS):
        flipped = bytearray(content)
        flipped[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        archive.write_bytes(flipped)
        try:
            read = read_arrays(archive, SHAPES)
        except InvalidArgumentError as error:
            refusals.append(str(error))
        else:  # a date, or a note on the program that wrote it
            for name, array in expected.items():
                np.testing.assert_array_equal(read[name], array)
    assert len(refusals) > FLIPS * 0.5
    assert all(str(archive) in refusal for refusal in refusals)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_no_torn_file_is_believed(document, archive, share):
    for path in (document, archive):
        content = path.read_bytes()
        path.write_bytes(content[: int(len(content.rstrip()) * share)])
    with pytest.raises(DamagedFileError, match=r"outcome\.json"):
        read_document(document)
    with pytest.raises(DamagedFileError, match=r"swims\.npz"):
        read_arrays(archive, SHAPES)


NONSENSE = {
    "deep": b"[" * 1_000_000,
    "deep and closed": b"[" * 500 + b"]" * 500,
    "deep objects": b'{"a":' * 100_000 + b"1" + b"}" * 100_000,
    "digits": b'{"n": ' + b"9" * 100_000 + b"}",
    "twice": b'{"a": 1, "a": 2}',
    "not finite": b'{"a": NaN}',
    "infinite": b'{"a": 1e999}',
    "no text": bytes(range(256)),
    "half a character": b'{"a": "\xff"}',
    "lone surrogate": b'{"a": "\\ud800"}',
    "a list": b"[1, 2]",
    "a number": b"3",
    "nothing": b"",
    "a pickle": pickle.dumps({"a": 1}),
    "zeros": bytes(1000),
    "long": b'["' + b"x" * 1_000_000 + b'"]',
}


@pytest.mark.parametrize("content", NONSENSE.values(), ids=NONSENSE)
@pytest.mark.parametrize("checksum", ["required", "optional"])
def test_nonsense_is_one_short_sentence(tmp_path, content, checksum):
    path = tmp_path / "config.json"
    path.write_bytes(content)
    if checksum == "optional" and content.startswith(b'{"a": "\\u'):
        assert read_document(path, checksum=checksum)  # odd, but JSON
        return
    with pytest.raises(DamagedFileError) as caught:
        read_document(path, argument="config", checksum=checksum)
    message = str(caught.value)
    assert message.startswith(f"config: {path}")
    assert len(message) < len(str(path)) + 160
    assert "\n" not in message


@pytest.mark.parametrize("make", ["zero", "pipe", "directory", "missing", "loop", "null"])
def test_what_is_no_file_is_not_read(tmp_path, make):
    path = tmp_path / "morphology.json"
    if make == "zero":
        path = "/dev/zero"
    elif make == "pipe":
        os.mkfifo(path)
    elif make == "directory":
        path.mkdir()
    elif make == "loop":
        path.symlink_to(path)
    elif make == "null":
        path = f"{path}\0"
    for read in (read_document, lambda path, argument: read_arrays(path, SHAPES, argument)):
        with pytest.raises(InvalidArgumentError, match=r"^morphology must be a (regular )?file"):
            read(path, argument="morphology")


# Under this much memory, reading what an attack asks for is not survived.
LIMITED = """
import resource
import aquafish_gym
from pathlib import Path
from aquafish_gym.runs.arrays import read_arrays
from aquafish_gym.runs.storage import read_document
used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 300 * 2**20,) * 2)
for path in sys.argv[1:]:
    try:
        if path.endswith("npz"):
            read_arrays(path, {"a": (None, 3)}, "baseline")
        else:
            read_document(path, argument="study")
    except ValueError as error:
        print(error)
"""


def member(shape, dtype="<f8", body=b""):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": dtype, "fortran_order": False, "shape": shape}
    )
    return header.getvalue() + body


def zipped(path, *members, flags=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", flags) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return path


class Malicious:
    """What a pickle does to who loads it."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return (os.mkdir, (str(self.mark),))


def test_bombs_are_refused_before_anything_is_allocated(tmp_path, start):
    bomb = tmp_path / "bomb.npz"
    rows = 360 * 2**20 // 24  # more than is let in, and than the memory that there is
    with (
        zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("a.npy", "w", force_zip64=True) as stream,
    ):
        stream.write(member((rows, 3)))
        block = bytes(2**20)
        for _ in range(rows * 24 // 2**20 + 1):
            stream.write(block)
    # The archive says that it holds little, and holds much.
    lying = tmp_path / "lying.npz"
    content = bytearray(bomb.read_bytes())
    at = content.rindex(b"PK\1\2") + 24  # the length, in the list at the end
    size = len(member((1, 3))) + 24
    content[at : at + 4] = size.to_bytes(4, "little")
    lying.write_bytes(content)
    files = [
        (bomb, "must hold at most"),
        (lying, ""),
        (zipped(tmp_path / "shape.npz", ("a.npy", member((10**12, 3)))), "numbers as its shape"),
        (zipped(tmp_path / "huge.npz", ("a.npy", member((10**30, 3)))), "numbers as its shape"),
    ]
    large = tmp_path / "large.json"
    with large.open("wb") as file:
        file.truncate(100 * 2**20)
    files.append((large, "must have at most 33554432 bytes"))
    program = start(LIMITED, *(path for path, _ in files))
    said, errors = program.communicate()
    assert (program.returncode, errors) == (0, "")
    for line, (path, reason) in zip(said.splitlines(), files, strict=True):
        assert str(path) in line
        assert reason in line
        assert len(line) < 400


def test_pickles_and_strangers_in_archives_are_refused_and_never_run(tmp_path):
    mark = tmp_path / "it ran"
    harm = pickle.dumps(Malicious(mark))
    good = ("a.npy", member((1, 3), body=bytes(24)))
    attacks = [
        [("a.npy", member((1,), "|O", harm))],
        [("a.npy", harm)],
        [("a", harm)],
        [good, ("b.npy", member((1, 3), body=bytes(24)))],
        [good, ("../../a.npy", b"")],
        [("a.npy", member((1, 3), [("x", "<f8")], bytes(24)))],
        [("a.npy", member((1, 3), "|V8", bytes(24)))],
        [("a.npy", member((3, 1), body=bytes(24)))],
        [("a.npy", member((1, 3), body=bytes(25)))],
        [("a.npy", member((-1, -3), body=bytes(24)))],
        [("a.npy", b"\x93NUMPY\x09\x00" + bytes(100))],
        [("a.npy", b"\x93NUMPY\x01\x00\xff\xff{'descr': " + b"(" * 60000)],
        [("a.npy", b"")],
        [],
    ]
    for number, members in enumerate(attacks):
        path = zipped(tmp_path / f"{number}.npz", *members)
        with pytest.raises(DamagedFileError, match=rf"parameters: .*{number}\.npz"):
            read_arrays(path, {"a": (None, 3)}, "parameters")
    pickled = tmp_path / "pickle.npz"
    pickled.write_bytes(harm)
    with pytest.warns(UserWarning, match="Duplicate name"):
        twice = zipped(tmp_path / "twice.npz", good, good)
    for path in (pickled, twice):
        with pytest.raises(DamagedFileError):
            read_arrays(path, {"a": (None, 3)})
    assert not mark.exists()
    assert read_arrays(zipped(tmp_path / "good.npz", good), {"a": (None, 3)})["a"].shape == (1, 3)


def test_a_checksum_cannot_be_had_by_turning_the_archive_s_off(tmp_path):
    path = zipped(tmp_path / "a.npz", ("a.npy", member((1, 3), body=bytes(24))), flags=0)
    content = path.read_bytes()
    crc = zlib.crc32(member((1, 3), body=bytes(24))).to_bytes(4, "little")
    changed = content.replace(bytes(24), bytes(23) + b"\1", 1)
    assert changed != content
    path.write_bytes(changed)
    with pytest.raises(DamagedFileError, match="whole archive"):
        read_arrays(path, {"a": (None, 3)})
    path.write_bytes(changed.replace(crc, bytes(4)))
    with pytest.raises(DamagedFileError, match="whole archive"):
        read_arrays(path, {"a": (None, 3)})


@pytest.mark.parametrize("content", NONSENSE.values(), ids=NONSENSE)
def test_a_damaged_description_is_gone_on_from_by_nobody(tmp_path, content):
    (tmp_path / "settings.json").write_bytes(content)
    with pytest.raises(InvalidArgumentError, match=r"^out: .*settings\.json"):
        claim(tmp_path, "a study", {"steps": 3})
    assert (tmp_path / "settings.json").read_bytes() == content
    with pytest.raises(InvalidArgumentError):
        described(tmp_path)


@pytest.mark.parametrize(
    "value",
    [10**400, -(10**400), 10**10_000, "9" * 10**7, [0] * 10**6],
    ids=["long", "negative", "too long to show", "text", "list"],
)
def test_absurd_numbers_are_short_sentences(value):
    with pytest.raises(InvalidArgumentError, match=r"^replicates must be a whole number") as caught:
        integer("replicates", value, 1, 10**6)
    assert len(str(caught.value)) < 250
    with pytest.raises(InvalidArgumentError) as caught:
        parse_json("config", f'{{"{"k" * 10**6}": 1, "{"k" * 10**6}": 2}}')
    assert len(str(caught.value)) < 250


def test_a_file_too_long_for_the_disk_is_one_sentence_and_the_old_one_stays(tmp_path, start):
    """The limit on a file's length stands for the disk's: no disk need be filled."""
    code = """
from aquafish_gym.runs.storage import write_document
try:
    write_document(sys.argv[1], {"text": "x" * 100_000})
except OSError as error:
    print(error)
"""
    path = tmp_path / "a.json"
    write_document(path, {"text": "short"})
    program = start(code, path, limits={"RLIMIT_FSIZE": 50_000})
    said, errors = program.communicate()
    assert (said, errors) == (f"cannot write {path}: File too large\n", "")
    assert read_document(path) == {"text": "short"}
    assert not list(tmp_path.glob(".*"))


def test_a_full_disk_stops_a_run_with_one_sentence_and_the_same_command_goes_on(tmp_path, start):
    command = start(COMMAND, tmp_path, "count", 3, limits={"RLIMIT_FSIZE": 200})
    _, errors = command.communicate()
    assert command.returncode == 2
    assert errors.startswith(f"cannot write {tmp_path}/runs/count/")
    assert errors.endswith("File too large\n")
    assert errors.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ".py"] == ["runs"]
    command = start(COMMAND, tmp_path, "count", 3)
    assert command.communicate()[1] == ""
    assert command.returncode == 0


def test_a_disk_that_is_full_indeed_is_one_sentence(tmp_path):
    """Where the tests may mount one."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = shutil.which("mount")
    command = [str(mount), "-t", "tmpfs", "-o", "size=32k", "none", str(disk)]
    if mount is None or subprocess.run(command, capture_output=True).returncode:
        pytest.skip("no disk can be mounted here")
    try:
        write_document(disk / "a.json", {"text": "short"})
        with pytest.raises(CannotWriteError, match=r"a\.json: No space left on device$"):
            write_document(disk / "a.json", {"text": "x" * 100_000})
        assert read_document(disk / "a.json") == {"text": "short"}
        assert [path.name for path in disk.iterdir()] == ["a.json"]
        with held(disk):
            pass
    finally:
        subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.parametrize("files", [9, 20])
def test_too_few_files_stop_a_run_with_one_sentence(tmp_path, start, files):
    """As under ``ulimit -n``; the modules are there by then."""
    code = COMMAND.replace(
        "    try:",
        "    import resource, os\n"
        f"    resource.setrlimit(resource.RLIMIT_NOFILE, ({files}, {files}))\n    try:",
        1,
    )
    command = start(code, tmp_path, "count", 6)
    _, errors = command.communicate()
    if command.returncode:
        assert command.returncode == 2, errors
        assert "Too many open files" in errors
        assert errors.count("\n") == 1
        assert start(COMMAND, tmp_path, "count", 6).wait() == 0
    assert len(list(tmp_path.rglob("*.json"))) == 6


def test_a_folder_that_is_no_more_is_one_sentence(tmp_path):
    with pytest.raises(CannotWriteError, match=r"cannot write .*: No such file or directory"):
        write_bytes(tmp_path / "gone" / "a", b"")


def test_a_limit_on_bytes_is_the_callers(document):
    with pytest.raises(InvalidArgumentError, match="outcome must have at most 10 bytes"):
        read_document(document, argument="outcome", most_bytes=10)
    assert json.loads(document.read_text())["seed"] == 3
