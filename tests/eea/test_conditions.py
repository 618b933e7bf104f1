from __future__ import annotations

import numpy as np
import pytest

from eea.core.angles import circular_distance
from eea.core.behavior import summarize
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
from eea.core.genome import pose_layout
from eea.core.model_evaluator import ModelEvaluator
from fake_fish import ACTIONS, MODELS, STEPS, TRUTH, FakeSimulator

COMMAND = np.array([0.4, -0.3, 0.8])
POSE = np.array([2.5, -0.7, 3.0])


def experiment(context=None):
    log = FakeSimulator().simulate(Trials(TRUTH[None], COMMAND[None], POSE[None]))
    return Experiment(COMMAND, summarize(log)[0], context or Context.unknown(3, 0.0), POSE)


def test_first_contexts():
    for inference, pose in ((NoInference(), np.zeros(3)), (Ideal(), POSE)):
        context = inference.first_context(3, POSE)
        assert context.fixed
        assert np.array_equal(context.min_angle, pose)
    context = InBand(InBandConfig()).first_context(3, POSE)
    assert context.confidence == 0.5
    assert np.allclose(context.max_angle - context.min_angle, 2 * np.pi)


# Five models' sims to an earlier and to the newest experiment, and their angles in the newest.
SIMILARITIES = np.array([[1.0, 0.1], [0.9, 0.8], [0.0, 0.9], [0.1, 0.7], [1.0, 0.2]])
ANGLES = np.zeros((5, 2, 3))
ANGLES[:, 1] = np.array([0.0, 3.0, -3.0, 3.1, 1.0])[:, None]


def test_in_band_takes_the_range_of_the_models_that_fit_the_newest_experiment_best():
    inference, both = InBand(InBandConfig()), (experiment(), experiment())
    after = inference.after_generation(ANGLES, SIMILARITIES, both)
    context = after[-1].context
    assert context.min_angle == pytest.approx([3.0] * 3)
    assert context.max_angle == pytest.approx([2 * np.pi - 3.0] * 3)
    assert context.confidence == 0.5
    assert inference.after_round(after)[-1].context.confidence == 1.0
    assert after[0] is both[0]
    assert both[1].context.confidence == 0.0  # experiments are immutable
    one = InBand(InBandConfig(k=1)).after_generation(ANGLES, SIMILARITIES, both)[-1].context
    assert np.array_equal(one.min_angle, one.max_angle)


def out_of_band(config=None):
    simulator = FakeSimulator()
    evaluator = ModelEvaluator(simulator, STEPS, 3)
    made = OutOfBand(
        config or OutOfBandConfig(), pose_layout(ACTIONS.names), evaluator, GeneticConfig()
    )
    return made, simulator


def test_opt_ang_finds_the_pose_if_the_models_are_right():
    pose = out_of_band()[0].opt_ang(np.tile(TRUTH, (4, 1)), experiment(), np.random.default_rng(0))
    assert circular_distance(pose, POSE).max() < 0.15


def test_out_of_band_infers_at_generations_0_35_and_70():
    inference, simulator = out_of_band()
    models = MODELS.decode(MODELS.random(5, np.random.default_rng(0)))
    some, paused, rng = (experiment(),), [], np.random.default_rng(0)
    for generation in range(100):
        before = simulator.calls
        some = inference.before_generation(generation, models, some, rng)
        assert some[-1].context.fixed
        if simulator.calls > before:
            paused.append(generation)
    assert paused == [0, 35, 70]


def test_population_and_sample_bound_the_trials():
    config = OutOfBandConfig(inner_population=7, inner_generations=1, sampled_models=3)
    inference, simulator = out_of_band(config)
    inference.opt_ang(bodies := np.tile(TRUTH, (9, 1)), experiment(), np.random.default_rng(0))
    assert simulator.sizes == [7 * 3]
    inference, simulator = out_of_band(OutOfBandConfig(inner_population=7, inner_generations=1))
    inference.opt_ang(bodies, experiment(), np.random.default_rng(0))
    assert simulator.sizes == [7 * 9]


def test_revisit_updates_earlier_experiments():
    wrong = Context.known(np.zeros(3))
    for revisit in (0, 1):
        inference, _ = out_of_band(OutOfBandConfig(revisit=revisit))
        both = (experiment(wrong), experiment())
        old, _ = inference.before_generation(0, TRUTH[None], both, np.random.default_rng(0))
        moved = circular_distance(old.context.min_angle, POSE).max() < 0.3
        assert moved == bool(revisit)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: InBandConfig(k=0), "in_band.k"),
        (lambda: InBandConfig(confidence=1.5), "in_band.confidence"),
        (lambda: OutOfBandConfig(sampled_models=0), "out_of_band.sampled_models"),
    ],
)
def test_bad_settings_are_refused(make, message):
    with pytest.raises(ConfigurationError, match=message):
        make()
