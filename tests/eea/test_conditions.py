from __future__ import annotations

import numpy as np
import pytest

from eea.core.angles import circular_distance
from eea.core.behavior import BehaviorConfig, summarize
from eea.core.bits import pose_layout
from eea.core.checks import ConfigurationError
from eea.core.conditions import (
    Ideal,
    InBand,
    InBandConfig,
    NoInference,
    OutOfBand,
    OutOfBandConfig,
)
from eea.core.experiment import Context, Experiment, Trials
from eea.core.genetic import GeneticConfig
from eea.core.model_evaluator import ModelEvaluator
from fake_fish import ACTIONS, MODELS, STEPS, TRUTH, FakeSimulator

COMMAND = np.array([0.4, -0.3, 0.8])
POSE = np.array([2.5, -0.7, 3.0])


def experiment(pose: np.ndarray = POSE) -> Experiment:
    log = FakeSimulator().simulate(Trials(TRUTH[None], COMMAND[None], pose[None]))
    behavior = summarize(log, BehaviorConfig())[0]
    return Experiment(COMMAND, behavior, Context.unknown(3, 0.0), pose)


def test_without_inference_fins_begin_arms_back():
    newest = experiment()
    NoInference().begin([newest], 100)
    assert newest.context.fixed
    assert newest.context.min_angle.tolist() == [0.0, 0.0, 0.0]


def test_ideal_knows_the_truth():
    newest = experiment()
    Ideal().begin([newest], 100)
    assert newest.context.fixed
    assert np.array_equal(newest.context.min_angle, POSE)


# Five models' fits to an earlier and to the newest experiment, and where they began the newest.
SIMILARITIES = np.array([[1.0, 0.1], [0.9, 0.8], [0.0, 0.9], [0.1, 0.7], [1.0, 0.2]])
ANGLES = np.zeros((5, 2, 3))
ANGLES[:, 1] = np.array([0.0, 3.0, -3.0, 3.1, 1.0])[:, None]


def in_band(config: InBandConfig, generations: int = 100) -> tuple[InBand, Experiment]:
    strategy, newest = InBand(config), experiment()
    strategy.begin([experiment(), newest], generations)
    return strategy, newest


def test_in_band_begins_with_no_range():
    _, newest = in_band(InBandConfig())
    assert newest.context.confidence == 0.5
    assert np.allclose(newest.context.max_angle - newest.context.min_angle, 2 * np.pi)


def test_in_band_takes_the_range_of_the_three_that_fit_the_newest_best():
    strategy, newest = in_band(InBandConfig())
    strategy.after_generation(0, ANGLES, SIMILARITIES)
    assert newest.context.min_angle == pytest.approx([3.0] * 3)
    assert newest.context.max_angle == pytest.approx([2 * np.pi - 3.0] * 3)
    assert newest.context.confidence == 0.5
    strategy.end()
    assert newest.context.confidence == 1.0
    assert newest.context.min_angle == pytest.approx([3.0] * 3)


def test_in_band_options_change_the_range():
    strategy, newest = in_band(InBandConfig(rank_by="overall"))
    strategy.after_generation(0, ANGLES, SIMILARITIES)  # models 1, 4 and 0
    assert newest.context.min_angle == pytest.approx([0.0] * 3)
    assert newest.context.max_angle == pytest.approx([3.0] * 3)

    strategy, newest = in_band(InBandConfig(inclusion="linear"))
    strategy.after_generation(0, ANGLES, SIMILARITIES)
    assert newest.context.min_angle == pytest.approx([-3.0] * 3)
    assert newest.context.max_angle == pytest.approx([3.1] * 3)

    strategy, newest = in_band(InBandConfig(k=1))
    strategy.after_generation(0, ANGLES, SIMILARITIES)
    assert np.array_equal(newest.context.min_angle, newest.context.max_angle)

    strategy, newest = in_band(InBandConfig(extension=0.2))
    strategy.after_generation(0, ANGLES, SIMILARITIES)
    width = 2 * np.pi - 6.0
    assert newest.context.min_angle == pytest.approx([3.0 - 0.2 * width] * 3)
    assert newest.context.max_angle == pytest.approx([3.0 + 1.2 * width] * 3)


def test_the_dynamic_split_reaches_certainty_by_the_middle_of_the_round():
    strategy, newest = in_band(InBandConfig(dynamic_split=True), generations=100)
    confidences = [newest.context.confidence]
    for generation in range(100):
        strategy.after_generation(generation, ANGLES, SIMILARITIES)
        confidences.append(newest.context.confidence)
    assert confidences[0] == 0.5
    assert confidences[25] == pytest.approx(0.75)
    assert confidences[50:] == [1.0] * 51


def out_of_band(
    config: OutOfBandConfig | None = None, seed: int = 0
) -> tuple[OutOfBand, FakeSimulator]:
    simulator = FakeSimulator()
    evaluator = ModelEvaluator(simulator, BehaviorConfig(), STEPS, 3)
    rng = np.random.default_rng(seed)
    poses = pose_layout(ACTIONS.names)
    return OutOfBand(config or OutOfBandConfig(), poses, evaluator, GeneticConfig(), rng), simulator


def test_opt_ang_finds_the_pose_if_the_models_are_right():
    strategy, _ = out_of_band()
    pose = strategy.opt_ang(np.tile(TRUTH, (4, 1)), experiment())
    assert circular_distance(pose, POSE).max() < 0.15


def test_inference_happens_at_generations_0_35_and_70():
    strategy, simulator = out_of_band()
    newest = experiment()
    strategy.begin([newest], 100)
    models = MODELS.decode(MODELS.random(5, np.random.default_rng(0)))
    paused = []
    for generation in range(100):
        before = simulator.calls
        strategy.before_generation(generation, models)
        assert newest.context.fixed
        if simulator.calls > before:
            paused.append(generation)
    assert paused == [0, 35, 70]


def test_population_generations_and_sample_bound_the_trials():
    config = OutOfBandConfig(inner_population=7, inner_generations=3, sampled_models=2)
    strategy, simulator = out_of_band(config)
    models = MODELS.decode(MODELS.random(30, np.random.default_rng(0)))
    strategy.opt_ang(models, experiment())
    assert simulator.calls == 3
    assert simulator.sizes[0] == 7 * 2
    strategy, simulator = out_of_band(OutOfBandConfig(inner_population=7, inner_generations=1))
    strategy.opt_ang(models, experiment())
    assert simulator.sizes == [7 * 30]


@pytest.mark.parametrize(("pose_fitness", "chosen"), [("mean", False), ("best", True)])
def test_a_pose_is_judged_by_the_mean_or_the_best_model(pose_fitness, chosen):
    # One true model among models without fins: for the mean, poses matter as little as for it.
    strategy, _ = out_of_band(OutOfBandConfig(pose_fitness=pose_fitness))
    models = np.stack([TRUTH, np.zeros(9), np.zeros(9)])
    layout = pose_layout(ACTIONS.names)
    fit = strategy._pose_fitness(layout.decode(layout.encode(POSE[None])), models, experiment())
    assert (fit[0] > 0.9) == chosen


def test_a_warm_start_never_loses_what_it_began_with():
    config = OutOfBandConfig(inner_population=2, inner_generations=1)
    strategy, _ = out_of_band(config)
    newest = experiment()
    models = TRUTH[None]
    assert circular_distance(strategy.opt_ang(models, newest, POSE), POSE).max() < 0.02
    for warm in (False, True):
        strategy, _ = out_of_band(OutOfBandConfig(2, 2, 1, warm_start=warm))
        strategy.begin([newest], 10)
        newest.context = Context.known(POSE)
        strategy.before_generation(2, models)
        assert (circular_distance(newest.context.min_angle, POSE).max() < 0.02) == warm


def test_revisiting_mends_a_pose_that_was_locked_in_wrongly():
    for revisit in (0, 1):
        strategy, _ = out_of_band(OutOfBandConfig(revisit=revisit))
        old, newest = experiment(), experiment(-POSE)
        old.context = Context.known(POSE + 1.0)
        strategy.begin([old, newest], 100)
        strategy.before_generation(0, TRUTH[None])
        error = circular_distance(old.context.min_angle, POSE).max()
        assert (error < 0.15) == bool(revisit)
        assert circular_distance(newest.context.min_angle, -POSE).max() < 0.15


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: InBandConfig(k=0), "in_band.k"),
        (lambda: InBandConfig(rank_by="latest"), "in_band.rank_by must be one of newest, overall"),
        (lambda: InBandConfig(confidence=1.2), r"in_band.confidence .* in \[0, 1\]"),
        (lambda: InBandConfig(extension=-0.1), "in_band.extension"),
        (lambda: InBandConfig(inclusion="circle"), "did you mean 'circular'"),
        (lambda: OutOfBandConfig(period=0), "out_of_band.period"),
        (lambda: OutOfBandConfig(inner_population=1), "out_of_band.inner_population"),
        (lambda: OutOfBandConfig(inner_generations=0), "out_of_band.inner_generations"),
        (lambda: OutOfBandConfig(sampled_models=0), "out_of_band.sampled_models"),
        (lambda: OutOfBandConfig(pose_fitness="max"), "out_of_band.pose_fitness"),
        (lambda: OutOfBandConfig(revisit=-1), "out_of_band.revisit"),
        (lambda: InBandConfig(dynamic_split="no"), "in_band.dynamic_split must be True or False"),
        (lambda: OutOfBandConfig(warm_start=1), "out_of_band.warm_start must be True or False"),
    ],
)
def test_bad_settings_are_refused(make, message):
    with pytest.raises(ConfigurationError, match=message):
        make()
