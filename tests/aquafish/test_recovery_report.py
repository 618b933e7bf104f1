"""The report of the case study follows from the outcomes alone."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from aquafish.recovery import figures
from aquafish.recovery.command import REPORT_SCHEMA
from aquafish.recovery.report import build_report, to_markdown
from aquafish_gym import Damage, Morphology
from aquafish_gym.utils.storage import encode_document

COMMITTED = Path(__file__).parents[2] / "docs" / "recovery"


@pytest.fixture
def report() -> dict[str, Any]:
    committed = json.loads((COMMITTED / "report.json").read_text(encoding="utf-8"))
    return build_report(committed["config"], committed["code"], committed["replicates"])


def test_the_committed_report_follows_from_its_replicates(report: dict[str, Any]) -> None:
    assert encode_document(report, REPORT_SCHEMA) == (COMMITTED / "report.json").read_bytes()
    text = (COMMITTED / "report.md").read_text(encoding="utf-8")
    assert text.startswith(to_markdown(report).rstrip())


@pytest.mark.parametrize(
    ("damage", "mark"),
    [
        ("left_pectoral:length=0.5", "broken fin in yellow"),
        ("left_pectoral:missing", "break of the lost fin in black"),
        ("left_pectoral:missing;caudal:length=0.5", "broken fin in yellow"),
    ],
)
def test_the_picture_of_the_bodies_says_how_the_damage_is_marked(
    report: dict[str, Any], damage: str, mark: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "render_pose", lambda *_: np.zeros((2, 2, 3), np.uint8))
    healthy = Morphology.nominal()
    job: Any = SimpleNamespace(morphology=healthy, target=Damage.parse(damage).apply(healthy))
    first = figures.bodies_figure(job, report["replicates"]).axes[0]
    assert first.get_title() == f"the damaged robot\n{mark}"


def test_without_a_distance_of_the_oracle_there_is_no_share(report: dict[str, Any]) -> None:
    outcomes = copy.deepcopy(report["replicates"])
    for outcome in outcomes["oracle-neat"]:
        outcome["target_distance"] = -0.1
    row = build_report(report["config"], [], outcomes)["treatments"]["none"]
    assert row["share_of_oracle"] is None
    assert row["share_of_oracle_random_poses"] is not None


@pytest.mark.parametrize("gain", [5.0, 0.0, -50.0])
def test_the_headline_follows_from_the_numbers(report: dict[str, Any], gain: float) -> None:
    outcomes = copy.deepcopy(report["replicates"])
    outcomes["joint"] = copy.deepcopy(outcomes["oracle"])
    for outcome in outcomes["joint"]:
        outcome["treatment"] = "joint"
        outcome["target_distance"] += gain
        outcome["target_random_distances"] = [d + gain for d in outcome["target_random_distances"]]
    text = to_markdown(build_report(report["config"] | {"joint_rounds": 3}, [], outcomes))
    wins = {5.0: "10 of 10", -50.0: "0 of 10"}
    if gain:
        assert (
            f"**joint inference**: after 3 trials the gait beats the old one in {wins[gain]}"
            in text
        )
    else:
        assert "it swims 100% and 100% as far as the gait for the true body (neither sig" in text


def test_the_report_is_of_the_finished_treatments(report: dict[str, Any]) -> None:
    some = ["undamaged", "none", "oracle-neat", "oracle"]
    fewer = build_report(report["config"], [], {n: report["replicates"][n] for n in some})
    assert list(fewer["treatments"]) == some
    assert fewer["paired"] == []
    assert "the paper's method" not in to_markdown(fewer)


def test_diverged_swims_are_counted(report: dict[str, Any]) -> None:
    assert "diverged" not in to_markdown(report)
    outcomes = copy.deepcopy(report["replicates"])
    outcomes["none"][0]["diverged"] = outcomes["oracle"][3]["diverged"] = 1
    text = to_markdown(build_report(report["config"], [], outcomes))
    assert "diverged and count as 0 cm: 2." in text


def test_the_report_of_one_replicate_says_how_far_each_gait_swims(report: dict[str, Any]) -> None:
    one = {name: several[:1] for name, several in report["replicates"].items()}
    text = to_markdown(build_report(report["config"], [], one))
    assert "1 of 1" not in text.partition("## Within")[0]
    far = {
        name: f"{5 * np.mean(several[0]['target_random_distances']):z.0f} cm"
        for name, several in one.items()
    }
    assert (
        f"**joint inference**: after 2 trials the gait swims {far['joint']} from random poses; the "
        f"old gait swims {far['undamaged']}, one gait for any damage {far['randomised']}, and that "
        f"of the oracle, true body, {far['oracle']}."
    ) in text
