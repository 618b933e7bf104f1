"""The league at its smallest: the same episodes for all, and a file that says who made what."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym import held_out
from aquafish_gym.damage import Chance, Damage, Tier, faults
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.engines.worlds import World, make_world
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.storage import read_document
from aquafish_gym.utils.validation import InvalidArgumentError
from experiments.league import draws
from experiments.league.command import SCHEMA, League
from experiments.league.draws import OUTSIDE, beginning_current
from experiments.league.entrants import ENTRANTS, USUAL
from experiments.league.episodes import (
    SEEDS,
    TIERS,
    Episode,
    Task,
    damage_of,
    episode_numbers,
    play,
)
from experiments.league.statistics import (
    HORIZON,
    after_onset,
    interval,
    paired,
    recognition,
    recovered,
    share,
    summary,
)
from experiments.league.waters import VORTEX_SPEED, VORTEX_WIDTH, WATERS, DenseWorld, vortices_at
from experiments.league.whole import WholeLeague
from gait.swims.evaluation import success_rate
from tests.in_process import jobs_in_process
from tests.pictures import is_drawn

FISH = "four-fins"


def result(paces: list[float], onset: int = 50, **more: Any) -> dict[str, Any]:
    """Return an episode of 300 actions; its paces, units/s, share the time after the onset."""
    steps = np.repeat(paces, -(-(300 - onset) // len(paces)))[: 300 - onset]
    way = np.concatenate([np.zeros(onset + 1), 0.2 * np.cumsum(steps)])
    seconds = {"cpu": 1.0, "slowest": 0.1}
    return {
        "onsets": [onset], "way": way.tolist(), "events": [], "diverged": False,
        "seconds": seconds, **more,
    }  # fmt: skip


@jobs_in_process()
def test_a_league_of_one_episode(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = League(
        out=tmp_path, entrants=("still", "PPO, fins"), tiers=("severe",), episodes=1, workers=1
    )
    command.execute()
    assert command.cpu_left() == (0, 0.0)
    with pytest.raises(InvalidArgumentError, match="seeds"):  # a folder holds one set
        replace(command, seeds="development").execute()
    league = read_document(tmp_path / "league.json", SCHEMA)
    assert set(league) == {"still", "PPO, fins"}
    still, ppo = (league[name]["severe"]["way_after_onset"][0] for name in league)
    assert still < 1.0 < ppo
    assert is_drawn(tmp_path / "pace.png")
    assert "| still | - | - |" in (tmp_path / "gain.md").read_text()
    assert "PPO, fins" in capsys.readouterr().out


def test_other_fish_play_their_own_held_out_damages() -> None:
    league = League(entrants=("blind", "self-model"), tiers=("severe",), episodes=2, plan=FISH)
    severe = held_out(f"{FISH} severe@15-30", [0, 1])
    wanted = [f"gyro:noise=0.01; {damage}" for damage in severe]
    assert [job.damage for job in league.jobs()[::2]] == wanted
    for wrong in ({"entrants": ("RMA",)}, {"tiers": ("three faults",)}, {"tiers": ("held-out",)}):
        with pytest.raises(InvalidArgumentError, match=f"{next(iter(wrong))} of the plan {FISH}"):
            replace(league, **wrong).jobs()  # type: ignore[arg-type]


@pytest.mark.slow
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


def test_a_paired_gain_is_the_mean_of_differences_with_its_interval() -> None:
    mine = [result([pace]) for pace in (1.0, 0.5, 0.8, 0.3)]
    other = [result([pace]) for pace in (0.5, 0.6, 0.8, 0.2)]
    found = paired(mine, other, 1)
    mean, low, high = found["mean"]
    gains = [after_onset(a) - after_onset(b) for a, b in zip(mine, other, strict=True)]
    assert mean == pytest.approx(np.mean(gains))
    assert (found["mean"], found["worse"], found["episodes"]) == (interval(gains, 1, 0.0), 1, 4)
    assert low < mean < high
    ways = {"self-model": mine, "blind": other}
    league = {
        name: {"mild": summary(way, 1, {n: w for n, w in ways.items() if n != name}, mine)}
        for name, way in ways.items()
    }
    command = League(entrants=tuple(ways), tiers=("mild",))
    _, hero, blind = command._gains(league)
    assert hero == ["self-model", "-", "4 of 4"]
    assert blind[1].startswith(f"{mean:.2f} [")
    _, hero, blind = command._over_blind(league)
    assert hero[1].startswith(f"{mean:.2f} [")
    assert hero[2] == "1 of 4"
    assert blind == ["blind", "-", "-"]


def test_what_agents_of_the_league_do_when_a_fin_is_lost() -> None:
    """Blind refines the whole robot's gait, and never looks for damage; the oracle is told."""
    env = gym.make("AquaFishRecovery-v0", damage="caudal:missing@15", engine="numba")
    events: dict[str, list[Any]] = {}
    swum: dict[str, list[Any]] = {}
    for name in ("blind", "self-model", "oracle"):
        observation, info = env.reset(seed=1)
        agent: Any = ENTRANTS[name].make(generations=2, refinements=1)
        agent.begin(info["fin_angles"])
        swum[name] = []
        for step in range(90):
            if name == "oracle" and step == 75:
                agent.learn(info)
            swum[name].append(agent.act(observation))
            observation, *_, info = env.step(swum[name][-1])
        events[name] = [(event.what, event.seconds) for event in agent.events]
    said = {name: [what for what, _ in found] for name, found in events.items()}
    assert said["blind"] == ["chose", "refined"]
    assert said["self-model"][:4] == ["chose", "refined", "alarm", "inferred"]
    np.testing.assert_array_equal(swum["blind"][:75], swum["self-model"][:75])
    refined = [seconds for what, seconds in events["oracle"] if what == "refined"]
    assert len(refined) == 2
    assert refined[0] < 15.0 <= refined[1]


@pytest.mark.parametrize("tier", TIERS)
def test_no_change_of_random_damage_changes_an_episode(
    tier: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the development's, each draws."""
    numbers = (7, 120_041)
    tasks: tuple[Task, ...] = ("recovery", "return")
    before = [damage_of(tier, number, task) for number in numbers for task in tasks]
    assert "random" not in "".join(before)
    for name in ("severe", "moderate", "mild"):
        monkeypatch.setitem(faults.TIERS, name, Tier(1, (Chance("seized", 1.0),)))
    monkeypatch.setattr(draws, "ONSETS", (1.0, 2.0))
    assert [damage_of(tier, number, task) for number in numbers for task in tasks] == before
    severe = damage_of("severe", 60_000)
    assert severe == "random:severe@15-30"


def test_recovery_is_when_the_pace_stays_above() -> None:
    steady, slump = result([1.0]), result([1.0, 1.0, 0.0, 0.0, 0.0])
    assert recovered(steady["way"], 50, 0.9) == 0.0
    late = result([0.0, 1.0, 1.0, 1.0, 1.0])
    assert 9.0 < recovered(late["way"], 50, 0.9) <= 10.0
    assert recovered(slump["way"], 50, 0.9) == HORIZON


def test_the_summary_compares_with_the_oracle_episode_by_episode() -> None:
    oracle = [result([1.0]), result([0.8])]
    mine = [result([0.5]), result([0.1], events=[(3.0, "alarm", "")])]
    found = summary(mine, 1, {"oracle": oracle}, oracle)
    lost = [after_onset(m) - after_onset(o) for o, m in zip(oracle, mine, strict=True)]
    assert found["over"]["oracle"]["mean"][0] == pytest.approx(np.mean(lost))
    assert found["failures"] == 1
    assert (found["successes"], found["compared"]) == (0, 2)
    assert summary(oracle, 1, {}, oracle)["successes"] == 2
    assert found["false_alarms"] == 1
    assert found["seconds_to"]["50%"]["mean"] == HORIZON / 2
    assert "success_rate" not in found


def test_a_success_has_a_share_and_its_interval() -> None:
    results = [result([1.0], success=success) for success in (True, True, False, True)]
    blind = [result([1.0], success=success) for success in (False, True, True, False)]
    found = summary(results, 1, {"blind": blind}, None)
    assert found["success_rate"] == success_rate(3, 4)
    assert (found["over"]["blind"]["only_own"], found["over"]["blind"]["only_other"]) == (2, 1)
    rows = League(tiers=("mild",), task="return")._alone({"self-model": {"mild": found}})
    assert rows[1] == ["self-model", "2, 1"]


def test_sets_of_seeds_do_not_meet() -> None:
    numbers = [number for seeds in SEEDS.values() for number in seeds]
    assert len(set(numbers)) == len(numbers)
    assert episode_numbers("development", 2, 3) == [60_002, 60_003, 60_004]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"first": 999, "episodes": 2}, "episodes must be at most 1 from the 999-th"),
        ({"seeds": "held-out", "first": 190}, "120000 to 120199; got 120200"),
        ({"task": "return", "water": "current"}, "water must not be current"),
        ({"task": "return", "seconds": 600.0}, "seconds must"),
        ({"scheduler": "tcp://host:1", "workers": 2}, "workers has no effect with a scheduler"),
    ],
)
def test_what_no_league_can_play_is_refused_before_anything_plays(
    options: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        League(out=tmp_path, tiers=("none", "severe"), **options).execute()
    assert list(tmp_path.iterdir()) == []


def test_held_out_damages_begin_after_the_gait() -> None:
    damages = held_out("league")
    assert len(set(damages)) == len(damages) == 26
    assert Episode("still", "held-out", 28, noise=0.0).damage == damages[2]
    for text in damages:
        assert min(fault.span[0] for fault in Damage.parse(text)) >= 15.0
    gyroscope = Episode("still", "held-out", 3, sensing="gyroscope").damage
    assert "north_z:dropped; right_pectoral:length=0.27@18.0" in gyroscope
    assert gyroscope.count("dropped") == 6


@jobs_in_process()
def test_entrants_return_in_time_or_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    League(
        out=tmp_path, entrants=("still", "PPO, fins"), tiers=("none",), episodes=2,
        seeds="development", task="return", workers=1,
    ).execute()  # fmt: skip
    assert "4 of 4 episodes to play: about 0 CPU minutes" in capsys.readouterr().err
    head, _, still, ppo = (tmp_path / "table.md").read_text().splitlines()
    assert head == "| entrant | success, none | units, none |"
    assert still.startswith("| still | 0% [0%, 66%] | -")
    assert ppo.startswith("| PPO, fins | 100% [34%, 100%] | 2")


@pytest.mark.parametrize("tier", ["three faults", *OUTSIDE])
def test_damage_is_drawn_by_the_episodes_number(tier: str) -> None:
    drawn = [Episode("still", tier, number).damage for number in range(60_000, 60_040)]
    assert len(set(drawn)) == 40
    assert Episode("blind", tier, 60_003).damage == drawn[3]
    whole = Scenario.create()
    for text in drawn:
        damage = Damage.parse(text)
        damage.check_onsets(60.0)
        damage.edit(whole)  # raises if it fits no robot


def test_early_faults_are_those_that_come_later() -> None:
    for number in range(60_000, 60_010):
        early, later = (
            play(Episode("still", tier, number, seconds=60.0)) for tier in ("early", "after 15 s")
        )
        assert 5 <= early["onsets"][0] <= 46
        assert 75 <= later["onsets"][0] <= 81


def test_a_current_begins_in_still_water() -> None:
    still = play(Episode("still", "current begins", 60_001))
    onset = still["onsets"][0]
    begins = beginning_current(Episode("blind", "current begins", 60_001).rng)
    assert onset == np.ceil(begins.onset / 0.2)
    assert tuple(still["flow"]) == begins.flow
    assert 0.1 <= np.linalg.norm(begins.flow) <= 0.2
    way = np.array(still["way"])
    np.testing.assert_allclose(way[: onset + 1], 0.0, atol=1e-3)
    # At first the water passes a robot that holds still; then it is carried along.
    passed = (way[onset + 5] - way[onset]) / -begins.flow[1]
    assert passed == pytest.approx(1.0, abs=0.3)
    assert abs(way[-1] - way[-6]) < 0.6 * abs(way[onset + 5] - way[onset])


def believed(alarms: int = 1, about: str = "the tail is missing", **more: Any) -> dict[str, Any]:
    """Return an episode that breaks at 10 s, is recognised, and changes its gait."""
    events = [[10.2 + k, "alarm", ""] for k in range(alarms)]
    events += [[10.4, "inferred", about], [10.6, "chose", ""], [11.0, "refined", ""]]
    found = {"belief": {"alike": True, "current": []}} | more
    return result([1.0]) | found | {"events": events}


def test_recognition_counts_what_the_agent_knew_and_when() -> None:
    results = [
        believed(),
        believed(alarms=2),
        believed(belief={"alike": False, "current": []}),
        believed(about="up_x gives no readings"),
    ]
    results[0]["events"].insert(0, [9.0, "chose", ""])  # before it broke
    results[2]["events"].append([20.0, "unknown", ""])
    found = recognition(results)
    counts = [found[name] for name in ("episodes", "right", "at_once", "named_fins", "unknown")]
    assert counts == [4, 3, 2, 3, 1]
    assert (found["changed"], found["refined"]) == (pytest.approx(0.6), pytest.approx(1.0))
    begun = [
        believed(flow=[0.1, 0.0, 0.0], belief={"alike": same, "current": current})
        for same, current in (
            (True, [0.12, 0.02, 0.0]), (True, [0.14, 0.0, 0.0]),
            (True, []), (False, [0.1, 0.0, 0.0]),
        )
    ]  # fmt: skip
    assert recognition(begun)["right"] == 1


def test_a_share_of_anothers_pace_has_the_interval_of_the_pairs() -> None:
    others = [result([pace]) for pace in (0.2, 0.4, 0.6, 0.8)]
    mine = [result([0.9 * pace]) for pace in (0.2, 0.4, 0.6, 0.8)]
    assert share(mine, others) == pytest.approx((0.9, 0.9, 0.9))
    middle, low, high = share([result([0.5])] * 4, others)
    assert middle == pytest.approx(1.0)
    assert low < 0.9
    assert high > 1.1


def test_every_usual_entrant_plays_every_water_in_the_same_episodes() -> None:
    leagues = WholeLeague(out=Path("out")).leagues()
    played: dict[str, set[Any]] = {}
    for league in leagues:
        if league.entrants != USUAL:
            continue
        if league.tiers[0] == "severe" and league.sensing == "fins" and league.task == "recovery":
            for job in league.jobs():
                if job.tier == "severe" and job.number < 20:
                    played.setdefault(league.water, set()).add((job.entrant, job.number))
    assert set(played) == set(WATERS)
    assert {frozenset(one) for one in played.values()} == {
        frozenset((entrant, number) for entrant in USUAL for number in range(20))
    }
    assert set(ENTRANTS) - set(USUAL) == {"ceiling"}


@jobs_in_process()
def test_the_whole_league_says_what_is_left_and_compares_the_waters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(ENTRANTS, "blind", replace(ENTRANTS["still"]))
    entrants = ("still", "blind", "PPO, fins")
    tables = ("home", "none", "vortices")
    command = WholeLeague(tmp_path, tables, entrants, "development", first=7, episodes=1)
    for left in (24, 0):
        command.execute()
        assert f"3 tables: {left} of 24 episodes to play" in capsys.readouterr().err
    assert (tmp_path / "home" / "runs" / "blind" / "severe" / "60007.json").exists()
    for tier in ("severe", "none"):
        head, _, still, blind, ppo = (tmp_path / f"waters-{tier}.md").read_text().splitlines()
        assert head == "| entrant | still | vortices |"
        assert still == "| still | 0.00 [0.00, 0.00] | 0.00 [0.00, 0.00] |"
        assert [cell[:4] for cell in blind.split(" | ")[1:]] == ["way "] * 2
        assert ppo.count("[") == 2


@jobs_in_process()
def test_the_whole_league_says_how_far_below_the_ceiling_others_swim(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("blind", "self-model", "oracle"):
        monkeypatch.setitem(ENTRANTS, name, replace(ENTRANTS["still"]))
    monkeypatch.setitem(ENTRANTS, "ceiling", replace(ENTRANTS["PPO, fins"]))
    monkeypatch.setattr(League, "_recognition", lambda *_: [["tier"]])
    WholeLeague(tmp_path, ("ceiling-other",), seeds="development", episodes=2).execute()
    league = read_document(tmp_path / "ceiling-other" / "league.json", SCHEMA)
    head, _, moderate, mild = (tmp_path / "ceiling.md").read_text().splitlines()
    assert head.startswith("| tier | episodes | ceiling, units | blind, below it |")
    mean, low, high = league["ceiling"]["mild"]["over"]["self-model"]["mean"]
    assert mean > 20.0
    way = f"{league['ceiling']['mild']['mean']:.1f}"
    below = f"{mean:.2f} [{low:.2f}, {high:.2f}]"
    assert mild == f"| mild | 2 | {way} |" + f" {below} |" * 3 + " 0.0% |" * 3 + " 2 of 2 |"
    assert moderate.startswith("| moderate | 2 | ")


@pytest.mark.parametrize("water", ["vortices", pytest.param("dense", marks=pytest.mark.slow)])
def test_a_water_of_the_leagues_own_is_another_one_and_repeats(water: Any) -> None:
    home, one, again = (
        play(Episode("PPO, fins", "mild", 60_000, seconds=32.0, water=name))["way"]
        for name in ("still", water, water)
    )
    assert one == again
    assert np.abs(np.subtract(one, home)).max() > 0.3
    assert one[-1] > 5.0  # it swims


def test_vortices_neither_diverge_nor_drift() -> None:
    world = vortices_at((0.3, -1.0))()
    at = np.linspace(0.0, 2.0 * VORTEX_WIDTH, 41)[:-1]
    field = np.array([[world.water((x, y, 0.0)) for y in at] for x in at])
    np.testing.assert_allclose(field.mean(axis=(0, 1)), 0.0, atol=1e-12)
    assert np.hypot(*field.T).max() == pytest.approx(VORTEX_SPEED, rel=0.01)
    h = 1e-5
    x, y = 1.7, -4.2
    along = world.water((x + h, y, 0.0))[0] - world.water((x - h, y, 0.0))[0]
    across = world.water((x, y + h, 0.0))[1] - world.water((x, y - h, 0.0))[1]
    assert along + across == pytest.approx(0.0, abs=1e-12)


def swim_of(world: type[World]) -> Any:
    """Return where a robot gets with some commands, and how it turns then."""
    made = make_world(world, Scenario.create(fin_angles=(0.3, -1.0, 2.0), current=(0.1, 0.0, 0.0)))
    rng = np.random.default_rng(0)
    for _ in range(30):
        left, right, caudal = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]).tolist()
        made.advance((left, right, caudal), 20)
    return [*made.state().position, *made.state().spin]


def test_skin_friction_and_density_are_all_that_dense_water_differs_in() -> None:
    """With factors of 1 it is the engine's water, to the last bit."""
    plain = type("Plain", (DenseWorld,), {"fin_density": 1.0, "friction": 1.0})
    assert swim_of(plain) == swim_of(CompiledWorld)
    for factor in ("fin_density", "friction"):
        factors = {"fin_density": 1.0, "friction": 1.0, factor: 2.0}
        other = np.subtract(swim_of(type("Other", (DenseWorld,), factors)), swim_of(plain))
        assert np.abs(other).max() > 1e-3
    glide = [
        make_world(type("Glide", (DenseWorld,), {"friction": friction}),
                   Scenario.create(velocity=(0.0, 1.0, 0.0)))
        for friction in (1.0, 5.0)
    ]  # fmt: skip
    for world in glide:
        world.advance((0.0, 0.0, 0.0), 300)
    slow, fast = sorted(world.state().position[1] for world in glide)
    assert glide[1].state().position[1] == slow < fast


def test_the_bootstrap_draws_within_each_damage() -> None:
    # Two damages that differ, without any spread within: the interval has no width.
    values = [1.0, 5.0] * 10
    middle, low, high = interval(values, 2)
    assert low == middle == high
    _, low, high = interval(values, 1)
    assert low < high
