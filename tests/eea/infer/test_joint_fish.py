"""Joint inference bound to the fish: an estimate, a recorded session, a picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aquafish_gym.morphology import DIMENSIONS, Morphology
from eea import (
    ConfigurationError,
    EngineTarget,
    JointConfig,
    MorphologyEstimate,
    PaperConfig,
    Performed,
    RecordedLog,
    SwimLog,
    TargetError,
    estimate_morphology,
    estimate_morphology_of,
    fins_after,
    infer_log,
)
from eea.core.session import streams
from eea.fish.plots import posterior_figure

DAMAGE = "left_pectoral:length=0.5"
# Few starts, which a trial without noise forgives.
QUICK = JointConfig(
    steps=64, rounds=2, bodies=24, poses=24, descents=6, polished=2, restarts=0,
    alternatives="never",
)  # fmt: skip


@pytest.fixture(scope="module")
def estimate():
    return estimate_morphology(None, DAMAGE, QUICK, 1, target_engine="numba")


class Saturated:
    """A robot whose left flipper is slower than it is told, which says so; noisy, and recorded."""

    def __init__(self, seed=0, sigma=0.01):
        self._fish = EngineTarget(None, DAMAGE, streams(seed)["target"], 64, "numba")
        self._rng, self._sigma = np.random.default_rng(seed), sigma
        self.asked, self.executed, self.logs = [], [], []

    def perform(self, command):
        executed = np.clip(command, [-0.2, -0.5, 0.0], [0.2, 0.5, 1.0])
        gyro = self._fish.perform(executed).gyro[0]
        log = RecordedLog(gyro + self._sigma * self._rng.normal(size=gyro.shape))
        self.asked.append(command)
        self.executed.append(executed)
        self.logs.append(log)
        return Performed(log, executed)


def test_one_line_finds_the_body_and_how_sure_it_is(estimate):
    assert isinstance(estimate.morphology, Morphology)
    assert estimate.objective_fitness > 0.999
    low, high = estimate.interval(0.9)
    assert (low <= estimate.model).all()
    assert (estimate.model <= high).all()
    inside = estimate.belief.branches[0].posterior.interval(0.9)
    assert np.max(inside[1][:9] - inside[0][:9]) < 0.01  # if the simulator is right
    assert 0.01 < estimate.width() < 0.5  # no noise, yet no more than the simulator is worth
    bodies = estimate.sample(7, seed=3)
    assert bodies.shape == (7, 9)
    assert np.array_equal(bodies, estimate.sample(7, seed=3))
    assert not np.array_equal(bodies, estimate.sample(7, seed=4))


def test_the_same_seed_gives_the_same_bytes_whatever_the_threads(estimate):
    again = estimate_morphology(None, DAMAGE, QUICK, 1, target_engine="numba", threads=1)
    clockless = [replace(r, seconds=0.0) for r in estimate.rounds]
    assert [replace(r, seconds=0.0) for r in again.rounds] == clockless
    assert again.belief.to_dict() == estimate.belief.to_dict()


def test_posterior_figure_has_a_panel_of_sizes_and_one_of_nuisances(estimate):
    sizes, others = posterior_figure(estimate).axes
    assert [label.get_text() for label in sizes.get_yticklabels()] == [d.name for d in DIMENSIONS]
    assert len(others.get_yticklabels()) == 10


def test_an_estimate_of_a_posterior_needs_no_rounds(estimate):
    found = MorphologyEstimate.of(estimate.belief, estimate.truth)
    assert found.morphology == estimate.morphology
    assert found.objective_fitness == estimate.objective_fitness
    assert np.array_equal(found.interval(0.8), estimate.interval(0.8))
    assert str(found) == str(estimate)
    told = found.to_dict()
    assert told["objective_fitness"] == found.objective_fitness
    assert not {"rounds", "config", "stopped", "seed"} & told.keys()
    assert repr(found).startswith("MorphologyEstimate(logs, seed 0, OBJ_FIT 1")
    assert len(posterior_figure(found).axes) == 2
    with pytest.raises(ConfigurationError, match="result must be of a run"):
        fins_after(found)


def test_without_a_posterior_there_is_no_picture_and_no_interval():
    config = PaperConfig("none", steps=64, rounds=1)
    plain = estimate_morphology(None, DAMAGE, config, target_engine="numba")
    with pytest.raises(ConfigurationError, match="result must have a posterior to be drawn"):
        posterior_figure(plain)
    with pytest.raises(TargetError, match='only the condition "joint" has a posterior'):
        plain.interval()
    assert "interval" not in repr(plain)


def test_a_log_is_credited_to_the_command_that_was_executed():
    robot = Saturated(seed=2, sigma=0.001)
    truth, config = robot._fish.morphology, replace(QUICK, rounds=1)
    live = estimate_morphology_of(robot, config, seed=2)
    assert not np.array_equal(robot.asked, robot.executed)
    assert [record.command for record in live.rounds] == [tuple(c) for c in robot.executed]
    right, wrong = (
        infer_log(SwimLog.of_trials(commands, robot.logs), QUICK, seed=5, truth=truth)
        for commands in (robot.executed, robot.asked)
    )
    assert right.belief.good
    assert right.objective_fitness > wrong.objective_fitness
