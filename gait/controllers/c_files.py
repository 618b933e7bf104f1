"""C files that ``export`` writes from templates, each with a header and test vectors beside it."""

from __future__ import annotations

import hashlib
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.plans import BodyPlan
from aquafish_gym.utils.storage import output_file, write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError, brief, file_path

_FIRST_LINE = re.compile(rb"/\* Written by `aquafish export`")
_COLUMNS = re.compile(rb"[a-z]\w*(,[a-z]\w*)*\n")  # of test vectors

# Of C's own headers, in front of which a header of the same name would be found.
_HEADERS_OF_C = re.compile(
    "assert|complex|ctype|errno|fenv|float|inttypes|iso646|limits|locale|math|setjmp|signal|"
    "stdalign|stdarg|stdatomic|stdbit|stdbool|stdckdint|stddef|stdint|stdio|stdlib|stdnoreturn|"
    "string|tgmath|threads|time|uchar|wchar|wctype",
    re.IGNORECASE,
)


def c_file_path(argument: str, path: Path | str) -> Path:
    """Return the path of a C file that may be written, with a header and test vectors beside it.

    Raises
    ------
    InvalidArgumentError
        If the file's name is no identifier of C followed by .c, if its header would hide one of
        C's own, or if another file than an exported one is there.
    """
    source = file_path(argument, path)
    if source.suffix != ".c" or not re.fullmatch(r"[A-Za-z]\w*", source.stem, re.ASCII):
        raise InvalidArgumentError(
            f"{argument} must be a file name FILE.c, where FILE is a letter and then letters, "
            "digits and _, because it begins the names of the functions; "
            f"got {brief(source.name)}"
        )
    if _HEADERS_OF_C.fullmatch(source.stem):
        raise InvalidArgumentError(
            f"{argument} must have another name: its header {source.stem}.h would hide C's own "
            f"<{source.stem.lower()}.h>; got {brief(source.name)}"
        )
    beside = False
    for suffix, ours in ((".c", _FIRST_LINE), (".h", _FIRST_LINE), (".csv", _COLUMNS)):
        file = source.with_suffix(suffix)
        is_ours = file.is_file() and bool(ours.match(file.read_bytes()))
        if suffix == ".csv":
            is_ours &= beside  # any table might have such columns
        beside |= is_ours
        if file.exists() and not is_ours:
            raise InvalidArgumentError(
                f"{argument} must not overwrite a file that no export wrote; {file} exists"
            )
        output_file(file, argument)
    return source


@dataclass(frozen=True)
class CFile:
    """A C file with its header and test vectors, whose path is checked; see ``c_file_path``."""

    path: Path
    source: str
    header: str
    columns: Sequence[str]
    rows: Iterable[Iterable[Any]]

    def write(self) -> tuple[Path, Path, Path]:
        """Write the C file, its header and its test vectors; return their paths."""
        lines = [",".join(self.columns), *(",".join(map(str, row)) for row in self.rows)]
        table = self.path.with_suffix(".csv")
        header = self.path.with_suffix(".h")
        write_bytes(table, ("\n".join(lines) + "\n").encode())
        write_bytes(header, self.header.encode())
        write_bytes(self.path, self.source.encode())
        return self.path, header, table


def source_and_header(
    template: str, name: str, values: Mapping[str, object], parts: Mapping[str, bool]
) -> tuple[str, str]:
    """Return the C file and the header of two templates of this folder, with ``name`` for NAME.

    The hash of both stands in both, so that those of two exports are never taken for a pair.
    """
    texts = [_filled(f"{template}.{suffix}", name, values, parts) for suffix in "ch"]
    export = hashlib.sha256("".join(texts).encode()).hexdigest()[:8]
    source, header = (text.replace("$EXPORT", export) for text in texts)
    return source, header


def _filled(
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
    given = {**values, "EXPORT": "$EXPORT"}
    text = re.sub(r"\$([A-Z_]+)", lambda found: str(given[found[1]]), "\n".join(lines))
    return re.sub(r"\bNAME(?=_|\b)|(?<=-D)NAME", name, text) + "\n"


def _lines(template: str) -> Iterator[str]:
    text = files("gait.controllers").joinpath(template).read_text(encoding="utf-8")
    for line in text.splitlines():
        if line.startswith("//+ "):
            yield from _lines(line.removeprefix("//+ "))
        else:
            yield line


def servo_lines(plan: BodyPlan) -> str:
    """Return the lines of a comment that say what each servo's command is."""
    return "\n".join(
        f" *            [{i}] {fin.word}, "
        + (f"rev/s, {-fin.speed:g} to {fin.speed:g}" if fin.turns else f"Hz, 0 to {fin.speed:g}")
        for i, fin in enumerate(plan.fins)
    )


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
