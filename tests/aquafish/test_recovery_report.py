"""The case study's report: numbers from outcomes alone, and words that follow from the numbers."""

from __future__ import annotations

import copy
import io
import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from aquafish.recovery.command import SCHEMA
from aquafish.recovery.report import build_report, show, to_markdown
from aquafish_gym.runs.storage import encode_document

COMMITTED = Path(__file__).parents[2] / "docs" / "recovery"
TREATMENTS = ["undamaged", "none", "out-of-band", "oracle"]


@pytest.fixture
def report() -> dict[str, Any]:
    committed = json.loads((COMMITTED / "report.json").read_text(encoding="utf-8"))
    return build_report(committed["config"], committed["code"], committed["replicates"])


def printed(report: dict[str, Any], width: int) -> str:
    console = Console(file=io.StringIO(), width=width)
    show(report, console)
    return str(console.file.getvalue())  # type: ignore[attr-defined]


def test_the_committed_report_is_what_the_code_makes_of_its_replicates(
    report: dict[str, Any],
) -> None:
    assert encode_document(report, SCHEMA) == (COMMITTED / "report.json").read_bytes()
    text = (COMMITTED / "report.md").read_text(encoding="utf-8")
    assert text.startswith(to_markdown(report, []).rstrip())


def test_an_interval_holds_its_mean_and_stays_in_its_numbers_range(report: dict[str, Any]) -> None:
    for treatment in TREATMENTS:
        for found in report["treatments"][treatment]["spread"].values():
            if "values" in found:
                low, high = found["interval"]
                assert min(found["values"]) - 1e-12 <= low <= found["mean"] + 1e-12
                assert found["mean"] - 1e-12 <= high <= max(found["values"]) + 1e-12


def test_a_share_is_of_the_oracles_mean(report: dict[str, Any]) -> None:
    rows = report["treatments"]
    for row in rows.values():
        share = row["target_distance"] / rows["oracle"]["target_distance"]
        assert row["share_of_oracle"] == pytest.approx(share, rel=1e-12)
    assert rows["oracle"]["spread"]["share_of_oracle"]["interval"] == [1.0, 1.0]


def test_without_a_distance_of_the_oracle_there_is_no_share(report: dict[str, Any]) -> None:
    outcomes = copy.deepcopy(report["replicates"])
    for outcome in outcomes["oracle"]:
        outcome["target_distance"] = -0.1
    row = build_report(report["config"], [], outcomes)["treatments"]["none"]
    assert row["share_of_oracle"] is None
    assert row["share_of_oracle_random_poses"] is not None


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        ("left_pectoral:length=0.5", "The old body has 8 of the 9 dimensions right"),
        ("caudal:missing", "The old body has 6 of the 9 dimensions right"),
        ("caudal:missing;left_pectoral:width=0.5", "The old body has 5 of the 9 dimensions right"),
        ("none", "Nothing broke, so the old body is the true one"),
    ],
)
def test_how_much_of_the_old_body_is_right_is_counted(
    report: dict[str, Any], damage: str, sentence: str
) -> None:
    report["config"]["damage"] = damage
    assert sentence in to_markdown(report, [])


def test_what_broke_is_said_in_words(report: dict[str, Any]) -> None:
    text = to_markdown(report, [])
    assert "left flipper: half its length, 0.80 where it was 1.60" in text


@pytest.mark.parametrize("width", [60, 80, 140])
def test_no_name_and_no_number_is_cut_on_a_narrow_terminal(
    report: dict[str, Any], width: int
) -> None:
    text = printed(report, width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    for treatment in TREATMENTS:
        assert f"\n{treatment} " in text
    words = text.replace("[", " ").replace("]", " ").replace(",", " ").split()
    for row in report["treatments"].values():
        for end in row["spread"]["target_distance"]["interval"]:
            assert f"{end:.1f}" in words


def test_each_replicate_that_diverged_is_told(report: dict[str, Any]) -> None:
    outcomes = copy.deepcopy(report["replicates"])
    assert "diverged" not in to_markdown(report, [])
    outcomes["none"][0]["diverged"] = outcomes["oracle"][3]["diverged"] = 1
    text = to_markdown(build_report(report["config"], [], outcomes), [])
    assert "2 swims on the damaged robot diverged and count as no progress." in text
