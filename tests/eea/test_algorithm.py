"""The algorithm on robots of a few lines: conditions, phases, widths, and what it refuses."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eea.core import algorithm, genetic
from eea.core.algorithm import EEA
from eea.core.angles import circular_distance
from eea.core.behavior import summarize
from eea.core.checks import ConfigurationError, TargetError
from eea.core.conditions import first_context, infer_angles, models_range, opt_ang
from eea.core.config import (
    CONDITIONS,
    EstimationConfig,
    ExplorationConfig,
    GeneticConfig,
    InBandConfig,
    OutOfBandConfig,
    PaperConfig,
)
from eea.core.experiment import (
    Context,
    Experiment,
    Performed,
    RecordedLog,
    Simulator,
    Trials,
    perform_angles,
)
from eea.core.genetic import next_generation
from eea.core.genome import action_layout, model_layout
from eea.core.model_evaluator import DIVERGED_SIMILARITY, ModelEvaluator
from eea.core.problem import Problem
from eea.core.session import STREAMS, streams
from eea.study.arms import FIGURES, figure_config
from fake_fish import (
    ACTIONS,
    MODELS,
    PROBLEM,
    STEPS,
    TRUTH,
    FakeRevealingTarget,
    FakeSimulator,
    FakeTarget,
)
from fake_fish import fake_eea as eea_of

QUICK = PaperConfig(
    steps=STEPS,
    rounds=3,
    exploration=ExplorationConfig(8, 4),
    estimation=EstimationConfig(population=10, generations=15),
)


def timeless(records):
    return [replace(record, seconds=0.0) for record in records]


@pytest.mark.parametrize("condition", CONDITIONS)
def test_same_seed_gives_same_run(condition):
    config = QUICK.under(condition)
    runs = [timeless(eea_of(config, seed).run().rounds) for seed in (3, 3, 4)]
    assert runs[0] == runs[1]
    assert runs[2][-1].morphology != runs[0][-1].morphology


@pytest.mark.parametrize(
    ("condition", "choice"),
    [
        *(("in-band", InBandConfig(**one)) for one in (
            {"best": 5}, {"confidence": 0.9}, {"dynamic_split": True}, {"extension": 0.2},
        )),
        *(("ideal", GeneticConfig(**one)) for one in (
            {"coding": "binary"}, {"crossover": "two-point"}, {"crossover_rate": 0.5},
            {"mutations": 2.5}, {"elites": 0},
        )),
        ("ideal", ExplorationConfig(8, 4, initial_angles="random")),
    ],
)  # fmt: skip
def test_every_choice_of_the_paper_changes_a_run(condition, choice):
    part = {InBandConfig: "in_band", GeneticConfig: "genetic", ExplorationConfig: "exploration"}
    config = QUICK.under(condition)
    other = replace(config, **{part[type(choice)]: choice})
    runs = [timeless(eea_of(each).run().rounds) for each in (config, other)]
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


def test_streams_differ_and_repeat():
    drawn = {name: rng.random() for name, rng in streams(0).items()}
    assert tuple(drawn) == STREAMS
    assert len(set(drawn.values())) == 4
    assert drawn == {name: rng.random() for name, rng in streams(0).items()}


def test_records_hold_commands_fitnesses_and_errors():
    target = FakeRevealingTarget()
    eea, seen = EEA(target, FakeSimulator(), PROBLEM, QUICK, 0, TRUTH), []
    assert (eea.result.stopped, eea.result.to_dict()["morphology"]) == ("interrupted", None)
    with pytest.raises(TargetError, match="no round"):
        _ = eea.result.model
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
    hidden = EEA(FakeTarget(0), FakeSimulator(), PROBLEM, QUICK, 0).run()
    assert [r.morphology for r in hidden.rounds] == [r.morphology for r in seen]
    assert all(r.objective_fitness is None and r.angle_error is None for r in hidden.rounds)
    assert (hidden.chance, hidden.mid_range, hidden.nearest) == (None, None, None)


class Steady(FakeTarget):
    """Its hidden angles follow from the command, so that a repeated round is the same."""

    def perform(self, command):
        self.commands.append(command)
        angles = 3.0 * np.sin(1000.0 * command)
        return self._simulator.simulate(Trials(TRUTH[None], command[None], angles[None]))


class Interrupted(FakeSimulator):
    """Raises KeyboardInterrupt in one of its calls."""

    def __init__(self, call):
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


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        ({"out_of_band": OutOfBandConfig(sampled_models=26)}, "out_of_band.sampled_models"),
        ({"condition": "in-band", "in_band": InBandConfig(best=26)}, "in_band.best"),
        ({"condition": "none", "genetic": GeneticConfig(elites=25)}, "exploration.population - 1"),
        (
            {
                "out_of_band": OutOfBandConfig(inner_population=4),
                "genetic": GeneticConfig(elites=4),
            },
            "out_of_band.inner_population - 1, 3; got 4",
        ),
        ({"condition": "none", "genetic": GeneticConfig(mutations=18.5)}, "genetic.mutations"),
    ],
)
def test_settings_that_do_not_fit_together_are_refused(settings, name):
    with pytest.raises(ConfigurationError, match=name):
        eea_of(PaperConfig(**settings))


def evolved(simulator=None, rounds=1, **settings):
    """Return the algorithm after some rounds under the Ideal condition."""
    config = PaperConfig(condition="ideal", steps=STEPS, rounds=rounds, **settings)
    eea = EEA(FakeRevealingTarget(0), simulator or FakeSimulator(), PROBLEM, config, 0, TRUTH)
    eea.run()
    return eea


def disputed(simulator=None, **exploration):
    """Return the command and ACT_FIT of the second of two rounds, and the models of the first."""
    settings = {"exploration": ExplorationConfig(**exploration), "estimation": FEW}
    first, both = evolved(**settings), evolved(simulator, 2, **settings)
    record = both.result.rounds[1]
    models = MODELS.decode(first._kept[0].genomes)
    return np.array(record.command), record.action_fitness, models


FEW = EstimationConfig(6, 2)


def test_exploration_increases_disagreement():
    command, act_fit, _ = disputed()
    assert act_fit >= disputed(generations=1)[1]
    assert (command >= ACTIONS.low).all()
    assert (command <= ACTIONS.high).all()


class Fragile(FakeSimulator):
    """A robot that diverges for some of the trials."""

    def __init__(self, diverges):
        super().__init__()
        self._diverges = diverges

    def simulate(self, trials):
        log = super().simulate(trials)
        log.gyro[self._diverges(trials)] = np.nan
        return log


def test_what_diverges_is_not_chosen():
    command, act_fit, _ = disputed(Fragile(lambda trials: trials.commands[:, 0] > 0))
    assert command[0] <= 0
    assert act_fit > 0
    large = Fragile(lambda trials: trials.models[:, 0] > 0.3)  # the truth's too
    record = evolved(large, estimation=EstimationConfig(generations=5)).result.rounds[-1]
    assert record.morphology[0] <= 0.3
    assert DIVERGED_SIMILARITY < record.model_fitness <= 1


def test_act_fit_is_the_mean_over_pairs_of_models_from_zero_angles():
    command, act_fit, models = disputed(population=5, generations=3)
    alike = [
        summarize(FakeSimulator().simulate(Trials(m[None], command[None], np.zeros((1, 3)))))[0]
        for m in models
    ]
    apart = [np.abs(alike[i] - alike[j]).mean() / 100 for i in range(6) for j in range(i)]
    assert act_fit == pytest.approx(np.mean(apart))


def test_estimation_finds_body_that_explains_experiments():
    record = evolved(rounds=3).result.rounds[-1]
    assert record.model_fitness > 0.95
    assert np.abs(np.array(record.morphology) - TRUTH).mean() < 0.1


def test_generation_is_one_batch_without_known_similarities():
    simulator = FakeSimulator()
    evolved(simulator, estimation=EstimationConfig(25, 10))
    assert simulator.calls == 10
    assert simulator.sizes[0] == 25
    assert max(simulator.sizes[1:]) < 25  # at least the elite is known


def test_known_similarities_change_no_bit(monkeypatch):
    settings = {"rounds": 3, "estimation": EstimationConfig(12, 20)}
    knowing = evolved(**settings)
    simulate = EEA._similarities
    monkeypatch.setattr(EEA, "_similarities", lambda self, *given: simulate(self, *given[:3], []))
    forgetful = evolved(**settings)
    assert np.array_equal(knowing._kept[0].genomes, forgetful._kept[0].genomes)
    for one, other in zip(knowing.result.rounds, forgetful.result.rounds, strict=True):
        assert one.trials < other.trials
        assert replace(one, trials=0, seconds=0.0) == replace(other, trials=0, seconds=0.0)


def test_out_of_band_infers_at_generations_0_35_and_70(monkeypatch):
    config = PaperConfig(
        steps=STEPS, rounds=1, estimation=EstimationConfig(4, 100),
        out_of_band=OutOfBandConfig(inner_population=4, inner_generations=1),
    )  # fmt: skip
    events = []

    def noted(name, function, *arguments):
        events.append(name)
        return function(*arguments)

    for name in ("infer_angles", "perform_angles"):
        monkeypatch.setattr(algorithm, name, partial(noted, name, getattr(algorithm, name)))
    EEA(FakeRevealingTarget(0), FakeSimulator(), PROBLEM, config, 0, TRUTH).run()
    pauses = [i for i, name in enumerate(events) if name == "infer_angles"]
    assert [events[:i].count("perform_angles") for i in pauses] == [0, 35, 70]


def test_in_band_locks_its_range_after_the_round():
    config = PaperConfig("in-band", STEPS, 1, estimation=EstimationConfig(generations=2))
    eea = EEA(FakeRevealingTarget(0), FakeSimulator(), PROBLEM, config, 0, TRUTH)
    eea.run()
    context = eea._kept[0].experiments[-1].context
    assert context.confidence == 1.0
    assert (context.max_angle - context.min_angle < 2 * np.pi).all()


def test_population_survives_between_rounds():
    eea = evolved(rounds=2, estimation=EstimationConfig(generations=1))
    rngs = streams(0)
    assert np.array_equal(eea._kept[0].genomes, MODELS.random(25, rngs["estimation"]))


COMMAND = np.array([0.4, -0.3, 0.8])
POSE = np.array([2.5, -0.7, 3.0])


def experiment(context=None):
    log = FakeSimulator().simulate(Trials(TRUTH[None], COMMAND[None], POSE[None]))
    return Experiment(COMMAND, summarize(log)[0], context or Context.unknown(3, 0.0))


def test_first_contexts():
    for condition, pose in (("none", np.zeros(3)), ("ideal", POSE)):
        context = first_context(PaperConfig(condition=condition), 3, POSE)
        assert context.fixed
        assert np.array_equal(context.min_angle, pose)
    context = first_context(PaperConfig(condition="in-band"), 3, POSE)
    assert context.confidence == 0.5
    assert np.allclose(context.max_angle - context.min_angle, 2 * np.pi)


# What each choice makes of five models' similarities to the newest experiment and their angles in
# it: the low end and the high end of the best models' range, and the confidence.
@pytest.mark.parametrize(
    ("config", "progress", "low", "high", "confidence"),
    [
        (InBandConfig(), 0.0, 3.0, 2 * np.pi - 3.0, 0.5),
        (InBandConfig(best=1), 0.0, -3.0, -3.0, 0.5),
        (InBandConfig(best=4), 0.0, 1.0, 2 * np.pi - 3.0, 0.5),
        (InBandConfig(confidence=0.75), 0.0, 3.0, 2 * np.pi - 3.0, 0.75),
        (InBandConfig(best=4, extension=0.1), 0.0, 1.0 - 0.2283185, 3.5115037 - 2 * np.pi, 0.5),
        (InBandConfig(dynamic_split=True), 0.25, 3.0, 2 * np.pi - 3.0, 0.75),
        (InBandConfig(dynamic_split=True, confidence=0.2), 0.5, 3.0, 2 * np.pi - 3.0, 1.0),
        (InBandConfig(dynamic_split=True), 0.9, 3.0, 2 * np.pi - 3.0, 1.0),
    ],
)
def test_in_bands_choices_set_the_range_and_the_share_of_random_models(
    config, progress, low, high, confidence
):
    similarities = np.array([0.1, 0.8, 0.9, 0.7, 0.2])
    angles = np.tile(np.array([0.0, 3.0, -3.0, 3.1, 1.0])[:, None], 3)
    context = models_range(angles, similarities, config, progress)
    assert circular_distance(context.min_angle, low) == pytest.approx([0.0] * 3, abs=1e-6)
    assert circular_distance(context.max_angle, high) == pytest.approx([0.0] * 3, abs=1e-6)
    assert context.confidence == confidence


def evaluated():
    simulator = FakeSimulator()
    return ModelEvaluator(simulator, STEPS, 3), simulator


def test_opt_ang_finds_the_pose_if_the_models_are_right():
    evaluator, rng = evaluated()[0], np.random.default_rng(0)
    pose = opt_ang(
        np.tile(TRUTH, (4, 1)), experiment(), evaluator, OutOfBandConfig(), GeneticConfig(), rng
    )
    assert circular_distance(pose, POSE).max() < 0.15


def test_population_and_sample_bound_the_trials():
    for judges, count in ((3, 3), (None, 9)):
        evaluator, simulator = evaluated()
        config = OutOfBandConfig(inner_population=7, inner_generations=1, sampled_models=judges)
        bodies, rng = np.tile(TRUTH, (9, 1)), np.random.default_rng(0)
        opt_ang(bodies, experiment(), evaluator, config, GeneticConfig(), rng)
        assert simulator.sizes == [7 * count]


def test_revisit_updates_earlier_experiments():
    wrong = Context.known(np.zeros(3))
    for revisit in (0, 1):
        both, rng = (experiment(wrong), experiment()), np.random.default_rng(0)
        config = OutOfBandConfig(revisit=revisit)
        old, newest = infer_angles(both, TRUTH[None], evaluated()[0], config, GeneticConfig(), rng)
        moved = circular_distance(old.context.min_angle, POSE).max() < 0.3
        assert moved == bool(revisit)
        assert newest.context.fixed
        assert both[1].context.confidence == 0.0  # experiments are immutable


def with_context(context):
    return Experiment(np.zeros(3), np.zeros(2), context)


def test_a_known_pose_is_where_all_begin_and_costs_no_chance():
    rng = np.random.default_rng(0)
    angles = perform_angles([with_context(Context.known(POSE))] * 2, 5, rng)
    assert np.array_equal(angles, np.broadcast_to(POSE, (5, 2, 3)))
    assert rng.random() == np.random.default_rng(0).random()


def test_confidence_is_the_share_that_begin_in_the_range():
    context = Context(POSE, POSE + 0.1, 0.5)
    angles = perform_angles([with_context(context)], 20_000, np.random.default_rng(0))[:, 0]
    inside = ((angles >= POSE) & (angles <= POSE + 0.1)).all(axis=1)
    assert abs(inside.mean() - 0.5) < 0.02
    # The others are anywhere, independently of one another and of the range.
    others = angles[~inside]
    assert np.abs(np.cos(others).mean(axis=0)).max() < 0.03
    assert np.abs(np.sin(others).mean(axis=0)).max() < 0.03


@given(st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_a_locked_range_is_still_sampled(seed, width):
    context = Context(POSE, POSE + width, 1.0)
    angles = perform_angles([with_context(context)], 50, np.random.default_rng(seed))[:, 0]
    assert ((angles >= POSE) & (angles <= POSE + width)).all()
    assert width < 1e-6 or len(np.unique(angles[:, 0])) == 50


def test_only_certainty_about_one_pose_is_fixed():
    assert Context.known(POSE).fixed
    assert not Context(POSE, POSE, 0.5).fixed
    assert not Context(POSE, POSE + 0.1, 1.0).fixed
    assert not Context.unknown(3, 1.0).fixed


SHORT, SAMPLES = 16, 0.1 * np.arange(16)
GAINS = np.array([0.3, 0.8])
NARROW = PaperConfig(
    steps=SHORT,
    rounds=2,
    exploration=ExplorationConfig(5, 3),
    estimation=EstimationConfig(population=6, generations=5),
    out_of_band=OutOfBandConfig(2, 4, 3, revisit=1),
)


def problem(commands, hidden, axes):
    return Problem(
        models=model_layout([("gain", 1.0, 5), ("tone", 1.0, 5)]),
        actions=action_layout([(f"motor {i}", -1.0, 1.0) for i in range(commands)]),
        hidden=tuple(f"angle {i}" for i in range(hidden)),
        axes=axes,
    )


class Machine(Simulator):
    """Every motor and every hidden angle has a say in every axis."""

    def __init__(self, axes):
        self._axes = axes
        self.shapes: set[tuple[int, ...]] = set()

    def simulate(self, trials):
        b = len(trials)
        assert trials.models.shape[0] == trials.commands.shape[0] == trials.angles.shape[0] == b
        self.shapes.add((trials.models.shape[1], trials.commands.shape[1], trials.angles.shape[1]))
        axis = 1.0 + np.arange(self._axes)
        drive = (trials.commands * (1.0 + np.arange(trials.commands.shape[1]))).sum(axis=1)
        phase = (trials.angles * (1.0 + np.arange(trials.angles.shape[1]))).sum(axis=1)
        turn = drive[:, None, None] * SAMPLES[:, None] * axis + phase[:, None, None]
        gain, tone = trials.models.T[:, :, None, None]
        return RecordedLog(gyro=gain * np.sin(turn) + tone * np.cos(2.0 * turn))


class Robot:
    def __init__(self, hidden, axes):
        self._rng, self._hidden, self._machine = np.random.default_rng(0), hidden, Machine(axes)
        self.commands: list[np.ndarray] = []
        self.start_angles = np.zeros(hidden)

    def perform(self, command):
        self.commands.append(command)
        self.start_angles = self._rng.uniform(-np.pi, np.pi, self._hidden)
        trial = Trials(GAINS[None], command[None], self.start_angles[None])
        return self._machine.simulate(trial)


@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_width_runs_under_every_condition(condition):
    for commands, hidden, axes in itertools.product((1, 4), (1, 3), (1, 2)):
        machine, robot = Machine(axes), Robot(hidden, axes)
        config = NARROW.under(condition)
        eea = EEA(robot, machine, problem(commands, hidden, axes), config, 1, GAINS)
        for record, performed in zip(eea.run().rounds, robot.commands, strict=True):
            assert record.command == tuple(performed)
            assert len(record.command) == commands
            assert len(record.min_angle) == len(record.true_angles) == hidden
            assert len(record.morphology) == len(record.spread) == 2
            assert np.isfinite(record.model_fitness)
        assert len(robot.commands) == 2
        assert machine.shapes == {(2, commands, hidden)}
        # Coefficients of every axis, and no others, were compared.
        assert len(eea._kept[0].experiments[0].behavior) == axes * (SHORT // 2 + 1)


@pytest.mark.parametrize(
    ("commands", "hidden", "axes"), [(1, 1, 1), (1, 3, 1), (3, 1, 2), (2, 2, 3)]
)
def test_at_any_width_the_body_is_found_if_the_angles_are_known(commands, hidden, axes):
    config = replace(NARROW.under("ideal"), estimation=EstimationConfig(20, 40), rounds=3)
    eea = EEA(Robot(hidden, axes), Machine(axes), problem(commands, hidden, axes), config, 0, GAINS)
    assert eea.run().objective_fitness > 0.95


class Stubborn(Robot):
    """Executes half of what it is asked for, and says so, or says something else."""

    def __init__(self, says=None):
        super().__init__(1, 1)
        self._says = says

    def perform(self, command):
        return Performed(super().perform(0.5 * command), self._says or 0.5 * command)


def test_log_is_credited_to_the_executed_command():
    robot = Stubborn()
    rounds = EEA(robot, Machine(1), problem(2, 1, 1), NARROW, 0).run().rounds
    first = EEA(Robot(1, 1), Machine(1), problem(2, 1, 1), NARROW, 0).run().rounds[0]
    assert np.array_equal(rounds[0].command, 0.5 * np.array(first.command))
    assert [record.command for record in rounds] == [tuple(c) for c in robot.commands]
    assert all(record.action_fitness is None for record in rounds)  # it is the requested one's
    for executed in ([0.1], [0.1, np.nan]):
        with pytest.raises(TargetError, match="the target's executed command must"):
            EEA(Stubborn(executed), Machine(1), problem(2, 1, 1), NARROW).run()


@pytest.mark.parametrize(
    ("log", "said"),
    [
        (RecordedLog(np.zeros((2, 64, 3))), "the log of one trial; it returned 2"),
        (RecordedLog(np.full((64, 3), np.nan)), "must be finite"),
        (RecordedLog(np.zeros((65, 3))), "64 .*; it logged 65"),
        (RecordedLog(np.zeros((64, 1))), r"got \(1, 64, 1\) from the target"),
        (RecordedLog([[1.0], [2.0, 3.0]]), "ragged"),
        (None, "it returned None"),
    ],
)
def test_wrong_logs_of_a_target_are_refused(log, said):
    class Broken(FakeTarget):
        def perform(self, command):  # noqa: ARG002
            return log

    with pytest.raises(TargetError, match=said):
        EEA(Broken(), FakeSimulator(), PROBLEM, QUICK).run()


def test_the_ideal_condition_needs_revealed_angles():
    target = FakeTarget()
    with pytest.raises(TargetError, match="start_angles"):
        EEA(target, FakeSimulator(), PROBLEM, QUICK.under("ideal"))
    assert not target.commands


@pytest.mark.parametrize("angles", [None, [0.0, np.nan, 0.0]])
def test_revealed_angles_must_be_three_numbers(angles):
    class Confused(FakeTarget):
        @property
        def start_angles(self):
            return angles

    with pytest.raises(TargetError, match="the target's start_angles must"):
        EEA(Confused(), FakeSimulator(), PROBLEM, QUICK).run()


def test_a_simulator_must_log_every_trial_step_and_axis():
    class Lazy(FakeSimulator):
        def simulate(self, trials):
            return RecordedLog(super().simulate(trials).gyro[1:])

    with pytest.raises(TargetError, match=r"64 .* logged 65"):
        evolved(FakeSimulator(STEPS + 1))
    with pytest.raises(TargetError, match="25 trials; it returned 24"):
        evolved(Lazy())
    with pytest.raises(TargetError, match=r"got \(\d+, 16, 2\) from the simulator"):
        EEA(Robot(1, 1), Machine(2), problem(1, 1, 1), NARROW).run()
