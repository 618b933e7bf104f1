"""Files that appear whole or not at all, and are checked when they are read.

A document is a JSON object with its schema beside the content's own keys. For arrays see
``arrays``.
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError, brief, parse_json

MOST_BYTES = 32 * 2**20  # of a document


class DamagedFileError(InvalidArgumentError):
    """A file does not hold what it should; the message names it and the reason."""


class CannotWriteError(OSError):
    """A file cannot be written, as on a full disk; an old one of that name is still there."""


def ensure_writable_directory(path: str | os.PathLike[str], argument: str = "out") -> Path:
    """Return ``path`` as a directory that takes files; created if missing, else refused."""
    if path == "":  # Path("") is the current directory
        raise InvalidArgumentError(f"{argument} must be a directory; got ''")
    try:
        directory = Path(path)
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except (OSError, ValueError, TypeError) as error:  # a null character is a ValueError
        raise InvalidArgumentError(
            f"{argument} must be a directory that can be written; "
            f"{brief(str(path))}: {_reason(error)}"
        ) from None
    return directory


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file whole or not at all, also if the power fails, or raise CannotWriteError."""
    target = Path(path)
    part = target.parent / f".{secrets.token_hex(4)}.part"
    try:
        with part.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(target)
    except (OSError, ValueError) as error:
        raise CannotWriteError(f"cannot write {target}: {_reason(error)}") from error
    finally:
        with contextlib.suppress(OSError, ValueError):
            part.unlink()


def write_document(
    path: str | os.PathLike[str], content: Mapping[str, Any], schema: str | None = None
) -> None:
    """Write what :func:`encode_document` returns, whole or not at all."""
    write_bytes(path, encode_document(content, schema))


def encode_document(content: Mapping[str, Any], schema: str | None = None) -> bytes:
    """Return the bytes of a document: its schema, then its content, as JSON.

    Numpy numbers and arrays become numbers and lists, paths become text. Raises ValueError or
    TypeError for what JSON cannot hold, such as NaN.
    """
    whole = content if schema is None else {"schema": schema, **content}
    return (json.dumps(whole, indent=1, allow_nan=False, default=_plain) + "\n").encode()


def read_document(
    path: str | os.PathLike[str],
    schema: str | None = None,
    argument: str = "file",
    most_bytes: int = MOST_BYTES,
) -> dict[str, Any]:
    """Return the content of a document, without its schema.

    In messages ``argument`` names the file. Raises DamagedFileError if the file holds something
    else, and InvalidArgumentError if it cannot be read.
    """
    content = read_bytes(path, argument, most_bytes)
    return decode_document(content, f"{argument}: {path}", schema)


def decode_document(content: bytes, name: str, schema: str | None = None) -> dict[str, Any]:
    """Return the content of an encoded document, or raise DamagedFileError with the name."""
    try:
        whole = parse_json(name, content)
    except InvalidArgumentError as error:
        raise DamagedFileError(str(error)) from None
    if not isinstance(whole, dict):
        raise DamagedFileError(f"{name} must hold a JSON object; it holds {brief(whole)}")
    whole.pop("checksum", None)  # of files of version 0.1
    found = whole.pop("schema", None)
    if schema is not None and found != schema:
        raise DamagedFileError(f"{name} must be of schema {schema}; it has {brief(found)}")
    return whole


def read_bytes(path: str | os.PathLike[str], argument: str, most_bytes: int) -> bytes:
    """Return the content of a regular file of at most ``most_bytes``.

    Anything else, such as a device or pipe, raises InvalidArgumentError before it is read.
    """
    try:
        file = Path(path)
        status = file.stat()
        if not stat.S_ISREG(status.st_mode):
            raise OSError(0, "it is no regular file")
        if status.st_size > most_bytes:
            raise OSError(0, f"it has more than {most_bytes} bytes")
        return file.read_bytes()
    except (OSError, ValueError, TypeError) as error:
        raise InvalidArgumentError(
            f"{argument} must be a file that can be read; {path}: {_reason(error)}"
        ) from None


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"a {type(value).__name__} cannot be written as JSON")
