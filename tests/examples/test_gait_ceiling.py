"""The example that says how far each body can swim does each search once, and keeps a table."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.slow  # a day's measurement in small; tests of examples/compare_gaits.py are alike
def test_the_table_has_a_row_a_body_and_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(EXAMPLES)
    ceiling = importlib.import_module("gait_ceiling").Ceiling
    searches = ("linear", "recurrent, fins")
    small = {"out": tmp_path, "searches": searches, "bodies": ("none", "caudal:missing")}
    command = ceiling(**small, seeds=2, others=1, shorter=400, workers=1)
    command.execute()
    lines = (tmp_path / "table.md").read_text().splitlines()
    head, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    assert head == ["", *searches]
    assert [row[0] for row in rows] == ["whole", "caudal:missing", "CPU s a gait"]
    for _, once, twice in rows[:2]:
        assert "(" not in once
        assert twice.endswith(")")  # the spread of two seeds
    runs = {path: path.stat().st_mtime_ns for path in tmp_path.glob("runs/*/*/*.json")}
    assert len(runs) == 2 * (1 + 2)
    command.execute()
    assert {path: path.stat().st_mtime_ns for path in runs} == runs
    assert "caudal:missing" in capsys.readouterr().out
