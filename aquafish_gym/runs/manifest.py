"""Folders of results: a lock for one command at a time, and a manifest of its settings.

The manifest, ``settings.json``, has the kind of results and the settings that determine them. A
command with other settings is refused. A command that continues what it finds also writes the hash
of its code there, and is refused in a folder of other code. Other versions, such as another commit
with the same code, are added.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from importlib import metadata
from pathlib import Path
from platform import python_version
from typing import Any

from aquafish_gym.runs.code import code_hash
from aquafish_gym.runs.version import PACKAGE, version
from aquafish_gym.utils.storage import (
    ensure_writable_directory,
    existing_folder,
    read_document,
    write_document,
)
from aquafish_gym.utils.validation import InvalidArgumentError, brief

LOCK = ".aquafish.lock"
SETTINGS = "settings.json"
FOLDER_SCHEMA = "aquafish.folder/1"
REMOVES_OPEN_FILES = os.name != "nt"
LIBRARIES = ("cma", "gymnasium", "neat-python", "numba", "numpy", "pybullet", "scipy")

_Versions = dict[str, str]


@contextmanager
def lock(folder: Path) -> Iterator[None]:
    """Lock a folder for this process; the system releases the lock of a process that dies.

    Raises
    ------
    InvalidArgumentError
        If another process holds the lock.
    """
    path = folder / LOCK
    handle = _locked(path)
    try:
        yield
    finally:
        try:
            # removed while locked, because it may later belong to another process
            if REMOVES_OPEN_FILES:
                path.unlink(missing_ok=True)
        finally:
            os.close(handle)
        if not REMOVES_OPEN_FILES:
            with suppress(OSError):  # another process has opened the file, and will remove it
                path.unlink()


def _locked(path: Path) -> int:
    """Return the descriptor of a file, locked by this process; see :func:`lock`."""
    from filelock import lock_descriptor  # of the extra cli: only commands lock

    flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)  # Windows has no O_NOFOLLOW
    with ExitStack() as undo:
        try:
            handle = os.open(path, flags, 0o666)
            undo.callback(os.close, handle)
            free = lock_descriptor(handle, blocking=False)
            found = os.fstat(handle)
        except OSError as error:
            raise InvalidArgumentError(f"out: cannot lock {path}: {error.strerror}") from None
        if not free or not found.st_nlink:  # no link: the last holder has just removed the file
            raise InvalidArgumentError(f"out: {path.parent} is in use by another command")
        if found.st_size:  # the lock file is removed at the end, so it must be empty
            raise InvalidArgumentError(f"out: {path} is no lock of ours: it is not empty")
        undo.pop_all()
        return handle


def versions() -> _Versions:
    """Return the versions of Python, of this package and of the libraries that compute results.

    That of this package names the commit; see :func:`aquafish_gym.runs.version.version`.
    """
    found = {"python": python_version(), PACKAGE: version()}
    for library in LIBRARIES:
        try:
            found[library] = metadata.version(library)
        except metadata.PackageNotFoundError:
            found[library] = "not installed"
    return found


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """Return a folder's manifest, ``None`` without one.

    It has ``kind``, ``settings``, and ``versions``: those of each command that made the results.
    """
    path = folder / SETTINGS
    if not path.exists():
        return None
    document = read_document(path, FOLDER_SCHEMA, "out")
    if not (
        isinstance(document.get("kind"), str)
        and isinstance(document.get("settings"), dict)
        and isinstance(document.get("versions", []), list)
    ):
        raise InvalidArgumentError(f"out: {path} does not say what the folder holds")
    return document


def write_manifest(
    folder: Path,
    kind: str,
    settings: Mapping[str, Any],
    outputs: Iterable[str] = (),
    work: Callable[..., Any] | None = None,
) -> None:
    """Write the manifest of a locked folder, or refuse one that holds something else.

    Parameters
    ----------
    kind
        Kind of results in words, such as "a study".
    settings
        Settings that determine the results, ready for JSON.
    outputs
        Files that the command will write. They must not exist without a manifest.
    work
        Function that computes the results of a command that continues what the folder holds; the
        manifest has the hash of its code. None for a command that starts again.

    Raises
    ------
    InvalidArgumentError
        If a setting differs, or the code of ``work``; the message names the first difference.
        Nothing is written then.
    """
    before = check_manifest(folder, kind, settings, outputs)
    document: dict[str, Any] = {"kind": kind, "settings": settings, "versions": [versions()]}
    if work is not None:
        document["code"] = code_hash(work)
        if before is not None:
            refuse_other_code(folder, kind, before.get("code"), document["code"])
            held = before.get("versions", [])
            document["versions"] = joined_versions(held, document["versions"])
            if document["versions"] == held:
                return
    write_document(folder / SETTINGS, document, FOLDER_SCHEMA)


def joined_versions(held: Sequence[_Versions], here: Sequence[_Versions]) -> list[_Versions]:
    """Return the versions that made a folder's results, with those of a command that continues."""
    return [*held, *(one for one in here if one not in held)]


def check_manifest(
    folder: Path, kind: str, settings: Mapping[str, Any], outputs: Iterable[str] = ()
) -> dict[str, Any] | None:
    """Return a folder's manifest, None without one; parameters and errors of ``write_manifest``."""
    before = read_manifest(folder)
    rule = f"out must be a new directory or hold {kind}; {folder} holds"
    if before is None:
        # A study's manifest is study.json, which can be extended.
        found = [n for n in dict.fromkeys(("study.json", *outputs)) if (folder / n).exists()]
        if found:
            raise InvalidArgumentError(f"{rule} {' and '.join(found)} but no {SETTINGS}")
        return None
    if before["kind"] != kind:
        raise InvalidArgumentError(f"{rule} {before['kind']}")
    refuse_difference(folder, kind, before["settings"], json.loads(json.dumps(dict(settings))))
    return before


@contextmanager
def result_folder(
    out: Path | str | None,
    kind: str,
    settings: Mapping[str, Any],
    outputs: Iterable[str] | None = None,
    work: Callable[..., Any] | None = None,
) -> Iterator[Path | None]:
    """Yield the folder ``out``, locked and with the manifest of a run; None if ``out`` is None.

    For the parameters see ``write_manifest``; without ``outputs``, a folder without a manifest must
    be empty. InvalidArgumentError if the folder cannot be written, is in use, or holds another run.
    """
    if out is None:
        yield None
        return
    folder = ensure_writable_directory(out)
    with lock(folder):
        write_manifest(folder, kind, settings, _present(folder, outputs), work)
        yield folder


def check_folder(
    out: Path | str, kind: str, settings: Mapping[str, Any], outputs: Iterable[str] | None = None
) -> None:
    """Refuse a folder that ``result_folder`` would refuse, except one in use; create nothing.

    For a command that compiles or computes before it writes.
    """
    folder = Path(out)
    ensure_writable_directory(existing_folder(folder / SETTINGS))
    check_manifest(folder, kind, settings, _present(folder, outputs))


def _present(folder: Path, outputs: Iterable[str] | None) -> list[str]:
    """Return a command's files, or by default all that a folder has."""
    if outputs is not None:
        return list(outputs)
    found = folder.iterdir() if folder.exists() else ()
    return sorted(path.name for path in found if path.name != LOCK)


def refuse_difference(
    folder: Path, kind: str, held: Mapping[str, Any], asked: Mapping[str, Any]
) -> None:
    """Raise InvalidArgumentError with the first setting that differs in two mappings."""
    there = flat(held)
    here = flat(asked)
    missing = object()
    for name in [*here, *(name for name in there if name not in here)]:
        if here.get(name, missing) != there.get(name, missing):
            raise InvalidArgumentError(
                f"out: {folder} holds {kind} with {name} {brief(there.get(name))}, not "
                f"{brief(here.get(name))}; choose another folder"
            )


def refuse_other_code(folder: Path, kind: str, held: str | None, here: str) -> None:
    """Raise InvalidArgumentError if results of other code would continue those in a folder."""
    if held != here:
        raise InvalidArgumentError(
            f"out: {folder} holds {kind} that other code made (hash {held or 'missing'}, here "
            f"{here}); choose another folder, or continue with the version that made it"
        )


def flat(settings: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings as one mapping with dotted names."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        nested = isinstance(value, Mapping)
        found |= flat(value, f"{prefix}{name}.") if nested else {f"{prefix}{name}": value}
    return found
