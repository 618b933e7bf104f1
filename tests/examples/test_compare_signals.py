"""The example that compares signals prints what it says it does."""

from __future__ import annotations

import pathlib
import runpy

import pytest

SCRIPT = pathlib.Path(__file__).parent.parent / "examples" / "compare_signals.py"


def test_the_gyroscope_keeps_long_trials_comparable(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "120")  # narrower terminals break cells in two
    command = runpy.run_path(str(SCRIPT))["CompareSignals"]
    command(pairs=40).execute()
    rows = [line.split("│")[1:-1] for line in capsys.readouterr().out.splitlines() if "│" in line]
    assert [(row[0].split(",")[0].strip(), int(row[1])) for row in rows] == [
        (signal, steps) for signal in ("attitude", "gyroscope") for steps in (128, 256, 512, 1024)
    ]
    medians = [[float(cell.split(",")[0]) for cell in row[2:]] for row in rows]
    attitude, gyroscope = medians[:4], medians[4:]
    for column in (0, 1):
        assert attitude[3][column] > 3 * attitude[0][column]
        assert gyroscope[3][column] < 2 * gyroscope[0][column]
