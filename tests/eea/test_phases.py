"""Exploration and estimation on the fake robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eea.core.behavior import BehaviorConfig, summarize
from eea.core.checks import ConfigurationError, TargetError
from eea.core.conditions import Ideal, NoInference, OutOfBandConfig
from eea.core.config import CONDITIONS, EEAConfig
from eea.core.estimation import Estimation, EstimationConfig
from eea.core.experiment import Context, Experiment, Trials
from eea.core.exploration import Exploration, ExplorationConfig
from eea.core.genetic import GeneticConfig
from eea.core.model_evaluator import DIVERGED, ModelEvaluator
from fake_fish import (
    ACTIONS,
    MODELS,
    STEPS,
    TRUTH,
    FakeLog,
    FakeRevealingTarget,
    FakeSimulator,
    fake_eea,
)

BEHAVIOR = BehaviorConfig()


def explore(
    config: ExplorationConfig, simulator: FakeSimulator | None = None, seed: int = 0
) -> Exploration:
    evaluator = ModelEvaluator(simulator or FakeSimulator(), BEHAVIOR, STEPS, 3)
    return Exploration(ACTIONS, 3, evaluator, config, GeneticConfig(), np.random.default_rng(seed))


def bodies(count: int, seed: int = 0) -> np.ndarray:
    return MODELS.decode(MODELS.random(count, np.random.default_rng(seed)))


def test_exploration_finds_more_disagreement_than_chance():
    models = bodies(10)
    command, act_fit = explore(ExplorationConfig()).run(models, np.zeros(10))
    _, first = explore(ExplorationConfig(generations=1)).run(models, np.zeros(10))
    assert act_fit >= first
    assert (command >= ACTIONS.low).all()
    assert (command <= ACTIONS.high).all()


def test_exploration_is_the_double_loop_over_actions_and_models():
    models, simulator = bodies(6), FakeSimulator()
    command, act_fit = explore(ExplorationConfig(5, 3), simulator).run(models, np.zeros(6))
    alike = [
        summarize(
            FakeSimulator().simulate(Trials(m[None], command[None], np.zeros((1, 3)))), BEHAVIOR
        )[0]
        for m in models
    ]
    apart = [np.abs(alike[i] - alike[j]).mean() / 100 for i in range(6) for j in range(i)]
    assert act_fit == pytest.approx(np.mean(apart))
    assert simulator.sizes[0] == 5 * 6
    assert simulator.calls == 3


def test_only_the_best_models_have_a_say_if_so_configured():
    models, simulator = bodies(8), FakeSimulator()
    fitness = np.array([0.0, 0.9, 0.1, 0.8, 0.2, 0.3, 0.4, 0.5])
    chosen = explore(ExplorationConfig(best_models=2), simulator).run(models, fitness)
    alone = explore(ExplorationConfig()).run(models[[1, 3]], fitness[[1, 3]])
    assert simulator.sizes[0] == 25 * 2
    assert np.array_equal(chosen[0], alone[0])


def test_models_explore_from_the_zero_pose_or_a_common_random_one():
    class Watch(FakeSimulator):
        def simulate(self, trials):
            self.poses = np.unique(trials.angles, axis=0)
            return super().simulate(trials)

    for pose, moved in (("zero", False), ("common_random", True)):
        simulator = Watch()
        explore(ExplorationConfig(pose=pose), simulator).run(bodies(4), np.zeros(4))
        assert simulator.poses.shape == (1, 3)
        assert simulator.poses.any() == moved


def test_an_action_that_cannot_be_simulated_is_not_chosen():
    class Fragile(FakeSimulator):
        def simulate(self, trials):
            log = super().simulate(trials)
            log.gyro[trials.commands[:, 0] > 0] = np.nan
            return log

    command, act_fit = explore(ExplorationConfig(), Fragile()).run(bodies(5), np.zeros(5))
    assert command[0] <= 0
    assert act_fit > 0


def experiments(count: int) -> list[Experiment]:
    target, rng, made = FakeRevealingTarget(0), np.random.default_rng(0), []
    for _ in range(count):
        command = rng.uniform(ACTIONS.low, ACTIONS.high)
        behavior = summarize(target.perform(command), BEHAVIOR)[0]
        made.append(Experiment(command, behavior, Context.unknown(3, 0), target.start_angles))
    for old in made[:-1]:
        old.context = Context.known(old.true_angles)
    return made


def estimate(config: EstimationConfig, simulator: FakeSimulator | None = None) -> Estimation:
    evaluator = ModelEvaluator(simulator or FakeSimulator(), BEHAVIOR, STEPS, 3)
    return Estimation(MODELS, evaluator, config, GeneticConfig(), np.random.default_rng(0))


def test_estimation_finds_a_body_that_explains_the_experiments():
    estimation = estimate(EstimationConfig())
    morphology, mod_fit = estimation.run(experiments(3), Ideal(), np.random.default_rng(0))
    assert mod_fit == estimation.population.fitness.max() > 0.95
    assert np.abs(morphology - TRUTH).mean() < 0.1


def test_a_generation_runs_as_one_batch_and_forgets_nothing_it_may_keep():
    simulator = FakeSimulator()
    estimation = estimate(EstimationConfig(population=25, generations=10), simulator)
    estimation.run(experiments(3), Ideal(), np.random.default_rng(0))
    assert simulator.calls == 10
    assert simulator.sizes[0] == 25 * 3
    assert max(simulator.sizes[1:]) < 25 * 3  # at least the elite is known
    forgetful = FakeSimulator()
    estimation = estimate(EstimationConfig(generations=10, remember=False), forgetful)
    estimation.run(experiments(3), Ideal(), np.random.default_rng(0))
    assert forgetful.sizes == [25 * 3] * 10


@pytest.mark.parametrize("condition", CONDITIONS)
def test_memory_changes_no_bit_of_any_result(condition):
    config = EEAConfig(
        condition=condition,
        steps=STEPS,
        rounds=4,
        exploration=ExplorationConfig(10, 5),
        estimation=EstimationConfig(population=12, generations=30),
        out_of_band=OutOfBandConfig(period=7, inner_population=6, inner_generations=4, revisit=1),
    )
    runs = []
    for remember in (True, False):
        estimation = replace(config.estimation, remember=remember)
        result = fake_eea(replace(config, estimation=estimation)).run()
        runs.append([replace(r, seconds=0.0, trials=0) for r in result.rounds])
        if remember:
            trials = sum(r.trials for r in result.rounds)
    assert runs[0] == runs[1]
    assert trials <= sum(r.trials for r in result.rounds)


def test_the_population_lives_on_unless_it_is_reseeded():
    for carry_over, same in (("continue", True), ("reseed", False)):
        estimation = estimate(EstimationConfig(generations=1, carry_over=carry_over))
        first = estimation.population.models
        made = experiments(2)
        estimation.run(made[:1], Ideal(), np.random.default_rng(0))
        assert np.array_equal(estimation.population.models, first)
        estimation.run(made, Ideal(), np.random.default_rng(0))
        assert np.array_equal(estimation.population.models, first) == same


def test_what_was_learnt_of_an_undone_experiment_is_forgotten():
    # Both begin arms back, so nothing but the behaviour tells the second from the third.
    first, undone, second = experiments(3)
    found = []
    for interrupted in (True, False):
        rng = np.random.default_rng(0)
        evaluator = ModelEvaluator(FakeSimulator(), BEHAVIOR, STEPS, 3)
        config = EstimationConfig(generations=8)
        estimation = Estimation(MODELS, evaluator, config, GeneticConfig(), rng)
        estimation.run([first], NoInference(), rng)
        saved, drawn = estimation.population, rng.bit_generator.state
        if interrupted:
            estimation.run([first, undone], NoInference(), rng)
            estimation.go_back(saved)
            rng.bit_generator.state = drawn
        found.append(estimation.run([first, second], NoInference(), rng))
    assert found[0][1] == found[1][1]
    assert np.array_equal(found[0][0], found[1][0])


def test_a_body_that_cannot_be_simulated_loses():
    class Fragile(FakeSimulator):
        def simulate(self, trials):
            log = super().simulate(trials)
            log.gyro[trials.models[:, 0] > 0.3] = np.inf  # the truth's too
            return log

    estimation = estimate(EstimationConfig(generations=5), Fragile())
    morphology, mod_fit = estimation.run(experiments(2), Ideal(), np.random.default_rng(0))
    assert morphology[0] <= 0.3
    assert DIVERGED < mod_fit <= 1


@pytest.mark.parametrize("steps", [STEPS // 2, STEPS + 1])
def test_a_simulator_must_log_all_steps(steps):
    estimation = estimate(EstimationConfig(), FakeSimulator(steps))
    with pytest.raises(TargetError, match=f"simulator must log trials of 64 .* logged {steps}"):
        estimation.run(experiments(1), Ideal(), np.random.default_rng(0))


def test_a_simulator_must_answer_every_trial():
    class Lazy(FakeSimulator):
        def simulate(self, trials):
            log = super().simulate(trials)
            return FakeLog(log.rpy[1:], log.gyro[1:])

    with pytest.raises(TargetError, match="a log for each of 75 trials; it returned 74"):
        estimate(EstimationConfig(), Lazy()).run(experiments(3), Ideal(), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ExplorationConfig(population=1), "exploration.population"),
        (lambda: ExplorationConfig(generations=0), "exploration.generations"),
        (lambda: ExplorationConfig(pose="zeros"), "did you mean 'zero'"),
        (lambda: ExplorationConfig(best_models=1), "exploration.best_models"),
        (lambda: EstimationConfig(population=1), "estimation.population"),
        (lambda: EstimationConfig(generations=2.5), "estimation.generations"),
        (lambda: EstimationConfig(carry_over="continued"), "did you mean 'continue'"),
        (lambda: EstimationConfig(remember="no"), "estimation.remember must be True or False"),
    ],
)
def test_bad_settings_are_refused(make, message):
    with pytest.raises(ConfigurationError, match=message):
        make()
