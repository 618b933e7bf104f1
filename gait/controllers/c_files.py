"""C files that ``export`` writes from a template, each with test vectors beside it."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.utils.storage import output_file, write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError, brief, file_path
from gait.controllers.network import OUTPUTS

_FIRST_LINE = re.compile(rb"/\* Written by `aquafish export`")
# Of a controller's or a model's vectors, or of a policy's.
_HEADER = re.compile(rf"[\w,]*({','.join(OUTPUTS)}|observation_0,[\w,]*action_0)[\w,]*\n".encode())


def c_files(argument: str, path: Path | str) -> tuple[Path, Path]:
    """Return the paths of a C file and of its test vectors, which may be written.

    Raises
    ------
    InvalidArgumentError
        If the file's name is no identifier of C followed by .c, or if another file than an exported
        one is there.
    """
    source = file_path(argument, path)
    if source.suffix != ".c" or not re.fullmatch(r"[A-Za-z]\w*", source.stem, re.ASCII):
        raise InvalidArgumentError(
            f"{argument} must be a file name FILE.c, where FILE is a letter and then letters, "
            "digits and _, because it begins the names of the functions; "
            f"got {brief(source.name)}"
        )
    table = source.with_suffix(".csv")
    for file, ours in ((source, _FIRST_LINE), (table, _HEADER)):
        if file.exists() and not (file.is_file() and ours.match(file.read_bytes())):
            raise InvalidArgumentError(
                f"{argument} must not overwrite a file that no export wrote; {file} exists"
            )
        output_file(file, argument)
    return source, table


@dataclass(frozen=True)
class CFile:
    """A C file and its test vectors, which nothing refuses any more; see ``c_files``."""

    source: Path
    table: Path
    text: str
    columns: Sequence[str]
    rows: Iterable[Iterable[Any]]

    def write(self) -> tuple[Path, Path]:
        """Write both, and return their paths."""
        lines = [",".join(self.columns), *(",".join(map(str, row)) for row in self.rows)]
        write_bytes(self.table, ("\n".join(lines) + "\n").encode())
        write_bytes(self.source, self.text.encode())
        return self.source, self.table


def filled(
    template: str, name: str, values: Mapping[str, object], parts: Mapping[str, bool]
) -> str:
    """Return a template of this folder with ``values`` for $NAMES and ``name`` for NAME.

    In the template, a line "//? part" begins what only some files have, and "//." ends it. A line
    "//+ file" stands for the lines of another file of this folder.
    """
    lines = []
    kept = True
    for line in _lines(template):
        if line.startswith("//"):
            kept = line == "//." or parts[line.removeprefix("//? ")]
        elif kept:
            lines.append(line)
    text = re.sub(r"\$([A-Z_]+)", lambda found: str(values[found[1]]), "\n".join(lines))
    return re.sub(r"\bNAME(?=_|\b)|(?<=-D)NAME", name, text) + "\n"


def _lines(template: str) -> Iterator[str]:
    text = files("gait.controllers").joinpath(template).read_text(encoding="utf-8")
    for line in text.splitlines():
        if line.startswith("//+ "):
            yield from _lines(line.removeprefix("//+ "))
        else:
            yield line


def c_float(number: float) -> str:
    """Return the shortest literal of a number in float32."""
    return str(np.float32(number)) + "f"


def c_floats(numbers: ArrayLike) -> str:
    """Return the literals of numbers in float32, with commas."""
    return wrapped(map(c_float, np.asarray(numbers).tolist()))


def wrapped(items: Iterable[object]) -> str:
    """Return items with commas, on lines of their own if they are many."""
    joined = ", ".join(map(str, items))
    if len(joined) < 60:
        return joined
    return "\n" + textwrap.fill(joined, 100, initial_indent=" " * 4, subsequent_indent=" " * 4)
