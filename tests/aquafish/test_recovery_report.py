"""The report and the page of the case study follow from the outcomes alone."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from aquafish.recovery import figures
from aquafish.recovery.command import REPORT_SCHEMA, CaseStudy
from aquafish.recovery.report import build_report, shown_replicate, to_markdown
from aquafish_gym import Damage, Morphology
from aquafish_gym.utils.storage import encode_document

COMMITTED = Path(__file__).parents[2] / "docs" / "recovery"


@pytest.fixture(scope="module")
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


def test_the_figure_of_several_replicates_shows_each_and_their_mean(report: dict[str, Any]) -> None:
    outcomes = report["replicates"]
    axes = figures.distances_figure(outcomes).axes[0]
    assert axes.get_figure().get_supxlabel().endswith("; 10 replicates")
    means = [
        5.0 * np.mean([one["target_random_distances"] for one in several])
        for several in outcomes.values()
    ]
    shown = [text.get_text() for text in axes.texts]
    assert shown == [f"{mean:z.0f} cm" for mean in means]
    each = [line for line in axes.lines if len(line.get_xdata()) == 10]
    np.testing.assert_allclose([np.mean(line.get_xdata()) for line in each], means)


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


@pytest.mark.parametrize(
    ("gains", "shown"), [([3.0], 0), ([1.0, 9.0, 2.0], 2), ([4.0, 3.0, 2.0, 1.0], 2), ([1, 1], 0)]
)
def test_the_shown_replicate_has_the_median_gain(gains: list[float], shown: int) -> None:
    outcomes: dict[str, list[dict[str, Any]]] = {
        "joint-fins": [{"target_distance": 10 + gain} for gain in gains],
        "undamaged": [{"target_distance": 10.0} for _ in gains],
    }
    assert shown_replicate(outcomes) == shown


def test_the_commands_on_the_page_name_what_differs_from_the_defaults() -> None:
    study = CaseStudy(held_out=True, format=("svg", "pdf"), film=False, seed=3, out=Path("x"))
    recover, film = study._commands(study.treatments()[0])
    assert recover == "aquafish recover --held-out --seed 3 --format svg pdf --no-film"
    assert film == (
        "aquafish film seed-003/undamaged/controller.json seed-003/undamaged/controller.json "
        "seed-003/joint-fins/controller.json --morphology seed-003/undamaged/morphology.json "
        "--damage none right_pectoral:width=0.4 right_pectoral:width=0.4 "
        "--label healthy 'damaged, old gait' 'damaged, new gait' --html swim.html"
    )
