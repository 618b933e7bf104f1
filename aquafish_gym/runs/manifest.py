"""Folders of results: one command at a time fills one, and a manifest names its settings.

The manifest, ``settings.json``, holds the kind of results and the settings that decide them. A
command with other settings is refused.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version
from typing import Any

from aquafish_gym.runs.storage import PART, read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, brief

LOCK, SETTINGS = ".aquafish.lock", "settings.json"
SCHEMA = "aquafish.folder/1"
LIBRARIES = (
    "aquafish-gym", "cma", "gymnasium", "neat-python", "numba", "numpy", "pybullet", "scipy",
)  # fmt: skip
_PART = re.compile(r"\..+\.[a-z0-9_]{8}" + re.escape(PART))  # as write_bytes names them
_MARK = "aquafish lock of process "


@contextmanager
def lock(folder: Path) -> Iterator[None]:
    """Lock a folder for this process, and remove what a killed one left half written.

    The system releases the lock of a process that dies.

    Raises
    ------
    InvalidArgumentError
        If another process has it, or the file of its name is no lock of ours.
    """
    path = folder / LOCK
    while True:
        with _opened(path) as file:
            held = file.read(len(_MARK) + 20)
            if held and not held.startswith(_MARK):
                raise InvalidArgumentError(f"out: {path} is no lock of this program; remove it")
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                holder = held.removeprefix(_MARK).strip() or "that is starting"
                raise InvalidArgumentError(
                    f"out: {folder} is in use by another command, process {holder}"
                ) from None
            if not _is_at(file.fileno(), path):
                continue  # its last holder has just removed it: this is another file
            with contextlib.suppress(OSError):  # a full disk: locked all the same
                file.seek(0)
                file.truncate()
                file.write(f"{_MARK}{os.getpid()}\n")
                file.flush()
            try:
                _sweep(folder)
                yield
            finally:
                path.unlink(missing_ok=True)
            return


def _opened(path: Path) -> Any:
    """Open a lock's file, created if missing, without following a link."""
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        handle = os.open(path, flags, 0o666)
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            os.close(handle)
            raise OSError(0, "it is no regular file")
    except OSError as error:
        raise InvalidArgumentError(f"out: cannot lock {path}: {error.strerror}") from None
    return os.fdopen(handle, "r+", encoding="utf-8", errors="replace")


def _is_at(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _sweep(folder: Path) -> None:
    for path in folder.rglob(f".*{PART}"):
        if _PART.fullmatch(path.name) and path.is_file():
            path.unlink(missing_ok=True)


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that compute results."""
    found = {"python": python_version()}
    for library in LIBRARIES:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            found[library] = "not installed"
    return found


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """Return a folder's manifest, with ``kind`` and ``settings``, or ``None`` without one."""
    path = folder / SETTINGS
    if not path.exists():
        return None
    document = read_document(path, SCHEMA, "out")
    if not isinstance(document.get("kind"), str) or not isinstance(document.get("settings"), dict):
        raise InvalidArgumentError(f"out: {path} does not say what the folder holds")
    return document


def write_manifest(
    folder: Path, kind: str, settings: Mapping[str, Any], outputs: Iterable[str] = ()
) -> None:
    """Write the manifest of a locked folder, or refuse one that holds something else.

    Parameters
    ----------
    kind
        In words, such as "a study".
    settings
        All that decides the results, ready for JSON.
    outputs
        Files that the command will write, which must not exist without a manifest.

    Raises
    ------
    InvalidArgumentError
        With the first setting that differs; nothing has been written then.
    """
    before = read_manifest(folder)
    asked: dict[str, Any] = json.loads(json.dumps(dict(settings)))
    rule = f"out must be a new directory or hold {kind}; {folder} holds"
    if before is None:
        # A study's manifest is study.json, which grows with it.
        found = [n for n in dict.fromkeys(("study.json", *outputs)) if (folder / n).exists()]
        if found:
            raise InvalidArgumentError(f"{rule} {' and '.join(found)} but no {SETTINGS}")
        document = {"kind": kind, "settings": asked, "versions": versions()}
        write_document(folder / SETTINGS, document, SCHEMA)
        return
    if before["kind"] != kind:
        raise InvalidArgumentError(f"{rule} {before['kind']}")
    name = first_difference(before["settings"], asked)
    if name is not None:
        there, here = (brief(flat(one).get(name)) for one in (before["settings"], asked))
        raise InvalidArgumentError(
            f"out: {folder} holds {kind} with {name} {there}, not {here}; choose another folder"
        )


def flat(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings as one mapping with dotted names."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        nested = isinstance(value, Mapping)
        found |= flat(value, f"{prefix}{name}.") if nested else {f"{prefix}{name}": value}
    return found


def first_difference(held: Mapping[str, Any], asked: Mapping[str, Any]) -> str | None:
    """Return the dotted name of the first setting, in order, in which two nested ones differ."""
    here, there = flat(held), flat(asked)
    missing = object()
    for name in [*there, *(name for name in here if name not in there)]:
        if here.get(name, missing) != there.get(name, missing):
            return name
    return None
