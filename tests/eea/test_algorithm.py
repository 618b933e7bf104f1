from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eea.core import algorithm, genetic
from eea.core.algorithm import EEA
from eea.core.checks import ConfigurationError, TargetError
from eea.core.config import (
    CONDITIONS,
    EstimationConfig,
    ExplorationConfig,
    GeneticConfig,
    InBandConfig,
    JointConfig,
    OutOfBandConfig,
    PaperConfig,
    config_for,
    recovery_config,
)
from eea.core.experiment import RecordedLog, Trials
from eea.core.genetic import next_generation
from eea.core.session import STREAMS, streams
from eea.study.arms import FIGURES, figure_config
from fake_fish import MODELS, PROBLEM, STEPS, TRUTH, FakeRevealingTarget, FakeSimulator, FakeTarget
from fake_fish import fake_eea as eea_of

QUICK = PaperConfig(
    steps=STEPS,
    rounds=3,
    exploration=ExplorationConfig(8, 4),
    estimation=EstimationConfig(population=10, generations=15),
)


def timeless(records, **changed):
    return [replace(record, seconds=0.0, **changed) for record in records]


@pytest.mark.parametrize("condition", CONDITIONS)
def test_same_seed_gives_same_run(condition):
    config = QUICK.under(condition)
    runs = [timeless(eea_of(config, seed).run().rounds) for seed in (3, 3, 4)]
    assert runs[0] == runs[1]
    assert runs[2][-1].morphology != runs[0][-1].morphology


@pytest.mark.parametrize(
    ("condition", "part", "changed"),
    [
        ("in-band", "in_band", InBandConfig(best=5)),
        ("in-band", "in_band", InBandConfig(confidence=0.9)),
        ("in-band", "in_band", InBandConfig(dynamic_split=True)),
        ("in-band", "in_band", InBandConfig(extension=0.2)),
        ("ideal", "genetic", GeneticConfig(coding="binary")),
        ("ideal", "genetic", GeneticConfig(crossover="two-point")),
        ("ideal", "genetic", GeneticConfig(crossover_rate=0.5)),
        ("ideal", "genetic", GeneticConfig(mutations=2.5)),
        ("ideal", "genetic", GeneticConfig(elites=0)),
        ("ideal", "exploration", ExplorationConfig(8, 4, initial_angles="random")),
    ],
)
def test_every_choice_of_the_paper_changes_a_run(condition, part, changed):
    config = QUICK.under(condition)
    runs = [
        timeless(eea_of(each).run().rounds) for each in (config, replace(config, **{part: changed}))
    ]
    assert runs[0] != runs[1]
    # The first command is random, and the hidden angles belong to the seed.
    angles = [[record.true_angles for record in rounds] for rounds in runs]
    assert angles[0] == angles[1]


def test_the_genetic_choices_hold_for_commands_models_and_poses(monkeypatch):
    config = GeneticConfig(coding="binary", crossover="two-point", elites=3)
    seen = []

    def recorded(genomes, fitness, config, rng):
        seen.append((genomes.shape[1], config))
        return next_generation(genomes, fitness, config, rng)

    for module in (algorithm, genetic):
        monkeypatch.setattr(module, "next_generation", recorded)
    eea_of(replace(QUICK, rounds=2, genetic=config)).run()
    assert set(seen) == {(bits, config) for bits in (18, 45, 24)}


def test_random_initial_angles_while_exploring_are_shared_by_all_models():
    seen = []

    class Watched(FakeSimulator):
        def simulate(self, trials):
            seen.append(trials)
            return super().simulate(trials)

    exploration = ExplorationConfig(8, 1, initial_angles="random")
    estimation = EstimationConfig(population=10, generations=1)
    config = replace(QUICK, condition="none", exploration=exploration, estimation=estimation)
    EEA(FakeTarget(), Watched(), PROBLEM, config).run()
    explored = [trials.angles for trials in seen if len(trials) == 8 * 10]
    poses = [np.unique(angles, axis=0) for angles in explored]
    assert [len(pose) for pose in poses] == [1, 1]  # in each of rounds 2 and 3
    assert not np.array_equal(poses[0], poses[1])
    assert poses[0].any()


def test_conditions_share_hidden_angles_and_first_command():
    runs = [eea_of(QUICK.under(c)).run().rounds for c in CONDITIONS]
    assert len({tuple(r.true_angles for r in rounds) for rounds in runs}) == 1
    assert len({rounds[0].command for rounds in runs}) == 1
    assert len({rounds[2].morphology for rounds in runs}) == 4


def test_streams_differ_and_repeat():
    drawn = {name: rng.random() for name, rng in streams(0).items()}
    assert tuple(drawn) == STREAMS
    assert len(set(drawn.values())) == 4
    assert drawn == {name: rng.random() for name, rng in streams(0).items()}
    for seed in (-1, 1.5, None, 2**64):
        with pytest.raises(ConfigurationError, match="seed must be a whole number"):
            streams(seed)


def test_known_angles_give_better_models_than_unknown_ones():
    config = PaperConfig(steps=STEPS, rounds=3, estimation=EstimationConfig(generations=60))
    score = {c: eea_of(config.under(c)).run().objective_fitness for c in ("ideal", "none")}
    assert score["ideal"] > 0.95
    assert score["none"] < score["ideal"] - 0.1
    inference = OutOfBandConfig(sampled_models=5)
    result = eea_of(PaperConfig(steps=STEPS, rounds=3, out_of_band=inference)).run()
    assert result.objective_fitness > result.chance + 0.1
    assert np.mean([r.angle_error for r in result.rounds]) < 0.5


def test_records_hold_commands_fitnesses_and_errors():
    target = FakeRevealingTarget()
    eea, seen = EEA(target, FakeSimulator(), PROBLEM, QUICK, 0, TRUTH), []
    result = eea.run(seen.append)
    assert seen == result.rounds
    assert result.stopped == "rounds"
    assert [r.round for r in seen] == [1, 2, 3]
    assert [r.action_fitness is None for r in seen] == [True, False, False]
    assert np.array_equal([r.command for r in seen], target.commands)
    for record in seen:
        error = np.abs(np.array(record.morphology) - TRUTH) / MODELS.high
        assert np.allclose(record.dimension_error, error)
        assert record.objective_fitness == pytest.approx(1 - error.mean())
        assert max(record.spread) > 0.0


def test_truth_affects_only_the_records():
    known = eea_of(QUICK).run()
    hidden = EEA(FakeTarget(0), FakeSimulator(), PROBLEM, QUICK, 0).run()
    assert [r.morphology for r in known.rounds] == [r.morphology for r in hidden.rounds]
    assert all(r.objective_fitness is None and r.angle_error is None for r in hidden.rounds)
    assert (hidden.chance, hidden.mid_range, hidden.nearest) == (None, None, None)


def test_a_result_without_rounds_has_no_model():
    result = eea_of(QUICK).result
    assert (result.stopped, result.rounds) == ("interrupted", [])
    with pytest.raises(TargetError, match="no round was completed"):
        _ = result.model
    assert result.to_dict()["morphology"] is None


class Steady(FakeTarget):
    """Its hidden angles follow from the command, so that a repeated round is the same."""

    def perform(self, command):
        self.commands.append(command)
        angles = 3.0 * np.sin(1000.0 * command)
        return self._simulator.simulate(Trials(TRUTH[None], command[None], angles[None]))


class Interrupted(FakeSimulator):
    """Raises KeyboardInterrupt in one of its calls."""

    def __init__(self, call: int) -> None:
        super().__init__()
        self._call = call

    def simulate(self, trials):
        log = super().simulate(trials)
        if self.calls == self._call:
            raise KeyboardInterrupt
        return log


@pytest.mark.parametrize("condition", ["none", "in-band", "out-of-band"])
def test_interrupted_round_leaves_no_trace(condition):
    inference = OutOfBandConfig(period=5, inner_population=6, inner_generations=3, revisit=1)
    config = replace(QUICK, out_of_band=inference).under(condition)
    simulator = FakeSimulator()
    expected = timeless(EEA(Steady(), simulator, PROBLEM, config, 0, TRUTH).run().rounds)
    for call in (2, simulator.calls // 2, simulator.calls - 1):
        eea = EEA(Steady(), Interrupted(call), PROBLEM, config, 0, TRUTH)
        with pytest.raises(KeyboardInterrupt):
            eea.run()
        assert eea.result.stopped == "interrupted"
        assert len(eea.result.rounds) < 3
        result = eea.run()
        assert timeless(result.rounds) == expected
        assert np.all(np.diff([r.seconds for r in result.rounds]) >= 0)


def test_ideal_condition_needs_revealing_target():
    target = FakeTarget()
    with pytest.raises(TargetError, match="start_angles"):
        EEA(target, FakeSimulator(), PROBLEM, QUICK.under("ideal"))
    assert not target.commands


@pytest.mark.parametrize(
    ("log", "message"),
    [
        (RecordedLog(np.zeros((2, 64, 3))), "the log of one trial; it returned 2"),
        (RecordedLog(np.full((64, 3), np.nan)), "must be finite"),
        (RecordedLog(np.zeros((65, 3))), "target must log trials of 64 .*; it logged 65"),
    ],
)
def test_wrong_log_raises_target_error(log, message):
    class Broken(FakeTarget):
        def perform(self, command):  # noqa: ARG002
            return log

    with pytest.raises(TargetError, match=message):
        EEA(Broken(), FakeSimulator(), PROBLEM, QUICK).run()


@pytest.mark.parametrize("angles", [None, [0.0, np.nan, 0.0]])
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
        ({"config": JointConfig()}, "config must be of type PaperConfig"),
        ({"truth": TRUTH[:8]}, r"truth must have shape \(9,\); got \(8,\)"),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_performed(changed, message):
    target = FakeTarget()
    arguments = {"config": QUICK, "seed": 0, "truth": TRUTH, **changed}
    with pytest.raises(ConfigurationError, match=message):
        EEA(target, FakeSimulator(), PROBLEM, **arguments)
    assert not target.commands


def test_defaults_are_the_papers():
    config = PaperConfig()
    assert (config.exploration.population, config.exploration.generations) == (25, 25)
    assert (config.estimation.population, config.estimation.generations) == (25, 100)
    assert (config.rounds, config.out_of_band.period) == (25, 35)
    assert set(FIGURES) == {f"fig{number}" for number in range(5, 11)}
    tenth = figure_config("fig10", steps=1024)
    assert (tenth.condition, tenth.steps, tenth.rounds) == ("out-of-band", 1024, 25)
    assert tenth.estimation.population == 100
    assert (tenth.out_of_band.inner_population, tenth.out_of_band.sampled_models) == (50, 5)
    assert figure_config("fig8").estimation.population == 200


def test_conditions_have_settings_by_name():
    for name in CONDITIONS:
        assert config_for(name) == PaperConfig(condition=name)
    assert config_for() == config_for("joint") == JointConfig()
    assert config_for("joint", rounds=2, noise=0.01).noise == 0.01
    assert config_for("recovery", steps=64, rounds=3) == recovery_config(64, 3)
    with pytest.raises(ConfigurationError, match="did you mean 'out-of-band'"):
        config_for("outofband")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"condition": "outofband"}, "did you mean 'out-of-band'"),
        ({"steps": 100}, "steps must be a power of two; got 100"),
        ({"estimation": None}, "estimation must be of type EstimationConfig; got None"),
        (
            {"out_of_band": OutOfBandConfig(sampled_models=26)},
            "out_of_band.sampled_models must be at most estimation.population, 25; got 26",
        ),
        (
            {"condition": "in-band", "in_band": InBandConfig(best=26)},
            "in_band.best must be at most estimation.population, 25; got 26",
        ),
        (
            {"condition": "none", "genetic": GeneticConfig(elites=25)},
            "genetic.elites must be at most exploration.population - 1, 24; got 25",
        ),
        (
            {
                "out_of_band": OutOfBandConfig(inner_population=4),
                "genetic": GeneticConfig(elites=4),
            },
            "genetic.elites must be at most out_of_band.inner_population - 1, 3; got 4",
        ),
    ],
)
def test_bad_paper_settings_are_refused(settings, message):
    with pytest.raises(ConfigurationError, match=message):
        PaperConfig(**settings)


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        (OutOfBandConfig, {"sampled_models": 0}, r"^out_of_band.sampled_models must be a whole"),
        (InBandConfig, {"best": 0}, r"^in_band.best must be a whole number of at least 1"),
        (InBandConfig, {"confidence": 1.5}, r"^in_band.confidence must be .* in \[0, 1\]"),
        (InBandConfig, {"extension": -0.1}, r"^in_band.extension must be .* in \[0, 1\]"),
        (InBandConfig, {"dynamic_split": 1}, r"^in_band.dynamic_split must be True or False"),
        (GeneticConfig, {"coding": "grey"}, r"^genetic.coding .* did you mean 'gray'"),
        (GeneticConfig, {"crossover": "two_point"}, r"^genetic.crossover .* mean 'two-point'"),
        (GeneticConfig, {"crossover_rate": 2}, r"^genetic.crossover_rate must be .* in \[0, 1\]"),
        (GeneticConfig, {"mutations": -1.0}, r"^genetic.mutations must be a finite number"),
        (GeneticConfig, {"elites": -1}, r"^genetic.elites must be a whole number of at least 0"),
        (ExplorationConfig, {"initial_angles": "none"}, r"^exploration.initial_angles must be one"),
    ],
)
def test_settings_of_a_phase_are_checked_where_they_are_made(kind, settings, message):
    with pytest.raises(ConfigurationError, match=message):
        kind(**settings)


def test_more_mutations_than_bits_are_refused():
    config = replace(QUICK, genetic=GeneticConfig(mutations=18.5))
    with pytest.raises(ConfigurationError, match=r"genetic.mutations must be at most .* bits, 18;"):
        eea_of(config)


@pytest.mark.parametrize(
    "settings",
    [{"steps": 15}, {"noise": 0.0}, {"alternatives": "maybe"}, {"nuisances": "lag"}],
)
def test_bad_joint_settings_are_refused(settings):
    with pytest.raises(ConfigurationError, match=next(iter(settings))):
        JointConfig(**settings)
