from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eea.core.angles import circular_distance
from eea.core.behavior import summarize
from eea.core.checks import ConfigurationError
from eea.core.conditions import first_context, infer_angles, models_range, opt_ang
from eea.core.config import GeneticConfig, InBandConfig, OutOfBandConfig, PaperConfig
from eea.core.experiment import Context, Experiment, Trials
from eea.core.model_evaluator import ModelEvaluator
from fake_fish import STEPS, TRUTH, FakeSimulator

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


# Five models' sims to the newest experiment, and their angles in it.
SIMILARITIES = np.array([0.1, 0.8, 0.9, 0.7, 0.2])
ANGLES = np.tile(np.array([0.0, 3.0, -3.0, 3.1, 1.0])[:, None], 3)


def test_in_band_takes_the_range_of_the_three_models_that_fit_the_newest_experiment_best():
    context = models_range(ANGLES, SIMILARITIES, InBandConfig())
    assert context.min_angle == pytest.approx([3.0] * 3)
    assert context.max_angle == pytest.approx([2 * np.pi - 3.0] * 3)
    assert context.confidence == 0.5


# What each choice makes of the same models: the low end, the high end and the confidence.
@pytest.mark.parametrize(
    ("config", "progress", "low", "high", "confidence"),
    [
        (InBandConfig(best=1), 0.0, -3.0, -3.0, 0.5),
        (InBandConfig(best=2), 0.0, 3.0, 2 * np.pi - 3.0, 0.5),
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
    context = models_range(ANGLES, SIMILARITIES, config, progress)
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


@pytest.mark.parametrize("condition", ["none", "ideal", "out-of-band", "recovery"])
def test_in_band_settings_of_another_condition_are_refused(condition: Any) -> None:
    with pytest.raises(ConfigurationError, match="in_band is for the condition in-band"):
        PaperConfig(condition=condition, in_band=InBandConfig(best=5))
