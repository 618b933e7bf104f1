"""Logs a line at a time, as the folders of before the runner have them; goes with their readers."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from aquafish_gym.runs.storage import DamagedFileError, _plain, _sync_directory


class DamagedLogError(DamagedFileError):
    """A log is not what was written: ``line``, and the sound ``records`` before it."""

    def __init__(self, path: Path, line: int, reason: str, records: list[Any]) -> None:
        super().__init__(f"{path}, line {line}: {reason}")
        self.path = path
        self.line = line
        self.records = records


def append_record(path: str | os.PathLike[str], record: Any) -> None:
    """Append a record to a log as one line with its checksum, and bring it to the disk."""
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
    """Return the records of a log, in order."""
    source = Path(path)
    records: list[Any] = []
    lines = source.read_bytes().split(b"\n")
    torn = lines.pop()
    for number, line in enumerate(lines, start=1):
        records.append(_read_line(source, number, line, records))
    if torn:
        raise DamagedLogError(source, len(lines) + 1, "the line is torn", records)
    return records


def _read_line(path: Path, number: int, line: bytes, before: list[Any]) -> Any:
    try:
        entry = json.loads(line)
        checksum, record = entry["checksum"], entry["record"]
    except (ValueError, KeyError, TypeError):
        raise DamagedLogError(path, number, "the line is not a record", before) from None
    if checksum != _checksum(json.dumps(record)):
        raise DamagedLogError(path, number, "the record does not match its checksum", before)
    return record


def _checksum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
