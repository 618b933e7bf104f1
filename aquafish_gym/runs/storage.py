"""Files that appear whole or not at all, and are checked when they are read.

A document is a JSON object with its schema beside the content's own keys. For arrays see
``arrays``.
"""

from __future__ import annotations

import contextlib
import json
import os
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError, brief, parse_json

MOST_BYTES = 32 * 2**20  # of a document
PART = ".part"  # ends the name of a file that is being written


class DamagedFileError(InvalidArgumentError):
    """A file does not hold what it should; the message names it and the reason."""


class CannotWriteError(OSError):
    """A file cannot be written, as on a full disk; an old one of that name is still there."""


def ensure_writable_directory(path: str | os.PathLike[str], argument: str = "out") -> Path:
    """Return ``path`` as a directory that takes files; created if missing, else refused."""
    try:
        directory = Path(path)
    except TypeError:
        raise InvalidArgumentError(f"{argument} must be a path; got {brief(path)}") from None
    if not os.fspath(path):  # Path("") is the current directory
        raise InvalidArgumentError(f"{argument} must be a directory; got ''")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except (OSError, ValueError) as error:  # a null character is a ValueError
        raise InvalidArgumentError(
            f"{argument} must be a directory that can be written; {brief(str(directory))}: "
            f"{'it is a file' if directory.is_file() else _reason(error)}"
        ) from None
    return directory


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file whole or not at all, also if the power fails, or raise CannotWriteError."""
    target = Path(path)
    name = None
    try:
        handle, name = tempfile.mkstemp(PART, f".{target.name}.", target.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes files for the owner alone; results follow the umask.
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
    """Write anything as indented JSON without a schema; see :func:`encode_document`."""
    text = json.dumps(document, indent=2, allow_nan=False, default=_plain) + "\n"
    write_bytes(path, text.encode())


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
    whole = dict(content) if schema is None else {"schema": schema, **content}
    if schema is not None and whole["schema"] != schema:
        raise ValueError(f"the content has the schema {whole['schema']!r}, not {schema!r}")
    return (json.dumps(whole, indent=1, allow_nan=False, default=_plain) + "\n").encode()


def read_document(
    path: str | os.PathLike[str],
    schema: str | None = None,
    argument: str = "file",
    most_bytes: int = MOST_BYTES,
    schema_optional: bool = False,
) -> dict[str, Any]:
    """Return the content of a document, without its schema.

    With ``schema_optional``, for what people write by hand, it may have none. In messages
    ``argument`` names the file. Raises DamagedFileError if the file holds something else, and
    InvalidArgumentError if it cannot be read.
    """
    content = read_bytes(path, argument, most_bytes)
    return decode_document(content, f"{argument}: {path}", schema, schema_optional)


def decode_document(
    content: bytes, name: str, schema: str | None = None, schema_optional: bool = False
) -> dict[str, Any]:
    """Return the content of an encoded document, or raise DamagedFileError with the name."""
    try:
        whole = parse_json(name, content)
    except InvalidArgumentError as error:
        raise DamagedFileError(str(error)) from None
    if not isinstance(whole, dict):
        raise DamagedFileError(f"{name} must hold a JSON object; it holds {brief(whole)}")
    whole.pop("checksum", None)  # of files of version 0.1
    found = whole.pop("schema", None)
    if schema is not None and found != schema and not (found is None and schema_optional):
        raise DamagedFileError(f"{name} must be of schema {schema}; it has {brief(found)}")
    return whole


def read_bytes(path: str | os.PathLike[str], argument: str, most_bytes: int) -> bytes:
    """Return the content of a regular file of at most ``most_bytes``.

    Anything else, such as a device or pipe, raises InvalidArgumentError before it is read.
    """
    try:
        # Without O_NONBLOCK, opening a pipe waits for a writer.
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(handle, "rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise InvalidArgumentError(f"{argument} must be a regular file; {path} is not")
            # read() allocates as much as it is asked for, so not most_bytes.
            long = status.st_size > most_bytes
            content = b"" if long else file.read(status.st_size + 1)
    except InvalidArgumentError:
        raise
    except (OSError, ValueError, TypeError) as error:
        raise InvalidArgumentError(
            f"{argument} must be a file that can be read; {path}: {_reason(error)}"
        ) from None
    if long or len(content) > most_bytes:  # it may have grown meanwhile
        raise InvalidArgumentError(
            f"{argument} must have at most {most_bytes} bytes; {path} has more"
        )
    return content


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"a {type(value).__name__} cannot be written as JSON")
