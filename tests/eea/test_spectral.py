"""Comparing in the engine is comparing in numpy, but for rounding."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym.imu import ImuLog
from eea.core.experiment import Simulator, Trials
from eea.core.model_evaluator import DIVERGED_SIMILARITY, ModelEvaluator
from eea.fish.simulator import EngineSimulator
from eea.fish.spectral import SpectralComparer
from instruments.verification.trials import random_trials

STEPS, MODELS = 128, 6
T = random_trials(30, 1)
TRIALS = Trials(T.morphologies, T.commands, T.fin_angles)


class ByNumpy(Simulator):
    """A simulator of one's own around the engine's: nothing of that one's is inherited."""

    def __init__(self, steps: int = STEPS) -> None:
        self._engine = EngineSimulator(steps)
        self.asked = 0

    def simulate(self, trials: Trials) -> ImuLog:
        self.asked += 1
        return self._engine.simulate(trials)


def some(count: int) -> Trials:
    return Trials(TRIALS.models[:count], TRIALS.commands[:count], TRIALS.angles[:count])


def evaluator(compiled: bool) -> ModelEvaluator:
    return ModelEvaluator(EngineSimulator(STEPS) if compiled else ByNumpy(), STEPS, 3)


def test_the_engine_compares_as_numpy_does() -> None:
    ours, theirs = (evaluator(compiled) for compiled in (True, False))
    assert isinstance(ours._comparer, SpectralComparer)
    observed = theirs.behaviors(some(4)).astype(np.complex128)
    which = np.arange(30) % 4
    sims = [one.similarities(TRIALS, observed, which) for one in (ours, theirs)]
    assert sims[1].min() < 0.995
    np.testing.assert_allclose(1 - sims[0], 1 - sims[1], rtol=1e-5, atol=1e-6)
    fits = [one.disagreements(TRIALS, MODELS) for one in (ours, theirs)]
    assert fits[0].shape == (5,)
    np.testing.assert_allclose(fits[0], fits[1], rtol=1e-5)
    assert ours.trials == 60


@pytest.mark.pybullet
def test_engine_compares_only_what_it_can_transform() -> None:
    assert EngineSimulator(2).comparer(2) is None
    assert EngineSimulator(STEPS).comparer(64) is None
    assert EngineSimulator(STEPS, engine="pybullet").comparer(STEPS) is None


def test_a_robot_that_diverged_is_like_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lab = evaluator(compiled=True)
    spectra = SpectralComparer._spectra

    def sick(self: SpectralComparer, trials: object) -> np.ndarray:
        found = spectra(self, trials)  # type: ignore[arg-type]
        found[2] = np.nan
        return found

    monkeypatch.setattr(SpectralComparer, "_spectra", sick)
    observed, which = np.zeros((1, 195), complex), np.zeros(30, np.intp)
    sim = lab.similarities(TRIALS, observed, which)
    assert sim[2] == DIVERGED_SIMILARITY
    assert (sim[np.arange(30) != 2] > DIVERGED_SIMILARITY).all()
    assert not np.isfinite(lab.disagreements(TRIALS, MODELS)[0])


def test_a_simulator_of_ones_own_is_asked_and_not_bypassed() -> None:
    noisy = ByNumpy()
    lab = ModelEvaluator(noisy, STEPS, 3)
    observed = lab.behaviors(some(1))
    lab.similarities(TRIALS, observed, np.zeros(30, np.intp))
    lab.disagreements(TRIALS, MODELS)
    assert noisy.asked == 3


def test_a_subclass_is_asked_and_not_bypassed() -> None:
    class Noisy(EngineSimulator):
        pass

    assert Noisy(STEPS).comparer(STEPS) is None


def test_it_swims_in_the_simulators_water() -> None:
    still, moving = (
        ModelEvaluator(EngineSimulator(STEPS, current=current), STEPS, 3)
        for current in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.5))
    )
    assert (moving.disagreements(TRIALS, MODELS) != still.disagreements(TRIALS, MODELS)).all()
