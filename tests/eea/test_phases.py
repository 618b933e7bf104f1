"""Exploration and estimation on the fake robot."""

from __future__ import annotations

import numpy as np
import pytest

from eea.core.behavior import summarize
from eea.core.checks import TargetError
from eea.core.conditions import Ideal
from eea.core.estimation import Estimation, EstimationConfig, SimilarityTable
from eea.core.experiment import Context, Experiment, RecordedLog, Trials
from eea.core.exploration import Exploration, ExplorationConfig
from eea.core.genetic import GeneticConfig
from eea.core.model_evaluator import DIVERGED, ModelEvaluator
from fake_fish import ACTIONS, MODELS, STEPS, TRUTH, FakeRevealingTarget, FakeSimulator


def explored(models, config=None, simulator=None):
    """Return the command and ACT_FIT of an exploration."""
    evaluator = ModelEvaluator(simulator or FakeSimulator(), STEPS, 3)
    made = Exploration(ACTIONS, 3, evaluator, config or ExplorationConfig(), GeneticConfig())
    return made.disputed(models, np.random.default_rng(0))


def bodies(count):
    return MODELS.decode(MODELS.random(count, np.random.default_rng(0)))


def experiments(count):
    target, rng, made = FakeRevealingTarget(0), np.random.default_rng(0), []
    for _ in range(count):
        command = rng.uniform(ACTIONS.low, ACTIONS.high)
        behavior = summarize(target.perform(command))[0]
        context = Context.known(target.start_angles)
        made.append(Experiment(command, behavior, context, target.start_angles))
    return tuple(made)


def estimation(config=None, simulator=None):
    evaluator = ModelEvaluator(simulator or FakeSimulator(), STEPS, 3)
    return Estimation(MODELS, evaluator, config or EstimationConfig(), GeneticConfig())


def evolved(made, count):
    """Return the population after a round with ``count`` experiments."""
    rng = np.random.default_rng(0)
    return made.evolve(made.random(rng), experiments(count), Ideal(), rng, rng)[0]


def test_exploration_increases_disagreement():
    models = bodies(10)
    command, act_fit = explored(models)
    assert act_fit >= explored(models, ExplorationConfig(generations=1))[1]
    assert (command >= ACTIONS.low).all()
    assert (command <= ACTIONS.high).all()


def test_act_fit_is_the_mean_over_pairs_of_models_from_zero_angles():
    models, simulator = bodies(6), FakeSimulator()
    command, act_fit = explored(models, ExplorationConfig(5, 3), simulator)
    alike = [
        summarize(FakeSimulator().simulate(Trials(m[None], command[None], np.zeros((1, 3)))))[0]
        for m in models
    ]
    apart = [np.abs(alike[i] - alike[j]).mean() / 100 for i in range(6) for j in range(i)]
    assert act_fit == pytest.approx(np.mean(apart))
    assert simulator.sizes[0] == 5 * 6
    assert simulator.calls == 3


def test_command_under_which_models_diverge_is_not_chosen():
    class Fragile(FakeSimulator):
        def simulate(self, trials):
            log = super().simulate(trials)
            log.gyro[trials.commands[:, 0] > 0] = np.nan
            return log

    command, act_fit = explored(bodies(5), simulator=Fragile())
    assert command[0] <= 0
    assert act_fit > 0


def test_estimation_finds_body_that_explains_experiments():
    population = evolved(estimation(), 3)
    model, mod_fit = population.best
    assert mod_fit == population.fitness.max() > 0.95
    assert np.abs(model - TRUTH).mean() < 0.1


def test_generation_is_one_batch_without_known_similarities():
    simulator = FakeSimulator()
    evolved(estimation(EstimationConfig(25, 10), simulator), 3)
    assert simulator.calls == 10
    assert simulator.sizes[0] == 25 * 3
    assert max(simulator.sizes[1:]) < 25 * 3  # at least the elite is known


def test_similarity_table_changes_no_bit(monkeypatch):
    found = []
    for forgetful in (False, True):
        if forgetful:
            forget = lambda self, some: np.full((99, len(some)), np.nan)  # noqa: E731, ARG005
            monkeypatch.setattr(SimilarityTable, "columns", forget)
            monkeypatch.setattr(SimilarityTable, "rows", lambda _, genomes: np.arange(len(genomes)))
            monkeypatch.setattr(SimilarityTable, "only", lambda table, _: table)
        found.append(evolved(estimation(EstimationConfig(12, 20)), 3))
    assert np.array_equal(found[0].genomes, found[1].genomes)
    assert np.array_equal(found[0].fitness, found[1].fitness)


def test_population_survives_between_rounds():
    made, rng = estimation(EstimationConfig(generations=1)), np.random.default_rng(0)
    first = made.random(rng)
    second, _ = made.evolve(first, experiments(1), Ideal(), rng, rng)
    assert np.array_equal(second.models, first.models)
    assert np.isnan(first.fitness).all()


def test_diverging_body_loses():
    class Fragile(FakeSimulator):
        def simulate(self, trials):
            log = super().simulate(trials)
            log.gyro[trials.models[:, 0] > 0.3] = np.inf  # the truth's too
            return log

    model, mod_fit = evolved(estimation(EstimationConfig(generations=5), Fragile()), 2).best
    assert model[0] <= 0.3
    assert DIVERGED < mod_fit <= 1


def test_simulator_must_log_every_trial_and_step():
    class Lazy(FakeSimulator):
        def simulate(self, trials):
            return RecordedLog(super().simulate(trials).gyro[1:])

    with pytest.raises(TargetError, match=r"simulator must log trials of 64 .* logged 65"):
        evolved(estimation(simulator=FakeSimulator(STEPS + 1)), 1)
    with pytest.raises(TargetError, match="a log for each of 75 trials; it returned 74"):
        evolved(estimation(simulator=Lazy()), 3)
