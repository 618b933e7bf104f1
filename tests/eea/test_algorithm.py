from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from eea.core.algorithm import EEA
from eea.core.behavior import BehaviorConfig
from eea.core.checks import ConfigurationError, TargetError
from eea.core.conditions import InBandConfig, OutOfBandConfig
from eea.core.config import CONDITIONS, EEAConfig, recovery_config
from eea.core.estimation import EstimationConfig
from eea.core.experiment import Trials
from eea.core.exploration import ExplorationConfig
from eea.core.fitness import mid_range_level, quantisation_limit
from eea.core.genetic import GeneticConfig
from eea.core.session import STREAMS, streams
from eea.study.presets import FIGURES, figure_config
from fake_fish import (
    MODELS,
    PROBLEM,
    STEPS,
    TRUTH,
    FakeLog,
    FakeRevealingTarget,
    FakeSimulator,
    FakeTarget,
    fake_eea,
)

QUICK = EEAConfig(
    steps=STEPS,
    rounds=3,
    exploration=ExplorationConfig(8, 4),
    estimation=EstimationConfig(population=10, generations=15),
)


def without_clock(records):
    return [replace(record, seconds=0.0) for record in records]


@pytest.mark.parametrize("condition", CONDITIONS)
def test_the_same_seed_makes_the_same_run(condition):
    config = replace(QUICK, condition=condition)
    runs = [without_clock(fake_eea(config, seed=3).run().rounds) for _ in range(2)]
    assert runs[0] == runs[1]
    other = without_clock(fake_eea(config, seed=4).run().rounds)
    assert other[-1].morphology != runs[0][-1].morphology


def test_conditions_are_paired_by_hidden_angles_and_first_command():
    runs = [fake_eea(replace(QUICK, condition=c)).run().rounds for c in CONDITIONS]
    assert len({tuple(r.true_angles for r in rounds) for rounds in runs}) == 1
    assert len({rounds[0].command for rounds in runs}) == 1
    assert len({rounds[2].morphology for rounds in runs}) == 4


def test_the_streams_are_independent_of_each_other():
    drawn = {name: rng.random() for name, rng in streams(0).items()}
    assert tuple(drawn) == STREAMS
    assert len(set(drawn.values())) == 4
    assert drawn == {name: rng.random() for name, rng in streams(0).items()}


def test_knowing_the_angles_beats_not_knowing_them():
    config = EEAConfig(steps=STEPS, rounds=3, estimation=EstimationConfig(generations=60))
    score = {
        c: fake_eea(replace(config, condition=c)).run().rounds[-1].objective_fitness
        for c in ("ideal", "none")
    }
    assert score["ideal"] > 0.95
    assert score["none"] < score["ideal"] - 0.1


def test_inferring_the_angles_lies_between():
    inference = OutOfBandConfig(sampled_models=5)
    result = fake_eea(EEAConfig(steps=STEPS, rounds=3, out_of_band=inference)).run()
    assert result.rounds[-1].objective_fitness > result.chance + 0.1
    assert np.mean([r.angle_error for r in result.rounds]) < 0.5


def test_a_record_tells_what_happened():
    target = FakeRevealingTarget()
    eea = EEA(target, FakeSimulator(), PROBLEM, QUICK, 0, TRUTH)
    seen = []
    result = eea.run(seen.append)
    assert seen == result.rounds
    assert [r.round for r in seen] == [1, 2, 3]
    assert [r.action_fitness is None for r in seen] == [True, False, False]
    assert np.array_equal([r.command for r in seen], target.commands)
    assert result.stopped == "rounds"
    assert np.array_equal(result.model, seen[-1].morphology)
    assert seen[0].objective_fitness == pytest.approx(
        1 - np.mean(np.abs(np.array(seen[0].morphology) - TRUTH) / MODELS.high)
    )


def test_the_truth_may_be_unknown():
    eea = EEA(FakeTarget(), FakeSimulator(), PROBLEM, QUICK, 0)
    result = eea.run()
    assert all(r.objective_fitness is None and r.angle_error is None for r in result.rounds)
    assert result.chance is None
    assert result.mid_range is None
    assert result.nearest is None
    assert json.loads(result.to_json())["truth"] is None


def test_the_ideal_condition_needs_to_be_told():
    with pytest.raises(TargetError, match="start_angles"):
        EEA(FakeTarget(), FakeSimulator(), PROBLEM, EEAConfig(condition="ideal"))


def test_a_revealing_target_changes_nothing_but_the_records():
    known = fake_eea(QUICK).run()
    hidden = EEA(FakeTarget(0), FakeSimulator(), PROBLEM, QUICK, 0).run()
    assert [r.morphology for r in known.rounds] == [r.morphology for r in hidden.rounds]


def test_ideal_is_refused_before_anything_is_performed():
    target = FakeTarget()
    with pytest.raises(TargetError, match="FakeTarget has none"):
        EEA(target, FakeSimulator(), PROBLEM, replace(QUICK, condition="ideal"))
    assert not target.commands


def test_json_holds_everything():
    result = fake_eea(QUICK).run()
    document = json.loads(result.to_json())
    assert document["schema"] == "eea.result/1"
    assert document["morphology"] == list(result.rounds[-1].morphology)
    assert document["truth"] == TRUTH.tolist()
    assert document["config"]["estimation"]["population"] == 10
    assert len(document["rounds"]) == 3
    assert document["rounds"][0]["command"] == list(result.rounds[0].command)
    assert document["chance"] == pytest.approx(result.chance)
    assert document["mid_range"] == mid_range_level(TRUTH, MODELS)
    assert document["nearest"] == quantisation_limit(TRUTH, MODELS)
    assert document["dimensions"] == list(MODELS.names)


def test_it_stops_when_the_model_is_accurate():
    result = fake_eea(replace(QUICK, condition="ideal", rounds=50, accurate=0.6)).run()
    assert result.stopped == "accurate"
    assert len(result.rounds) < 50
    assert result.rounds[-1].model_fitness >= 0.6
    assert all(r.model_fitness < 0.6 for r in result.rounds[:-1])


def test_it_stops_when_time_is_up():
    result = fake_eea(replace(QUICK, time_limit=0.0)).run()
    assert result.stopped == "time"
    assert result.rounds == []
    with pytest.raises(TargetError, match="no round was completed"):
        _ = result.model
    assert json.loads(result.to_json())["morphology"] is None


def test_an_interrupted_run_keeps_its_rounds():
    eea = fake_eea(QUICK)

    def interrupt(record):
        if record.round == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        eea.run(interrupt)
    assert len(eea.result.rounds) == 2
    assert eea.result.stopped == "interrupted"
    assert len(json.loads(eea.result.to_json())["rounds"]) == 2


class Steady(FakeTarget):
    """Hides angles that follow from the command, so that a repeated round is the same."""

    def perform(self, command):
        self.commands.append(command)
        angles = 3.0 * np.sin(1000.0 * command)
        return self._simulator.simulate(Trials(TRUTH[None], command[None], angles[None]))


class Interrupted(FakeSimulator):
    """Presses Ctrl-C once, in its so-many-th call."""

    def __init__(self, call: int) -> None:
        super().__init__()
        self._call = call

    def simulate(self, trials):
        log = super().simulate(trials)
        if self.calls == self._call:
            raise KeyboardInterrupt
        return log


@pytest.mark.parametrize("condition", ["none", "in-band", "out-of-band"])
def test_going_on_after_an_interrupt_ends_as_if_there_had_been_none(condition):
    inference = OutOfBandConfig(period=5, inner_population=6, inner_generations=3, revisit=1)
    config = replace(QUICK, condition=condition, out_of_band=inference)
    simulator = FakeSimulator()
    whole = EEA(Steady(), simulator, PROBLEM, config, 0, TRUTH).run()
    expected = [replace(r, trials=0) for r in without_clock(whole.rounds)]
    for call in (2, simulator.calls // 2, simulator.calls // 2 + 8, simulator.calls - 1):
        eea = EEA(Steady(), Interrupted(call), PROBLEM, config, 0, TRUTH)
        with pytest.raises(KeyboardInterrupt):
            eea.run()
        kept = len(eea.result.rounds)
        assert kept < 3
        assert eea.result.stopped == "interrupted"
        result = eea.run()
        assert [r.round for r in result.rounds] == [1, 2, 3]
        assert [replace(r, trials=0) for r in without_clock(result.rounds)] == expected
        assert np.all(np.diff([r.seconds for r in result.rounds]) >= 0)


def test_a_target_that_fails_once_may_be_asked_again():
    class Flaky(Steady):
        failed = False

        def perform(self, command):
            if len(self.commands) == 1 and not self.failed:
                self.failed = True
                raise OSError("the tank is empty")
            return super().perform(command)

    expected = EEA(Steady(), FakeSimulator(), PROBLEM, QUICK).run()
    eea = EEA(Flaky(), FakeSimulator(), PROBLEM, QUICK)
    with pytest.raises(OSError, match="the tank is empty"):
        eea.run()
    assert [r.morphology for r in eea.run().rounds] == [r.morphology for r in expected.rounds]


def test_a_record_tells_the_error_and_the_spread_of_each_dimension():
    eea = fake_eea(QUICK)
    for record in eea:
        error = np.abs(np.array(record.morphology) - TRUTH) / MODELS.high
        assert np.allclose(record.dimension_error, error)
        assert record.objective_fitness == pytest.approx(1 - np.mean(record.dimension_error))
        # Of nine sizes each: twice as far apart is twice the spread, whatever the range.
        models = eea._estimation.population.models
        assert np.allclose(record.spread, np.std(models / MODELS.high, axis=0))
        assert max(record.spread) > 0.0
        document = json.loads(json.dumps(record.to_dict()))
        assert {k: tuple(v) if isinstance(v, list) else v for k, v in document.items()} == vars(
            record
        )
    unknown = fake_eea(QUICK, truth=False).run().rounds[-1]
    assert unknown.dimension_error is None
    assert unknown.spread == record.spread


def test_a_run_that_ended_stays_ended():
    eea = fake_eea(replace(QUICK, condition="ideal", rounds=50, accurate=0.6))
    rounds = list(eea.run().rounds)
    assert list(eea) == []
    assert (eea.result.rounds, eea.result.stopped) == (rounds, "accurate")


@pytest.mark.parametrize("steps", [STEPS - 1, STEPS + 1, 2 * STEPS])
@pytest.mark.parametrize("summary", ["dft", "mean_rate"])
def test_a_target_that_logs_another_number_of_steps_is_refused(steps, summary):
    config = replace(QUICK, behavior=BehaviorConfig(summary=summary))
    eea = EEA(FakeTarget(steps=steps), FakeSimulator(), PROBLEM, config)
    with pytest.raises(TargetError, match=f"target must log trials of 64 .*; it logged {steps}"):
        eea.run()


@pytest.mark.parametrize(("signal", "name"), [("body_rates", "gyro"), ("attitude", "rpy")])
def test_a_target_that_returns_no_log_is_named(signal, name):
    class Mute(FakeTarget):
        def perform(self, command):
            super().perform(command)

    config = replace(QUICK, behavior=BehaviorConfig(signal=signal))
    message = f"the target must return a log with {name}; it returned None"
    with pytest.raises(TargetError, match=message):
        EEA(Mute(), FakeSimulator(), PROBLEM, config).run()


@pytest.mark.parametrize("angles", [None, [1.0, 2.0], [0.0, np.nan, 0.0], "left"])
def test_revealed_angles_must_be_three_numbers(angles):
    class Confused(FakeTarget):
        @property
        def start_angles(self):
            return angles

    with pytest.raises(TargetError, match="the target's start_angles must"):
        EEA(Confused(), FakeSimulator(), PROBLEM, QUICK).run()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"config": {"rounds": 3}}, "config must be of type EEAConfig; got {'rounds': 3}"),
        ({"truth": TRUTH[:8]}, r"truth must have shape \(9,\); got \(8,\)"),
        (
            {"config": replace(QUICK, genetic=GeneticConfig(mutations=18.5))},
            "genetic.mutations must be at most the shortest genome's bits, 18; got 18.5",
        ),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_performed(changed, message):
    target = FakeTarget()
    arguments = {"config": QUICK, "seed": 0, "truth": TRUTH, **changed}
    with pytest.raises(ConfigurationError, match=message):
        EEA(target, FakeSimulator(), PROBLEM, **arguments)
    assert not target.commands


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (np.zeros((2, 64, 3)), "the log of one trial; it returned 2"),
        (np.full((64, 3), np.nan), "must be finite"),
        (np.zeros((64, 2)), r"\(B, T, 3\)"),
    ],
)
def test_a_target_that_answers_wrongly_is_named(samples, message):
    class Broken(FakeTarget):
        def perform(self, command):
            super().perform(command)
            return FakeLog(samples, samples)

    with pytest.raises(TargetError, match=message):
        EEA(Broken(), FakeSimulator(), PROBLEM, QUICK).run()


def test_the_figures_are_the_papers_settings():
    assert set(FIGURES) == {
        "fig5",
        "fig6",
        "fig7",
        "fig8",
        "fig9",
        "fig10",
        "in-band-split",
        "in-band-extended",
    }
    tenth = figure_config("fig10", steps=1024)
    assert (tenth.condition, tenth.steps, tenth.rounds) == ("out-of-band", 1024, 25)
    assert tenth.estimation.population == 100
    assert (tenth.out_of_band.inner_population, tenth.out_of_band.sampled_models) == (50, 5)
    assert figure_config("fig8").estimation.population == 200
    assert figure_config("in-band-extended").in_band.extension == 0.2
    assert figure_config("in-band-split").in_band.dynamic_split
    with pytest.raises(ConfigurationError, match="did you mean 'fig10'"):
        figure_config("fig100")


def test_the_recommended_settings_are_the_case_studys():
    config = recovery_config()
    assert (config.condition, config.steps, config.rounds) == ("out-of-band", 256, 16)
    assert (config.out_of_band.sampled_models, config.out_of_band.revisit) == (5, 5)
    assert recovery_config(64, 3) == replace(config, steps=64, rounds=3)


def test_the_defaults_are_the_papers():
    config = EEAConfig()
    assert (config.exploration.population, config.exploration.generations) == (25, 25)
    assert (config.estimation.population, config.estimation.generations) == (25, 100)
    assert (config.rounds, config.in_band.k, config.out_of_band.period) == (25, 3, 35)
    assert (config.genetic.tournament_size, config.genetic.crossover_rate) == (2, 0.75)
    assert config.genetic.mutations == 1.0
    assert config.behavior.maximum == 100.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"condition": "outofband"}, "did you mean 'out-of-band'"),
        ({"steps": 100}, "steps must be a power of two; got 100"),
        ({"steps": 1}, "steps must be a whole number of at least 2"),
        ({"rounds": 0}, "rounds"),
        ({"accurate": 1.5}, "accurate"),
        ({"time_limit": -1.0}, "time_limit"),
        ({"steps": 2**40}, "steps must be .* and at most 1048576; got 1099511627776"),
        ({"genetic": None}, "genetic must be of type GeneticConfig; got None"),
        ({"in_band": {"k": 3}}, "in_band must be of type InBandConfig"),
        ({"behavior": BehaviorConfig}, "behavior must be of type BehaviorConfig"),
        (
            {"condition": "in-band", "in_band": InBandConfig(k=26)},
            "in_band.k must be at most estimation.population, 25; got 26",
        ),
        (
            {"out_of_band": OutOfBandConfig(sampled_models=26)},
            "out_of_band.sampled_models must be at most estimation.population, 25; got 26",
        ),
        (
            {"exploration": ExplorationConfig(best_models=26)},
            "exploration.best_models must be at most estimation.population, 25; got 26",
        ),
        (
            {"genetic": GeneticConfig(elites=25)},
            "genetic.elites must be at most exploration.population - 1, 24; got 25",
        ),
        (
            {"genetic": GeneticConfig(elites=9), "estimation": EstimationConfig(9)},
            "genetic.elites must be at most estimation.population - 1, 8; got 9",
        ),
        (
            {"genetic": GeneticConfig(elites=4), "out_of_band": OutOfBandConfig(5, 4)},
            "genetic.elites must be at most out_of_band.inner_population - 1, 3; got 4",
        ),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(ConfigurationError, match=message):
        EEAConfig(**settings)


def test_settings_that_have_no_say_are_not_refused():
    few = EstimationConfig(population=2)
    unused = OutOfBandConfig(sampled_models=5, inner_population=2)
    for condition in ("ideal", "none"):
        EEAConfig(condition=condition, estimation=few, out_of_band=unused)
    EEAConfig(condition="in-band", estimation=few, in_band=InBandConfig(k=2), out_of_band=unused)
    EEAConfig(condition="out-of-band", estimation=few)
    EEAConfig(condition="none", genetic=GeneticConfig(elites=2), out_of_band=unused)
    EEAConfig(steps=2**20, genetic=GeneticConfig(elites=24))


@pytest.mark.parametrize("seed", [-1, 1.5, None, 2**64, 10**400])
def test_bad_seeds_are_refused(seed):
    with pytest.raises(ConfigurationError, match="seed must be a whole number"):
        streams(seed)
