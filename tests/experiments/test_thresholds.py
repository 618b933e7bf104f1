"""The table of thresholds, and what each is worth in the league's short form."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from aquafish.online import thresholds
from experiments.league import thresholds as instrument
from experiments.league.episodes import Episode
from experiments.league.thresholds import Pass, Thresholds, documented, play_pass, scaled
from tests.in_process import jobs_in_process

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "league"
SHORT = (Episode("self-model, library only", "none", 60_900, seconds=12.0),)


def test_each_threshold_has_a_unit_and_a_meaning() -> None:
    found = documented()
    assert [one.name for one in found] == [name for name in vars(thresholds) if name.isupper()]
    for one in found:
        assert one.group
        assert one.unit
        assert one.decides


def test_a_threshold_that_was_played_is_in_the_code_or_the_page_says_why_it_went() -> None:
    rows = (RESULTS / "thresholds-worth.md").read_text(encoding="utf-8").splitlines()[2:]
    gone = {row.split("`")[1] for row in rows} - {one.name for one in documented()}
    page = (RESULTS.parents[1] / "thresholds.md").read_text(encoding="utf-8")
    assert gone == set(re.findall(r"^\| `(\w+)` \| gone \|", page, re.MULTILINE))


def test_a_tuple_or_an_array_is_scaled_in_all_its_numbers_and_a_count_is_at_least_one() -> None:
    assert scaled((1, 2, 5), 0.5) == (1, 1, 2)
    assert scaled(0.3, 2.0) == 0.6
    np.testing.assert_array_equal(scaled(np.array([1.0, 2.0]), 2.0), [2.0, 4.0])


def test_a_pass_changes_one_threshold_while_it_plays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instrument, "EPISODES", SHORT)
    before = thresholds.CALIBRATION_ACTIONS
    usual, same, other = (
        play_pass(Pass(name, factor))
        for name, factor in (
            ("CALIBRATION_ACTIONS", 1.0),
            ("LONGEST_DELAY_ACTIONS", 2.0),
            ("CALIBRATION_ACTIONS", 0.8),
        )
    )
    assert before == thresholds.CALIBRATION_ACTIONS
    assert same["hashes"] == usual["hashes"]
    assert other["hashes"] != usual["hashes"]


@jobs_in_process()
def test_the_table_says_what_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instrument, "EPISODES", SHORT)
    Thresholds(out=tmp_path, names=("OUTAGE_ACTIONS",), factors=(2.0,), workers=1).execute()
    rows = (tmp_path / "table.md").read_text().splitlines()
    assert rows[2:] == ["| `OUTAGE_ACTIONS` | +0.00 | 0 |"]
