"""Any swimming is an experiment, and is held against what was believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.morphology import MAXIMA
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.config import FitConfig
from eea.core.experiment import RecordedLog
from eea.fish.estimate import MorphologyEstimate
from eea.fish.known import UNCHANGED, infer_changes, known_body, watch_swim
from eea.fish.log_inference import infer_log
from eea.fish.swim_log import SwimLog
from eea.fish.windows import LAG_SAMPLES, log_windows

NOISE = 0.01
BODY = Damage.parse("left_pectoral:length=0.6").apply(Morphology.nominal())
PLAIN = FitConfig(alternatives="never")
SECOND = 100  # samples


def swim(
    seed: int,
    samples: int,
    become: Morphology | None = None,
    at: int = 0,
    noise: float = NOISE,
) -> SwimLog:
    """Return a swim of brisk commands at 4 Hz, in which the robot may become another."""
    rng, world = np.random.default_rng(seed), CompiledWorld()
    left, right, phase = rng.uniform(-np.pi, np.pi, 3).tolist()
    scenario = Scenario.create(BODY, fin_angles=(left, right, phase))
    world.start(scenario)
    commands = np.repeat(
        rng.uniform([-0.5, -0.5, 0.5], [0.5, 0.5, 1.0], (-(-samples // 25), 3)), 25, axis=0
    )[:samples]
    gyro = []
    for t, (left, right, caudal) in enumerate(commands.tolist()):
        if become is not None and t == at:
            world.update(replace(scenario, body=become.to_array()[None]))
        world.advance((left, right, caudal))
        gyro.append(world.state().spin)
    felt = RecordedLog(np.array(gyro) + rng.normal(0.0, noise, (samples, 3)))
    return SwimLog.of_trials([commands], [felt], moving=True)


def together(*logs: SwimLog) -> SwimLog:
    """Return logs of a trial each as one."""
    number = np.repeat(np.arange(len(logs)), [len(log.time) for log in logs])
    return SwimLog(
        *(np.concatenate([getattr(log, n) for log in logs]) for n in ("time", "gyro", "commands")),
        number,
    )


@pytest.fixture(scope="module")
def known() -> MorphologyEstimate:
    log = together(*(swim(seed, 501 + LAG_SAMPLES) for seed in (1, 2)))
    return infer_log(log, PLAIN, truth=BODY, moving=True, threads=1)


def test_a_body_is_known_from_swimming_alone(known: MorphologyEstimate) -> None:
    assert known.objective_fitness is not None
    assert known.objective_fitness > 0.98
    assert known.belief is not None
    assert known.belief.good
    low, high = known.belief.branches[0].posterior.interval(0.9)
    shares = BODY.to_array() / MAXIMA
    assert ((low[:9] <= shares) & (shares <= high[:9])).sum() >= 6
    low, high = known.interval(0.9)
    assert ((low <= BODY.to_array()) & (BODY.to_array() <= high)).sum() >= 6


def test_from_rest_the_current_is_found_too() -> None:
    rng = np.random.default_rng(0)
    commands = np.repeat(rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (6, 3)), 50, axis=0)
    log = simulate(
        BODY, commands[None], (1.0, 2.0, -1.0), 300, dtype="float64", current=(0.2, -0.1, 0.1),
        record="gyro", interval=1, servo_gain=0.95, lag=0.03,
    )  # fmt: skip
    assert log.gyro is not None
    found = infer_log(SwimLog.of_trials([commands], [log]), PLAIN, truth=BODY, threads=1)
    assert found.objective_fitness is not None
    assert found.objective_fitness > 0.999
    table = found.belief.table()  # type: ignore[union-attr]
    assert table["current x"][0] == pytest.approx(0.2, abs=1e-3)
    assert table["servo gain"][0] == pytest.approx(0.95, abs=1e-4)
    assert table["lag"][0] == pytest.approx(0.03, abs=1e-4)


def test_windows_are_cut_where_they_should_be() -> None:
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


def test_an_unchanged_body_raises_no_alarm_more_often_than_is_said(
    known: MorphologyEstimate,
) -> None:
    watched = watch_swim(swim(7, LAG_SAMPLES + 40 * SECOND + 1), known.belief, threads=1)  # type: ignore[arg-type]
    chances = [look.p for look in watched.looks]
    assert watched.noticed is None
    assert "still the body" in str(watched)
    # Not smaller than even chances would be, and hardly greater: the priors of what a window begins
    # with are wider than what it does begin with.
    assert kstest(chances, "uniform", alternative="greater").pvalue > 1e-2
    assert 0.93 < np.mean([look.excess for look in watched.looks]) < 1.03


@pytest.fixture(scope="module")
def exact() -> MorphologyEstimate:
    """Return what trials without noise tell, as those of a simulation have none."""
    log = together(*(swim(seed, 501 + LAG_SAMPLES, noise=0.0) for seed in (1, 2)))
    return infer_log(log, PLAIN, truth=BODY, moving=True, threads=1)


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.01, 0.05])
def test_trials_without_noise_raise_no_false_alarm_later(
    exact: MorphologyEstimate, noise: float
) -> None:
    assert exact.belief is not None
    assert exact.belief.sigma < 1e-5
    struck = LAG_SAMPLES + 5 * SECOND + 1
    other = Damage.parse("right_pectoral:length=0.5; caudal:length=0.6").apply(BODY)
    log = swim(9, struck + 6 * SECOND, other, struck, noise)
    watched = watch_swim(log, exact.belief, threads=1, until_noticed=True)  # type: ignore[arg-type]
    assert watched.noticed is not None
    assert watched.noticed > 0.01 * struck


def test_a_log_that_does_not_tell_its_noise_is_refused_after_trials_without(
    exact: MorphologyEstimate,
) -> None:
    log = swim(9, 12 * SECOND)
    sparse = SwimLog(log.time[24::25], log.gyro[24::25], log.commands[24::25])
    with pytest.raises(InvalidArgumentError, match="belief must know the gyroscope's noise"):
        watch_swim(sparse, exact.belief)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgumentError, match=r"infer with FitConfig\(noise=0.01\)"):
        infer_changes(sparse, exact.belief)  # type: ignore[arg-type]


def test_nothing_has_changed_since_trials_without_noise(exact: MorphologyEstimate) -> None:
    log = swim(9, LAG_SAMPLES + 2 * SECOND)
    found = infer_changes(log, exact.belief, threads=1)  # type: ignore[arg-type]
    assert found.good
    assert found.branches[0].hypothesis.name == UNCHANGED.name


def test_a_wrong_valley_of_the_initial_state_is_no_change() -> None:
    rng = np.random.default_rng(131)
    command = rng.uniform([-0.5, -0.5, 0.5], [0.5, 0.5, 1.0])
    angles = rng.uniform(-np.pi, np.pi, 3)
    log = simulate(BODY, command, angles, 300, dtype="float64", record="gyro")
    assert log.gyro is not None
    felt = RecordedLog(np.reshape(log.gyro, (300, 3))[180:])
    held = SwimLog.of_trials([command], [felt], moving=True)
    assert watch_swim(held, known_body(BODY, 1e-3, ()), threads=1).noticed is None


@pytest.mark.parametrize("damage", ["right_pectoral:length=0.7", "caudal:missing"])
def test_a_change_of_body_is_noticed_at_once(known: MorphologyEstimate, damage: str) -> None:
    other = Damage.parse(damage).apply(BODY)
    struck = LAG_SAMPLES + 3 * SECOND + 40
    log = swim(8, LAG_SAMPLES + 8 * SECOND + 1, other, struck)
    watched = watch_swim(log, known.belief, threads=1, until_noticed=True)  # type: ignore[arg-type]
    assert watched.noticed is not None
    assert 0.0 < watched.noticed - 0.01 * struck < 3.0
    assert "no longer the body" in str(watched)
