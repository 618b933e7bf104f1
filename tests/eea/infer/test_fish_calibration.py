"""Is joint inference honest on the fish itself? Small ``python -m instruments.inference``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eea import FitConfig, RecordedLog, SwimLog, infer_log
from eea.fish.joint import fish_robot
from eea.fish.simulator import EngineSimulator, fish_problem
from eea.infer.misfit import Regression
from eea.infer.search import search
from eea.infer.session import fast_command
from eea.infer.unknowns import Unknowns
from instruments.inference.calibration import coverage, rank_uniformity, ranks
from instruments.inference.cases import DRAWS, examine, truth_of
from instruments.inference.robots import ORDINARY_WORLD, SPANS, Robot, draw_body, draw_world
from instruments.inference.settings import Setting
from instruments.inference.summary import NAMES

# As much of a search as one trial needs, and no hypotheses: nothing here is seized.
QUICK = FitConfig(bodies=48, poses=48, descents=16, alternatives="never")
NEARLY_NONE = FitConfig(bodies=2, poses=1, descents=1, polished=1, restarts=0)
# So little noise that one trial tells a body, and more than is tried to be explained exactly.
PRIOR = Setting("everything drawn from the prior", 32, "prior", "prior", 1, noise=0.0015)


def examined(setting, numbers, effort=QUICK):
    """Return what was found of some of a setting's robots."""
    return [examine(setting, i, np.random.default_rng([7, i]), effort) for i in numbers]


@pytest.fixture(scope="module")
def posteriors():
    """Return posteriors and truths. The search begins at the truth: others are of finding it."""
    joint = fish_robot(EngineSimulator(PRIOR.steps, threads=1))
    parameters = Unknowns.of(joint, 1, joint.groups)
    found = []
    for number in range(PRIOR.robots):
        rng = np.random.default_rng([7, number])
        body, world = draw_body(PRIOR, number, rng), draw_world(PRIOR, rng)
        robot = Robot(PRIOR, body, world, rng, rng)
        robot.perform(fast_command(fish_problem().actions, np.empty((0, 3)), rng))
        truth = truth_of(parameters, robot)
        optima = search(Regression(parameters, robot.observed, None), rng, NEARLY_NONE, truth[None])
        found.append((optima.mixture(optima), truth))
    return found


def test_intervals_hold_the_truth_as_often_as_they_say(posteriors):
    """A posterior of twice the sd holds 76% in the intervals of 50%, of half the sd 26%."""
    truths = np.array([truth for _, truth in posteriors])
    for mass, slack in ((0.5, 0.09), (0.8, 0.08), (0.9, 0.07)):
        low, high = np.transpose([p.interval(mass) for p, _ in posteriors], (1, 0, 2))
        held = coverage(truths, low, high, posteriors[0][0].circular)
        assert held.overall == pytest.approx(mass, abs=slack)


def test_truths_rank_evenly_among_draws(posteriors):
    """The ranks' mean square about the middle is 1/12; 0.05 with twice the sd, 0.15 with half."""
    rng = np.random.default_rng(0)
    counted = [ranks(p.sample(DRAWS, rng), truth, rng, p.circular) for p, truth in posteriors]
    off = (np.array(counted) + 0.5) / (DRAWS + 1) - 0.5
    assert (off**2).mean() == pytest.approx(1 / 12, abs=0.015)
    assert abs(off.mean()) < 0.03
    assert rank_uniformity(counted, DRAWS, bins=4).min() > 1e-4


SLOW = np.array([0.4, -0.3, 0.002])  # the tail hardly beats: was it on its way out, or back?


def test_both_of_two_answers_are_kept():
    setting = Setting("a slow tail", 3, trials=1, steps=128)
    for number in range(setting.robots):
        rng = np.random.default_rng([3, number])
        robot = Robot(setting, SPANS * rng.uniform(0.3, 0.9, 9), ORDINARY_WORLD, rng, rng)
        robot.perform(SLOW)
        log = SwimLog.of_trials([SLOW], [RecordedLog(robot.logs[0])])
        belief = infer_log(log, QUICK, number, threads=1).belief
        posterior = belief.branches[0].posterior
        phase = posterior.draws[:, posterior.names.index("caudal@1")]
        assert 0.15 < np.mean(np.cos(phase) > 0.0) < 0.85


def test_a_world_that_is_not_imagined_is_noticed():
    water = Setting("reactive water", 1, world="reactive", trials=1, noise=0.003)
    (one,) = examined(water, [0])
    assert not one["good"]
    assert one["findings"][0].startswith("no body explains the log")


EDGE = Setting("edges", 6, "edge", trials=1, noise=0.0003)


@pytest.mark.slow  # every hypothesis is fitted
def test_a_fin_without_length_is_said_to_be_missing():
    (one,) = examined(EDGE, [2], replace(QUICK, alternatives="doubt"))
    length = NAMES.index("caudal.length")
    assert one["truth"][length] == one["low"][2][length] == 0.0
    assert one["findings"][0].startswith("the tail is missing")
