"""Any swimming is an experiment, and is held against what was believed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.aquafish.estimate import MorphologyEstimate
from eea.aquafish.swims import BEFORE, Trace, estimate_from_swims, windows
from eea.aquafish.watch import WINDOW, watch_swim
from eea.core import ConfigurationError, EEAConfig
from eea.core.config import JointConfig

NOISE = 0.01
BODY = Damage.parse("left_pectoral:length=0.6").apply(Morphology.nominal())
PLAIN = JointConfig(alternatives="never")


def swim(seed: int, samples: int, become: Morphology | None = None, at: int = 0) -> Trace:
    """Return a swim of brisk commands at 4 Hz, in which the robot may become another."""
    rng, world = np.random.default_rng(seed), CompiledWorld()
    left, right, phase = rng.uniform(-np.pi, np.pi, 3).tolist()
    world.reset(BODY.to_array(), (left, right, phase), (0.0, 0.0, 0.0))
    commands = np.repeat(
        rng.uniform([-0.5, -0.5, 0.5], [0.5, 0.5, 1.0], (-(-samples // 25), 3)), 25, axis=0
    )[:samples]
    gyro = []
    for t, (left, right, caudal) in enumerate(commands.tolist()):
        if become is not None and t == at:
            world.become(become.to_array())
        world.advance((left, right, caudal))
        gyro.append(world.state().spin)
    return Trace(commands, np.array(gyro) + rng.normal(0.0, NOISE, (samples, 3)))


@pytest.fixture(scope="module")
def known() -> MorphologyEstimate:
    config = EEAConfig("joint", steps=500, rounds=1, joint=PLAIN)
    traces = [swim(seed, 500 + BEFORE) for seed in (1, 2)]
    return estimate_from_swims(traces, config, truth=BODY, moving=True, threads=1)


def test_a_body_is_known_from_swimming_alone(known: MorphologyEstimate) -> None:
    assert known.objective_fitness is not None
    assert known.objective_fitness > 0.98
    assert known.belief is not None
    assert known.belief.good
    low, high = known.interval(0.9)
    held = (low <= BODY.to_array()) & (BODY.to_array() <= high)
    assert held.sum() >= 6


def test_from_rest_the_current_is_found_too() -> None:
    rng = np.random.default_rng(0)
    commands = np.repeat(rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (6, 3)), 50, axis=0)
    log = simulate(
        BODY, commands[None], (1.0, 2.0, -1.0), 300, dtype="float64", current=(0.2, -0.1, 0.1),
        record="gyro", interval=1, servo_gain=0.95, lag=0.03,
    )  # fmt: skip
    assert log.gyro is not None
    config = EEAConfig("joint", steps=300, rounds=1, joint=PLAIN)
    found = estimate_from_swims([Trace(commands, log.gyro[0])], config, truth=BODY, threads=1)
    assert found.objective_fitness is not None
    assert found.objective_fitness > 0.999
    table = found.belief.table()  # type: ignore[union-attr]
    assert table["current x"][0] == pytest.approx(0.2, abs=1e-3)
    assert table["servo gain"][0] == pytest.approx(0.95, abs=1e-4)
    assert table["lag"][0] == pytest.approx(0.03, abs=1e-4)


def test_windows_are_cut_where_they_should_be() -> None:
    trace = swim(3, 600)
    cut = windows([trace, Trace(*(part[:300] for part in trace))], moving=True, steps=250)
    assert cut.interval == 25  # as the commands, of which a window begins in the middle of one
    assert [len(part) for part in cut[:3]] == [3, 3, 3]
    np.testing.assert_array_equal(cut.gyro[1], trace.gyro[BEFORE + 250 : BEFORE + 500])
    np.testing.assert_array_equal(cut.spin[1], trace.gyro[BEFORE + 249])
    held = np.repeat(cut.series, cut.interval, axis=1)[:, : 250 + BEFORE]
    np.testing.assert_array_equal(held[1], trace.commands[250 : 500 + BEFORE])
    resting = windows([trace], moving=False)
    assert resting.gyro.shape == (1, 600, 3)
    assert resting.begun == 0


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"swims": []}, "swims must hold at least one"),
        ({"swims": [Trace(np.zeros((15, 3)), np.zeros((15, 3)))]}, "steps must be"),
        ({"swims": [Trace(np.zeros((90, 3)), np.zeros((80, 3)))]}, "gyro of swim 1 must have"),
        ({"swims": [Trace(np.ones((90, 3)), np.zeros((90, 3)))]}, "commands of swim 1"),
        ({"config": EEAConfig("none")}, "config.condition must be joint"),
    ],
)
def test_what_makes_no_sense_is_refused(wrong: dict[str, Any], says: str) -> None:
    right = {"swims": [swim(3, 300)], "moving": True}
    with pytest.raises((ConfigurationError, InvalidArgumentError), match=says):
        estimate_from_swims(**right | wrong)


def test_an_unchanged_body_raises_no_alarm_more_often_than_is_said(
    known: MorphologyEstimate,
) -> None:
    watched = watch_swim(swim(7, BEFORE + 40 * WINDOW), known.belief, threads=1)  # type: ignore[arg-type]
    chances = [look.p for look in watched.looks]
    assert watched.noticed is None
    assert "still the body" in str(watched)
    # Not smaller than even chances would be, and hardly greater: the priors of what a window begins
    # with are wider than what it does begin with.
    assert kstest(chances, "uniform", alternative="greater").pvalue > 1e-2
    assert 0.93 < np.mean([look.excess for look in watched.looks]) < 1.03


@pytest.mark.parametrize("damage", ["right_pectoral:length=0.7", "caudal:missing"])
def test_a_change_of_body_is_noticed_at_once(known: MorphologyEstimate, damage: str) -> None:
    other = Damage.parse(damage).apply(BODY)
    struck = BEFORE + 3 * WINDOW + 40
    trace = swim(8, BEFORE + 8 * WINDOW, other, struck)
    watched = watch_swim(trace, known.belief, threads=1, until_noticed=True)  # type: ignore[arg-type]
    assert watched.noticed is not None
    assert 0.0 < watched.noticed - 0.01 * struck < 3.0
    assert "no longer the body" in str(watched)
