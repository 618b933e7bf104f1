"""Swims of a body that was known: what has changed since, also at five rows a second."""

from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

import aquafish_gym  # noqa: F401  registers the environments
from aquafish_gym import Damage, Morphology
from aquafish_gym.command import scale_action
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import (
    SwimLog,
    infer_changes,
    known_body,
    load_posterior,
    save_posterior,
    watch_swim,
)
from eea.core.checks import ConfigurationError
from eea.core.config import FitConfig
from eea.fish.estimate import MorphologyEstimate
from eea.fish.joint import fish_robot
from eea.fish.known import CHANGES, UNCHANGED
from eea.fish.simulator import EngineSimulator
from eea.fish.windows import log_windows
from eea.infer.answer import Answer
from eea.infer.unknowns import Unknowns

HOLD, DT, NOISE = 20, 0.2, 0.01
BEFORE = 15  # actions until the damage
FINS = (0.4, -1.0, 0.5)
WHOLE = Morphology.nominal()
KNOWN = known_body(WHOLE, NOISE, nuisances=())
QUICK = FitConfig(bodies=12, descents=3, polished=1)


def swim(
    damage: str, actions: int = 25, noise: float = NOISE, seed: int = 0
) -> tuple[SwimLog, Scenario]:
    """Return what a robot feels 5 times a second from its damage on, and itself."""
    rng = np.random.default_rng(seed)
    commands = scale_action(rng.uniform(-1.0, 1.0, (BEFORE + actions, 3)))
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


def test_windows_of_five_rows_a_second() -> None:
    log, _ = swim("none", 45)
    cut = log_windows(log, moving=True, seconds=1.0)
    assert cut.gyro.shape == (2, 16, 3)  # a second has too few
    assert (cut.interval, cut.stride) == (HOLD, 1)
    np.testing.assert_array_equal(cut.gyro[0], log.gyro[2:18])
    np.testing.assert_array_equal(cut.series[0][:17], log.commands[:17])


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        ("none", UNCHANGED.name),
        ("caudal:weak=0.4", "the servo of the tail has another speed"),
        ("left_pectoral:reversed", "the servo of the left flipper has another speed"),
        ("left_pectoral:missing", "the left flipper is missing"),
        pytest.param(
            "right_pectoral:seized; caudal:width=0.5",
            "the servo of the right flipper has another speed and the tail has other sizes",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_changed_is_named(damage: str, said: str) -> None:
    log, robot = swim(damage)
    belief = infer_changes(log, KNOWN, QUICK, threads=1)
    assert belief.good, belief.verdict
    assert belief.branches[0].hypothesis.name == said
    assert belief.branches[0].probability > 0.9
    fitness = MorphologyEstimate.of(belief, robot.body[0]).objective_fitness
    assert fitness is not None
    assert fitness > 0.97
    if "weak" in damage:
        middle, low, high = belief.table()["servo of the tail"]
        assert low < middle < high
        assert middle == pytest.approx(0.4, abs=0.02)


@pytest.fixture(scope="module")
def shorter() -> Answer:
    return infer_changes(swim("left_pectoral:length=0.5")[0], KNOWN, QUICK, threads=1)


def test_a_posterior_is_a_prior_with_its_noise(shorter: Answer) -> None:
    log, _ = swim("left_pectoral:length=0.5", seed=1)
    belief = infer_changes(log, shorter, threads=1)
    assert belief.branches[0].hypothesis.name == UNCHANGED.name
    assert belief.sigma == shorter.sigma
    alone = infer_changes(log, KNOWN, QUICK, threads=1)
    np.testing.assert_array_less(belief.spread[:3], 0.9 * shorter.spread[:3])
    np.testing.assert_array_less(belief.spread[:3], 0.9 * alone.spread[:3])


def test_what_is_known_says_nothing_of_what_changed(shorter: Answer) -> None:
    windows = log_windows(swim("none")[0], moving=True)
    fish = fish_robot(EngineSimulator(windows.steps, threads=1), windows)
    robot = shorter.known(replace(fish, hypotheses=CHANGES, at_once=2)).robot
    one = next(h for h in CHANGES if h.name == "the tail has other sizes")
    parameters = Unknowns.of(robot, 1, (), one)
    flat = (parameters.prior_precision == 0.0) & ~parameters.circular
    free = np.array(parameters.names)[flat]
    assert set(free) == {"caudal.length", "caudal.width", "caudal.thickness"}
    assert len(robot.alternatives) == 9 + 27
    odds = sum(h.odds for h in robot.alternatives if h.changes == 1)
    assert odds == pytest.approx(3 * 0.1 / 0.9)


def test_a_log_of_an_environment_is_understood() -> None:
    env = gym.make("AquaFishRecovery-v0", damage=f"gyro:noise={NOISE}", engine="numba")
    seen, _ = env.reset(seed=0)
    rng, gyro, actions = np.random.default_rng(0), [seen[6:9]], []
    for _ in range(25):
        actions.append(rng.uniform(-1.0, 1.0, 3).astype(np.float32))
        gyro.append(env.step(actions[-1])[0][6:9])
    commands = scale_action([*actions, actions[-1]])
    log = SwimLog(DT * np.arange(26), np.array(gyro), commands)
    found = infer_changes(log, KNOWN, QUICK, threads=1)
    assert found.branches[0].hypothesis.name == UNCHANGED.name
    assert found.good


def test_a_known_body_is_watched_at_five_rows_a_second(tmp_path) -> None:  # type: ignore[no-untyped-def]
    save_posterior(tmp_path / "whole.npz", KNOWN)
    belief = load_posterior(tmp_path / "whole.npz")
    np.testing.assert_allclose(belief.model, WHOLE.to_array(), atol=1e-6)
    assert "servo_gain" not in belief.table()
    watched = watch_swim(swim("none", 50)[0], belief, threads=1)
    assert (watched.noticed, len(watched.looks)) == (None, 3)
    assert min(look.p for look in watched.looks) > 1e-3
    broken = watch_swim(swim("right_pectoral:missing", 20)[0], belief, threads=1)
    assert broken.noticed is not None


def test_wrong_arguments_are_named() -> None:
    log, _ = swim("none")
    with pytest.raises(ConfigurationError, match=r"noise is that of belief; got 0\.02"):
        infer_changes(log, KNOWN, FitConfig(noise=0.02))
    with pytest.raises(InvalidArgumentError, match="belief must be"):
        infer_changes(log, WHOLE)  # type: ignore[arg-type]
    bad = replace(KNOWN, goodness=replace(KNOWN.goodness, good=False))
    with pytest.raises(ConfigurationError, match="an answer must be good to be known"):
        infer_changes(log, bad)
    with pytest.raises(ConfigurationError, match="noise must be"):
        known_body(WHOLE, 0.0)
    with pytest.raises(ConfigurationError, match="did you mean 'drag'"):
        known_body(WHOLE, NOISE, nuisances=("darg",))
