"""The example of another robot: the core knows no fish."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / "examples" / "toy_robot.py"


def test_a_pendulum_is_modelled_in_under_a_hundred_lines(capsys):
    assert len(SCRIPT.read_text().splitlines()) < 100
    example = runpy.run_path(str(SCRIPT))
    found, true = example["main"](), example["TRUE_BODY"]
    ranges = example["PENDULUM"].models.span
    assert (abs(found - true) / ranges).max() < 0.05
    said = capsys.readouterr().out
    assert said.count("trial ") == 5
    assert f"length: found {found[0]:.3f}, it is 0.630" in said


def test_it_loads_neither_the_fish_nor_its_engines():
    code = (
        f"import sys, runpy; runpy.run_path({str(SCRIPT)!r}); "
        "print({'aquafish_gym', 'numba', 'pybullet', 'eea.fish.methods'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
