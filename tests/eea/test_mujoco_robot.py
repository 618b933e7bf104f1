"""The example of a MuJoCo robot: its weak motor is found from its own observations."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "mujoco_robot.py"


def test_a_swimmer_finds_its_weak_motor_in_at_most_80_lines(capsys):
    pytest.importorskip("mujoco")
    assert len(SCRIPT.read_text().splitlines()) <= 80
    found = runpy.run_path(str(SCRIPT))["main"](share=0.7)
    assert found.good, found.verdict
    assert found.probability("the rear motor is weak") > 0.99
    _, low, high = found.broken("rear motor")
    assert low < 0.7 < high
    assert high - low < 0.02
    assert "the rear motor is weak (100%): rear motor 0.70" in capsys.readouterr().out
