"""The example that compares gaits prints what it says it does."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "compare_gaits.py"


def test_three_gaits_are_compared_on_two_samples(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "140")  # narrower terminals break cells in two
    command = runpy.run_path(str(SCRIPT))["CompareGaits"]
    command(bodies=4, generations=2, population=10, screened=12, seeds=2).execute()
    lines = capsys.readouterr().out.splitlines()
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines if "│" in line]
    names = ["one body, broken on the left", "the sample, mean", "the sample, 20% quantile"]
    assert [row[0] for row in rows] == 2 * names
    for row in rows:
        mean, low, worst = (float(cell.split()[0]) for cell in row[1:4])
        assert worst <= low <= mean
    assert [row[4] for row in rows[::3]] == ["x 1.00"] * 2
