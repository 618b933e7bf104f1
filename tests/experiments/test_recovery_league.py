"""The league at its smallest: the same episodes for all, and a file that says who made what."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym.damage import Damage
from aquafish_gym.utils.storage import read_document
from experiments.league.command import SCHEMA, League
from experiments.league.entrants import ENTRANTS
from experiments.league.episodes import HELD_OUT, TIERS, UNKNOWN, Episode, play
from experiments.league.statistics import HORIZON, after_onset, interval, recovered, summary
from tests.in_process import jobs_in_process


def result(paces: list[float], onset: int = 50, **more: Any) -> dict[str, Any]:
    """Return an episode of 300 actions; its paces, units/s, share the time after the onset."""
    steps = np.repeat(paces, -(-(300 - onset) // len(paces)))[: 300 - onset]
    way = np.concatenate([np.zeros(onset + 1), 0.2 * np.cumsum(steps)])
    seconds = {"cpu": 1.0, "slowest": 0.1}
    return {
        "onsets": [onset], "way": way.tolist(), "events": [], "terminated": False,
        "seconds": seconds, **more,
    }  # fmt: skip


@jobs_in_process()
def test_a_league_of_one_episode(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    League(
        out=tmp_path, entrants=("still", "PPO, fins"), tiers=("severe",), episodes=1, workers=1
    ).execute()
    league = read_document(tmp_path / "league.json", SCHEMA)
    assert set(league) == {"still", "PPO, fins"}
    still, ppo = (league[name]["severe"]["way_after_onset"][0] for name in league)
    assert still < 1.0 < ppo
    assert (tmp_path / "pace.png").stat().st_size > 10_000
    assert "| still | - | - |" in (tmp_path / "gain.md").read_text()
    assert "PPO, fins" in capsys.readouterr().out


def test_the_script_and_its_workers_run_from_any_folder(tmp_path: Path) -> None:
    script = Path(__file__).parents[2] / "examples" / "recovery_league.py"
    options = "--entrants still --tiers none --episodes 2 --workers 2 --out league"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run(
        [sys.executable, script, *options.split()],
        cwd=tmp_path, env=environment, check=True, timeout=300,
    )  # fmt: skip
    rows = (tmp_path / "league" / "table.md").read_text().splitlines()
    assert rows[2].startswith("| still |")


def test_an_episode_breaks_at_the_same_time_for_all() -> None:
    one, other = (play(Episode(name, "mild", 3, 0.0)) for name in ("still", "PPO, fins"))
    assert one["onsets"] == other["onsets"]
    assert one["onsets"][0] > 70
    assert len(one["way"]) == 301


def test_the_league_tells_the_gain_of_the_self_model_over_each_entrant() -> None:
    ways = {"self-model": [result([1.0]), result([0.9])], "blind": [result([0.5]), result([0.8])]}
    hero = ways["self-model"]
    league = {name: {"mild": summary(ways[name], 1, hero, hero)} for name in ways}
    rows = League(entrants=tuple(ways), tiers=("mild",))._gains(league)
    gain = np.mean(
        [after_onset(h) - after_onset(b) for h, b in zip(hero, ways["blind"], strict=True)]
    )
    assert rows[0] == ["entrant", "self-model's gain, mild", "successes, mild"]
    assert rows[1] == ["self-model", "-", "2 of 2"]
    assert rows[2][1].startswith(f"{gain:.2f} [")
    assert rows[2][2] == "1 of 2"


def test_blind_refines_the_whole_robots_gait_and_never_looks_for_damage() -> None:
    env = gym.make("AquaFishRecovery-v0", damage="caudal:missing@15", engine="numba")
    events: dict[str, list[str]] = {}
    swum: dict[str, list[Any]] = {}
    for name in ("blind", "self-model"):
        observation, info = env.reset(seed=1)
        agent: Any = ENTRANTS[name].make(generations=10, refinements=1)
        agent.begin(info["fin_angles"])
        swum[name] = []
        for _ in range(90):
            swum[name].append(agent.act(observation))
            observation, *_ = env.step(swum[name][-1])
        events[name] = [event.what for event in agent.events]
    assert events["blind"] == ["chose", "refined"]
    assert events["self-model"][:4] == ["chose", "refined", "alarm", "inferred"]
    np.testing.assert_array_equal(swum["blind"][:75], swum["self-model"][:75])


def test_a_gyroscope_alone_observes_nothing_else() -> None:
    damage = Episode("still", "held-out", 3, sensing="gyroscope").damage
    assert "north_z:dropped; right_pectoral:length=0.27@18.0" in damage
    assert damage.count("dropped") == 6


def test_held_out_damages_are_frozen_and_can_be_simulated() -> None:
    assert len(set(HELD_OUT)) == len(HELD_OUT) == 26
    assert set(UNKNOWN) < set(TIERS["held-out"])
    for text in HELD_OUT:
        assert not any(fault.is_random for fault in Damage.parse(text))
        assert min(fault.span[0] for fault in Damage.parse(text)) >= 15.0


def test_recovery_is_when_the_pace_stays_above() -> None:
    steady, slump = result([1.0]), result([1.0, 1.0, 0.0, 0.0, 0.0])
    assert recovered(steady["way"], 50, 0.9) == 0.0
    late = result([0.0, 1.0, 1.0, 1.0, 1.0])
    assert 9.0 < recovered(late["way"], 50, 0.9) <= 10.0
    assert recovered(slump["way"], 50, 0.9) == HORIZON


def test_the_summary_compares_with_the_oracle_episode_by_episode() -> None:
    oracle = [result([1.0]), result([0.8])]
    mine = [result([0.5]), result([0.1], events=[(3.0, "alarm", "")])]
    found = summary(mine, 1, oracle, None)
    lost = [after_onset(o) - after_onset(m) for o, m in zip(oracle, mine, strict=True)]
    assert found["lost"][0] == pytest.approx(np.mean(lost))
    assert found["failures"] == 1
    assert (found["successes"], found["compared"]) == (0, 2)
    assert summary(oracle, 1, oracle, None)["successes"] == 2
    assert found["false_alarms"] == 1
    assert found["seconds_to"]["50%"]["mean"] == HORIZON / 2
    assert "hero_gain" not in found


def test_the_bootstrap_draws_within_each_damage() -> None:
    # Two damages that differ, without any spread within: the interval has no width.
    values = [1.0, 5.0] * 10
    middle, low, high = interval(values, 2)
    assert low == middle == high
    _, low, high = interval(values, 1)
    assert low < high
