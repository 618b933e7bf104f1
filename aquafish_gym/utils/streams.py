"""Standard streams that survive closed descriptors and readers that leave."""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path
from typing import Any


class _Lasting(io.FileIO):
    """A file that becomes the null device when its reader leaves, such as ``head``.

    Other errors, such as a full disk, are raised once.
    """

    def write(self, data: bytes) -> int:  # type: ignore[override]
        try:
            return super().write(data)
        except OSError as error:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.fileno())
            os.close(null)
            if not isinstance(error, BrokenPipeError):
                raise
            return super().write(data)


def keep_streams() -> None:
    """Make the standard streams accept output until the end of the process.

    The null device replaces closed streams, so that no file takes their place, and streams whose
    reader leaves. Characters that the terminal cannot show, such as a file's name that is not
    UTF-8, are written with escapes.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open(mode))  # noqa: SIM115
        elif mode == "w":
            setattr(sys, name, _lasting(stream))


def _lasting(stream: io.TextIOBase) -> io.TextIOBase:
    """Return a lasting stream for a file's descriptor; other streams are returned unchanged."""
    buffer = getattr(stream, "buffer", None)
    raw = getattr(buffer, "raw", buffer)  # "python -u" has no buffer
    if not isinstance(stream, io.TextIOWrapper) or type(raw) is not io.FileIO:
        return stream
    stream.flush()
    lasting: Any = _Lasting(raw.fileno(), "w", closefd=False)
    return io.TextIOWrapper(
        lasting if raw is buffer else io.BufferedWriter(lasting),
        stream.encoding,
        "backslashreplace" if stream.errors == "strict" else stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
