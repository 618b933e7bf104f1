"""Run the README's first block where the package is installed without an extra.

    python alone.py README.md

It also asserts that pip brought nothing else than environments need, and that the command says what
it lacks.
"""

from __future__ import annotations

import contextlib
import io
import re
import subprocess
import sys
from importlib.metadata import distributions
from pathlib import Path

MOST = 12  # distributions besides pip: ours, five that it needs, and theirs


def main(readme: Path) -> None:
    """Check everything; an AssertionError says what is wrong."""
    text = readme.read_text(encoding="utf-8")
    block, shown = re.findall(r"^```(?:python|text)\n(.*?)^```$", text, re.M | re.S)[:2]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(block, str(readme), "exec"), {"__name__": "readme"})
    assert printed.getvalue() == shown, (printed.getvalue(), shown)
    there = sorted(
        {one.metadata["Name"].lower() for one in distributions()} - {"pip", "setuptools"}
    )
    assert len(there) <= MOST, there
    command = [str(Path(sys.executable).parent / "aquafish"), "recover", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, ""), done
    assert done.stderr.endswith('pip install "aquafish-gym[cli]"\n'), done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    print(f"the wheel alone runs the README's first block, on {', '.join(there)}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
