"""A self-model knows where the fins are, as well as it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aquafish_gym import Morphology, simulate
from aquafish_gym.engines.api import TIMESTEP
from eea.core.angles import wrap
from eea.core.config import JointConfig
from eea.fish import RealityGap
from eea.fish.fins import fins_after
from eea.fish.methods import fish_eea
from eea.fish.target import EngineTarget

# As much of a search as these trials need.
QUICK = JointConfig(rounds=2, bodies=48, poses=48, descents=12, polished=2, alternatives="never")


@pytest.mark.parametrize("gain", [pytest.param(1.0, marks=pytest.mark.slow), 0.93])
def test_the_fins_are_where_they_are_believed_to_be(gain: float) -> None:
    errors = []
    for seed in range(4):
        gap = RealityGap(gyro_noise=0.01, servo_gain=(gain,) * 3)
        target = EngineTarget(
            None, "left_pectoral:length=0.5", np.random.default_rng(seed), engine="numba", gap=gap
        )
        config = QUICK
        found = fish_eea(target, config, seed, target.morphology, threads=1).run()
        log = simulate(
            target.morphology, found.rounds[-1].command, target.start_angles, steps=config.steps,
            record="pose", servo_gain=(gain,) * 3, dtype="float64",
        )  # fmt: skip
        assert log.fin_angles is not None
        fins = fins_after(found)
        errors.append(wrap(fins.angles - log.fin_angles[0, -1]) / fins.spread)
        assert (fins.spread < np.radians(10.0)).all()
        np.testing.assert_allclose(fins.servo_gain, gain, atol=0.02)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.6)


@pytest.mark.slow  # every hypothesis is fitted
def test_a_fin_that_is_stuck_stays_where_it_was() -> None:
    rng = np.random.default_rng(5)
    target = EngineTarget(None, "left_pectoral:seized=0", rng, engine="numba")
    config = replace(QUICK, descents=6, polished=1, restarts=0, alternatives="always")
    found = fish_eea(target, config, 5, Morphology.nominal(), threads=1).run()
    fins = fins_after(found)
    assert fins.servo_gain[0] == 0.0
    assert abs(wrap(fins.angles[0] - target.start_angles[0])) < 0.05
    assert config.steps * TIMESTEP > 2.0
