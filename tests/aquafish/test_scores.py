"""Reference scores: same episodes for all, a table of any rows, nothing done twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aquafish.cli import main
from aquafish.scores.command import FIRST_SEED, iqm, kept
from aquafish.scores.entries import ENTRIES
from aquafish.scores.play import COLUMNS, damage_of, play
from aquafish_gym import IDS
from aquafish_gym.runs.storage import read_document

ARGUMENTS = ["scores", "--seeds", "2", "--shorter", "1000", "--episodes", "3", "--workers", "1"]


def test_a_row_is_made_once_and_the_table_has_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = ["--entries", "zero", "CPG", "--tasks", "forward", "--out", str(tmp_path)]
    assert main([*ARGUMENTS, *rows]) == 0
    head, _, *lines = (tmp_path / "table.md").read_text().splitlines()
    assert head == (
        "| environment | controller | hears | whole | mild | moderate | severe | CPU s |"
    )
    assert [line.split(" | ")[:2] for line in lines] == [
        [f"| {name}", entry]
        for name in ("AquaFish-v0", "AquaFishRecovery-v0")
        for entry in ("zero", "CPG")
    ]
    made = tmp_path / "runs" / "forward" / "CPG"
    assert sorted(file.name for file in made.iterdir()) == [
        f"{FIRST_SEED}.json", f"{FIRST_SEED + 1}.json"
    ]  # fmt: skip
    before = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.json")}
    assert main([*ARGUMENTS, *rows]) == 0
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.json")} == before
    capsys.readouterr()
    result = read_document(made / f"{FIRST_SEED}.json", "aquafish.result/1", "out")
    assert result["controller"]["interval"] == 20
    assert set(result["scores"]["AquaFish-v0"]) == set(COLUMNS)


def test_episodes_are_the_same_for_all_and_repeat() -> None:
    entry = ENTRIES["tail only"]
    one = play("AquaFishRecovery-v0", lambda fins: entry.player(None, fins), 4)
    assert one == play("AquaFishRecovery-v0", lambda fins: entry.player(None, fins), 4)
    assert len({*one["whole"]["returns"]}) == 4
    assert one["whole"]["returns"] != one["severe"]["returns"]
    for tier in COLUMNS[1:]:
        assert len(one[tier]["after"]) == len(one[tier]["twin"]) == 4
    # What has no damage moves as its twin: a noisy gyroscope does not matter to who hears nothing.
    assert "after" not in one["whole"]
    seen = []
    play("AquaFish-v0", lambda fins: seen.append(fins) or entry.player(None, fins), 4)  # type: ignore[func-returns-value]
    for fins in seen:
        np.testing.assert_array_equal(fins, seen[0])


def test_damage_strikes_when_the_id_says() -> None:
    assert damage_of("AquaFish-v0", "severe") == "random:severe"
    assert damage_of("AquaFish-v0", "whole") == "none"
    onset = IDS["AquaFishRecovery-v0"]["damage"].partition("@")[2]
    assert damage_of("AquaFishRecovery-v0", "mild") == f"random:mild@{onset}"


def test_interquartile_means_have_intervals() -> None:
    rng = np.random.default_rng(1)
    runs = [rng.normal(3.0, 1.0, 100) for _ in range(5)]
    middle, low, high = iqm(runs)
    assert low < middle < high
    assert middle == pytest.approx(3.0, abs=0.2)
    assert iqm([[5.0] * 4])[1:] == (5.0, 5.0)
    assert kept([{"after": [1.0, 2.0], "twin": [3.0, 3.0]}]) == 0.5
    assert kept([{"after": [1.0], "twin": [0.5]}]) is None


def test_every_controller_can_be_made() -> None:
    pytest.importorskip("stable_baselines3")
    for name in ("PPO, damaged, 8 frames", "SAC, fins"):
        controller = ENTRIES[name].make("forward", 0, 10**6, lambda _text, _share: None)
        assert controller is not None
        assert controller.memory is ("frames" in name)


def test_unknown_rows_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*ARGUMENTS, "--entries", "PPO, fin", "--out", str(tmp_path)]) == 2
    assert "did you mean 'PPO, fins'" in capsys.readouterr().err
