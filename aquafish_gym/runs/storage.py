"""Files that survive a crash: whole JSON documents, and logs that grow a line at a time.

A document appears under its name complete or not at all. A log is JSONL in which each line
carries a checksum of its record, so that a torn or edited line is found and named.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError, brief

_CHECKSUM_DIGITS = 16


class DamagedFileError(ValueError):
    """A file is not what was written.

    Attributes
    ----------
    path
        The file.
    line
        The first damaged line, from 1.
    records
        The sound records before it.
    """

    def __init__(self, path: Path, line: int, reason: str, records: list[Any]) -> None:
        super().__init__(f"{path}, line {line}: {reason}")
        self.path = path
        self.line = line
        self.records = records


def ensure_writable_directory(path: str | os.PathLike[str], argument: str = "out") -> Path:
    """Return ``path`` as a directory that exists and takes files; it is made if need be.

    Raises
    ------
    InvalidArgumentError
        If it cannot be made or written; the message names ``argument`` and the reason.
    """
    try:
        directory = Path(path)
    except TypeError:
        raise InvalidArgumentError(f"{argument} must be a path; got {brief(path)}") from None
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except (OSError, ValueError) as error:  # a null character is a ValueError
        reason = getattr(error, "strerror", None) or str(error)
        raise InvalidArgumentError(
            f"{argument} must be a directory that can be written; {directory} cannot: {reason}"
        ) from None
    return directory


def write_json(path: str | os.PathLike[str], document: Any) -> None:
    """Write a document as indented JSON, replacing the file at once or not at all.

    Numpy numbers and arrays are written as numbers and lists.

    Raises
    ------
    ValueError
        If the document holds NaN or infinity, which JSON does not have.
    TypeError
        If it holds something that JSON cannot.
    """
    text = json.dumps(document, indent=2, allow_nan=False, default=_plain) + "\n"
    write_bytes(path, text.encode())


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file, replacing an old one at once or not at all, also if the power fails."""
    target = Path(path)
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes files for the owner alone; results are for whoever the umask allows.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)  # noqa: PTH101 - name is a str from mkstemp
        os.replace(name, target)  # noqa: PTH105
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(name)  # noqa: PTH108
        raise
    _sync_directory(target.parent)


def append_record(path: str | os.PathLike[str], record: Any) -> None:
    """Append a record to a log as one line with its checksum, and bring it to the disk.

    If the last line is torn, the record begins a line of its own, and the torn one stays to be
    found.

    Raises
    ------
    ValueError, TypeError
        As ``write_json``.
    """
    text = json.dumps(record, allow_nan=False, default=_plain)
    line = f'{{"checksum": "{_checksum(text)}", "record": {text}}}\n'
    target = Path(path)
    new = not target.exists()
    with target.open("ab+") as file:
        size = file.seek(0, os.SEEK_END)
        if size:
            file.seek(size - 1)
            if file.read(1) != b"\n":
                line = "\n" + line
        file.write(line.encode())
        file.flush()
        os.fsync(file.fileno())
    if new:
        _sync_directory(target.parent)


def read_records(path: str | os.PathLike[str]) -> list[Any]:
    """Return the records of a log, in order.

    Raises
    ------
    DamagedFileError
        At the first line that is torn, changed or no record; it holds the sound ones before.
    FileNotFoundError
        If there is no such file.
    """
    source = Path(path)
    records: list[Any] = []
    lines = source.read_bytes().split(b"\n")
    torn = lines.pop()
    for number, line in enumerate(lines, start=1):
        records.append(_read_line(source, number, line, records))
    if torn:
        raise DamagedFileError(source, len(lines) + 1, "the line is torn", records)
    return records


def _read_line(path: Path, number: int, line: bytes, before: list[Any]) -> Any:
    try:
        entry = json.loads(line)
        checksum, record = entry["checksum"], entry["record"]
    except (ValueError, KeyError, TypeError):
        raise DamagedFileError(path, number, "the line is not a record", before) from None
    if checksum != _checksum(json.dumps(record)):
        raise DamagedFileError(path, number, "the record does not match its checksum", before)
    return record


def _checksum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:_CHECKSUM_DIGITS]


def _sync_directory(directory: Path) -> None:
    handle = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"a {type(value).__name__} cannot be written as JSON")
