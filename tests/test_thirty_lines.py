"""The README's thirty lines are the example's, and run."""

from __future__ import annotations

import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).parent.parent
EXAMPLE = (ROOT / "examples" / "thirty_lines.py").read_text()


def test_the_readme_shows_the_example() -> None:
    code = EXAMPLE.split('"""', 2)[2].strip()
    assert f"```python\n{code}\n```" in (ROOT / "README.md").read_text()


def test_it_runs(tmp_path: pathlib.Path) -> None:
    pytest.importorskip("pybullet")
    short = EXAMPLE
    assert short.count('search="cma"') == 1
    short = short.replace(
        'search="cma"', 'search="cma", screened=6, generations=1, starts=1, poses=2'
    )
    script = tmp_path / "short.py"
    script.write_text(short)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True)
    said = done.stdout.splitlines()
    assert said[0].startswith("random commands:")
    assert said[1:4] == [f"trial {n}: OBJ_FIT 1.000" for n in (1, 2, 3)]
    assert [line.split(":")[0] for line in said[4:]] == [
        "gait for the old body",
        "gait for the self-model",
    ]
