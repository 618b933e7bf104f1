"""Folders that one command at a time fills, and what they say of themselves.

A folder that a command fills has one description, ``settings.json``: what kind of thing it holds,
with which settings, and from which code. A command with other settings is refused.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from aquafish_gym.runs.storage import PART, read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, brief, parse_json

LOCK, SETTINGS = "lock", "settings.json"
SCHEMA = "aquafish.folder/1"
_PART = re.compile(r"\..+\.[a-z0-9_]{8}" + re.escape(PART))  # as write_bytes names them
_MOST_BYTES = 4096  # of a lock


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold a folder for this command until it ends, in whatever way, or say who holds it.

    The system lets go of a dead process's lock, so that it is simply taken over. Workers of a
    killed command need not be waited for: they touch no file. What it was writing is swept.
    """
    path = folder / LOCK
    while True:
        try:
            file = path.open("a+", encoding="utf-8")
        except OSError as error:
            raise InvalidArgumentError(f"out: cannot write {path}: {error.strerror}") from None
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                file.seek(0)
                raise InvalidArgumentError(
                    f"out: {folder} is in use by another command, {_holder(file)}"
                ) from None
            if not _is_at(file.fileno(), path):
                continue  # its last holder has just removed it: this is another file than theirs
            with contextlib.suppress(OSError):  # a full disk: held all the same
                file.truncate(0)
                since = datetime.now(UTC).isoformat(timespec="seconds")
                file.write(json.dumps({"pid": os.getpid(), "since": since}) + "\n")
                file.flush()
            try:
                sweep(folder)
                yield
            finally:
                path.unlink(missing_ok=True)
            return


def sweep(folder: Path) -> None:
    """Remove what a kill left of files that were being written, here and in folders below."""
    for path in folder.rglob(f".*{PART}"):
        if _PART.fullmatch(path.name) and path.is_file():
            path.unlink(missing_ok=True)


def described(folder: Path) -> dict[str, Any] | None:
    """Return a folder's description, with ``kind`` and ``settings``, or ``None`` without one."""
    path = folder / SETTINGS
    if not path.exists():
        return None
    document = read_document(path, SCHEMA, "out")
    if not isinstance(document.get("kind"), str) or not isinstance(document.get("settings"), dict):
        raise InvalidArgumentError(f"out: {path} does not say what the folder holds")
    return document


def claim(
    folder: Path,
    kind: str,
    settings: Mapping[str, Any],
    code: Mapping[str, str] | None = None,
    outputs: Iterable[str] = (),
    other_code: bool = False,
) -> None:
    """Note what a folder, which is held, is to hold, or refuse one that holds something else.

    The message names the first difference; nothing has been changed then. The kind is in words,
    "a study"; the settings are all that decides the results, ready for JSON; ``code``, from names,
    such as of packages, to versions or stamps (see ``stamps``), is what they come from; with
    ``other_code`` results of other code are gone on from, and the description then names both.
    A folder without a description must not hold ``outputs``, which the command will write.
    """
    before = described(folder)
    asked: dict[str, Any] = json.loads(json.dumps(dict(settings)))
    codes = [dict(code)] if code is not None else []
    rule = f"out must be a new directory or hold {kind}; {folder} holds"
    if before is None:
        # A study describes itself in study.json, which grows with it.
        names = dict.fromkeys(("study.json", *outputs))
        found = [name for name in names if (folder / name).exists()]
        if found:
            raise InvalidArgumentError(
                f"{rule} {' and '.join(found)} but no {SETTINGS}, so what they are is not known"
            )
    else:
        if before["kind"] != kind:
            raise InvalidArgumentError(f"{rule} {before['kind']}")
        name = first_difference(before["settings"], asked)
        if name is not None:
            there, here = (brief(flat(one).get(name)) for one in (before["settings"], asked))
            raise InvalidArgumentError(
                f"out: {folder} holds {kind} with {name} {there}, not {here}; choose another folder"
            )
        former = before.get("code") or []
        if former and codes and codes[0] not in former and not other_code:
            name = first_difference(former[-1], codes[0]) or ""
            raise InvalidArgumentError(
                f"out: {folder} holds results of {name} {former[-1].get(name)}, not "
                f"{codes[0].get(name)}; choose another folder, or say --other-code if no result "
                "can have changed"
            )
        codes = [*former, *(one for one in codes if one not in former)]
    document = {"kind": kind, "settings": asked, "code": codes}
    if document != before:
        write_document(folder / SETTINGS, document, SCHEMA)


def flat(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings as one mapping with dotted names."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        nested = isinstance(value, Mapping)
        found |= flat(value, f"{prefix}{name}.") if nested else {f"{prefix}{name}": value}
    return found


def first_difference(held: Mapping[str, Any], asked: Mapping[str, Any]) -> str | None:
    """Return the dotted name of the first setting, in order, that two nested ones differ in."""
    here, there = flat(held), flat(asked)
    missing = object()
    for name in [*there, *(name for name in here if name not in there)]:
        if here.get(name, missing) != there.get(name, missing):
            return name
    return None


def _is_at(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _holder(file: Any) -> str:
    try:
        held = parse_json("lock", file.read(_MOST_BYTES))
        return f"process {held['pid']} since {held['since']}"
    except (ValueError, KeyError, TypeError):  # it is empty as yet, or somebody else's
        return "which is just beginning"
