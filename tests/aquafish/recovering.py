"""The case study as a user runs it, small: what the tests of this folder share."""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path
from typing import NamedTuple

from aquafish.cli import main

SMALL = ("--rounds", "2", "--joint-rounds", "1", "--steps", "64", "--models", "6", "--angle-sets",
         "6", "--generations", "3", "--population", "12", "--gait-poses", "1",
         "--search-generations", "3", "--search-starts", "1", "--screened", "10",
         "--search-population", "10", "--direct-generations", "2", "--poses", "2",
         "--seconds", "2", "--target-engine", "numba", "--no-film")  # fmt: skip
COMMAND = [sys.executable, "-m", "aquafish", "recover"]


class Done(NamedTuple):
    """What a command ended with, and said."""

    returncode: int
    stdout: str
    stderr: str


def recover(out: Path, *arguments: str) -> Done:
    """Run the case study with these arguments to its end, in this process and its workers."""
    said, complained = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(complained):
        code = main(["recover", "--out", str(out), *arguments])
    return Done(code, said.getvalue(), complained.getvalue())


def results(out: Path) -> dict[str, bytes]:
    """Return file -> content of all but the pictures."""
    files = [path for end in ("json", "md") for path in out.rglob(f"*.{end}")]
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(files)}
