"""Files that are written whole or not at all, and checked when they are read.

A document is a JSON object. Documents that programs write have a schema and a checksum beside their
content; documents that people write need neither. For arrays see ``aquafish_gym.runs.arrays``.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import secrets
import stat
import tempfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError, brief, file_path, parse_json

MAXIMUM_DOCUMENT_BYTES = 32 * 2**20  # of a document
_CHECKSUM = "checksum"  # its key in a document
_CHECKSUM_DIGITS = 16  # hexadecimal, of SHA-256


class DamagedFileError(InvalidArgumentError):
    """A file is damaged or has other content than expected; the message names file and reason."""


class CannotWriteError(OSError):
    """A file cannot be written, such as on a full disk; an old file of that name remains."""


def ensure_writable_directory(path: str | os.PathLike[str], argument: str = "out") -> Path:
    """Return ``path`` as a writable directory, created if missing; raise if that is impossible."""
    if isinstance(path, str) and not path:  # Path("") is the current directory
        raise InvalidArgumentError(f"{argument} must be a directory; got ''")
    directory = file_path(argument, path)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except (OSError, ValueError, TypeError) as error:  # a null character is a ValueError
        raise InvalidArgumentError(
            f"{argument} must be a directory that can be written; "
            f"{brief(str(path))}: {_reason(error)}"
        ) from None
    return directory


def output_file(path: str | os.PathLike[str], argument: str = "out") -> Path:
    """Return ``path`` for a file to write; nothing is created.

    A device, a pipe, a socket or a directory of that name is refused, and so is a folder that
    :func:`write_bytes` could not create.
    """
    target = file_path(argument, path)
    try:
        _check_replaceable(target)
    except (OSError, ValueError) as error:
        raise InvalidArgumentError(
            f"{argument} must be a file that can be written; {brief(str(path))}: {_reason(error)}"
        ) from None
    ensure_writable_directory(existing_folder(target), f"the folder of {argument}")
    return target


def existing_folder(path: str | os.PathLike[str]) -> Path:
    """Return the nearest folder of a path that exists, in which the others can be created."""
    return next(place for place in Path(os.path.realpath(path)).parents if place.exists())


def _check_replaceable(target: Path) -> None:
    """Raise OSError if the name, also through a link, belongs to anything but a regular file."""
    try:
        mode = target.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):  # or no folder
        return
    if not stat.S_ISREG(mode):
        raise OSError(0, "it exists and is no regular file")


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file whole or not at all, also if the power fails, or raise CannotWriteError.

    Its folder is created if missing. A symbolic link stays, and its target is written. Devices,
    pipes and directories are never replaced.
    """
    target = file_path("path", path)
    try:
        _check_replaceable(target)
        real = Path(os.path.realpath(target))
        real.parent.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise CannotWriteError(f"cannot write {target}: {_reason(error)}") from error
    part = real.parent / f".{secrets.token_hex(4)}.part"
    try:
        with part.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(real)
    except (OSError, ValueError) as error:
        raise CannotWriteError(f"cannot write {target}: {_reason(error)}") from error
    finally:
        with contextlib.suppress(OSError, ValueError):
            part.unlink()


def write_document(
    path: str | os.PathLike[str],
    content: Mapping[str, Any],
    schema: str | None = None,
    indent: int | None = 1,
) -> None:
    """Write what :func:`encode_document` returns, whole or not at all."""
    write_bytes(path, encode_document(content, schema, indent))


def encode_document(
    content: Mapping[str, Any], schema: str | None = None, indent: int | None = 1
) -> bytes:
    """Return the bytes of a document as JSON: schema and checksum, if any, then the content.

    Numpy numbers and arrays become numbers and lists, paths become text. Values that JSON cannot
    hold, such as NaN, raise ValueError or TypeError. A document without a schema is for people to
    edit, and has no checksum.
    """
    if schema is not None and _CHECKSUM in content:
        raise ValueError(f"a document's {_CHECKSUM} is made here")
    whole = content if schema is None else {"schema": schema, **content}
    text = json.dumps(whole, indent=indent, allow_nan=False, default=_plain)
    if schema is not None:
        head = json.dumps({"schema": schema}, indent=indent)[:-1].rstrip()
        line = json.dumps({_CHECKSUM: _checksum(json.loads(text))}, indent=indent)[1:-1].rstrip()
        text = f"{head},{line if indent else f' {line}'}{text[len(head) :]}"
    return f"{text}\n".encode()


def _checksum(whole: object) -> str:
    """Return the checksum of a document's value, independent of spaces and the order of keys."""
    text = json.dumps(whole, allow_nan=False, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_CHECKSUM_DIGITS]


def read_document(
    path: str | os.PathLike[str],
    schema: str | None = None,
    argument: str = "file",
    most_bytes: int = MAXIMUM_DOCUMENT_BYTES,
) -> dict[str, Any]:
    """Return the content of a document, without its schema.

    In messages ``argument`` names the file. Raises DamagedFileError if the file has other content,
    and InvalidArgumentError if it cannot be read.
    """
    content = read_bytes(path, argument, most_bytes)
    return decode_document(content, f"{argument}: {path}", schema)


def decode_document(content: bytes, name: str, schema: str | None = None) -> dict[str, Any]:
    """Return the content of an encoded document, or raise DamagedFileError with the name.

    A checksum must match the rest. Files that people write have none.
    """
    try:
        whole = parse_json(name, content)
    except InvalidArgumentError as error:
        raise DamagedFileError(str(error)) from None
    if not isinstance(whole, dict):
        raise DamagedFileError(f"{name} must hold a JSON object; it holds {brief(whole)}")
    if _CHECKSUM in whole and whole.pop(_CHECKSUM) != _checksum(whole):
        raise DamagedFileError(
            f"{name} is damaged: its content is not that of its checksum; drop the line "
            f'"{_CHECKSUM}" if you changed it on purpose'
        )
    found = whole.pop("schema", None)
    if schema is not None and found != schema:
        raise DamagedFileError(f"{name} must be of schema {schema}; it has {brief(found)}")
    return whole


def read_packaged(package: str, name: str, schema: str) -> dict[str, Any]:
    """Return the content of a document in a package, also from a zip.

    A missing or damaged document raises DamagedFileError, which advises to install again.
    """
    place = f"{package}/{name}"
    try:
        return decode_document((files(package) / name).read_bytes(), place, schema)
    except (OSError, InvalidArgumentError) as error:
        raise DamagedFileError(
            f"the installation is damaged, install the package again: {place}: {_reason(error)}"
        ) from None


def read_bytes(path: str | os.PathLike[str], argument: str, most_bytes: int) -> bytes:
    """Return the content of a file; see :func:`open_regular`."""
    with open_regular(path, argument, most_bytes) as file:
        try:
            return file.read(most_bytes)
        except OSError as error:
            raise _unreadable(argument, path, error) from None


def open_regular(path: str | os.PathLike[str], argument: str, most_bytes: int) -> BinaryIO:
    """Open a regular file of at most ``most_bytes``.

    Anything else, such as a device or a pipe, raises InvalidArgumentError before it is opened.
    """
    file = file_path(argument, path)
    try:
        status = file.stat()
        if not stat.S_ISREG(status.st_mode):
            raise OSError(0, "it is no regular file")
        if status.st_size > most_bytes:
            raise OSError(0, f"it has more than {most_bytes} bytes")
        return file.open("rb")
    except (OSError, ValueError, TypeError) as error:
        raise _unreadable(argument, path, error) from None


def _unreadable(argument: str, path: object, error: Exception) -> InvalidArgumentError:
    return InvalidArgumentError(
        f"{argument} must be a file that can be read; {path}: {_reason(error)}"
    )


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"a {type(value).__name__} cannot be written as JSON")
