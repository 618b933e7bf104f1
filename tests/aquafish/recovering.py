"""The case study as a user runs it, small: what the tests of this folder share."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SMALL = ("--rounds", "2", "--steps", "64", "--models", "6", "--angle-sets", "6", "--generations",
         "3", "--population", "12", "--gait-poses", "1", "--poses", "2", "--seconds", "2",
         "--target-engine", "numba", "--no-film")  # fmt: skip
COMMAND = [sys.executable, "-m", "aquafish", "recover"]


def recover(out: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the case study with these arguments to its end."""
    return subprocess.run(
        [*COMMAND, "--out", str(out), *arguments], capture_output=True, text=True, check=False
    )


def results(out: Path) -> dict[str, bytes]:
    """Return file -> content of all but the pictures."""
    files = [path for end in ("json", "md") for path in out.rglob(f"*.{end}")]
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(files)}
