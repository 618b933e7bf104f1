"""The league at its smallest: the same episodes for all, and a file that says who made what."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aquafish_gym.runs.storage import read_document
from recovery_league import SCHEMA, Episode, League, _recovered, play


def test_a_league_of_one_episode(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    League(
        out=tmp_path, entrants=("still", "PPO, fins"), tiers=("severe",), episodes=1, workers=1
    ).execute()
    league = read_document(tmp_path / "league.json", SCHEMA)
    assert set(league) == {"still", "PPO, fins"}
    still, ppo = (league[name]["severe"]["way_after_onset"][0] for name in league)
    assert still < 1.0 < ppo
    assert (tmp_path / "pace.png").stat().st_size > 10_000
    assert "PPO, fins" in capsys.readouterr().out


def test_an_episode_breaks_at_the_same_time_for_all() -> None:
    one, other = (play(Episode(name, "mild", 3, 0.0, "still")) for name in ("still", "PPO, fins"))
    assert one["onset"] == other["onset"] > 70
    assert len(one["way"]) == 301


def test_recovery_is_when_the_pace_stays_above() -> None:
    oracle = np.arange(201.0).tolist()
    slow = np.concatenate([np.zeros(50), np.arange(151.0)]).tolist()
    assert _recovered(oracle, oracle, 0, 0.9) == 0.0
    assert 0.2 * 20 < _recovered(slow, oracle, 0, 0.9) <= 0.2 * 51
