"""The one door for files: what is written appears whole or not at all, what is read is checked.

A document is a JSON object that carries its schema and a checksum of its content beside the
content's own keys. Whoever reads one gets what was written, or an error that names the file.
Arrays have the same door in ``arrays``.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError, brief, parse_json

MOST_BYTES = 32 * 2**20  # of a document; parsed, JSON takes up to 20 times its length
PART = ".part"  # ends the name of a file that is being written
_CHECKSUM_DIGITS = 16


class DamagedFileError(InvalidArgumentError):
    """A file is not what was written, or not what was asked for; the message names it and why."""


class CannotWriteError(OSError):
    """A file cannot be written, as on a full disk; an old one of that name is still there."""


def ensure_writable_directory(path: str | os.PathLike[str], argument: str = "out") -> Path:
    """Return ``path`` as a directory that takes files; made if need be, refused if it cannot be."""
    try:
        directory = Path(path)
    except TypeError:
        raise InvalidArgumentError(f"{argument} must be a path; got {brief(path)}") from None
    if not os.fspath(path):  # Path("") is the current directory, which nobody means by it
        raise InvalidArgumentError(f"{argument} must be a directory; got ''")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except (OSError, ValueError) as error:  # a null character is a ValueError
        raise InvalidArgumentError(
            f"{argument} must be a directory that can be written; {brief(str(directory))} cannot: "
            f"{_reason(error)}"
        ) from None
    return directory


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file at once or not at all, also if the power fails, or raise CannotWriteError."""
    target = Path(path)
    name = None
    try:
        handle, name = tempfile.mkstemp(PART, f".{target.name}.", target.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes files for the owner alone; results are for whoever the umask allows.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)  # noqa: PTH101 - name is a str from mkstemp
        os.replace(name, target)  # noqa: PTH105
        name = None
        handle = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    except (OSError, ValueError) as error:
        raise CannotWriteError(f"cannot write {target}: {_reason(error)}") from error
    finally:
        if name is not None:
            with contextlib.suppress(OSError):
                os.unlink(name)  # noqa: PTH108


def write_json(path: str | os.PathLike[str], document: Any) -> None:
    """Write anything as indented JSON for other programs: without schema and checksum.

    Numpy numbers and arrays are written as numbers and lists. ValueError and TypeError refuse NaN,
    infinity and what else JSON cannot hold.
    """
    text = json.dumps(document, indent=2, allow_nan=False, default=_plain) + "\n"
    write_bytes(path, text.encode())


def write_document(
    path: str | os.PathLike[str], content: Mapping[str, Any], schema: str | None = None
) -> None:
    """Write what :func:`encode_document` returns; see there, and :func:`write_bytes`."""
    write_bytes(path, encode_document(content, schema))


def encode_document(content: Mapping[str, Any], schema: str | None = None) -> bytes:
    """Return a document as it stands in a file: its schema, its checksum, then its content.

    ValueError refuses content with a key ``checksum`` or another schema; see also ``write_json``.
    """
    content = dict(content)
    held = content.pop("schema", schema)
    if "checksum" in content or (schema is not None and held != schema):
        raise ValueError("a document's schema and checksum are written by the storage")
    # Numbers as keys become text in JSON: the checksum is of what will be read.
    plain = json.loads(json.dumps(content, allow_nan=False, default=_plain))
    first = {} if held is None else {"schema": held}
    whole = {**first, "checksum": _checksum(first | plain), **plain}
    return (json.dumps(whole, indent=1, allow_nan=False) + "\n").encode()


def read_document(
    path: str | os.PathLike[str],
    schema: str | None = None,
    argument: str = "file",
    most_bytes: int = MOST_BYTES,
    checksum: Literal["required", "optional"] = "required",
) -> dict[str, Any]:
    """Return the content of a document, without its schema and checksum.

    A ``schema`` is what it must say it is. A checksum is "optional" for what people write by hand:
    it is checked where it is there. In messages ``argument`` names the file. DamagedFileError says
    that it is not what was written, InvalidArgumentError that it cannot be read.
    """
    content = read_bytes(path, argument, most_bytes)
    return decode_document(content, f"{argument}: {path}", schema, checksum)


def decode_document(
    content: bytes,
    name: str,
    schema: str | None = None,
    checksum: Literal["required", "optional"] = "required",
) -> dict[str, Any]:
    """Return what :func:`encode_document` was given, or raise DamagedFileError with the name."""
    try:
        whole = parse_json(name, content)
    except InvalidArgumentError as error:
        raise DamagedFileError(str(error)) from None
    if not isinstance(whole, dict):
        raise DamagedFileError(f"{name} must hold a JSON object; it holds {brief(whole)}")
    found = whole.pop("checksum", None)
    if found is None and checksum == "required":
        raise DamagedFileError(f"{name} has no checksum, so it is not known to be whole")
    try:
        expected = _checksum(whole)
    except ValueError:
        raise DamagedFileError(f"{name} holds a number that is not finite") from None
    if found is not None and found != expected:
        raise DamagedFileError(f"{name} is damaged: its content does not match its checksum")
    held = whole.pop("schema", None)
    if schema is not None and held != schema and (held is not None or checksum == "required"):
        raise DamagedFileError(f"{name} must be of schema {schema}; it says {brief(held)}")
    return whole


def read_bytes(path: str | os.PathLike[str], argument: str, most_bytes: int) -> bytes:
    """Return what a file holds, or raise InvalidArgumentError, before it is read if it is longer.

    Devices, pipes and directories are refused.
    """
    try:
        # Without O_NONBLOCK, opening a pipe waits for somebody to write.
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(handle, "rb") as file:
            status = os.fstat(file.fileno())
            regular = stat.S_ISREG(status.st_mode)
            # read() first takes the memory that it is told, so it is not told most_bytes.
            size = status.st_size
            content = file.read(size + 1) if regular and size <= most_bytes else None
    except (OSError, ValueError, TypeError) as error:
        raise InvalidArgumentError(
            f"{argument} must be a file that can be read; {path}: {_reason(error)}"
        ) from None
    if not regular:
        raise InvalidArgumentError(f"{argument} must be a regular file; {path} is none")
    if content is None or len(content) > most_bytes:  # it may have grown meanwhile
        raise InvalidArgumentError(
            f"{argument} must have at most {most_bytes} bytes; {path} has more"
        )
    return content


def _checksum(content: Any) -> str:
    text = json.dumps(content, allow_nan=False, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_CHECKSUM_DIGITS]


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"a {type(value).__name__} cannot be written as JSON")
