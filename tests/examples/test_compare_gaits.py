"""The example that compares gaits prints what it says it does."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

from gait import EvolveConfig

EXAMPLES = Path(__file__).parents[2] / "examples"
QUICK = EvolveConfig(
    search="cma", generations=1, population=10, random_candidates=12, seconds=2.0, threads=1
)


def test_gaits_for_one_body_and_for_many_are_held_against_the_truths(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(EXAMPLES)
    script = importlib.import_module("compare_gaits")
    command = script.CompareGaits(
        out=tmp_path, noise=(0.1,), seeds=1, gait=QUICK, workers=1, trials=1
    )
    command.execute()
    table = (tmp_path / "table.md").read_text()
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()][2:]
    assert [row[1] for row in rows] == [*script.KINDS, "the true body"]
    assert rows[-1][2] == "1.000"
    assert rows[-1][4:] == ["100%", "100%"]
    told = {row[2] for row in rows[:-1]}  # one self-model, for whoever makes use of it
    assert len(told) == 1
    assert 0.7 < float(told.pop()) < 1.0
    for *_, median, least in rows[:-1]:
        assert int(least[:-1]) <= int(median[:-1])

    runs = {path: path.stat().st_mtime_ns for path in tmp_path.glob("runs/*/*.json")}
    assert len(runs) == 4
    command.execute()
    assert (tmp_path / "table.md").read_text() == table
    assert {path: path.stat().st_mtime_ns for path in runs} == runs
    assert "the true body" in capsys.readouterr().out
