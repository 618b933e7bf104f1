"""Readings that cannot be, and arguments that are wrong: the agent swims on, or refuses them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import aquafish_gym  # noqa: F401  registers the environments
from aquafish.online import AgentConfig, SelfModelAgent, thresholds
from aquafish.online.gaits import load_library
from aquafish_gym.envs import AquaFishEnv
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.scenario import CHANNELS, Scenario
from aquafish_gym.sense import limits
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.agents import ControllerAgent

QUICK = AgentConfig(generations=1, refinements=0)
MOST = limits()
Spoil = Callable[[int, np.ndarray], object]  # at an action changes an observation (9,) in place


def swim(
    spoil: Spoil, damage: str = "none", steps: int = 110, config: AgentConfig = QUICK,
    known: bool = True,
) -> tuple[SelfModelAgent, np.ndarray]:  # fmt: skip
    """Return an agent that observes spoilt readings, and its actions."""
    env = gym.make("AquaFishRecovery-v0", damage=damage, engine="numba")
    observation, info = env.reset(seed=1)
    # Of eight phases of a teacher, which swim nearly equally far, a rounding error would choose.
    agent, actions = SelfModelAgent(config=config, teachers=()), []
    agent.begin(info["fin_angles"] if known else None)
    for step in range(steps):
        seen = observation.astype(float)
        spoil(step, seen)
        actions.append(agent.act(seen))
        observation, *_ = env.step(actions[-1])
    env.close()
    return agent, np.array(actions)


def about(agent: SelfModelAgent, what: str) -> list[str]:
    return [event.about for event in agent.events if event.what == what]


def at(steps: tuple[int, ...], channel: int, reading: float) -> Spoil:
    return lambda step, seen: step in steps and seen.__setitem__(channel, reading)


@pytest.fixture(scope="module")
def untouched() -> SelfModelAgent:
    return swim(lambda *_: None, "caudal:missing@20")[0]


@pytest.mark.parametrize(("channel", "reading"), [(6, np.nan), (4, -1e300)])
def test_a_glitch_is_not_observed(channel: int, reading: float, untouched: SelfModelAgent) -> None:
    steps = (0, 1, 7, 49, 60, 85)  # at the start, in the calibration, at its end, and after it
    agent, actions = swim(at(steps, channel, reading), "caudal:missing@20")
    assert np.isfinite(actions).all()
    assert np.isfinite(agent.model.state).all()
    assert about(agent, "alarm") == ["this is not what the self-model predicts"]  # at 20 s
    assert set(about(agent, "inferred")) == {"the tail is missing"}
    assert about(agent, "sensor") == []
    np.testing.assert_allclose(agent.model.state, untouched.model.state, atol=0.01)


def test_beyond_its_minute_it_still_answers_and_changes_its_gait() -> None:
    """With faults and glitches, in an episode that is longer than the agent's settings say."""
    damage = "caudal:missing@20; left_pectoral:missing@80"
    env = AquaFishEnv(task=SwimForward(100.0), damage=damage, engine="numba")
    observation, info = env.reset(seed=0)
    rng = np.random.default_rng(0)
    agent, actions = SelfModelAgent(config=QUICK, teachers=()), []
    agent.begin(info["fin_angles"])
    for _ in range(480):
        seen = observation.astype(float)
        if rng.random() < 0.05:
            seen[rng.integers(9)] = rng.choice([np.nan, np.inf, 1e6])
        actions.append(agent.act(seen))
        observation, *_ = env.step(actions[-1])
    env.close()
    assert np.isfinite(actions).all()
    assert np.isfinite(agent.model.state).all()
    chose = [event.seconds for event in agent.events if event.what == "chose"]
    assert any(20 < seconds < 60 for seconds in chose)
    assert any(80 < seconds < 90 for seconds in chose)


@pytest.mark.parametrize("channels", [slice(0, 3), slice(3, 6)])
def test_a_direction_without_length_is_not_observed(
    channels: slice, untouched: SelfModelAgent
) -> None:
    def spoil(step: int, seen: np.ndarray) -> None:
        if step in (30, 31, 60):
            seen[channels] = 0.0

    agent, _ = swim(spoil, "caudal:missing@20")
    assert len(about(agent, "alarm")) == 1  # at 20 s
    assert set(about(agent, "inferred")) == {"the tail is missing"}
    np.testing.assert_allclose(agent.model.state, untouched.model.state, atol=0.01)


@pytest.mark.parametrize("known", [True, False], ids=["fins known", "fins unknown"])
def test_a_channel_without_readings_is_left_out(known: bool) -> None:
    spoil = at(tuple(range(30, 110)), 7, np.nan)
    agent, _ = swim(spoil, "left_pectoral:length=0.3@16", known=known)
    assert about(agent, "sensor") == ["gyro_y gives no readings"]
    assert len(about(agent, "alarm")) == 1
    assert about(agent, "inferred")[-1].startswith("the left flipper has 30% of its length")
    agent.act(np.zeros(9))  # it reads again, and is used again
    assert np.isfinite(agent.model.noise[7])


def test_what_breaks_while_nothing_is_observed_is_found_after_it() -> None:
    def outage(step: int, seen: np.ndarray) -> None:
        if 100 < step < 104:
            seen[:] = np.inf

    agent, _ = swim(outage, "caudal:length=0.4@20; right_pectoral:weak=0.5@20", 130)
    found = about(agent, "inferred")[-1]
    assert found.startswith(
        "the right flipper turns at 50% of its speed and the tail has 40% of its length"
    )
    assert "_y" not in found  # no sensor is broken


def test_without_any_readings_it_swims_by_dead_reckoning() -> None:
    agent, actions = swim(lambda _, seen: seen.fill(np.nan))
    assert np.isfinite(actions).all()
    assert about(agent, "sensor") == [f"{channel} gives no readings" for channel in CHANNELS]
    assert about(agent, "alarm") == []


def test_a_gyroscope_alone_is_not_said_to_lack_the_other_sensors() -> None:
    gyro = AgentConfig(gyro_only=True, refinements=0)
    agent, _ = swim(lambda _, seen: seen[:6].fill(np.nan), "caudal:missing@15", config=gyro)
    assert about(agent, "sensor") == []
    assert about(agent, "inferred")[-1] == "the tail is missing"


@pytest.mark.parametrize(("channel", "reading"), [(5, 1.0), (8, -10.0)])
def test_a_reading_alone_that_surprises_every_filter_does_not_calibrate(
    channel: int, reading: float
) -> None:
    agent, _ = swim(at((30,), channel, reading), steps=60)
    np.testing.assert_array_equal(agent.model.model_error, thresholds.MODEL_ERROR)


@pytest.mark.parametrize(
    ("share", "known"), [pytest.param(0.2, False, marks=pytest.mark.slow), (1.0, True)]
)
def test_no_storm_of_possible_readings_silences_it(share: float, known: bool) -> None:
    rng = np.random.default_rng(0)

    def storm(_: int, seen: np.ndarray) -> None:
        wild = rng.random(len(seen)) < share
        seen[wild] = rng.uniform(-MOST, MOST)[wild]

    agent, actions = swim(storm, steps=75, known=known)
    assert np.isfinite(actions).all()
    assert np.isfinite(agent.model.state).all()


WRONG: dict[str, Any] = {
    "none": None, "booleans": [True] * 9, "ragged": [[0.0], 1.0], "short": np.zeros(8),
    "two robots": np.zeros((2, 9)), "masked": np.ma.masked_array(np.zeros(9), [True] * 9),
}  # fmt: skip


@pytest.mark.parametrize("step", [20, 70])
def test_a_malformed_observation_changes_nothing(step: int) -> None:
    env = gym.make("AquaFishRecovery-v0", damage="none", engine="numba")
    observation, info = env.reset(seed=1)
    agents = [SelfModelAgent(config=QUICK) for _ in range(2)]
    for agent in agents:
        agent.begin(info["fin_angles"])
    for k in range(step + 3):
        for wrong in WRONG.values() if k == step else ():
            with pytest.raises(InvalidArgumentError, match="observation must"):
                agents[0].act(wrong)
            with pytest.raises(InvalidArgumentError, match="fin_angles must"):
                agents[0].begin((0.0, np.nan, 0.0))
        one, other = (agent.act(observation) for agent in agents)
        np.testing.assert_array_equal(one, other)
        observation, *_ = env.step(one)


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("robot", lambda: SelfModelAgent(robot=Scenario.create(servo_lag=[0.1]))),
        ("robot", lambda: SelfModelAgent(robot=Scenario.create(servo_gain=np.ones((2, 3))))),
        ("library must have gaits .* hold, 10 steps", lambda: SelfModelAgent(hold=10)),
        ("inferences", lambda: AgentConfig(inferences=(5, 3))),
        ("info", lambda: ControllerAgent(load_library()[0]).reset({})),
    ],
)
def test_what_does_not_fit_the_agent_is_refused_by_name(name: str, make: Any) -> None:
    """Of a right kind; ``tests/robustness`` has those of a wrong kind."""
    with pytest.raises(InvalidArgumentError, match=name):
        make()


@pytest.mark.parametrize(
    "agent", [SelfModelAgent(config=QUICK), ControllerAgent(load_library()[0])]
)
def test_an_agent_that_has_not_begun_says_so(agent: Any) -> None:
    with pytest.raises(InvalidArgumentError, match="must be called before act"):
        agent.act(np.zeros((1, 9)))


@pytest.mark.parametrize("reading", [np.nan, np.inf, -1e30, 300.0])
def test_an_agent_of_a_controller_senses_the_last_reading_instead_of_a_glitch(
    reading: float,
) -> None:
    rng = np.random.default_rng(0)
    seen = rng.uniform(-1.0, 1.0, (6, 2, 9)).astype(np.float32)
    one, other = (ControllerAgent(load_library()[0]) for _ in range(2))
    for agent in (one, other):
        agent.reset({"fin_angles": np.zeros((2, 3))})
    for k, row in enumerate(seen):
        spoilt, held = row.copy(), row.copy()
        if k == 3:
            spoilt[1, 6], held[1, 6] = reading, seen[2, 1, 6]
        np.testing.assert_array_equal(one.act(spoilt), other.act(held))
    others = [wrong for name, wrong in WRONG.items() if name != "two robots"]
    for wrong in (*others, np.zeros((3, 9)), np.zeros((2, 8))):
        with pytest.raises(InvalidArgumentError, match="observations must"):
            one.act(wrong)
    np.testing.assert_array_equal(one.act(seen[0]), other.act(seen[0]))


def test_a_policy_of_a_controller_does_not_observe_a_glitch() -> None:
    gait = load_library()[0]
    policies = [gait.policy() for _ in range(2)]
    for k in range(5):
        spoilt, plain = np.full((2, 9), 0.1)
        if k == 2:
            spoilt[6] = 1e308
        one, other = (
            policy(seen, 0.2 * k) for policy, seen in zip(policies, (spoilt, plain), strict=True)
        )
        assert np.isfinite(one).all()
        np.testing.assert_array_equal(one, other)
