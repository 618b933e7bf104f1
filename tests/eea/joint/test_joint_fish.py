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
    PaperConfig,
    Performed,
    RecordedLog,
    SwimLog,
    TargetError,
    estimate_morphology,
    estimate_morphology_of,
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
    assert estimate.width() < 0.01
    bodies = estimate.sample(7, seed=3)
    assert bodies.shape == (7, 9)
    assert np.array_equal(bodies, estimate.sample(7, seed=3))
    assert not np.array_equal(bodies, estimate.sample(7, seed=4))
    assert [Morphology.from_array(body) for body in bodies]


def test_the_same_seed_gives_the_same_bytes_whatever_the_threads(estimate):
    again = estimate_morphology(None, DAMAGE, QUICK, 1, target_engine="numba", threads=1)
    clockless = [replace(r, seconds=0.0) for r in estimate.rounds]
    assert [replace(r, seconds=0.0) for r in again.rounds] == clockless
    assert again.belief.to_dict() == estimate.belief.to_dict()


def test_an_estimate_shows_its_intervals(estimate):
    wide = f"90% intervals {100 * estimate.width():.2g}% of the ranges wide"
    assert repr(estimate) == (
        "MorphologyEstimate(joint, 2 rounds of 64 steps, seed 1; "
        f"MOD_FIT 1.000, OBJ_FIT {estimate.objective_fitness:.3f}, {wide})"
    )


def rows_of(axes):
    return [label.get_text() for label in axes.get_yticklabels()]


def test_the_posteriors_picture_has_a_row_for_each_size_and_nuisance(estimate):
    figure = posterior_figure(estimate)
    sizes, others = figure.axes
    assert rows_of(sizes) == [d.name for d in DIMENSIONS]
    assert rows_of(others)[:3] == ["current x", "current y", "current z"]
    assert {"servo gain", "lag"} <= set(rows_of(others))
    truths = [line for line in sizes.lines if line.get_marker() == "v"]
    found = np.array([line.get_xdata()[0] for line in truths])
    ranges = np.array([d.maximum for d in DIMENSIONS])
    assert found * ranges == pytest.approx(estimate.truth)
    assert not [line for line in others.lines if line.get_marker() == "v"]
    assert any(text.get_text().startswith("0.800 [") for text in sizes.texts)
    assert estimate.belief.verdict in figure.get_supxlabel()


def test_trials_of_their_own_nuisances_share_a_row():
    config = replace(QUICK, per_trial=("gyro_bias",))
    found = estimate_morphology(None, DAMAGE, config, 1, target_engine="numba")
    figure = posterior_figure(found)
    rows = rows_of(figure.axes[1])
    assert "gyro bias z, by trial" in rows
    assert len(rows) == len(set(rows)) == 10


def test_where_no_nuisance_is_inferred_there_is_no_panel_and_no_truth_where_it_is_not_known():
    config = replace(QUICK, nuisances=(), rounds=1)
    robot = EngineTarget(None, DAMAGE, streams(1)["target"], 64, "numba")
    figure = posterior_figure(estimate_morphology_of(robot, config, 1))
    assert len(figure.axes) == 1
    assert not [line for line in figure.axes[0].lines if line.get_marker() == "v"]
    assert "truth" not in figure.get_suptitle()


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
