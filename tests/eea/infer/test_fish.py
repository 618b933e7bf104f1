"""Joint inference of the fish: its estimate, its intervals, its fins and its servos' faults."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aquafish_gym import simulate
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH
from eea import (
    ConfigurationError,
    EngineTarget,
    FitConfig,
    JointConfig,
    JointInference,
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
from eea.core.angles import wrap
from eea.core.session import streams
from eea.fish import RealityGap
from eea.fish.joint import fish_robot
from eea.fish.methods import fish_eea
from eea.fish.plots import posterior_figure
from eea.fish.simulator import EngineSimulator, fish_problem
from eea.infer.answer import Answer
from eea.infer.file import from_arrays, to_arrays
from eea.infer.misfit import Regression
from eea.infer.search import search
from eea.infer.session import fast_command
from eea.infer.unknowns import Unknowns
from instruments.inference.calibration import coverage, rank_uniformity, ranks
from instruments.inference.cases import DRAWS, Case, examine, measure, truth_of
from instruments.inference.robots import ORDINARY_WORLD, SPANS, Robot, draw_body, draw_world
from instruments.inference.settings import SETTINGS, Setting
from instruments.inference.summary import NAMES
from instruments.inference.swims import SWIMS

DAMAGE = "left_pectoral:length=0.5"
# Few starts, which a trial without noise forgives.
QUICK = JointConfig(
    steps=64, rounds=2, bodies=24, poses=24, descents=6, polished=2, restarts=0,
    alternatives="never",
)  # fmt: skip
DOCS = Path(__file__).parents[3] / "docs"


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
    sizes, others = posterior_figure(estimate).axes
    assert [label.get_text() for label in sizes.get_yticklabels()] == [
        d.name for d in AQUAFISH.dimensions
    ]
    assert len(others.get_yticklabels()) == 10


def test_the_same_seed_gives_the_same_bytes_whatever_the_threads(estimate):
    again = estimate_morphology(None, DAMAGE, QUICK, 1, target_engine="numba", threads=1)
    clockless = [replace(r, seconds=0.0) for r in estimate.rounds]
    assert [replace(r, seconds=0.0) for r in again.rounds] == clockless
    assert again.belief.to_dict() == estimate.belief.to_dict()


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


# As much of a search as these trials need.
ENOUGH = JointConfig(rounds=2, bodies=48, poses=48, descents=12, polished=2, alternatives="never")


@pytest.mark.parametrize("gain", [pytest.param(1.0, marks=pytest.mark.slow), 0.93])
def test_the_fins_are_where_they_are_believed_to_be(gain):
    errors = []
    for seed in range(2):
        gap = RealityGap(gyro_noise=0.01, servo_gain=(gain,) * 3)
        target = EngineTarget(None, DAMAGE, np.random.default_rng(seed), engine="numba", gap=gap)
        found = fish_eea(target, ENOUGH, seed, target.morphology, threads=1).run()
        log = simulate(
            target.morphology, found.rounds[-1].command, target.start_angles, steps=ENOUGH.steps,
            record="pose", servo_gain=(gain,) * 3, dtype="float64",
        )  # fmt: skip
        fins = fins_after(found)
        errors.append(wrap(fins.angles - log.fin_angles[0, -1]) / fins.spread)
        assert (fins.spread < np.radians(10.0)).all()
        np.testing.assert_allclose(fins.servo_gain, gain, atol=0.02)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.6)


@pytest.mark.slow  # every hypothesis is fitted
def test_a_fin_that_is_stuck_stays_where_it_was():
    rng = np.random.default_rng(5)
    target = EngineTarget(None, "left_pectoral:seized=0", rng, engine="numba")
    config = replace(ENOUGH, descents=6, polished=1, restarts=0, alternatives="always")
    found = fish_eea(target, config, 5, Morphology.nominal(), threads=1).run()
    fins = fins_after(found)
    assert fins.servo_gain[0] == 0.0
    assert abs(wrap(fins.angles[0] - target.start_angles[0])) < 0.05
    assert config.steps * TIMESTEP > 2.0


# As much of a search as one trial needs, and no hypotheses: nothing here is seized.
ONE_TRIAL = FitConfig(bodies=48, poses=48, descents=16, alternatives="never")
NEARLY_NONE = FitConfig(bodies=2, poses=1, descents=1, polished=1, restarts=0)
# So little noise that one trial tells a body, and more than is tried to be explained exactly.
PRIOR = Setting("everything drawn from the prior", 32, "prior", "prior", 1, noise=0.0015)


def examined(setting, numbers, effort=ONE_TRIAL):
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


@pytest.mark.slow  # test_robot.py and test_posterior.py have quick ones
def test_intervals_hold_the_truth_as_often_as_they_say(posteriors):
    """A posterior of twice the sd holds 76% in the intervals of 50%, of half the sd 26%."""
    truths = np.array([truth for _, truth in posteriors])
    for mass, slack in ((0.5, 0.09), (0.8, 0.08), (0.9, 0.07)):
        low, high = np.transpose([p.interval(mass) for p, _ in posteriors], (1, 0, 2))
        held = coverage(truths, low, high, posteriors[0][0].circular)
        assert held.overall == pytest.approx(mass, abs=slack)


@pytest.mark.slow
def test_truths_rank_evenly_among_draws(posteriors):
    """The ranks' mean square about the middle is 1/12; 0.05 with twice the sd, 0.15 with half."""
    rng = np.random.default_rng(0)
    counted = [ranks(p.sample(DRAWS, rng), truth, rng, p.circular) for p, truth in posteriors]
    off = (np.array(counted) + 0.5) / (DRAWS + 1) - 0.5
    assert (off**2).mean() == pytest.approx(1 / 12, abs=0.015)
    assert abs(off.mean()) < 0.03
    assert rank_uniformity(counted, DRAWS, bins=4).min() > 1e-4


SLOW_TAIL = np.array([0.4, -0.3, 0.002])  # the tail hardly beats: was it on its way out, or back?


def test_both_of_two_answers_are_kept():
    setting = Setting("a slow tail", 1, trials=1, steps=128)
    for number in range(setting.robots):
        rng = np.random.default_rng([3, number])
        robot = Robot(setting, SPANS * rng.uniform(0.3, 0.9, 9), ORDINARY_WORLD, rng, rng)
        robot.perform(SLOW_TAIL)
        log = SwimLog.of_trials([SLOW_TAIL], [RecordedLog(robot.logs[0])])
        belief = infer_log(log, ONE_TRIAL, number, threads=1).belief
        posterior = belief.branches[0].posterior
        phase = posterior.draws[:, posterior.names.index("caudal@1")]
        assert 0.15 < np.mean(np.cos(phase) > 0.0) < 0.85


@pytest.mark.slow
def test_a_world_that_is_not_imagined_is_noticed():
    water = Setting("reactive water", 1, world="reactive", trials=1, noise=0.003)
    (one,) = examined(water, [0])
    assert not one["good"]
    assert one["findings"][0].startswith("no body explains the log")


@pytest.mark.slow  # every hypothesis is fitted
def test_a_fin_without_length_is_said_to_be_missing():
    edge = Setting("edges", 6, "edge", trials=1, noise=0.0003)
    (one,) = examined(edge, [2], replace(ONE_TRIAL, alternatives="doubt"))
    length = NAMES.index("caudal.length")
    assert one["truth"][length] == one["low"][2][length] == 0.0
    assert one["findings"][0].startswith("the tail is missing")


STEPS = 96
SMALL = JointConfig(
    steps=STEPS, bodies=24, poses=12, descents=6, polished=2, restarts=0, alternatives="always",
    nuisances=(),
)  # fmt: skip


def believed(damage, part="left flipper", rounds=2, **more):
    """Return what a target's trials tell, of the hypotheses that speak of a part."""
    config = replace(SMALL, rounds=rounds, **more)
    gap = RealityGap(gyro_noise=0.01)
    target = EngineTarget(None, damage, streams(1)["target"], STEPS, "numba", gap=gap)
    joint = fish_robot(EngineSimulator(STEPS, threads=1))
    some = tuple(h for h in joint.hypotheses if f"servo of the {part}" in h.name)
    result = JointInference(
        target, replace(joint, hypotheses=some), fish_problem(), config, 1
    ).run()
    assert isinstance(result.belief, Answer)
    return result.belief


@pytest.mark.parametrize(
    ("damage", "part", "fault"),
    [
        ("left_pectoral:reversed", "left flipper", "reversed"),
        pytest.param("caudal:seized", "tail", "seized", marks=pytest.mark.slow),
        pytest.param("left_pectoral:dead", "left flipper", "dead", marks=pytest.mark.slow),
        pytest.param("left_pectoral:weak=0.5", "left flipper", "weak", marks=pytest.mark.slow),
    ],
)
def test_a_servos_fault_is_named(damage, part, fault):
    belief = believed(damage, part, rounds=1 if "reversed" in damage else 2)
    assert belief.good, belief.verdict
    assert belief.findings[0].startswith(f"the servo of the {part} is {fault} (")
    assert belief.branches[0].probability > 0.8
    if "weak" in damage:
        middle, low, high = belief.table()[f"servo of the {part}"]
        assert low < middle < high
        assert middle == pytest.approx(0.5, abs=0.03)
        assert from_arrays(to_arrays(belief)).to_dict() == belief.to_dict()


def test_a_gyroscopes_bias_is_found():
    belief = believed("gyro_z:bias=0.1", rounds=1, alternatives="never", nuisances=("gyro_bias",))
    assert belief.good, belief.verdict
    found = [belief.table()[f"gyro bias {axis}"][0] for axis in "xyz"]
    np.testing.assert_allclose(found, [0.0, 0.0, 0.1], atol=0.01)


def test_what_no_hypothesis_says_is_noticed():
    belief = believed("left_pectoral:dead@0.4", rounds=1, alternatives="never")
    assert not belief.good
    assert belief.findings[0].startswith("no body explains the log")


def test_a_reversed_tail_is_no_fault_that_shows():
    """It sweeps as any that began at another phase."""
    target = EngineTarget(None, "caudal:reversed", streams(1)["target"], STEPS, "numba")
    command = np.array([0.3, 0.2, 0.9])
    log, begun = target.perform(command), target.start_angles
    same = EngineSimulator(STEPS, dtype="float64", threads=1)
    robot = fish_robot(same)
    values = {n: np.array([one.mean]) for n, one in robot.table.items() if one.mean is not None}
    values |= zip(robot.sought, target.morphology.to_array()[:, None], strict=True)
    angles = np.array([begun[0], begun[1], np.pi - begun[2]])
    values |= zip(robot.angles, angles[:, None], strict=True)
    there = robot.simulate(values, command[None], True)
    np.testing.assert_allclose(log.gyro, there, rtol=0, atol=1e-12)


def test_the_committed_report_has_every_setting():
    committed = DOCS / "inference" / "report.json"
    report = json.loads(committed.read_text(encoding="utf-8"))
    assert list(report["settings"]) == list(SETTINGS)
    assert list(report["swims"]) == list(SWIMS)


@pytest.mark.slow
def test_measurement_of_a_robot_depends_on_its_number_alone():
    one, again = (measure(Case("exact", 0)) for _ in range(2))
    for found in (one, again):
        for done in found["rounds"]:
            del done["seconds"]
    assert again == one
    assert one["rounds"][-1]["fitness"] > 0.99
    assert one["excess"] < 1.0
