"""The table of open choices is whole, its arms differ from their baselines, and costs are right."""

from __future__ import annotations

import json
import pathlib
import pkgutil
import re
from dataclasses import fields, replace

import pytest
from eea.study.arms import ablation_arms, arms, baseline_config, with_settings

from eea import ConfigurationError, EEAConfig, estimate_morphology
from eea.core.algorithm import EEA, Result
from eea.core.bits import BitLayout
from eea.core.config import PARTS
from eea.study.ablations import ABLATIONS, BASELINES, ELSEWHERE
from eea.study.cost import asked_trials, expected_trials
from fake_fish import ACTIONS, MODELS, PROBLEM, TRUTH, FakeRevealingTarget, FakeSimulator

# What the paper says outright, and what changes no result.
GIVEN = {
    "exploration.population",
    "exploration.generations",
    "estimation.population",
    "estimation.generations",
    "estimation.remember",
    "genetic.tournament_size",
    "genetic.crossover_rate",
    "behavior.maximum",
    "behavior.timestep",
    "in_band.confidence",
    "out_of_band.period",
}
TINY = {
    "exploration": {"generations": 2, "population": 4},
    "estimation": {"generations": 6},
    "out_of_band": {"period": 3},
}
ARMS = arms()


def tiny(config: EEAConfig) -> EEAConfig:
    """As the fake fish runs it in hundredths of a second."""
    small = with_settings(replace(config, steps=64, rounds=3), TINY)
    inner = max(2, config.out_of_band.inner_generations // 5)
    return with_settings(small, {"out_of_band": {"inner_generations": inner}})


def run(config: EEAConfig) -> Result:
    """Run the fake fish, its genomes coded as the settings say."""
    models, actions = (BitLayout(x.variables, config.genetic.coding) for x in (MODELS, ACTIONS))
    target, simulator = FakeRevealingTarget(0, config.steps), FakeSimulator(config.steps)
    problem = replace(PROBLEM, models=models, actions=actions)
    return EEA(target, simulator, problem, config, 0, TRUTH).run()


def story(result: Result) -> str:
    """All that happened, but for the clock."""
    return json.dumps([{**record.to_dict(), "seconds": 0} for record in result.rounds])


def field_names(settings) -> set[str]:
    return {f"{part}.{field}" for part, values in settings.items() for field in values}


def test_every_setting_is_asked_about_or_given_by_the_paper():
    asked = {
        name
        for ablation in ABLATIONS.values()
        for settings in ablation.answers.values()
        for name in field_names(settings)
    }
    known = {f"{part}.{field.name}" for part, kind in PARTS.items() for field in fields(kind)}
    assert asked | GIVEN == known
    assert not asked & GIVEN


def test_every_choice_of_the_map_is_asked_about_or_explained():
    text = (pathlib.Path(__file__).parents[2] / "docs" / "paper_map.md").read_text()
    table = text.split("leaves a choice")[1]
    rows = re.findall(r"^\| ([^|]+) \|", table, re.MULTILINE)
    rows = [row for row in rows if row != "choice" and not row.startswith("---")]
    assert len(rows) >= 15
    known = {a.row for a in ABLATIONS.values()} | {e.row for e in ELSEWHERE}
    assert set(rows) <= known, set(rows) - known


@pytest.mark.parametrize("choice", ELSEWHERE, ids=lambda choice: choice.row)
def test_choices_made_elsewhere_name_something_that_exists(choice):
    assert pkgutil.resolve_name(choice.symbol) is not None
    assert choice.row not in {ablation.row for ablation in ABLATIONS.values()}


@pytest.mark.parametrize("name", ABLATIONS)
def test_answers_set_the_same_fields_and_the_default_is_among_them(name):
    ablation = ABLATIONS[name]
    assert ablation.name == name
    assert len({frozenset(field_names(s)) for s in ablation.answers.values()}) == 1
    for condition in ablation.conditions:
        baseline = baseline_config(condition)
        configs = [with_settings(baseline, s) for s in ablation.answers.values()]
        assert configs.count(baseline) == 1, f"{condition}: no answer is the default"
        assert all(configs.count(config) == 1 for config in configs)


def test_arms_are_named_once_for_folders_and_share_their_baselines():
    configs = ablation_arms()
    baselines = {name: arm.baseline for name, arm in arms().items()}
    assert list(configs)[: len(BASELINES) - 1] == [
        f"baseline-{c}" for c in BASELINES if c != "none"
    ]
    assert configs.keys() == baselines.keys() | set(baselines.values())
    assert len(arms()) == sum((len(a.answers) - 1) * len(a.conditions) for a in ABLATIONS.values())
    for name, config in configs.items():
        assert re.fullmatch(r"[a-z0-9-]+", name)
        assert (config.steps, config.rounds) == (256, 25)
        if name in baselines:
            assert config != configs[baselines[name]]
            assert config.condition == configs[baselines[name]].condition


def test_some_ablations_bring_only_their_own_baselines():
    configs = ablation_arms(["arcs", "warm-start"], steps=128, rounds=3)
    assert list(configs) == [
        "baseline-in-band",
        "baseline-out-of-band",
        "arcs-linear-in-band",
        "warm-start-yes-out-of-band",
    ]
    assert {(c.steps, c.rounds) for c in configs.values()} == {(128, 3)}
    assert ablation_arms([]) == {}


def test_unknown_names_are_refused():
    with pytest.raises(ConfigurationError, match="did you mean 'revisit'"):
        ablation_arms(["revisits"])
    with pytest.raises(ConfigurationError, match="did you mean 'in-band'"):
        baseline_config("inband")


@pytest.fixture(scope="module")
def baseline_stories() -> dict[str, str]:
    return {
        f"baseline-{condition}": story(run(tiny(baseline_config(condition))))
        for condition in BASELINES
    }


@pytest.mark.parametrize("name", ARMS)
def test_every_arm_runs_and_does_something_else_than_its_baseline(name, baseline_stories):
    arm = ARMS[name]
    assert story(run(tiny(arm.config))) != baseline_stories[arm.baseline]


def test_dividing_by_a_power_of_two_changes_no_ranking():
    # So without a clamp it needs no arm of its own.
    results = [
        run(tiny(with_settings(baseline_config("ideal"), {"behavior": {"normalised": n}})))
        for n in (False, True)
    ]
    plain, divided = ([(r.command, r.morphology) for r in result.rounds] for result in results)
    assert plain == divided
    assert results[0].rounds[-1].model_fitness < results[1].rounds[-1].model_fitness


def simulated(config: EEAConfig) -> int:
    return sum(record.trials for record in run(config).rounds)


@pytest.mark.parametrize("condition", BASELINES)
@pytest.mark.parametrize("revisit", [0, 2])
def test_where_nothing_recurs_the_asked_trials_are_simulated(condition, revisit):
    # Nine flips of 18 bits make new genomes, no elite survives, and each round begins anew.
    settings = {
        "genetic": {"mutations": 9.0, "elites": 0},
        "estimation": {"population": 20, "generations": 7, "carry_over": "reseed"},
        "exploration": {"population": 4, "generations": 3, "best_models": 6},
        "out_of_band": {"period": 3, "inner_generations": 2, "revisit": revisit},
    }
    config = with_settings(baseline_config(condition, steps=64, rounds=4), settings)
    asked = asked_trials(config)
    assert asked.exploration == 3 * 4 * 3 * 6
    assert asked.estimation == 20 * 7 * (1 + 2 + 3 + 4)
    # Columns of experiments whose angles moved are asked for again, which is part of estimation.
    assert simulated(config) == pytest.approx(asked.total, rel=0.002)


@pytest.mark.parametrize("condition", ["ideal", "in-band", "out-of-band"])
def test_what_recurs_is_not_simulated_again(condition):
    config = tiny(baseline_config(condition))
    assert 0.3 * asked_trials(config).total < simulated(config) < asked_trials(config).total


@pytest.mark.parametrize("condition", ["ideal", "in-band", "out-of-band"])
def test_the_expected_trials_are_about_those_of_the_fish(condition):
    config = baseline_config(condition, steps=16, rounds=4)
    result = estimate_morphology(
        None, "left_pectoral:length=0.5", config, 1001, target_engine="numba", threads=1
    )
    trials = sum(record.trials for record in result.rounds)
    assert trials == pytest.approx(expected_trials(config).total, rel=0.25)


def test_the_paper_asks_for_what_its_settings_say():
    # 25 models, 100 generations, 1 to 25 experiments; 25 actions, 25 generations, 25 models.
    ideal = asked_trials(baseline_config("ideal"))
    assert (ideal.estimation, ideal.exploration, ideal.inference) == (812_500, 375_000, 0)
    # Three times a round, 25 poses for 25 generations judged by 25 models.
    assert asked_trials(baseline_config("out-of-band")).inference == 25 * 3 * 25**3
