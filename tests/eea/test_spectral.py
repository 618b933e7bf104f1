"""Comparing in the engine is comparing in numpy, but for rounding."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from aquafish_gym.utils.validation import InvalidArgumentError
from eea.aquafish.fish import EngineSimulator
from eea.aquafish.spectral import SpectralComparer, can_compare
from eea.core.behavior import BehaviorConfig, Signal
from eea.core.checks import TargetError
from eea.core.laboratory import DIVERGED, Laboratory
from tests.verification.trials import random_trials

STEPS, MODELS = 128, 6
T = random_trials(30, 1)
BODIES, COMMANDS, ANGLES = T.morphologies, T.commands, T.fin_angles
both_signals = pytest.mark.parametrize("signal", ["attitude", "body_rates"])


def laboratory(behavior: BehaviorConfig, compiled: bool) -> Laboratory:
    simulator = EngineSimulator(STEPS)
    if not compiled:
        simulator.comparer = lambda *_: None  # type: ignore[method-assign]
    return Laboratory(simulator, behavior, STEPS)


@both_signals
@pytest.mark.parametrize(
    "settings", [{}, {"unit": "radians"}, {"normalised": True, "maximum": 3.0}]
)
def test_the_engine_compares_as_numpy_does(settings: dict[str, Any], signal: Signal) -> None:
    behavior = BehaviorConfig(signal=signal, **settings)
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


@both_signals
def test_it_takes_over_only_what_it_knows(signal: Signal) -> None:
    known = BehaviorConfig(signal=signal)
    assert can_compare(known, 128)
    changes: list[dict[str, Any]] = [
        {"summary": "mean_rate"}, {"clamp": True}, {"difference": "magnitude"}
    ]  # fmt: skip
    for change in changes:
        assert not can_compare(dataclasses.replace(known, **change), 128)
    assert not can_compare(known, 2)
    pytest.importorskip("pybullet")
    assert EngineSimulator(STEPS, engine="pybullet").comparer(known, STEPS) is None


@both_signals
def test_a_robot_that_diverged_is_like_nothing(
    monkeypatch: pytest.MonkeyPatch, signal: Signal
) -> None:
    lab = laboratory(BehaviorConfig(signal=signal), compiled=True)
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


@both_signals
def test_a_simulator_of_ones_own_is_asked_and_not_bypassed(signal: Signal) -> None:
    class Noisy(EngineSimulator):
        asked = 0

        def simulate(self, trials):  # type: ignore[no-untyped-def]
            Noisy.asked += 1
            return super().simulate(trials)

    lab = Laboratory(Noisy(STEPS), BehaviorConfig(signal=signal), STEPS)
    before = Noisy.asked
    observed = lab.behaviors(BODIES[:1], COMMANDS[:1], ANGLES[:1])
    lab.similarities(BODIES, COMMANDS, ANGLES, observed, np.zeros(30, np.intp))
    assert Noisy.asked == before + 2


def test_it_checks_what_the_long_way_checks() -> None:
    lab = laboratory(BehaviorConfig(), compiled=True)
    observed, which = np.zeros((1, 195), complex), np.zeros(30, np.intp)
    with pytest.raises(InvalidArgumentError, match="morphologies"):
        lab.similarities(-BODIES, COMMANDS, ANGLES, observed, which)
    with pytest.raises(InvalidArgumentError, match=r"which must lie in \[0, 0\]; got 0 to 7"):
        lab.similarities(BODIES, COMMANDS, ANGLES, observed, which + 7 * (np.arange(30) == 3))
    other = Laboratory(EngineSimulator(64), BehaviorConfig(), STEPS)
    with pytest.raises(TargetError, match="128 steps"):
        other.similarities(BODIES, COMMANDS, ANGLES, observed, which)


@both_signals
def test_it_swims_in_the_simulators_present_water(signal: Signal) -> None:
    simulator = EngineSimulator(STEPS)
    lab = Laboratory(simulator, BehaviorConfig(signal=signal), STEPS)
    still = lab.disagreements(BODIES, COMMANDS, ANGLES, MODELS)
    simulator.current = (1.0, 0.0, 0.5)
    assert (lab.disagreements(BODIES, COMMANDS, ANGLES, MODELS) != still).all()
