"""Reference scores: same episodes for all, a table of any rows, nothing done twice."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquafish.cli import main
from aquafish.scores.command import FIRST_SEED, iqm, share
from aquafish.scores.entries import ENTRIES
from aquafish.scores.play import COLUMNS, damage_of, play, play_one, what_is_left
from aquafish.scores.recurrent import RecurrentConfig, learn_recurrent
from aquafish_gym import IDS
from aquafish_gym.runs.storage import read_document
from gait.controller import Controller
from gait.inputs import inputs, reckoned

ARGUMENTS = ["scores", "--seeds", "2", "--shorter", "10000", "--episodes", "3", "--workers", "1"]


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
        for name in ("AquaFish-v0", "AquaFishRecovery-v0", "AquaFishRecovery-v0, after the onset")
        for entry in ("zero", "CPG")
    ]
    for picture in ("scores.png", "curves.png"):
        assert (tmp_path / picture).stat().st_size > 10_000
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
    assert [generation for generation, _ in result["curve"]] == [1, 2, 3, 4]


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
    assert share([[1.0, 2.0], [3.0, 6.0]], [4.0, 4.0]) == "75%"
    assert share([[1.0]], [0.5]) == "-"


def test_a_learned_controller_can_be_made() -> None:
    pytest.importorskip("stable_baselines3")
    entry = ENTRIES["PPO, damaged, 8 frames"]
    controller, curve = entry.make("forward", 0, 10**6, lambda _text, _share: None)
    assert isinstance(controller, Controller)
    assert controller.memory
    ((steps, earned),) = curve
    assert steps == 256 * 100
    assert np.isfinite(earned)


def test_a_recurrent_policy_is_the_librarys_to_rounding() -> None:
    contrib = pytest.importorskip("sb3_contrib")
    kept: dict[str, Any] = {}
    make = contrib.RecurrentPPO

    class Kept(make):  # type: ignore[misc, valid-type]
        def learn(self, *args: Any, **kwargs: Any) -> Any:
            kept["model"] = self
            return super().learn(*args, **kwargs)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(contrib, "RecurrentPPO", Kept)
        made, curve = learn_recurrent(
            RecurrentConfig(steps=1, horizon=4, epochs=1), "waypoint", 0, "none", lambda *_: None
        )
    assert curve == []  # no episode has ended
    model, rng = kept["model"], np.random.default_rng(0)
    fins = rng.uniform(-3.0, 3.0, (2, 3))
    player, turned, state, first = made.player(fins), fins, None, np.ones(2, np.bool_)
    for step in range(5):
        seen = rng.normal(size=(2, 12)).astype(np.float32)
        times = np.full(2, step * made.dt)
        heard = model.get_env().normalize_obs(inputs(made.senses, made.clock, seen, times, turned))
        theirs, state = model.predict(heard, state, first, deterministic=True)
        first, ours = np.zeros(2, np.bool_), player.act(seen, times)
        np.testing.assert_allclose(ours, theirs, atol=1e-5)
        turned = reckoned(turned, ours, made.dt)
    assert np.ptp(ours) > 0.0
    assert made.to_dict()["shapes"]["w_back"] == [128, 32]


def test_the_oracle_has_a_gait_for_what_is_left(tmp_path: Path) -> None:
    name, tier = "AquaFishRecovery-v0", "severe"
    left = what_is_left(name, tier, 0)
    assert any(np.any(left[key] != what_is_left(name, tier, 1)[key]) for key in left)
    # The same episodes as everybody's.
    tail = ENTRIES["tail only"]
    ways = play(name, lambda fins: tail.player(None, fins), 2)[tier]["after"]
    make = lambda fins: tail.player(None, fins)  # noqa: E731
    alone = [play_one(name, tier, make, make, i) for i in range(2)]
    np.testing.assert_allclose(alone, ways)
    rows = ["--entries", "tail only", "oracle", "--tasks", "forward", "--out", str(tmp_path)]
    assert main([*ARGUMENTS[:-4], "--episodes", "1", *rows]) == 0
    *_, last = (tmp_path / "table.md").read_text().splitlines()
    assert last.startswith("| AquaFishRecovery-v0, after the onset | oracle | what is left of the")
    assert len(list((tmp_path / "runs" / "forward" / "oracle").iterdir())) == 3


def test_unknown_rows_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*ARGUMENTS, "--entries", "PPO, fin", "--out", str(tmp_path)]) == 2
    assert "did you mean 'PPO, fins'" in capsys.readouterr().err
    for rows, said in (((), "got none"), (("zero", "zero"), "got zero, zero")):
        assert main([*ARGUMENTS, "--entries", *rows, "--out", str(tmp_path)]) == 2
        assert f"each named once; {said}" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_what_is_missing_to_learn_is_said_before_anything_is_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    assert main([*ARGUMENTS, "--entries", "zero", "PPO", "--out", str(tmp_path)]) != 0
    assert "[rl]" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
