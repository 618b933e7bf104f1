"""Records of five rows a second, known starts, and what was known of the body before."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import aquafish_gym  # noqa: F401  registers the environments
from aquafish_gym import Damage, Morphology
from aquafish_gym.command import scale_action
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.morphology import DIMENSIONS, FIN_WORDS
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import (
    SwimLog,
    fins_after,
    infer_log,
    known_body,
    load_posterior,
    save_posterior,
    watch_swim,
)
from eea.core.checks import ConfigurationError
from eea.core.config import FitConfig
from eea.fish.estimate import MorphologyEstimate
from eea.fish.hypotheses import SERVO
from eea.fish.joint import fish_robot
from eea.fish.prior import UNCHANGED_NAME, since
from eea.fish.simulator import EngineSimulator
from eea.fish.windows import Start, log_windows
from eea.infer.answer import Answer
from eea.infer.unknowns import Unknowns

HOLD, DT, NOISE = 20, 0.2, 0.01
BEFORE = 15  # actions until the damage
FINS = (0.4, -1.0, 0.5)
WHOLE = Morphology.nominal()
KNOWN = FitConfig(nuisances=(), noise=NOISE, bodies=12, descents=3, polished=1)


def swim(
    damage: str, actions: int = 25, noise: float = NOISE, seed: int = 0
) -> tuple[SwimLog, Start, Scenario]:
    """Return what a robot feels 5 times a second from its damage on, its state then, and itself."""
    rng = np.random.default_rng(seed)
    commands = scale_action(rng.uniform(-1.0, 1.0, (BEFORE + actions, 3)))
    robot = Damage.parse(damage).edit(Scenario.create())
    lanes = LaneBatch(Scenario.create(fin_angles=FINS), np.float64, threads=1)
    for command in commands[:BEFORE]:
        lanes.advance(command[None], HOLD)
    state = lanes.states[:, 0].copy()
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
    return log, Start.of_state(state, commands[BEFORE - 1]), robot


def inferred(damage: str, **options: Any) -> tuple[MorphologyEstimate, Answer]:
    log, start, robot = swim(damage)
    found = infer_log(
        log, KNOWN, truth=robot.body[0], prior=WHOLE, start=start, threads=1, **options
    )
    assert isinstance(found.belief, Answer)
    return found, found.belief


def test_windows_of_five_rows_a_second() -> None:
    log, start, _ = swim("none", 45)
    cut = log_windows(log, moving=True, seconds=1.0)
    assert cut.gyro.shape == (2, 16, 3)  # a second has too few
    assert (cut.interval, cut.stride) == (HOLD, 1)
    np.testing.assert_array_equal(cut.gyro[0], log.gyro[2:18])
    np.testing.assert_array_equal(cut.series[0][:17], log.commands[:17])
    known = log_windows(log, start=start)
    assert known.gyro.shape == (1, 45, 3)
    np.testing.assert_array_equal(known.series[0][:2], [start.command, log.commands[0]])


def test_a_known_start_leaves_nothing_to_explain() -> None:
    log, start, robot = swim("left_pectoral:reversed; caudal:seized", noise=0.0)
    windows = log_windows(log, start=start)
    joint = fish_robot(EngineSimulator(windows.steps, threads=1), windows)
    one = Unknowns.of(joint, 1, ())
    values = one.values(one.local(one.prior_mean[None])[:, 0])
    assert not set(values) & set(FIN_WORDS)
    values |= {SERVO[fin]: robot.servo_gain[:, i] for i, fin in enumerate(FIN_WORDS)}
    values |= {d.name: robot.body[:, i] for i, d in enumerate(DIMENSIONS)}
    felt = joint.simulate(values, np.array([0]), True)
    np.testing.assert_allclose(felt[0], log.gyro[1:], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        ("none", UNCHANGED_NAME),
        ("caudal:weak=0.4", "the servo of the tail has another speed"),
        ("caudal:reversed", "the servo of the tail has another speed"),
        ("left_pectoral:missing", "the left flipper is missing"),
        pytest.param(
            "right_pectoral:seized; caudal:width=0.5",
            "the servo of the right flipper has another speed and the tail has other sizes",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_changed_is_named(damage: str, said: str) -> None:
    found, belief = inferred(damage)
    assert belief.good, belief.verdict
    assert belief.branches[0].hypothesis.name == said
    assert belief.branches[0].probability > 0.9
    assert found.objective_fitness is not None
    assert found.objective_fitness > 0.97
    if "weak" in damage:
        middle, low, high = belief.table()["servo of the tail"]
        assert low < middle < high
        assert middle == pytest.approx(0.4, abs=0.02)


@pytest.mark.slow
def test_a_prior_serves_without_a_known_start() -> None:
    log, _, robot = swim("caudal:missing", 40)
    found = infer_log(log, KNOWN, truth=robot.body[0], prior=WHOLE, moving=True, threads=1)
    assert isinstance(found.belief, Answer)
    assert found.belief.good
    assert found.belief.branches[0].hypothesis.name == "the tail is missing"
    assert found.objective_fitness == pytest.approx(1.0, abs=1e-3)


def test_a_known_start_serves_without_a_prior() -> None:
    log, start, robot = swim("none")
    found = infer_log(
        log, FitConfig(nuisances=(), alternatives="never", bodies=24, descents=6, polished=1),
        truth=robot.body[0], start=start, threads=1,
    )  # fmt: skip
    assert found.belief is not None
    assert found.belief.good
    assert found.objective_fitness is not None
    assert found.objective_fitness > 0.9
    assert not found.belief.robot.angles
    with pytest.raises(ConfigurationError, match="from unknown fin angles"):
        fins_after(found)


@pytest.fixture(scope="module")
def shorter() -> Answer:
    return inferred("left_pectoral:length=0.5")[1]


def test_a_posterior_is_a_prior_with_its_noise(shorter: Answer) -> None:
    before = shorter
    log, start, robot = swim("left_pectoral:length=0.5", seed=1)
    found = infer_log(
        log, FitConfig(nuisances=()), truth=robot.body[0], prior=before, start=start, threads=1
    )
    belief = found.belief
    assert isinstance(belief, Answer)
    assert belief.branches[0].hypothesis.name == UNCHANGED_NAME
    assert belief.sigma == before.sigma
    both = belief.spread.sum() / before.spread.sum()  # of two swims that tell equally much
    assert both == pytest.approx(2.0**-0.5, rel=0.05)


def test_a_prior_says_nothing_of_what_changed(shorter: Answer) -> None:
    log, start, _ = swim("none")
    windows = log_windows(log, start=start)
    joint = fish_robot(EngineSimulator(windows.steps, threads=1), windows)
    problem = since(joint, shorter)
    one = next(h for h in problem.hypotheses if h.name == "the tail has other sizes")
    parameters = Unknowns.of(problem, 1, (), one)
    free = np.array(parameters.names)[parameters.prior_precision == 0.0]
    assert set(free) == {"caudal.length", "caudal.width", "caudal.thickness"}
    assert len(problem.hypotheses) == 9 + 27
    odds = sum(h.odds for h in problem.hypotheses if h.changes == 1)
    assert odds == pytest.approx(3 * 0.1 / 0.9)


def test_a_log_of_an_environment_is_understood() -> None:
    env = gym.make("AquaFishRecovery-v0", damage=f"gyro:noise={NOISE}", engine="numba")
    seen, info = env.reset(seed=0)
    start = Start(info["fin_angles"])
    rng, gyro, actions = np.random.default_rng(0), [seen[6:9]], []
    for _ in range(25):
        actions.append(rng.uniform(-1.0, 1.0, 3).astype(np.float32))
        gyro.append(env.step(actions[-1])[0][6:9])
    commands = scale_action([*actions, actions[-1]])
    log = SwimLog(DT * np.arange(26), np.array(gyro), commands)
    found = infer_log(log, KNOWN, prior=WHOLE, start=start, threads=1)
    assert isinstance(found.belief, Answer)
    assert found.belief.branches[0].hypothesis.name == UNCHANGED_NAME
    assert found.belief.good


def test_a_known_body_is_watched_at_five_rows_a_second(tmp_path) -> None:  # type: ignore[no-untyped-def]
    save_posterior(tmp_path / "whole.npz", known_body(WHOLE, NOISE, nuisances=()))
    belief = load_posterior(tmp_path / "whole.npz")
    np.testing.assert_allclose(belief.model, WHOLE.to_array(), atol=1e-6)
    assert "servo_gain" not in belief.table()
    watched = watch_swim(swim("none", 50)[0], belief, threads=1)
    assert (watched.noticed, len(watched.looks)) == (None, 3)
    assert min(look.p for look in watched.looks) > 1e-3
    broken = watch_swim(swim("right_pectoral:missing", 20)[0], belief, threads=1)
    assert broken.noticed is not None


def test_wrong_arguments_are_named() -> None:
    log, start, _ = swim("none")
    with pytest.raises(InvalidArgumentError, match="joint must have the gyroscope's noise"):
        infer_log(log, prior=WHOLE, start=start)
    with pytest.raises(InvalidArgumentError, match="moving must be False where start"):
        infer_log(log, moving=True, start=start)
    with pytest.raises(InvalidArgumentError, match="start must be"):
        infer_log(log, start=(0.0, 0.0, 0.0))  # type: ignore[arg-type]
    with pytest.raises(InvalidArgumentError, match="velocity must"):
        Start(FINS, velocity=(1.0, 2.0))
    with pytest.raises(ConfigurationError, match="noise must be"):
        known_body(WHOLE, 0.0)
    with pytest.raises(ConfigurationError, match="did you mean 'drag'"):
        known_body(WHOLE, NOISE, nuisances=("darg",))
