"""Comparing in the engine is comparing in numpy, but for rounding."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from aquafish_gym.verification.trials import random_trials
from eea.aquafish import EngineSimulator
from eea.behavior import BehaviorConfig
from eea.laboratory import DIVERGED, Laboratory
from eea.spectral import SpectralComparer, can_compare

STEPS, MODELS = 128, 6
T = random_trials(30, 1)
BODIES, COMMANDS, ANGLES = T.morphologies, T.commands, T.fin_angles


def laboratory(behavior: BehaviorConfig, compiled: bool) -> Laboratory:
    simulator = EngineSimulator(STEPS)
    if not compiled:
        simulator.comparer = lambda _: None  # type: ignore[method-assign]
    return Laboratory(simulator, behavior, STEPS)


@pytest.mark.parametrize(
    "behavior",
    [BehaviorConfig(), BehaviorConfig(unit="radians"), BehaviorConfig(normalised=True, maximum=3)],
)
def test_the_engine_compares_as_numpy_does(behavior: BehaviorConfig) -> None:
    ours, theirs = (laboratory(behavior, compiled) for compiled in (True, False))
    assert isinstance(ours._comparer, SpectralComparer)
    observed = theirs.behaviors(BODIES[:4], COMMANDS[:4], ANGLES[:4]).astype(np.complex128)
    which = np.arange(30) % 4
    sims = [one.similarities(BODIES, COMMANDS, ANGLES, observed, which) for one in (ours, theirs)]
    assert sims[1].min() < 0.995
    np.testing.assert_allclose(1 - sims[0], 1 - sims[1], rtol=1e-5, atol=1e-6)
    fits = [one.disagreements(BODIES, COMMANDS, ANGLES, MODELS) for one in (ours, theirs)]
    assert fits[0].shape == (5,)
    np.testing.assert_allclose(fits[0], fits[1], rtol=1e-5)
    assert ours.trials == 60


def test_it_takes_over_only_what_it_knows() -> None:
    assert can_compare(BehaviorConfig(), 128)
    for change in ({"summary": "mean_rate"}, {"signal": "body_rates"}, {"clamp": True},
                   {"difference": "magnitude"}):  # fmt: skip
        assert not can_compare(dataclasses.replace(BehaviorConfig(), **change), 128)
    assert not can_compare(BehaviorConfig(), 2)
    pytest.importorskip("pybullet")
    assert EngineSimulator(STEPS, engine="pybullet").comparer(BehaviorConfig()) is None


def test_a_robot_that_diverged_is_like_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    lab = laboratory(BehaviorConfig(), compiled=True)
    spectra = SpectralComparer._spectra

    def sick(self: SpectralComparer, trials: object) -> np.ndarray:
        found = spectra(self, trials)  # type: ignore[arg-type]
        found[2] = np.nan
        return found

    monkeypatch.setattr(SpectralComparer, "_spectra", sick)
    observed, which = np.zeros((1, 195), complex), np.zeros(30, np.intp)
    sim = lab.similarities(BODIES, COMMANDS, ANGLES, observed, which)
    assert sim[2] == DIVERGED
    assert (sim[np.arange(30) != 2] > DIVERGED).all()
    assert not np.isfinite(lab.disagreements(BODIES, COMMANDS, ANGLES, MODELS)[0])
