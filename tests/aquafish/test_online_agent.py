"""The agent that swims on, in the environment: it sees observations alone."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import aquafish_gym  # noqa: F401  registers the environments
from aquafish.online import AgentConfig, SelfModelAgent
from aquafish.online.gaits import imagine, load_library, refine
from aquafish.online.watch import Watch
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.fish.self_model import SelfModel
from gait import evaluate

QUICK = AgentConfig(seconds=60.0, generations=2)


def swim(damage: str, steps: int = 150, config: AgentConfig = QUICK, **options: Any) -> Any:
    """Return an agent after some steps of an episode, its robot's truth, and its actions."""
    env = gym.make("AquaFishRecovery-v0", damage=damage, engine="numba", **options)
    observation, info = env.reset(seed=1)
    agent, actions = SelfModelAgent(config=config), []
    agent.begin(info["fin_angles"])
    for _ in range(steps):
        actions.append(agent.act(observation))
        observation, _, _, _, info = env.step(actions[-1])
    env.close()
    return agent, info, np.array(actions)


def whats(agent: SelfModelAgent) -> list[str]:
    return [event.what for event in agent.events]


def test_it_notices_infers_and_changes_its_gait() -> None:
    agent, info, _ = swim("caudal:length=0.3@20; left_pectoral:seized@20")
    alarm = agent.events[0]
    assert (alarm.what, 20.0 < alarm.seconds <= 20.6) == ("alarm", True)
    assert "chose" in whats(agent)
    np.testing.assert_allclose(agent.model.robot.body[0], info["morphology"], atol=0.02)
    np.testing.assert_allclose(agent.model.robot.servo_gain[0], info["servo_gain"], atol=0.02)


def test_the_same_seed_gives_the_same_actions() -> None:
    one, other = (swim("gyro:noise=0.01; caudal:missing@15", 110)[2] for _ in range(2))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    "options",
    [{}, {"current": (0.15, -0.1, 0.0)}, {"reactive": True}],
    ids=["still", "current", "reactive"],
)
def test_nothing_alarms_it_while_nothing_breaks(options: dict[str, Any]) -> None:
    noisy = AgentConfig(gyro_noise=0.01, generations=0)
    agent, _, _ = swim("gyro:noise=0.01", 300, noisy, **options)
    assert agent.events == []


def test_it_becomes_whole_again_when_a_fault_ends() -> None:
    agent, _, _ = swim("right_pectoral:seized@15+10", 170)
    about = [event.about for event in agent.events if event.what == "inferred"]
    assert about[0] == "right_pectoral:seized"
    assert about[-1] == "none"
    np.testing.assert_array_equal(agent.model.robot.servo_gain, [[1.0, 1.0, 1.0]])


def test_a_broken_sensor_is_left_out() -> None:
    agent, _, _ = swim("gyro_y:dropped@15", 130)
    assert np.isinf(agent.noise[7])
    assert np.isfinite(np.delete(agent.noise, 7)).all()


def test_it_plays_in_a_vector_environment() -> None:
    found = evaluate(
        SelfModelAgent(config=QUICK), "AquaFishRecovery-v0", episodes=1, damage="caudal:missing@58"
    )
    assert found.returns[0] > 50.0


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda agent: agent.act(np.zeros(9)), "begin.* must be called before"),
        (lambda agent: agent.begin("straight"), "fin_angles must be"),
        (lambda agent: agent.begin((0.0, 0.0)), "fin_angles must have shape"),
        (lambda agent: agent.reset({"fin_angles": np.zeros((2, 3))}), "fin_angles must have shape"),
        (lambda agent: (agent.begin(np.zeros(3)), agent.act(np.zeros(6))), "observation must have"),
        (lambda _: AgentConfig(gyro_noise=-1.0), "gyro_noise must"),
        (lambda _: AgentConfig(generations=1.5), "generations must"),
        (lambda _: AgentConfig(inferences=()), "inferences and waters must"),
        (lambda _: SelfModelAgent(library=[]), "library must have a gait"),
    ],
)
def test_wrong_input_is_refused(call: Any, said: str) -> None:
    with pytest.raises(InvalidArgumentError, match=said):
        call(SelfModelAgent(config=QUICK))


def test_a_refined_gait_is_no_worse_by_imagination() -> None:
    gaits, robot = load_library(), Scenario.create(servo_gain=[(1.0, -1.0, 1.0)])
    state = SelfModel(robot, (0.3, 1.0, 2.0), np.zeros(9)).state
    first = imagine(gaits[1:2], robot, state, 10.0)[0]
    gait, far = refine(gaits[1], robot, state, 10.0, 5, np.random.default_rng(0))
    assert far >= first
    assert imagine([gait], robot, state, 10.0)[0] == pytest.approx(far, abs=1e-5)


def test_a_watch_needs_more_than_it_saw_while_nothing_broke() -> None:
    watch = Watch(used=3)
    for _ in range(20):
        assert not watch.add(500.0, calm=True)
    assert not watch.add(500.0)
    assert watch.add(5000.0)
