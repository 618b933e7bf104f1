"""Any swimming is an experiment, held against what was believed."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import kstest

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.command import scale_action
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import load_posterior, save_posterior
from eea.core.checks import ConfigurationError
from eea.core.config import FitConfig
from eea.core.experiment import RecordedLog
from eea.fish.estimate import MorphologyEstimate
from eea.fish.joint import fish_robot
from eea.fish.known import (
    UNCHANGED,
    body_changes,
    infer_changes,
    known_body,
    watch_swim,
)
from eea.fish.log_inference import infer_log
from eea.fish.simulator import EngineSimulator
from eea.fish.swim_log import SwimLog
from eea.fish.windows import LAG_SAMPLES, log_windows
from eea.infer.unknowns import Unknowns
from tests.eea.fish_swims import BODY, NOISE, swim, together

PLAIN = FitConfig(alternatives="never")
SECOND = 100  # samples


@pytest.fixture(scope="module")
def known():
    log = together(*(swim(seed, 501 + LAG_SAMPLES) for seed in (1, 2)))
    return infer_log(log, PLAIN, truth=BODY, moving=True, threads=1)


def test_a_body_is_known_from_swimming_alone(known):
    assert known.objective_fitness > 0.98
    assert known.belief.good
    low, high = known.belief.branches[0].posterior.interval(0.9)
    shares = BODY.to_array() / AQUAFISH.maxima
    assert ((low[:9] <= shares) & (shares <= high[:9])).sum() >= 6
    low, high = known.interval(0.9)
    assert ((low <= BODY.to_array()) & (BODY.to_array() <= high)).sum() >= 6


def test_from_rest_the_current_is_found_too():
    rng = np.random.default_rng(0)
    commands = np.repeat(rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (6, 3)), 50, axis=0)
    log = simulate(
        BODY, commands[None], (1.0, 2.0, -1.0), 300, dtype="float64", current=(0.2, -0.1, 0.1),
        record="gyro", interval=1, servo_gain=0.95, lag=0.03,
    )  # fmt: skip
    found = infer_log(SwimLog.of_trials([commands], [log]), PLAIN, truth=BODY, threads=1)
    assert found.objective_fitness > 0.999
    table = found.belief.table()
    assert table["current x"][0] == pytest.approx(0.2, abs=1e-3)
    assert table["servo gain"][0] == pytest.approx(0.95, abs=1e-4)
    assert table["lag"][0] == pytest.approx(0.03, abs=1e-4)


def test_windows_are_cut_where_they_should_be():
    log = swim(3, 601)
    short = SwimLog(*(part[:301] for part in (log.time, log.gyro, log.commands)))
    cut = log_windows(together(log, short), moving=True, seconds=2.5)
    assert cut.interval == 1  # of commands held for 25 rows, the first of which is cut at 24
    assert [len(part) for part in (cut.series, cut.spin, cut.gyro)] == [3, 3, 3]
    np.testing.assert_array_equal(cut.gyro[1], log.gyro[LAG_SAMPLES + 251 : LAG_SAMPLES + 501])
    np.testing.assert_array_equal(cut.spin[1], log.gyro[LAG_SAMPLES + 250])
    held = np.repeat(cut.series, cut.interval, axis=1)
    np.testing.assert_array_equal(held[1], log.commands[250 : 500 + LAG_SAMPLES])
    resting = log_windows(log)
    assert resting.gyro.shape == (1, 600, 3)
    assert resting.begun == 0


def test_an_unchanged_body_raises_no_alarm_more_often_than_is_said(known):
    watched = watch_swim(swim(7, LAG_SAMPLES + 20 * SECOND + 1), known.belief, threads=1)
    chances = [look.p for look in watched.looks]
    assert watched.noticed is None
    assert "still the body" in str(watched)
    # Not smaller than even chances would be, and hardly greater: the priors of what a window begins
    # with are wider than what it does begin with.
    assert kstest(chances, "uniform", alternative="greater").pvalue > 1e-2
    assert 0.93 < np.mean([look.excess for look in watched.looks]) < 1.03


@pytest.fixture(scope="module")
def exact():
    """Return what trials without noise tell, as those of a simulation have none."""
    log = together(*(swim(seed, 501 + LAG_SAMPLES, noise=0.0) for seed in (1, 2)))
    return infer_log(log, PLAIN, truth=BODY, moving=True, threads=1)


@pytest.mark.parametrize(
    "noise", [*(pytest.param(sd, marks=pytest.mark.slow) for sd in (0.0, 0.001, 0.01)), 0.05]
)
def test_trials_without_noise_raise_no_false_alarm_later(exact, noise):
    assert exact.belief.sigma < 1e-5
    struck = LAG_SAMPLES + 5 * SECOND + 1
    other = Damage.parse("right_pectoral:length=0.5; caudal:length=0.6").apply(BODY)
    log = swim(9, struck + 6 * SECOND, other, struck, noise)
    watched = watch_swim(log, exact.belief, threads=1, until_noticed=True)
    assert watched.noticed is not None
    assert watched.noticed > 0.01 * struck


def test_after_trials_without_noise_a_log_must_tell_its_own(exact):
    log = swim(9, 12 * SECOND)
    sparse = SwimLog(log.time[24::25], log.gyro[24::25], log.commands[24::25])
    with pytest.raises(InvalidArgumentError, match="belief must know the gyroscope's noise"):
        watch_swim(sparse, exact.belief)
    with pytest.raises(InvalidArgumentError, match=r"infer with FitConfig\(noise=0.01\)"):
        infer_changes(sparse, exact.belief)
    short = swim(9, LAG_SAMPLES + 2 * SECOND)
    found = infer_changes(short, exact.belief, threads=1)
    assert found.good
    assert found.branches[0].hypothesis.name == UNCHANGED.name


def test_a_wrong_valley_of_the_initial_state_is_no_change():
    rng = np.random.default_rng(131)
    command = rng.uniform([-0.5, -0.5, 0.5], [0.5, 0.5, 1.0])
    angles = rng.uniform(-np.pi, np.pi, 3)
    log = simulate(BODY, command, angles, 300, dtype="float64", record="gyro")
    felt = RecordedLog(np.reshape(log.gyro, (300, 3))[180:])
    held = SwimLog.of_trials([command], [felt], moving=True)
    assert watch_swim(held, known_body(BODY, 1e-3, ()), threads=1).noticed is None


def test_what_an_answer_says_is_not_said_again():
    log, _ = broken_swim("none")
    with pytest.raises(ConfigurationError, match=r"noise is that of belief; got 0\.02"):
        infer_changes(log, KNOWN, FitConfig(noise=0.02))
    bad = replace(KNOWN, goodness=replace(KNOWN.goodness, good=False))
    with pytest.raises(ConfigurationError, match="an answer must be good to be known"):
        infer_changes(log, bad)


@pytest.mark.parametrize(
    "damage",
    [pytest.param("right_pectoral:length=0.7", marks=pytest.mark.slow), "caudal:missing"],
)
def test_a_change_of_body_is_noticed_at_once(known, damage):
    other = Damage.parse(damage).apply(BODY)
    struck = LAG_SAMPLES + 3 * SECOND + 40
    log = swim(8, LAG_SAMPLES + 8 * SECOND + 1, other, struck)
    watched = watch_swim(log, known.belief, threads=1, until_noticed=True)
    assert watched.noticed is not None
    assert 0.0 < watched.noticed - 0.01 * struck < 3.0
    assert "no longer the body" in str(watched)


HOLD, DT = 20, 0.2  # steps and s of an action
BEFORE = 15  # actions until the damage
FINS = (0.4, -1.0, 0.5)
WHOLE = Morphology.nominal()
KNOWN = known_body(WHOLE, NOISE, nuisances=())
QUICK = FitConfig(bodies=12, descents=3, polished=1)


def broken_swim(damage, actions=25, noise=NOISE, seed=0):
    """Return what a robot feels 5 times a second from its damage on, and itself."""
    rng = np.random.default_rng(seed)
    commands = scale_action(AQUAFISH, rng.uniform(-1.0, 1.0, (BEFORE + actions, 3)))
    robot = Damage.parse(damage).edit(Scenario.create())
    lanes = LaneBatch(Scenario.create(fin_angles=FINS), np.float64, threads=1)
    for command in commands[:BEFORE]:
        lanes.advance(command[None], HOLD)
    lanes.update(robot)
    felt = [np.ravel(lanes.state().spin)]
    for command in commands[BEFORE:]:
        lanes.advance(command[None], HOLD)
        felt.append(np.ravel(lanes.state().spin))
    log = SwimLog(
        np.round(DT * np.arange(actions + 1), 9),
        np.array(felt) + noise * rng.standard_normal((actions + 1, 3)),
        np.concatenate([commands[BEFORE:], commands[-1:]]),
    )
    return log, robot


def test_windows_of_five_rows_a_second():
    log, _ = broken_swim("none", 45)
    cut = log_windows(log, moving=True, seconds=1.0)
    assert cut.gyro.shape == (2, 16, 3)  # a second has too few
    assert (cut.interval, cut.stride) == (HOLD, 1)
    np.testing.assert_array_equal(cut.gyro[0], log.gyro[2:18])
    np.testing.assert_array_equal(cut.series[0][:17], log.commands[:17])


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        pytest.param("none", UNCHANGED.name, marks=pytest.mark.slow),
        ("caudal:weak=0.4", "the servo of the tail has another speed"),
        pytest.param(
            "left_pectoral:reversed", "the servo of the left flipper has another speed",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "left_pectoral:missing", "the left flipper is missing", marks=pytest.mark.slow
        ),
        pytest.param(
            "right_pectoral:seized; caudal:width=0.5",
            "the servo of the right flipper has another speed and the tail has other sizes",
            marks=pytest.mark.slow,
        ),
    ],
)  # fmt: skip
def test_what_changed_is_named(damage, said):
    log, robot = broken_swim(damage)
    belief = infer_changes(log, KNOWN, QUICK, threads=1)
    assert belief.good, belief.verdict
    assert belief.branches[0].hypothesis.name == said
    assert belief.branches[0].probability > 0.9
    assert MorphologyEstimate.of(belief, robot.body[0]).objective_fitness > 0.97
    if "weak" in damage:
        middle, low, high = belief.table()["servo of the tail"]
        assert low < middle < high
        assert middle == pytest.approx(0.4, abs=0.02)


@pytest.fixture(scope="module")
def shorter():
    return infer_changes(broken_swim("left_pectoral:length=0.5")[0], KNOWN, QUICK, threads=1)


@pytest.mark.slow
def test_a_posterior_is_a_prior_with_its_noise(shorter):
    log, _ = broken_swim("left_pectoral:length=0.5", seed=1)
    belief = infer_changes(log, shorter, threads=1)
    assert belief.branches[0].hypothesis.name == UNCHANGED.name
    assert belief.sigma == shorter.sigma
    alone = infer_changes(log, KNOWN, QUICK, threads=1)
    np.testing.assert_array_less(belief.spread[:3], 0.9 * shorter.spread[:3])
    np.testing.assert_array_less(belief.spread[:3], 0.9 * alone.spread[:3])


def test_what_is_known_says_nothing_of_what_changed():
    windows = log_windows(broken_swim("none")[0], moving=True)
    fish = fish_robot(EngineSimulator(windows.steps, threads=1), windows)
    changes = body_changes(AQUAFISH)
    robot = KNOWN.known(replace(fish, hypotheses=changes, at_once=2)).robot
    one = next(h for h in changes if h.name == "the tail has other sizes")
    parameters = Unknowns.of(robot, 1, (), one)
    flat = (parameters.prior_precision == 0.0) & ~parameters.circular
    free = np.array(parameters.names)[flat]
    assert set(free) == {"caudal.length", "caudal.width", "caudal.thickness"}
    assert len(robot.alternatives) == 9 + 27
    odds = sum(h.odds for h in robot.alternatives if h.changes == 1)
    assert odds == pytest.approx(3 * 0.1 / 0.9)


def test_a_log_of_an_environment_is_understood():
    env = gym.make("AquaFishRecovery-v0", damage=f"gyro:noise={NOISE}", engine="numba")
    seen, _ = env.reset(seed=0)
    rng, gyro, actions = np.random.default_rng(0), [seen[6:9]], []
    for _ in range(25):
        actions.append(rng.uniform(-1.0, 1.0, 3).astype(np.float32))
        gyro.append(env.step(actions[-1])[0][6:9])
    commands = scale_action(AQUAFISH, [*actions, actions[-1]])
    log = SwimLog(DT * np.arange(26), np.array(gyro), commands)
    found = infer_changes(log, KNOWN, QUICK, threads=1)
    assert found.branches[0].hypothesis.name == UNCHANGED.name
    assert found.good


def test_a_known_body_is_watched_at_five_rows_a_second(tmp_path):
    save_posterior(tmp_path / "whole.npz", KNOWN)
    belief = load_posterior(tmp_path / "whole.npz")
    np.testing.assert_allclose(belief.model, WHOLE.to_array(), atol=1e-6)
    assert "servo_gain" not in belief.table()
    watched = watch_swim(broken_swim("none", 50)[0], belief, threads=1)
    assert (watched.noticed, len(watched.looks)) == (None, 3)
    assert min(look.p for look in watched.looks) > 1e-3
    broken = watch_swim(broken_swim("right_pectoral:missing", 20)[0], belief, threads=1)
    assert broken.noticed is not None
