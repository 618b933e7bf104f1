"""The reality-gap suite, small: what its worlds change, what its report counts, and a run."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aquafish_gym.utils.storage import read_document
from experiments.reality_gap.command import Gap
from experiments.reality_gap.job import ORACLE, GapJob, Settings
from experiments.reality_gap.report import build_report, results, to_markdown
from experiments.reality_gap.worlds import WORLDS, gap_of
from tests.in_process import jobs_in_process
from tests.pictures import is_drawn

SETTINGS = Gap()._settings()


def test_each_world_changes_only_what_it_names() -> None:
    changes = {world: set(gap_of(world, 5).changes) for world in WORLDS}
    assert changes.pop("plain") == set()
    assert all("gyro_noise" in names for names in changes.values())
    named = {
        "drag": {"drag"}, "reactive": {"reactive"}, "servo": {"servo_gain"},
        "current": {"current"}, "bias": {"gyro_bias"}, "lag": {"lag"}, "substeps-8": {"substeps"},
        "seized": {"servo_gain"},
        "everything": {"drag", "servo_gain", "current", "gyro_bias"},
    }  # fmt: skip
    for world, names in changes.items():
        assert names - {"gyro_noise"} == named.get(world, set())


def test_all_methods_and_worlds_have_the_same_hidden_angles() -> None:
    command, hidden = np.array([0.4, -0.3, 0.8]), []
    for world, method in (("plain", "none"), ("plain", "joint"), ("everything", "joint")):
        target = GapJob(world, method, 4, SETTINGS).begin()._target
        for _ in range(2):
            target.perform(command)
        hidden.append(target.start_angles.tolist())
    assert hidden[0] == hidden[1] == hidden[2]


def outcome(world: str, method: str, seed: int, gait: list[float]) -> dict[str, object]:
    found = {
        "world": world, "method": method, "seed": seed, "damage": "caudal:missing",
        "gap": "nothing", "gaits": {"body": gait},
    }  # fmt: skip
    if method != ORACLE:
        found |= {
            "objective_fitness": [0.7, 0.6 + 0.01 * seed], "model_fitness": [0.5, 0.6],
            "trials": [100, 200], "seconds": [1.0, 4.0],
        }  # fmt: skip
    return found


def test_a_share_needs_an_oracle_that_swims() -> None:
    outcomes = [outcome("plain", ORACLE, s, [8.0, 12.0 + s]) for s in range(6)]
    outcomes += [outcome("plain", "none", s, [4.0, 6.0]) for s in range(6)]
    outcomes += [outcome("lag", ORACLE, s, [-2.0 + 5.0 * (s == 3)]) for s in range(6)]
    outcomes += [outcome("lag", "none", s, [-1.0]) for s in range(6)]
    report = build_report(results(outcomes), {}, [])
    rows = {(row["world"], row["method"]): row for row in report["summary"]}
    none = rows["plain", "none"]
    assert none["obj_fit"]["mean"] == pytest.approx(0.625)
    low, high = none["obj_fit"]["interval"]
    assert 0.6 <= low < 0.625 < high <= 0.65
    assert none["share"]["mean"] == pytest.approx(5.0 / 11.25)
    assert "share" not in rows["lag", "none"]
    text = to_markdown(report, SETTINGS, [])
    assert "| none | 6 | 0.625 [0.607, 0.643] |" in text


@pytest.mark.slow
@jobs_in_process()
def test_a_small_suite_is_reported_and_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def settings(self: Gap) -> Settings:
        """Fit no fault: those of such short trials would be most of the work."""
        found = whole(self)
        return replace(found, joint=replace(found.joint, alternatives="never"))

    whole = Gap._settings
    monkeypatch.setattr(Gap, "_settings", settings)
    small = Gap(
        out=tmp_path, worlds=("plain",), methods=("none", "joint"), replicates=1, rounds=2,
        steps=64, generations=2, population=10, gait_poses=1, bodies=3, poses=2, seconds=1.0,
        smoke=True, workers=1,
    )  # fmt: skip
    small.execute()
    with (tmp_path / "results.csv").open() as file:
        rows = {row["method"]: row for row in csv.DictReader(file)}
    assert set(rows) == {"none", "joint", ORACLE}
    assert 0.0 < float(rows["joint"]["obj_fit"]) <= 1.0
    report = read_document(tmp_path / "report.json", "aquafish.gap/1")
    assert [row["method"] for row in report["summary"]] == ["none", "joint", ORACLE]
    assert "covered" in report["summary"][1]
    assert "CPU s, joint" in (tmp_path / "times.md").read_text()
    for name in ("progress", "times", "obj_fit", "coverage"):
        assert is_drawn(tmp_path / f"{name}.png")
    before = {file: file.stat().st_mtime_ns for file in tmp_path.glob("runs/*/*/*.json")}
    small.execute()
    assert {file: file.stat().st_mtime_ns for file in before} == before
    assert json.loads((tmp_path / "settings.json").read_text())["settings"]["poses"] == 2
