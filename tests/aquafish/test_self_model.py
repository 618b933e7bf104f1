"""The self-model that is carried along: its filter follows a robot that it cannot see whole."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aquafish.online import thresholds
from aquafish.online.self_model import (
    SelfModel,
    error_size,
    imu_readings,
    moved,
    predict,
    state_errors,
)
from aquafish_gym.command import scale_action
from aquafish_gym.damage import Damage
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.physics.layout import FIELDS, layout
from aquafish_gym.plans import BodyPlan
from aquafish_gym.scenario import CHANNELS, Scenario
from tests.plans import COMPILED_PLANS, PLANS

STROKES = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 3))
FINS = np.array([0.4, -1.0, 2.0])


def strokes(plan: BodyPlan) -> np.ndarray:
    """Return actions (80, F)."""
    return np.random.default_rng(0).uniform(-1.0, 1.0, (80, len(plan.fins)))


def swim(scenario: Scenario, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return what the robot observes (K, 9) after each stroke, and its states (K, 25)."""
    lanes, rng = LaneBatch(scenario, np.float64, threads=1), np.random.default_rng(1)
    seen, states = [], []
    for stroke in strokes(scenario.plan):
        lanes.advance(scale_action(scenario.plan, stroke)[None], 20)
        states.append(lanes.states[:, 0].copy())
        seen.append(imu_readings(lanes.states)[0])
        seen[-1][6:] += noise * rng.standard_normal(3)
    return np.array(seen), np.array(states)


def follow(model: SelfModel, observed: np.ndarray) -> np.ndarray:
    """Return the squared innovations (K,)."""
    squares = []
    for stroke, seen in zip(strokes(model.robot.plan), observed, strict=True):
        model.step(stroke)
        squares.append(model.correct(seen))
    return np.array(squares)


@given(plan=st.sampled_from(PLANS), data=st.data())
def test_difference_undoes_moved(plan: BodyPlan, data: st.DataObject) -> None:
    size = error_size(plan)
    error = data.draw(st.lists(st.floats(-0.3, 0.3), min_size=size, max_size=size))
    state = layout(plan).start(np.linspace(-1.0, 2.0, len(plan.fins))[None])[:, 0]
    found = state_errors(plan, moved(plan, state, np.array([error])), state)[0]

    np.testing.assert_allclose(found, error, atol=1e-12)


@pytest.mark.parametrize("plan", COMPILED_PLANS)
def test_the_model_of_the_same_robot_follows_it_exactly(plan: BodyPlan) -> None:
    fins = np.linspace(-1.0, 2.0, len(plan.fins))
    scenario = Scenario.create(fin_angles=fins, plan=plan)
    observed, states = swim(scenario)
    model = SelfModel(scenario, fins)
    squares = follow(model, observed)
    assert squares.max() < 1.0
    assert squares[-10:].max() < 1e-3
    # Where it is cannot be observed.
    observable = np.r_[0:4, 7 : layout(plan).state_numbers]
    np.testing.assert_allclose(model.state[observable], states[-1][observable], atol=5e-5)


def test_innovations_are_chi_square_under_noise() -> None:
    observed, _ = swim(Scenario.create(fin_angles=FINS), noise=0.01)
    robot = Damage.parse("; ".join(f"{c}:dropped" for c in CHANNELS[:6])).edit(
        Scenario.create(gyro_noise=[0.01])
    )
    squares = follow(SelfModel(robot, FINS), observed)
    assert squares.mean() == pytest.approx(3.0, abs=4 * np.sqrt(6 / len(squares)))


def test_the_filter_finds_the_velocity_relative_to_water_that_flows() -> None:
    observed, states = swim(Scenario.create(fin_angles=FINS, current=(0.15, -0.1, 0.05)))
    model = SelfModel(Scenario.create(), FINS)
    follow(model, observed)
    relative = states[-1][FIELDS["velocity"]] - (0.15, -0.1, 0.05)
    np.testing.assert_allclose(model.state[FIELDS["velocity"]], relative, atol=2e-3)


def test_the_likelihood_tells_which_water_it_is_and_how_wrong_the_model() -> None:
    observed, _ = swim(Scenario.create(fin_angles=FINS, reactive=True))

    def likelihood(reactive: bool, scale: float) -> float:
        robot = Scenario.create(reactive=reactive)
        model = SelfModel(robot, FINS, thresholds.MODEL_ERROR * scale)
        follow(model, observed)
        return model.log_likelihood

    assert likelihood(True, 1.0) > likelihood(False, 100.0) > likelihood(False, 1.0)


def test_predictions_are_of_each_robot_alone() -> None:
    robots = Scenario.create(servo_gain=[(1, 1, 1), (1, 0, 1), (-1, 1, 0.5)])
    state = SelfModel(robots.take([0]), FINS).state
    together, ends = predict(robots, state, STROKES[:5])
    for b in range(3):
        alone, end = predict(robots.take([b]), state, STROKES[:5])
        np.testing.assert_array_equal(alone[0], together[b])
        np.testing.assert_array_equal(end[:, 0], ends[:, b])


def test_a_biased_sensor_is_predicted_with_its_bias() -> None:
    observed, _ = swim(Scenario.create(fin_angles=FINS))
    bias = np.array([[0.0] * 6 + [0.2, 0.0, -0.1]])
    model = SelfModel(Scenario.create(sensor_bias=bias), FINS)
    assert follow(model, observed + bias[0]).max() < 1.0


def test_a_channel_without_readings_corrects_as_little_as_a_dropped_one() -> None:
    observed, _ = swim(Scenario.create(fin_angles=FINS, gyro_noise=0.01), 0.01)
    dropped = Damage.parse("gyro_y:dropped; north_x:dropped").edit(Scenario.create(gyro_noise=0.01))
    models = SelfModel(Scenario.create(gyro_noise=0.01), FINS), SelfModel(dropped, FINS)
    gone = [CHANNELS.index(name) for name in ("gyro_y", "north_x")]
    silent = observed.copy()
    silent[:, gone] = np.nan
    one, other = (
        follow(model, seen) for model, seen in zip(models, (silent, observed), strict=True)
    )
    np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(models[0].state, models[1].state)
    assert models[0].surprise(silent[-1])[gone].tolist() == [0.0, 0.0]


def test_no_reading_makes_the_model_faster_than_it_can_simulate() -> None:
    model, rng = SelfModel(Scenario.create(), FINS), np.random.default_rng(0)
    for stroke in STROKES:
        model.step(stroke)
        model.correct(rng.uniform(-30.0, 30.0, 9))
        assert np.isfinite(model.state).all()
        assert np.abs(model.state[FIELDS["velocity"]]).max() <= 20.0
