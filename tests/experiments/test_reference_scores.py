"""Reference scores: the same episodes for all, a table of any rows, nothing done twice."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aquafish_gym import IDS, WorldConfig
from aquafish_gym.damage import TIERS, Damage
from aquafish_gym.plans import TAIL_FISH
from aquafish_gym.utils.storage import read_document
from aquafish_gym.utils.validation import InvalidArgumentError, MissingExtraError
from experiments.scores.command import FIRST_SEED, Scores, share
from experiments.scores.entries import ENTRIES
from experiments.scores.episodes import COLUMNS, damages_of, play, swim_to_onset
from gait import Controller, scores
from tests.in_process import jobs_in_process
from tests.pictures import is_drawn

COMMITTED = Path(__file__).parents[2] / "experiments" / "scores" / "results" / "runs"


def small(out: Path, *entries: str, episodes: int = 3) -> Scores:
    return Scores(
        out, entries=entries, tasks=("forward",), replicates=2, episodes=episodes,
        budget_divisor=10_000, workers=1,
    )  # fmt: skip


def test_a_committed_controller_has_its_committed_scores() -> None:
    # Another rounding, of processors or of single precision, decides where a few robots are after
    # 100 s. The scores were made when damage was drawn in the episode: its noise then was another.
    name = "AquaFishRecovery-v0"
    kept = json.loads((COMMITTED / "forward" / "CMA-ES--fins" / "100.json").read_text())
    found = play(name, Controller.from_dict(kept["controller"]))
    for column, kept_scores in kept["scores"][name].items():
        same = ["noise" not in damage for damage in damages_of(name, column, range(100))]
        assert sum(same) >= 85
        for what, values in kept_scores.items():
            expected = np.array(values)[same]
            now = np.array(found[column][what])[same]
            # Robots that tumble, as most of the severely damaged do, are chaotic.
            alike = np.isclose(now, expected, rtol=1e-3, atol=1e-3).mean()
            assert alike >= (0.6 if column == "severe" and what != "twin" else 0.95)
            assert now.mean() == pytest.approx(expected.mean(), rel=0.02)


@jobs_in_process()
def test_a_row_is_made_once_and_the_table_has_it(tmp_path: Path) -> None:
    command = small(tmp_path, "zero", "CPG")
    command.execute()
    for file, names in (
        ("table", ("AquaFish-v0", "AquaFishRecovery-v0", "AquaFishRecovery-v0, after the onset")),
        ("return", ("AquaFishReturn-v0", "AquaFishReturn-v0, success")),
    ):
        _, _, *lines = (tmp_path / f"{file}.md").read_text().splitlines()
        assert [line.split(" | ")[:2] for line in lines] == [
            [f"| {name}", entry] for name in names for entry in ("zero", "CPG")
        ]
    for picture in ("scores.png", "curves.png"):
        assert is_drawn(tmp_path / picture)
    made = tmp_path / "runs" / "forward" / "CPG" / f"{FIRST_SEED}.json"
    before = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.json")}
    command.execute()
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.json")} == before
    result = read_document(made, "aquafish.result/1", "out")
    assert set(result["scores"]["AquaFish-v0"]) == set(COLUMNS)


@pytest.mark.slow
@jobs_in_process()
def test_controllers_of_an_earlier_run_play_again(tmp_path: Path) -> None:
    """An entry without a file there is left out."""
    Scores(
        tmp_path, entries=("zero", "PPO, fins", "PPO, damaged"), tasks=("forward",), replicates=1,
        episodes=3, controllers=COMMITTED.parent, workers=1,
    ).execute()  # fmt: skip
    rows = (tmp_path / "return.md").read_text().splitlines()
    success = [row for row in rows if row.startswith("| AquaFishReturn-v0, success |")]
    assert success == [
        "| AquaFishReturn-v0, success | zero | nothing "
        + 4 * "| 0% [0%, 56%] " + "|",
        *(row for row in success[1:] if "PPO, fins" in row),
    ]  # fmt: skip
    assert len(success) == 2
    assert "| 100% [44%, 100%] |" in success[1]
    assert not any("PPO, damaged" in row for row in rows)


def test_damage_strikes_at_the_onset_of_the_id() -> None:
    for name in IDS:
        assert damages_of(name, "whole", [0, 1]) == ["none", "none"]
        for tier in TIERS:
            damages = [Damage.parse(one) for one in damages_of(name, tier, range(100))]
            early, late = (15.0, 30.0) if "damage" in IDS[name] else (0.0, 0.0)
            assert all(early <= fault.span[0] <= late for one in damages for fault in one)
            assert len({str(one) for one in damages}) > 80
    with pytest.raises(InvalidArgumentError, match="episodes"):
        Scores(episodes=101).jobs()


@jobs_in_process()
def test_other_fish_have_rows_of_their_own(tmp_path: Path) -> None:
    command = replace(
        small(tmp_path, "still", "tail only", "CPG", episodes=2), tasks=("tail-fish",)
    )
    replace(command, replicates=1).execute()
    rows = [line.split(" | ") for line in (tmp_path / "table.md").read_text().splitlines()[2:]]
    still, tail, cpg = ({"name": row[0], "whole": float(row[3].split()[0])} for row in rows)
    assert still == {"name": "| TailFish-v0", "whole": 0.0}
    assert tail["whole"] > 100.0  # in water with added mass, over twenty seconds
    gait = read_document(next(tmp_path.rglob("CPG/*.json")), "aquafish.result/1", "out")
    assert Controller.from_dict(gait["controller"]).plan == TAIL_FISH
    assert cpg["name"] == still["name"]


def test_a_share_is_of_the_mean_distance() -> None:
    assert share([[1.0, 2.0], [3.0, 6.0]], [4.0, 4.0]) == "75%"
    assert share([[1.0]], [0.5]) == "-"


@pytest.mark.slow
def test_a_learned_controller_can_be_made() -> None:
    pytest.importorskip("stable_baselines3")
    entry = ENTRIES["PPO, damaged"]
    controller, curve = entry.make("forward", 0, 10**6)
    assert controller is not None
    assert controller.senses.fins
    assert np.isfinite(curve[-1][1])


@jobs_in_process()
def test_the_oracle_plays_the_same_episodes(tmp_path: Path) -> None:
    name, tier = "AquaFishRecovery-v0", "severe"
    gait, _ = ENTRIES["CPG"].make("forward", 0, 10_000)
    assert gait is not None
    one, other = (swim_to_onset(name, tier, gait, episode) for episode in (0, 1))
    assert (one.info["morphology"] != other.info["morphology"]).any()
    assert one.swim_on(gait) == one.swim_on(gait)
    after = play(name, gait, 1)[tier]["after"]
    assert np.isfinite([one.swim_on(gait), *after]).all()
    world = WorldConfig(servo_gain=one.info["servo_gain"])
    options = {"seconds": one.seconds, "world": world, "start": one.state}
    far = scores([gait], one.info["morphology"], **options)[0, 0]
    assert one.swim_on(gait) == pytest.approx(far, abs=0.1)  # and 0.2 s before the onset
    small(tmp_path, "tail only", "oracle", episodes=1).execute()
    *_, last = (tmp_path / "table.md").read_text().splitlines()
    assert last.startswith("| AquaFishRecovery-v0, after the onset | oracle |")


def test_unknown_rows_and_missing_packages_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InvalidArgumentError, match="did you mean 'PPO, fins'"):
        small(tmp_path, "PPO, fin").execute()
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(MissingExtraError):
        small(tmp_path, "zero", "PPO").execute()
    assert not list(tmp_path.iterdir())
