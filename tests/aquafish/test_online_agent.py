"""The agent that swims on, in the environment: it sees observations alone."""

from __future__ import annotations

import math
import re
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import aquafish_gym  # noqa: F401  registers the environments
from aquafish.online import AgentConfig, SelfModelAgent, thresholds
from aquafish.online.belief import SurpriseMonitor, Water
from aquafish.online.calibration import ErrorCalibration
from aquafish.online.case import Moment, Moments
from aquafish.online.early import EarlyWatch
from aquafish.online.gaits import (
    PACKAGED,
    ControllerGait,
    check_library,
    imagine,
    imagine_gaits,
    load_library,
    swim_ahead,
)
from aquafish.online.self_model import SelfModel, imu_readings, predict
from aquafish_gym.damage import Damage
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import AQUAFISH, TAIL_FISH, BodyPlan
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from aquafish_gym.world_config import WorldConfig
from gait import EvolveConfig, evaluate, evolve_gait
from tests.plans import ODD

QUICK = AgentConfig(seconds=60.0, generations=2, refinements=1)
UNREFINED = AgentConfig(refinements=0)
NOISY = AgentConfig(gyro_noise=0.01, refinements=0)


def swim(
    damage: str,
    steps: int = 150,
    config: AgentConfig = QUICK,
    known: bool = True,
    teachers: Any = None,
    engine: Any = "numba",
    **options: Any,
) -> Any:
    """Return an agent after some steps of an episode, its robot's truth, and its actions."""
    env = gym.make("AquaFishRecovery-v0", damage=damage, engine=engine, **options)
    observation, info = env.reset(seed=1)
    robot = Scenario.create(plan=env.unwrapped.plan)
    agent, actions = SelfModelAgent(config=config, robot=robot, teachers=teachers), []
    agent.begin(info["fin_angles"] if known else None)
    for _ in range(steps):
        actions.append(agent.act(observation))
        observation, _, _, _, info = env.step(actions[-1])
    agent.act(observation)
    env.close()
    return agent, info, np.array(actions)


def whats(agent: SelfModelAgent) -> list[str]:
    return [event.what for event in agent.events]


def test_it_notices_infers_and_changes_its_gait() -> None:
    agent, info, _ = swim("caudal:length=0.3@20; left_pectoral:seized@20")
    assert whats(agent)[:4] == ["chose", "refined", "alarm", "inferred"]
    calibrated, _, alarm, *_ = (event.seconds for event in agent.events)
    assert (calibrated, 20.0 < alarm <= 20.6) == (10.0, True)
    assert whats(agent).count("chose") == 2
    np.testing.assert_allclose(agent.model.robot.body[0], info["morphology"], atol=0.02)
    np.testing.assert_allclose(agent.model.robot.servo_gain[0], info["servo_gain"], atol=0.02)


@pytest.mark.slow
def test_it_swims_on_as_another_fish() -> None:
    damage = "gyro:noise=0.01; fore_left:missing@15; hind_right:weak=0.5@15"
    agent, info, _ = swim(damage, 85, NOISY, plan="four-fins")
    assert whats(agent)[:4] == ["chose", "alarm", "inferred", "chose"]
    np.testing.assert_allclose(agent.model.robot.body[0], info["morphology"], atol=0.02)
    np.testing.assert_allclose(agent.model.robot.servo_gain[0], info["servo_gain"], atol=0.02)
    assert len(agent.act(np.zeros(9))) == 4


@pytest.mark.parametrize("plan", PACKAGED, ids=lambda plan: plan.name)
def test_a_packaged_library_is_of_its_plan(plan: BodyPlan) -> None:
    library = check_library(load_library(plan), plan, 20)
    still = layout(plan).start(np.zeros((1, len(plan.fins))))[:, 0]
    reactive = plan is TAIL_FISH
    assert imagine(library[:1], Scenario.create(plan=plan, reactive=reactive), still, 20.0)[0] > 8.0


def test_a_library_of_another_plan_is_refused() -> None:
    with pytest.raises(InvalidArgumentError, match="library must be of the plan four-fins; got"):
        SelfModelAgent(load_library(), robot=Scenario.create(plan="four-fins"))
    with pytest.raises(InvalidArgumentError, match="library must be given for the plan odd"):
        SelfModelAgent(robot=Scenario.create(plan=ODD))


@pytest.mark.slow
def test_the_same_seed_gives_the_same_actions() -> None:
    one, other = (swim("gyro:noise=0.01; caudal:missing@3", 60)[2] for _ in range(2))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("options", [{}, {"current": (0.15, -0.1, 0.0)}])
def test_nothing_alarms_it_while_nothing_breaks(options: dict[str, Any]) -> None:
    agent, _, _ = swim("gyro:noise=0.01", 200, NOISY, **options)
    assert whats(agent) == ["chose"]


@pytest.mark.slow
def test_in_water_with_added_mass_it_swims_another_gait_without_an_alarm() -> None:
    refining = AgentConfig(gyro_noise=0.01, generations=20, refinements=1)
    agent, info, _ = swim("gyro:noise=0.01", 300, refining, reactive=True)
    assert whats(agent) == ["water", "chose", "refined", "chose", "refined"]
    assert agent.events[0].about == "added mass"
    assert agent.model.robot.reactive
    assert info["y_position"] > 35.0  # the library's first gait makes 31


@pytest.mark.slow
def test_it_refines_the_whole_robots_gait_when_it_is_calibrated() -> None:
    agent, info, _ = swim("none", 299, AgentConfig(generations=40, refinements=2))
    assert whats(agent) == ["chose", "refined", "refined"]
    assert [event.seconds for event in agent.events] == pytest.approx([10.0, 10.0, 11.4])
    assert agent.gait.name in ("a gait refined before", "the teacher")
    assert info["y_position"] > 44.0  # the library's first gait makes 42.4


def test_it_may_choose_gaits_that_it_refined_before(monkeypatch: pytest.MonkeyPatch) -> None:
    library, candidates = load_library(), list[int]()

    def favour_own(gaits: Any, *rest: Any) -> Any:
        candidates.append(len(gaits))
        far = imagine_gaits(gaits, *rest)
        return far + 100.0 * (np.arange(len(gaits)) >= len(library))

    monkeypatch.setattr("aquafish.online.choosing.imagine_gaits", favour_own)
    config = AgentConfig(generations=20, refinements=1)
    agent, _, _ = swim("right_pectoral:missing@15", 90, config, teachers=())
    chose = [event.about for event in agent.events if event.what == "chose"]
    assert chose[0].startswith("gait ")
    assert chose[-1].startswith("a gait refined before")
    assert candidates[0] == len(library) < candidates[-1]


@pytest.mark.slow
def test_in_an_episode_of_any_length_it_thinks_a_minute_ahead() -> None:
    agent, _, _ = swim("caudal:missing@13", 80, AgentConfig(1e5, generations=2, refinements=1))
    assert whats(agent).count("refined") >= 2
    assert all(10.0 < float(e.about.split()[-2]) < 70.0 for e in agent.events if e.what == "chose")


def test_swim_until_sets_the_time_for_which_gaits_are_compared() -> None:
    with pytest.raises(InvalidArgumentError, match="begin"):
        SelfModelAgent().swim_until(20.0)
    agent, _, _ = swim("none", 10)
    for wrong in (-1.0, np.nan, "20", None):
        with pytest.raises(InvalidArgumentError, match="seconds"):
            agent.swim_until(wrong)
    agent.swim_until(2.0)  # s since the beginning: now
    agent._phase.episode.change_gait(agent.model, Water())
    assert whats(agent) == []
    agent.swim_until(6.0)
    agent._phase.episode.change_gait(agent.model, Water())
    assert whats(agent) == ["chose"]


@pytest.mark.parametrize("onset", [1.0, 9.8])
def test_a_fault_in_the_first_ten_seconds_is_noticed_and_named_at_once(onset: float) -> None:
    agent, info, _ = swim(f"gyro:noise=0.01; caudal:weak=0.4@{onset}", 75, NOISY)
    alarm, first, *_ = (event for event in agent.events if event.what != "chose")
    assert (alarm.what, onset < alarm.seconds <= onset + 0.6) == ("alarm", True)
    assert first.what == "inferred"
    assert re.fullmatch(r"the tail turns at (39|4[01])% of its speed", first.about)
    np.testing.assert_allclose(agent.model.robot.servo_gain[0], info["servo_gain"], atol=0.02)


@pytest.mark.parametrize("damage", ["right_pectoral:width=0.8", "caudal:weak=0.9"])
def test_a_mild_fault_in_the_first_ten_seconds_is_taken_for_no_current(damage: str) -> None:
    """A filter whose current wanders is surprised by it an action later than the others."""
    agent, _, _ = swim(f"{damage}@4", 40, UNREFINED)
    assert {event.about for event in agent.events if event.what == "inferred"} == {
        Damage.parse(damage).said()
    }
    # A second fault is to be noticed as after any first one.
    np.testing.assert_array_equal(agent.model.model_error, thresholds.RECOGNISED_ERROR)


@pytest.mark.slow
def test_a_fin_and_a_sensor_that_break_at_once_are_both_named() -> None:
    """The sensor is lost in the observation that ends an action, the fin in the next action."""
    agent, info, _ = swim("gyro:noise=0.01; caudal:missing@15; north_y:dropped@15", 95, NOISY)
    assert agent.events[-1].about == "the tail is missing and north_y gives no readings"
    assert "unknown" not in whats(agent)
    np.testing.assert_array_equal(agent.model.robot.body[0], info["morphology"])


def test_damage_from_the_start_is_found_after_two_seconds() -> None:
    agent, info, _ = swim("gyro:noise=0.01; left_pectoral:missing; caudal:weak=0.6", 30, NOISY)
    assert whats(agent)[:2] == ["inferred", "chose"]
    assert agent.events[0].seconds == pytest.approx(2.0)
    np.testing.assert_allclose(agent.model.robot.body[0], info["morphology"], atol=0.02)
    np.testing.assert_allclose(agent.model.robot.servo_gain[0], info["servo_gain"], atol=0.02)


def test_a_current_that_begins_changes_no_gait() -> None:
    class Kick(SwimForward):
        def current(self, memory: Any, seconds: Any) -> Any:  # noqa: ARG002
            return (-0.12 * (seconds >= 15.0), 0.21 * (seconds >= 15.0), 0.0)

    agent, _, _ = swim("gyro:noise=0.01", 110, NOISY, task=Kick(seconds=60.0))
    assert whats(agent)[:3] == ["chose", "alarm", "inferred"]
    assert whats(agent).count("chose") == 1
    for event in agent.events[2:]:
        assert event.about.startswith("a current of ")
        found = [float(number) for number in re.findall(r"-?\d\.\d+", event.about)]
        np.testing.assert_allclose(found, [-0.12, 0.21, 0.0], atol=0.02)


class TurningCurrent(CompiledWorld):
    """One robot in a horizontal current, which turns around once in ten seconds."""

    def _start(self, scenario: Scenario) -> None:
        self._steps = 0
        super()._start(scenario)

    def _swim(self, command: Vector, steps: int) -> None:
        turn = 2.0 * math.pi * self._steps / 1000
        self.set_current((0.15 * math.cos(turn), 0.15 * math.sin(turn), 0.0))
        super()._swim(command, steps)
        self._steps += steps


def test_where_the_current_wanders_it_is_no_fault_and_a_fault_is_named() -> None:
    agent, info, _ = swim("left_pectoral:length=0.5@20", 120, UNREFINED, engine=TurningCurrent)
    assert [e.about for e in agent.events if e.what == "water"] == ["a current that wanders"]
    (alarm,) = (event.seconds for event in agent.events if event.what == "alarm")
    assert 20.0 < alarm <= 20.6
    assert "unknown" not in whats(agent)
    assert re.fullmatch(r"left_pectoral:length=0\.\d+", str(agent.recognised.damage))
    np.testing.assert_allclose(agent.model.robot.body[0], info["morphology"], atol=0.05)


def test_a_slow_thinker_uses_what_it_found_seconds_before() -> None:
    slow = AgentConfig(refinements=0, inference_seconds=4.0)
    agent, info, _ = swim("caudal:missing@12", 100, slow)
    (first, *_) = (event for event in agent.events if event.what == "inferred")
    assert first.about == "the tail is missing"
    np.testing.assert_array_equal(agent.model.robot.body[0], info["morphology"])


def test_only_the_latest_moments_are_kept() -> None:
    moments = Moments(3)
    for k in range(10):
        moments.append(Moment(np.full(25, k), np.zeros(3), np.zeros(9)))
    assert len(moments) == 10
    assert [moment.state[0] for moment in moments.since(8)] == [8, 9]
    assert len(moments.since(7)) == 3
    with pytest.raises(IndexError, match="first must be 7 or later; got 6"):
        moments.since(6)


def test_what_none_of_its_words_says_is_fitted_as_all_sizes_and_gains() -> None:
    damage = "gyro:noise=0.01; caudal:thickness=0.25@15; right_pectoral:thickness=2.6@15"
    agent, info, _ = swim(damage, 100, NOISY)
    assert whats(agent)[1:4] == ["alarm", "inferred", "chose"]
    assert agent.events[2].about.startswith("the right flipper has 260% of its thickness")
    np.testing.assert_allclose(agent.model.robot.body[0], info["morphology"], atol=0.01)
    # An inference that fits all sizes at once is charged twice the time of another.
    inferred, chose = agent.events[2:4]
    assert chose.seconds - inferred.seconds == pytest.approx(1.2)


def test_what_no_sizes_and_gains_explain_is_unknown_and_changes_nothing() -> None:
    agent, _, _ = swim("gyro:noise=0.01; left_pectoral:hold=0.6@15", 120, NOISY)
    assert whats(agent) == ["chose", "alarm", "inferred", "unknown"]
    np.testing.assert_array_equal(agent.model.robot.body, Scenario.create().body)
    np.testing.assert_array_equal(agent.model.robot.servo_gain, 1.0)


def test_it_becomes_whole_again_when_a_fault_ends() -> None:
    agent, _, _ = swim("right_pectoral:seized@15+10", 150, UNREFINED)
    about = [event.about for event in agent.events if event.what == "inferred"]
    assert about[0] == "the right flipper is seized"
    assert about[-1] == "nothing is broken"
    np.testing.assert_array_equal(agent.model.robot.servo_gain, [[1.0, 1.0, 1.0]])


@pytest.mark.slow
def test_a_little_more_noise_is_one_alarm_and_no_fault_of_a_fin() -> None:
    agent, _, _ = swim("gyro:noise=0.01; gyro:noise=0.021@20", 300, NOISY)
    assert whats(agent).count("alarm") == 1
    assert agent.events[-1].about.startswith("the gyroscope has noise of 0.02")
    np.testing.assert_array_equal(agent.model.robot.body, Scenario.create().body)


@pytest.mark.slow
def test_a_sensor_that_works_again_is_used_again() -> None:
    agent, _, _ = swim("gyro_y:dropped@15+8; gyro_x:bias=0.2@15+10", 140, UNREFINED)
    about = [event.about for event in agent.events if event.what == "inferred"]
    assert about[0].startswith("gyro_y gives no readings and gyro_x is off by ")
    assert float(about[0].split()[-2]) == pytest.approx(0.2, abs=0.002)
    assert about[-1] == "nothing is broken"
    assert np.isfinite(agent.model.noise).all()
    np.testing.assert_array_equal(agent.model.robot.sensor_bias, 0.0)


def test_a_second_fault_is_recognised_beside_the_first() -> None:
    # A teacher may not move the tail: nothing can show then that its servo is weak.
    agent, info, _ = swim(
        "right_pectoral:missing@15; caudal:weak=0.4@19", 115, UNREFINED, teachers=()
    )
    np.testing.assert_allclose(agent.model.robot.body[0], info["morphology"], atol=0.02)
    np.testing.assert_allclose(agent.model.robot.servo_gain[0], info["servo_gain"], atol=0.03)


@pytest.mark.parametrize("gyro_only", [False, True], ids=["imu", "gyroscope"])
def test_unknown_fin_angles_are_found(gyro_only: bool) -> None:
    config = AgentConfig(gyro_noise=0.01, gyro_only=gyro_only, refinements=0)
    agent, info, _ = swim("gyro:noise=0.01", 60, config, known=False)
    error = layout(AQUAFISH).angles(agent.model.state) - info["fin_angles"]
    np.testing.assert_allclose(np.arctan2(np.sin(error), np.cos(error)), 0.0, atol=0.05)
    assert whats(agent) == ["fins", "chose"]


def test_it_plays_in_a_vector_environment() -> None:
    found = evaluate(
        SelfModelAgent(config=QUICK), "AquaFishRecovery-v0", episodes=1, max_episode_steps=100,
        damage="caudal:missing@19",
    )  # fmt: skip
    assert found.returns[0] > 10.0


def test_a_refined_gait_is_no_worse_by_imagination() -> None:
    gaits, robot = load_library(), Scenario.create(servo_gain=[(1.0, -1.0, 1.0)], reactive=True)
    model = SelfModel(robot, (0.3, 1.0, 2.0))
    model.step((0.5, -1.0, 1.0))
    first, *_ = imagine(gaits[1:], robot, model.state, 10.0)
    found = evolve_gait(
        robot.body[0],
        EvolveConfig(generations=2, seconds=10.0, threads=1),
        first=gaits[1],
        start=model.state,
        world=WorldConfig.of(robot),
    )
    assert found.fitness > first
    assert imagine([found.controller], robot, model.state, 10.0)[0] == found.fitness


def test_a_monitor_needs_more_than_it_saw_while_nothing_broke() -> None:
    monitor = SurpriseMonitor()
    for _ in range(20):
        assert not monitor.add(500.0, 3, calm=True)
    assert not monitor.add(500.0, 3)
    assert monitor.add(5000.0, 3)


def test_looking_ahead_is_imagining_the_gait_that_is_swum() -> None:
    robot = Scenario.create(servo_gain=[(1.0, 0.5, 1.0)])
    model, gait = SelfModel(robot, (0.3, 1.0, 2.0)), load_library()[2]
    swimming, begun = ControllerGait(gait).begin(robot, np.zeros(3)), model.state
    far = imagine([gait], robot, begun, 10.0)[0]
    for _ in range(10):  # without the filter, whose state is a mean
        action = swimming.act(robot, model.state)[None].astype(float)
        model.become(robot, predict(robot, model.state, action)[1][:, 0])
    ahead = swim_ahead(swimming, model, 5, 7.0)
    assert ahead.state[5] - begun[5] + ahead.way == pytest.approx(far, abs=1e-3)
    assert swim_ahead(swimming, model, 5, 7.0).way == ahead.way  # it forgets what it imagined


@pytest.mark.parametrize("number", [0, 2])
def test_a_gait_is_the_controller_with_true_fin_angles(number: int) -> None:
    robot, gait = Scenario.create(servo_gain=[(1.0, 0.5, 1.0)]), load_library()[number]
    state = SelfModel(robot, (0.3, 1.0, 2.0)).state
    swimming = ControllerGait(gait).begin(robot, np.zeros(3))
    policy = gait.policy((0.3, 1.0, 2.0), (1.0, 0.5, 1.0))
    for k in range(20):
        action = swimming.act(robot, state)
        true = np.clip(policy(imu_readings(state[:, None])[0], 0.2 * k), -1.0, 1.0)
        np.testing.assert_allclose(action, true, atol=1e-4)
        state = predict(robot, state, action[None].astype(float))[1][:, 0]


@pytest.mark.parametrize("drag", [0.5, 1.0])
def test_the_drag_of_foreign_water_is_measured(drag: float) -> None:
    water, fins = Scenario.create(drag=(drag, 1.0)), np.array([0.4, -1.0, 2.0])
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 3))
    observed = predict(water, SelfModel(water, fins).state, actions)[0][0]
    calibration = ErrorCalibration(Scenario.create(), fins, 20)
    for action, seen in zip(actions[:24], observed, strict=False):
        assert not calibration.add(action, seen)
    assert calibration.foreign == (drag != 1.0)
    for action, seen in zip(actions[24:-1], observed[24:], strict=False):
        assert not calibration.add(action, seen)
    assert calibration.add(actions[-1], observed[-1])
    assert calibration.model.robot.drag.tolist() == [[drag, 1.0]]
    assert calibration.other_water == ("" if drag == 1.0 else "drag of the fins x 0.5")
    assert not calibration.foreign


def test_damage_from_the_start_is_looked_for_once_in_each_water() -> None:
    """Of each, filters run whose current wanders or not."""
    calibration = ErrorCalibration(Scenario.create(), np.zeros(3), 20)
    case = EarlyWatch(calibration, 2, (1, 2)).case
    assert case is not None
    assert [robot.reactive for robot in case.before] == [False, True]
    assert len(calibration.exact) == 4


@pytest.mark.parametrize(
    ("actions", "way"),
    [
        (25, 0.0),  # until it has found the water
        pytest.param(300, 30.0, marks=pytest.mark.slow),  # the library's first gait makes 27
    ],
)
def test_nothing_alarms_it_in_water_that_it_does_not_know(actions: int, way: float) -> None:
    pytest.importorskip("mujoco")
    from instruments.verification.mujoco_world import BoxWorld

    env = gym.make("AquaFishRecovery-v0", damage=None, engine=BoxWorld)
    observation, info = env.reset(seed=3)
    agent = SelfModelAgent(config=AgentConfig(refinements=1))
    agent.begin(info["fin_angles"])
    for _ in range(actions):
        observation, _, _, _, info = env.step(agent.act(observation))
    agent.act(observation)
    assert set(whats(agent)) == {"water", "chose"}  # no gait is refined on a wrong model
    assert agent.model.robot.drag[0, 0] < 1.0
    assert info["y_position"] > way
