"""Folders that one command at a time fills."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from aquafish_gym.utils.validation import InvalidArgumentError

LOCK = "lock"


@contextmanager
def only_here(folder: Path) -> Iterator[None]:
    """Hold a folder for this command until it ends, in whatever way.

    The system lets go of a dead process's lock, so that it is simply taken over.

    Parameters
    ----------
    folder
        It exists; a file ``lock`` is in it as long as it is held.

    Raises
    ------
    InvalidArgumentError
        If another command holds it; the message says which and since when.
    """
    path = folder / LOCK
    while True:
        with path.open("a+", encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                file.seek(0)
                raise InvalidArgumentError(
                    f"out: {folder} is in use by another command, {_holder(file.read())}"
                ) from None
            if not _is_at(file.fileno(), path):
                continue  # its last holder has just removed it: this is another file than theirs
            file.truncate(0)
            since = datetime.now(UTC).isoformat(timespec="seconds")
            file.write(json.dumps({"pid": os.getpid(), "since": since}) + "\n")
            file.flush()
            try:
                yield
            finally:
                path.unlink(missing_ok=True)
            return


def _is_at(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _holder(text: str) -> str:
    try:
        held = json.loads(text)
        return f"process {held['pid']} since {held['since']}"
    except (ValueError, KeyError, TypeError):
        return "which is just beginning"
