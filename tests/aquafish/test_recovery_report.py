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
from aquafish.recovery.treatment import WAYS
from aquafish_gym.runs.storage import encode_document

COMMITTED = Path(__file__).parents[2] / "docs" / "recovery"


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
    for row in report["treatments"].values():
        for found in row["spread"].values():
            if "values" in found:
                low, high = found["interval"]
                assert min(found["values"]) - 1e-12 <= low <= found["mean"] + 1e-12
                assert found["mean"] - 1e-12 <= high <= max(found["values"]) + 1e-12


def test_a_share_is_of_the_oracles_mean(report: dict[str, Any]) -> None:
    rows = report["treatments"]
    for treatment, row in rows.items():
        share = row["target_distance"] / rows[WAYS[treatment].oracle]["target_distance"]
        assert row["share_of_oracle"] == pytest.approx(share, rel=1e-12)
    assert rows["oracle"]["spread"]["share_of_oracle"]["interval"] == [1.0, 1.0]


def test_without_a_distance_of_the_oracle_there_is_no_share(report: dict[str, Any]) -> None:
    outcomes = copy.deepcopy(report["replicates"])
    for outcome in outcomes["oracle-neat"]:
        outcome["target_distance"] = -0.1
    row = build_report(report["config"], [], outcomes)["treatments"]["none"]
    assert row["share_of_oracle"] is None
    assert row["share_of_oracle_random_poses"] is not None


def test_what_broke_is_said_in_words(report: dict[str, Any]) -> None:
    several = to_markdown(report, [])
    for outcome in report["replicates"]["joint"]:
        assert f"`{outcome['damage']}`" in several
    report["config"]["damage"] = "left_pectoral:length=0.5"
    assert "left flipper: half its length, 0.80 where it was 1.60" in to_markdown(report, [])


@pytest.mark.parametrize("width", [64, 80, 140])
def test_no_name_and_no_number_is_cut_on_a_narrow_terminal(
    report: dict[str, Any], width: int
) -> None:
    text = printed(report, width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    for treatment in report["treatments"]:
        assert f"\n{treatment} " in text
    words = text.replace("[", " ").replace("]", " ").replace(",", " ").split()
    for row in report["treatments"].values():
        for end in row["spread"]["target_distance"]["interval"]:
            assert f"{end:.1f}" in words


def with_joint(report: dict[str, Any], gain: float) -> dict[str, Any]:
    """Return the report as if joint inference's gait swam so much farther than the oracle's."""
    outcomes = copy.deepcopy(report["replicates"])
    outcomes["joint"] = copy.deepcopy(outcomes["oracle"])
    for outcome in outcomes["joint"]:
        outcome["treatment"] = "joint"
        outcome["target_distance"] += gain
        outcome["target_random_distances"] = [d + gain for d in outcome["target_random_distances"]]
    return build_report(report["config"] | {"joint_rounds": 3}, [], outcomes)


def test_the_headline_follows_from_the_numbers(report: dict[str, Any]) -> None:
    rows = {
        (r["first"], r["second"], r["measure"].endswith("poses")): r["wins"]
        for r in report["paired"]
    }
    zero, random = (rows["out-of-band", "undamaged", poses] for poses in (False, True))
    text = to_markdown(report, [])
    assert f"beats the old one in {zero} of 10 and {random} of 10 replicates" in text
    hours = [known for known in report["treatments"]["direct"]["robot_hours"] if known is not None]
    assert f"what joint inference's gait swims in {len(hours)} of 10 replicates" in text
    far = with_joint(report, 5.0)
    assert far["treatments"]["joint"]["trials"] == 3
    said = to_markdown(far, [])
    assert "**joint**: after 3 trials the robot's gait beats the old one in 10 of 10" in said
    share = far["treatments"]["joint"]["share_of_oracle"]
    assert share > 1.5
    assert f"it swims {share:.0%} and " in said
    assert "as far as one for the true body, both told from 100%." in said
    same = to_markdown(with_joint(report, 0.0), [])
    assert "it swims 100% and 100% as far as one for the true body, neither told from 100%." in same
    lost = to_markdown(with_joint(report, -50.0), [])
    assert "**joint**: after 3 trials the robot's gait beats the old one in 0 of 10" in lost


def test_the_report_is_of_the_treatments_that_were_done(report: dict[str, Any]) -> None:
    some = ["undamaged", "none", "oracle-neat", "oracle"]
    fewer = build_report(report["config"], [], {n: report["replicates"][n] for n in some})
    assert list(fewer["treatments"]) == some
    assert fewer["paired"] == []
    assert "**out-of-band**" not in to_markdown(fewer, [])


def test_each_replicate_that_diverged_is_told(report: dict[str, Any]) -> None:
    outcomes = copy.deepcopy(report["replicates"])
    assert "diverged" not in to_markdown(report, [])
    outcomes["none"][0]["diverged"] = outcomes["oracle"][3]["diverged"] = 1
    text = to_markdown(build_report(report["config"], [], outcomes), [])
    assert "2 swims on the damaged robot diverged and count as no progress." in text
