"""What a simulator assumes: contradicted by the trials, or not, or not told."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym import Morphology
from aquafish_gym.engines.api import simulate_scenario
from aquafish_gym.scenario import Scenario
from eea import FitConfig
from eea.core.checks import ConfigurationError
from eea.fish.joint import fish_robot
from eea.fish.simulator import EngineSimulator
from eea.fish.simulator_error import Assumed, Discrepancy, Material, contradiction
from eea.infer.fit import fit
from eea.infer.robot import Robot
from eea.infer.statement import Number
from eea.infer.trials import Observed

TIME = 0.01 * np.arange(1, 129)
SLOW = np.sin(7.0 * TIME)
FAST = np.sin(23.0 * TIME)
QUICK = FitConfig(bodies=8, poses=4, descents=4, polished=2, restarts=0)
SLIP = Assumed("the slip of the wheel", 0.0, 0.1, "m", "the size")
NOISE = 0.05


def wheel(values, _commands):
    return (values["size"][:, None] * SLOW)[:, :, None]


def slips(mixed):
    """Return what a slip does: some of the wave of the size, and a wave of its own."""

    def shapes(values, _commands):
        wave = SLIP.sd * (SLOW + mixed * FAST)
        return np.tile(wave[None, None, :, None], (len(values["size"]), 1, 1, 1))

    return shapes


def inferred(slip, mixed, seed=0):
    """Return the posterior of trials with a slip, which the simulator assumes to be none."""
    discrepancy = Discrepancy(1e-4, 5.0, assumed=(SLIP,), assumed_shapes=slips(mixed))
    robot = Robot(
        wheel,
        {"size": Number(0.0, 1.0), "a": Number.angle()},
        {"gyro": "rad/s"},
        discrepancy=discrepancy,
    )
    rng = np.random.default_rng(seed)
    signal = 0.5 * SLOW + slip * (SLOW + mixed * FAST) + NOISE * rng.normal(size=(2, 128))
    return fit(Observed(np.full((2, 1), 0.5), signal[:, :, None]), robot, QUICK, rng)


def width(belief):
    low, high = belief.interval(0.9)
    return float(high[0] - low[0])


def test_a_contradicted_assumption_becomes_a_nuisance_of_the_intervals():
    """Its amplitude is told by the fast wave alone, to 0.05 / sqrt(128) / 0.3 = 0.015."""
    belief = inferred(0.05, 0.3)
    assert belief.good
    (said,) = belief.findings
    assert said.startswith("the slip of the wheel is 0.0")
    assert "), not 0 as assumed; the intervals allow for it (p = " in said
    low, high = belief.interval(0.9)
    assert low[0] < 0.5 < high[0]
    assert width(belief) > 2.0 * width(inferred(0.0, 0.3))


def test_an_assumption_that_holds_leaves_intervals_as_they_are():
    plain = inferred(0.0, 0.3)
    assert plain.findings == []
    found = contradiction(plain.best_fit)
    assert found.p > 0.05
    assert found.spread[0] == pytest.approx(NOISE / 128**0.5 / 0.3, rel=0.2)


def test_an_assumption_that_the_data_do_not_tell_is_said_to_be_one():
    belief = inferred(0.05, 0.0)
    assert belief.findings == [
        "assumed, not measured: the slip of the wheel, 0 m; the size depends on it"
    ]


def test_contradictions_of_true_assumptions_are_as_rare_as_stated():
    p = np.array([contradiction(inferred(0.0, 0.3, seed).best_fit).p for seed in range(60)])
    assert (p < 0.05).sum() <= 8
    assert (p < 0.5).mean() == pytest.approx(0.5, abs=0.2)


def test_assumptions_and_their_shapes_are_given_together():
    with pytest.raises(ConfigurationError, match="assumed and assumed_shapes must be given toget"):
        Discrepancy(0.1, 5.0, assumed=(SLIP,))


# --- the fish's ---------------------------------------------------------------------------------


def test_the_engines_own_material_changes_nothing():
    bodies = Morphology.nominal().to_array()[None]
    fields = Material().fields(bodies, np.ones((1, 2)))
    assert fields["body"].tolist() == bodies.tolist()
    assert (fields["fin_density"] == 1.0).all()
    assert (fields["drag"] == 1.0).all()


def test_rough_fins_rub_like_thicker_ones_that_weigh_the_same():
    bodies = Morphology.nominal().to_array()[None]
    fields = Material(friction=3.0).fields(bodies, np.ones((1, 2)))
    thickness = [2, 5, 6]
    assert (fields["body"][:, thickness] > bodies[:, thickness]).all()
    np.testing.assert_allclose(
        fields["body"][:, thickness] * fields["fin_density"], bodies[:, thickness]
    )


@pytest.mark.parametrize("density", [2.0, 1.0])
def test_dense_fins_are_found_out(density):
    body = Morphology.nominal().to_array()
    rng = np.random.default_rng(3)
    commands = np.array([[0.5, -0.4, 1.0], [-0.4, 0.5, 0.8], [0.5, 0.4, 1.0]])
    angles = rng.uniform(-np.pi, np.pi, (3, 3))
    scenario = Scenario.create(body, fin_angles=angles, fin_density=np.full(3, density))
    log = simulate_scenario(scenario, commands, 256, "numba", "float64", record="gyro").gyro
    signal = log + rng.normal(0.0, 0.003, log.shape)
    robot = fish_robot(EngineSimulator(256, threads=1))
    effort = FitConfig(alternatives="never", restarts=0)
    belief = fit(Observed(commands, signal), robot, effort, rng)
    if belief.good:  # else no interval is given
        said = " ".join(belief.findings)
        assert ("the intervals allow for it" in said) == (density != 1.0)
    assert belief.good or density != 1.0
