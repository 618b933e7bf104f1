"""The experiments with a table run each job once and write the same table again."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.gaits.ceiling import Ceiling
from experiments.gaits.sample import KINDS, CompareGaits
from gait import EvolveConfig
from tests.in_process import jobs_in_process


def rows_of(out: Path) -> list[list[str]]:
    lines = (out / "table.md").read_text().splitlines()
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]


@jobs_in_process()
@pytest.mark.slow
def test_gaits_for_a_sample_are_compared_with_the_true_bodys(tmp_path: Path) -> None:
    quick = EvolveConfig(
        search="cma", generations=1, population=10, random_candidates=12, seconds=2.0, threads=1
    )
    command = CompareGaits(tmp_path, (0.1,), replicates=1, gait=quick, workers=1)
    command.execute()
    _, _, *rows = rows_of(tmp_path)
    assert [row[1] for row in rows] == [*KINDS, "the true body"]
    assert rows[-1][2] == "1.000"
    assert len({row[2] for row in rows[:-1]}) == 1, "one self-model for all gaits"
    table, files = (tmp_path / "table.md").read_text(), list(tmp_path.glob("runs/*/*.json"))
    before = {file: file.stat().st_mtime_ns for file in files}
    command.execute()
    assert (tmp_path / "table.md").read_text() == table
    assert {file: file.stat().st_mtime_ns for file in files} == before


@pytest.mark.slow
def test_the_gait_ceiling_has_a_row_for_each_body(tmp_path: Path) -> None:
    searches = ("linear", "recurrent, fins")
    Ceiling(
        tmp_path,
        replicates=2,
        searches=searches,
        bodies=("none", "caudal:missing"),
        budget_divisor=400,
        workers=1,
    ).execute()
    head, _, *rows = rows_of(tmp_path)
    assert head == ["", *searches]
    assert [row[0] for row in rows] == ["whole", "caudal:missing"]
    assert "CPU s a gait" in (tmp_path / "times.md").read_text()
