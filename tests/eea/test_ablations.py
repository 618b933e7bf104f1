"""The table of open choices is whole, its arms differ from their baselines, and costs are right."""

from __future__ import annotations

import json
import pathlib
import pkgutil
import re
from dataclasses import fields, replace

import pytest

from eea import ConfigurationError, EEAConfig, estimate_morphology
from eea.core.algorithm import EEA
from eea.core.bits import BitLayout
from eea.core.config import PARTS
from eea.core.problem import Problem
from eea.core.result import Result
from eea.report.arms import baseline_of
from eea.study.ablations import ABLATIONS, BASELINES, ablation_arms, with_settings
from eea.study.cost import asked_trials, expected_trials
from fake_fish import ACTIONS, MODELS, PROBLEM, TRUTH, FakeRevealingTarget, FakeSimulator

# What the paper says outright, and what changes no result.
GIVEN = {
    "exploration.population",
    "exploration.generations",
    "exploration.strategy",
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
ARMS = ablation_arms()
PAIRS = {name: baseline for name in ARMS if (baseline := baseline_of(name, ARMS)) is not None}


def tiny(config: EEAConfig) -> EEAConfig:
    """As the fake fish runs it in hundredths of a second."""
    small = with_settings(replace(config, steps=64, rounds=3), TINY)
    inner = max(2, config.out_of_band.inner_generations // 5)
    return with_settings(small, {"out_of_band": {"inner_generations": inner}})


def run(config: EEAConfig) -> Result:
    """Run the fake fish, its genomes coded as the settings say."""
    models, actions = (BitLayout(x.variables, config.genetic.coding) for x in (MODELS, ACTIONS))
    target, simulator = FakeRevealingTarget(0, config.steps), FakeSimulator(config.steps)
    problem = Problem(models, actions, PROBLEM.hidden, PROBLEM.axes)
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
    known = {
        f"{part}.{field.name}"
        for part, kind in PARTS.items()
        if part != "joint"  # which is no part of the paper's algorithm
        for field in fields(kind)
    }
    assert asked | GIVEN == known
    assert not asked & GIVEN


def test_every_choice_of_the_map_is_asked_about_or_explained():
    text = (pathlib.Path(__file__).parents[2] / "docs" / "paper_map.md").read_text()
    table = text.split("leaves a choice")[1]
    rows = re.findall(r"^\| ([^|]+) \|(.*)\|$", table, re.MULTILINE)
    rows = [row for row in rows if row[0] != "choice" and not row[0].startswith("---")]
    assert len(rows) >= 15
    asked = {ablation.row for ablation in ABLATIONS.values()}
    assert asked <= {row for row, _ in rows}
    for row, cells in rows:
        if row not in asked:  # it is made elsewhere, and says where and why
            symbols = re.findall(r"`((?:eea|aquafish_gym|gait)\.[\w.]+)`", cells)
            assert symbols, row
            assert all(pkgutil.resolve_name(symbol) is not None for symbol in symbols)
            assert cells.split("|")[2].strip(), row


@pytest.mark.parametrize("name", ABLATIONS)
def test_answers_set_the_same_fields_and_the_default_is_among_them(name):
    ablation = ABLATIONS[name]
    assert len({frozenset(field_names(s)) for s in ablation.answers.values()}) == 1
    for condition in ablation.conditions:
        baseline = BASELINES[condition]
        configs = [with_settings(baseline, s) for s in ablation.answers.values()]
        assert configs.count(baseline) == 1, f"{condition}: no answer is the default"
        assert all(configs.count(config) == 1 for config in configs)


def test_arms_are_named_once_for_folders_and_share_their_baselines():
    assert list(ARMS)[: len(BASELINES) - 1] == [f"baseline-{c}" for c in BASELINES if c != "none"]
    assert ARMS.keys() == PAIRS.keys() | set(PAIRS.values())
    assert len(PAIRS) == sum((len(a.answers) - 1) * len(a.conditions) for a in ABLATIONS.values())
    for name, config in ARMS.items():
        assert re.fullmatch(r"[a-z0-9-]+", name)
        assert (config.steps, config.rounds) == (256, 25)
        if name in PAIRS:
            assert config != ARMS[PAIRS[name]]
            assert config.condition == ARMS[PAIRS[name]].condition


def test_some_ablations_bring_only_their_own_baselines():
    configs = ablation_arms(["arcs", "warm-start"])
    assert list(configs) == [
        "baseline-in-band",
        "baseline-out-of-band",
        "arcs-linear-in-band",
        "warm-start-yes-out-of-band",
    ]
    assert ablation_arms([]) == {}


def test_unknown_names_are_refused():
    with pytest.raises(ConfigurationError, match="did you mean 'revisit'"):
        ablation_arms(["revisits"])


@pytest.fixture(scope="module")
def baseline_stories() -> dict[str, str]:
    return {
        f"baseline-{condition}": story(run(tiny(config))) for condition, config in BASELINES.items()
    }


@pytest.mark.parametrize("name", PAIRS)
def test_every_arm_runs_and_does_something_else_than_its_baseline(name, baseline_stories):
    assert story(run(tiny(ARMS[name]))) != baseline_stories[PAIRS[name]]


def test_dividing_by_a_power_of_two_changes_no_ranking():
    # So without a clamp it needs no arm of its own.
    results = [
        run(tiny(with_settings(BASELINES["ideal"], {"behavior": {"normalised": n}})))
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
    config = with_settings(replace(BASELINES[condition], steps=64, rounds=4), settings)
    asked = asked_trials(config)
    assert asked[:2] == (3 * 4 * 3 * 6, 20 * 7 * (1 + 2 + 3 + 4))
    # Columns of experiments whose angles moved are asked for again, which is part of estimation.
    assert simulated(config) == pytest.approx(sum(asked), rel=0.002)


@pytest.mark.parametrize("condition", ["ideal", "in-band", "out-of-band"])
def test_what_recurs_is_not_simulated_again(condition):
    config = tiny(BASELINES[condition])
    asked = sum(asked_trials(config))
    assert 0.3 * asked < simulated(config) < asked


@pytest.mark.parametrize("condition", ["ideal", "in-band", "out-of-band"])
def test_the_expected_trials_are_about_those_of_the_fish(condition):
    config = replace(BASELINES[condition], steps=16, rounds=4)
    result = estimate_morphology(
        None, "left_pectoral:length=0.5", config, 1001, target_engine="numba", threads=1
    )
    trials = sum(record.trials for record in result.rounds)
    assert trials == pytest.approx(expected_trials(config), rel=0.25)


def test_the_paper_asks_for_what_its_settings_say():
    # 25 models, 100 generations, 1 to 25 experiments; 25 actions, 25 generations, 25 models.
    assert asked_trials(BASELINES["ideal"]) == (375_000, 812_500, 0)
    # Three times a round, 25 poses for 25 generations judged by 25 models.
    assert asked_trials(BASELINES["out-of-band"])[2] == 25 * 3 * 25**3
