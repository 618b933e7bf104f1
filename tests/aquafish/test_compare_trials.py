"""The example that compares trials prints what it says it does, and goes on where it stopped."""

from __future__ import annotations

import runpy
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from eea import EEAConfig, JointConfig
from gait import EvolveConfig

SCRIPT = Path(__file__).parents[2] / "examples" / "compare_trials.py"


def test_strategies_are_compared_after_each_trial_and_none_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "140")  # narrower terminals break cells in two
    script = runpy.run_path(str(SCRIPT))
    little = JointConfig(
        (), bodies=24, poses=24, descents=6, polished=2, restarts=0, alternatives="never"
    )
    usual = partial(EEAConfig, joint=little)
    monkeypatch.setitem(script["CompareTrials"].jobs.__globals__, "EEAConfig", usual)
    gait = EvolveConfig(
        generations=2, population=10, poses=1, seconds=1.0, threads=1, starts=1, polish=0
    )
    command = script["CompareTrials"](
        out=tmp_path, strategies=("fast", "gait"), trials=2, seeds=2, steps=64, gait=gait
    )
    command.execute()
    said = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in said.splitlines()]
    rows = [row for row in rows if row]
    assert [row[:2] for row in rows] == [
        ["fast", "1"], ["", "2"], ["gait", "1"], ["", "2"], ["oracle", ""]
    ]  # fmt: skip
    assert rows[0][2:] == rows[2][2:]  # the first trial is the same
    for row in rows[:-1]:
        assert 0.0 < float(row[3]) <= float(row[2]) < 1.0
    files = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("seed-*/*.json")}
    assert len(files) == 6
    command.execute()
    assert capsys.readouterr().out == said
    assert {path: path.stat().st_mtime_ns for path in files} == files
    truth = np.random.default_rng(0).uniform(0.1, 1.0, 9)
    assert script["random_body"](0).to_array() == pytest.approx(truth * script["MAXIMA"])
