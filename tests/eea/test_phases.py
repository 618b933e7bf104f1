"""Exploration and estimation on the fake robot."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from eea.core import algorithm
from eea.core.algorithm import EEA
from eea.core.behavior import summarize
from eea.core.checks import TargetError
from eea.core.config import EstimationConfig, ExplorationConfig, OutOfBandConfig, PaperConfig
from eea.core.experiment import RecordedLog, Trials
from eea.core.model_evaluator import DIVERGED_SIMILARITY
from eea.core.session import streams
from fake_fish import (
    ACTIONS,
    MODELS,
    PROBLEM,
    STEPS,
    TRUTH,
    FakeRevealingTarget,
    FakeSimulator,
)


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


def test_act_fit_is_the_mean_over_pairs_of_models_from_zero_angles():
    command, act_fit, models = disputed(population=5, generations=3)
    alike = [
        summarize(FakeSimulator().simulate(Trials(m[None], command[None], np.zeros((1, 3)))))[0]
        for m in models
    ]
    apart = [np.abs(alike[i] - alike[j]).mean() / 100 for i in range(6) for j in range(i)]
    assert act_fit == pytest.approx(np.mean(apart))


def test_command_under_which_models_diverge_is_not_chosen():
    class Fragile(FakeSimulator):
        def simulate(self, trials):
            log = super().simulate(trials)
            log.gyro[trials.commands[:, 0] > 0] = np.nan
            return log

    command, act_fit, _ = disputed(Fragile())
    assert command[0] <= 0
    assert act_fit > 0


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
    for name in ("infer_angles", "perform_angles"):
        record = partial(_recorded, events, name, getattr(algorithm, name))
        monkeypatch.setattr(algorithm, name, record)
    EEA(FakeRevealingTarget(0), FakeSimulator(), PROBLEM, config, 0, TRUTH).run()
    pauses = [i for i, name in enumerate(events) if name == "infer_angles"]
    assert [events[:i].count("perform_angles") for i in pauses] == [0, 35, 70]


def _recorded(events, name, function, *arguments):
    events.append(name)
    return function(*arguments)


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


def test_diverging_body_loses():
    class Fragile(FakeSimulator):
        def simulate(self, trials):
            log = super().simulate(trials)
            log.gyro[trials.models[:, 0] > 0.3] = np.inf  # the truth's too
            return log

    record = evolved(Fragile(), estimation=EstimationConfig(generations=5)).result.rounds[-1]
    assert record.morphology[0] <= 0.3
    assert DIVERGED_SIMILARITY < record.model_fitness <= 1


def test_simulator_must_log_every_trial_and_step():
    class Lazy(FakeSimulator):
        def simulate(self, trials):
            return RecordedLog(super().simulate(trials).gyro[1:])

    with pytest.raises(TargetError, match=r"simulator must log trials of 64 .* logged 65"):
        evolved(FakeSimulator(STEPS + 1))
    with pytest.raises(TargetError, match="a log for each of 25 trials; it returned 24"):
        evolved(Lazy())
