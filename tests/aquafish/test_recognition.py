"""Recognising in mid-swim what broke, from the robot's own observations."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest

from aquafish.online.calibration import find_fins
from aquafish.online.hypotheses import all_hypotheses, broken
from aquafish.online.identification import identify
from aquafish.online.recognition import recognise
from aquafish.online.search import Search
from aquafish.online.self_model import SelfModel, predict
from aquafish_gym.damage import Damage
from aquafish_gym.physics.layout import FIELDS
from aquafish_gym.plans import AQUAFISH, FOUR_FINS, BodyPlan
from aquafish_gym.scenario import Scenario


class Fish:
    """A whole robot, and its state after some strokes (12, F) from rest at some fin angles."""

    def __init__(self, plan: BodyPlan) -> None:
        self.whole = Scenario.create(plan=plan)
        self.strokes = np.random.default_rng(3).uniform(-1.0, 1.0, (12, len(plan.fins)))
        self.fins = np.array([0.4, -1.0, 2.0, 1.2])[: len(plan.fins)]

    @functools.cached_property
    def state(self) -> np.ndarray:
        start = SelfModel(self.whole, self.fins).state
        return predict(self.whole, start, self.strokes)[1][:, 0]


AQUA, FOUR = Fish(AQUAFISH), Fish(FOUR_FINS)
WHOLE, STROKES = AQUA.whole, AQUA.strokes
DRIFT, TOLERANCE = np.full(9, 1e-4), np.full(9, 0.05)
DEAF = replace(WHOLE, sensor_dropped=np.array([[True] * 6 + [False] * 3]))


def observe(damage: str, noise: float = 0.0, fish: Fish = AQUA) -> np.ndarray:
    """Return what a damaged robot observes (K, 9) from the state on."""
    robot = Damage.parse(damage).edit(fish.whole)
    seen = predict(robot, fish.state, fish.strokes)[0][0].copy()
    seen[:, 6:] += noise * np.random.default_rng(0).standard_normal((len(seen), 3))
    seen[:, 6:] += robot.gyro_noise[0] * np.random.default_rng(1).standard_normal((len(seen), 3))
    seen += robot.sensor_bias[0]
    seen[:, robot.sensor_stuck[0]] = seen[0, robot.sensor_stuck[0]]
    seen[:, robot.sensor_dropped[0]] = 0.0
    return seen


@pytest.mark.parametrize(
    "damage",
    [
        "none",
        "caudal:missing",
        "left_pectoral:length=0.33",
        "right_pectoral:seized",
        "left_pectoral:reversed; caudal:width=0.5",
        "right_pectoral:weak=0.21; caudal:entangled=0.7",
        "left_pectoral:length=0.6; left_pectoral:width=0.7",
        "fore_left:length=0.33; hind_right:weak=0.5",
        "hind_left:missing",
    ],
)
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_single_and_double_faults_are_recognised(damage: str, noise: float) -> None:
    fish = FOUR if damage.startswith(("fore", "hind")) else AQUA
    whole = replace(fish.whole, gyro_noise=np.array([noise]))
    seen = observe(damage, noise, fish)
    found = recognise([whole], [fish.state], seen, fish.strokes, DRIFT, TOLERANCE)
    true = Damage.parse(damage).edit(fish.whole)
    assert found.explained
    np.testing.assert_allclose(found.robot.body, true.body, atol=0.04)
    np.testing.assert_allclose(found.robot.servo_gain, true.servo_gain, atol=0.04)
    assert not found.sensors


@pytest.mark.parametrize(
    "damage",
    [
        "left_pectoral:width=0.54; right_pectoral:length=0.7; caudal:weak=0.32",
        "left_pectoral:width=0.17; right_pectoral:missing; caudal:seized",
        "left_pectoral:entangled=0.3; right_pectoral:weak=0.4; caudal:reversed",
        "fore_left:width=0.54; fore_right:weak=0.7; hind_left:missing",
    ],
)
def test_three_faults_at_once_are_recognised(damage: str) -> None:
    fish = FOUR if damage.startswith("fore") else AQUA
    whole = replace(fish.whole, gyro_noise=np.array([0.01]))
    seen = observe(damage, 0.01, fish)
    found = recognise([whole], [fish.state], seen, fish.strokes, DRIFT, TOLERANCE)
    true = Damage.parse(damage).edit(fish.whole)
    assert found.fits
    assert found.decided
    np.testing.assert_allclose(found.robot.body, true.body, atol=0.02)
    np.testing.assert_allclose(found.robot.servo_gain, true.servo_gain, atol=0.02)


@pytest.mark.parametrize(
    "damage",
    [
        "right_pectoral:weak=1.69; left_pectoral:width=1.96",
        "caudal:thickness=0.25; right_pectoral:thickness=2.6",
        "left_pectoral:width=0.5; left_pectoral:weak=0.6; caudal:length=0.5; caudal:weak=0.7",
        "fore_left:thickness=2.6; hind_right:weak=1.5",
    ],
    ids=["too strong", "thickness", "four faults", "four fins"],
)
def test_what_no_hypothesis_says_is_fitted_as_all_sizes_and_gains(damage: str) -> None:
    fish = FOUR if damage.startswith("fore") else AQUA
    whole = replace(fish.whole, gyro_noise=np.array([0.01]))
    seen = observe(damage, 0.01, fish)
    case = [whole], [fish.state], seen, fish.strokes, DRIFT, TOLERANCE
    assert not recognise(*case).fits
    found = recognise(*case, identifies=True)
    assert found.fits
    assert found.decided
    assert found.identified
    true = Damage.parse(damage).edit(fish.whole)
    np.testing.assert_allclose(found.robot.body, true.body, atol=0.01)
    np.testing.assert_allclose(found.robot.servo_gain, true.servo_gain, atol=0.01)
    assert str(found.alternatives[0].damage) == str(found.damage)


def test_a_hypothesis_that_fits_is_kept_where_all_sizes_could_be_fitted() -> None:
    whole = replace(WHOLE, gyro_noise=np.array([0.01]))
    case = [whole], [AQUA.state], observe("caudal:length=0.5", 0.01), STROKES, DRIFT, TOLERANCE
    found = recognise(*case, identifies=True)
    assert not found.identified
    assert str(found.damage) == str(recognise(*case).damage)


def test_a_fit_of_all_sizes_changes_no_fin_that_is_missing_and_exceeds_no_maximum() -> None:
    body = WHOLE.body.copy()
    body[0, :3] = 0.0
    body[0, 6] = 0.5  # the largest
    whole = replace(WHOLE, body=body, servo_gain=np.array([[0.5, 0.0, 1.9]]))
    seen = observe("right_pectoral:entangled=1.0")
    search = Search([whole], [AQUA.state], seen, STROKES, DRIFT, 20)
    robot = identify(search).grid.damage().edit(whole)
    assert not robot.body[0, :3].any()
    assert (robot.body <= AQUAFISH.maxima).all()
    assert robot.servo_gain[0, 1] == 0.0
    assert (np.abs(robot.servo_gain) <= 2.0).all()


@pytest.mark.parametrize("current", [(0.0, 0.1, 0.0), (-0.2, 0.1, 0.2), (0.4, -0.3, 0.0)])
@pytest.mark.parametrize("damage", ["none", "caudal:missing"], ids=["whole", "broken"])
def test_a_current_that_begins_is_no_fault_of_a_fin(
    current: tuple[float, float, float], damage: str
) -> None:
    robot = replace(Damage.parse(damage).edit(WHOLE), gyro_noise=np.array([0.01]))
    start = AQUA.state.copy()
    start[FIELDS["velocity"]] -= current
    seen = predict(robot, start, STROKES)[0][0].copy()
    seen[:, 6:] += 0.01 * np.random.default_rng(0).standard_normal((len(seen), 3))
    found = recognise([robot], [AQUA.state], seen, STROKES, DRIFT, TOLERANCE)
    assert str(found.damage) == "none"
    assert found.about.startswith("a current of (")
    assert not found.unchanged
    np.testing.assert_allclose(found.current, current, atol=0.02)


def test_an_observation_of_a_current_does_not_decide_for_a_fin() -> None:
    noisy = replace(WHOLE, gyro_noise=np.array([0.01]))
    start = AQUA.state.copy()
    start[FIELDS["velocity"]] -= (-0.03, 0.1, 0.02)
    seen = predict(WHOLE, start, STROKES[:1])[0][0].copy()
    seen[:, 6:] += (-0.01, 0.01, 0.02)
    found = recognise([noisy], [AQUA.state], seen, STROKES[:1], DRIFT, TOLERANCE)
    assert not found.damage or not found.decided


def test_many_observations_show_a_bias_below_the_tolerance() -> None:
    found = recognise(
        [WHOLE], [AQUA.state], observe("north_x:bias=0.01"), STROKES, DRIFT, TOLERANCE
    )
    assert found.sensors.said() == "north_x is off by 0.01"
    assert found.whole is False


def test_the_gyroscope_alone_tells_what_broke() -> None:
    deaf = replace(DEAF, gyro_noise=np.array([0.01]))
    seen = observe("left_pectoral:missing;caudal:seized", 0.01)
    found = recognise([deaf], [AQUA.state], seen, STROKES, DRIFT, TOLERANCE)
    assert str(found.damage) == "left_pectoral:missing;caudal:seized"


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ("gyro_x:bias=0.2", "gyro_x is off by 0.2 rad/s"),
        ("gyro:noise=0.3", "the gyroscope has noise of 0."),
        ("gyro_z:stuck; up_y:dropped", "up_y gives no readings and gyro_z repeats its last value"),
    ],
)
def test_broken_sensors_are_told_from_broken_fins(damage: str, words: str) -> None:
    seen = observe(f"right_pectoral:missing; {damage}")
    found = recognise([WHOLE], [AQUA.state], seen, STROKES, DRIFT, TOLERANCE)
    assert found.explained
    assert str(found.damage) == "right_pectoral:missing"
    assert found.sensors.said().startswith(words)
    true = Damage.parse(damage).edit(WHOLE)
    np.testing.assert_allclose(found.robot.sensor_bias, true.sensor_bias, atol=1e-3)
    np.testing.assert_array_equal(found.robot.sensor_stuck, true.sensor_stuck)
    np.testing.assert_array_equal(found.robot.sensor_dropped, true.sensor_dropped)
    assert found.robot.gyro_noise[0] == pytest.approx(true.gyro_noise[0], rel=0.4)


def test_the_time_of_the_fault_is_found_among_several() -> None:
    healthy, ends = predict(WHOLE, AQUA.state, STROKES[:4])
    later = predict(Damage.parse("caudal:missing").edit(WHOLE), ends[:, 0], STROKES[4:])[0]
    states = [AQUA.state]
    for k in range(1, 6):
        states.append(predict(WHOLE, AQUA.state, STROKES[:k])[1][:, 0])
    seen = np.concatenate([healthy[0], later[0]])
    found = recognise([WHOLE], states, seen, STROKES, DRIFT, TOLERANCE)
    assert str(found.damage) == "caudal:missing"


def test_a_fault_that_ends_is_recognised_as_the_robot_that_was() -> None:
    now = Damage.parse("caudal:missing").edit(WHOLE)
    found = recognise([now, WHOLE], [AQUA.state], observe("none"), STROKES, DRIFT, TOLERANCE)
    assert str(found.damage) == "none"
    np.testing.assert_array_equal(found.robot.body, WHOLE.body)


def test_none_of_the_hypotheses_is_an_answer() -> None:
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, (len(STROKES), 9))
    found = recognise([WHOLE], [AQUA.state], seen, STROKES, DRIFT, TOLERANCE)
    assert not found.explained
    assert not found.fits


@pytest.mark.parametrize("fish", [AQUA, FOUR], ids=["aquafish", "four-fins"])
def test_hypotheses_are_edits_of_one_robot(fish: Fish) -> None:
    grids = all_hypotheses(fish.whole.plan)
    robots = broken(fish.whole, grids)
    each = [grid.row(i).damage() for grid in grids for i in range(len(grid.numbers))]
    assert len(robots) == len(each) == len(set(each)) > 2000
    for i, damage in [*enumerate(each)][::9]:
        true = damage.edit(fish.whole)
        np.testing.assert_array_equal(robots.body[i], true.body[0])
        np.testing.assert_array_equal(robots.servo_gain[i], true.servo_gain[0])


@pytest.mark.parametrize(
    ("fish", "is_deaf", "added_mass"),
    [(AQUA, False, (False, True)), (AQUA, True, (False, True)), (FOUR, False, (False,))],
    ids=["imu", "gyroscope", "four-fins"],
)
def test_initial_fin_angles_are_found_within_a_second(
    fish: Fish, is_deaf: bool, added_mass: tuple[bool, ...]
) -> None:
    dropped = DEAF.sensor_dropped if is_deaf else WHOLE.sensor_dropped
    robot = replace(fish.whole, sensor_dropped=dropped)
    waters = [replace(robot, reactive=reactive) for reactive in added_mass]
    strokes = fish.strokes[:5]
    for reactive in added_mass:
        world = replace(fish.whole, reactive=reactive)
        seen = predict(world, SelfModel(world, fish.fins).state, strokes)[0][0]
        found = find_fins(waters, seen, strokes)
        error = np.arctan2(np.sin(found - fish.fins), np.cos(found - fish.fins))
        np.testing.assert_allclose(error, 0.0, atol=0.05)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_what_was_not_observed_does_not_count(noise: float) -> None:
    whole = replace(WHOLE, gyro_noise=np.array([noise]))
    seen = observe("left_pectoral:length=0.33; gyro_z:bias=0.2", noise)
    seen[3, 6] = seen[5:8, 2] = seen[:, 1] = seen[-1, 8] = np.nan
    found = recognise([whole], [AQUA.state], seen, STROKES, DRIFT, TOLERANCE)
    assert str(found.damage).startswith("left_pectoral:length=0.3")
    assert [(fault.part, fault.word) for fault in found.sensors] == [("gyro_z", "bias")]
    assert found.explained
    assert not found.robot.sensor_dropped.any()


def test_a_dropped_channel_with_a_gap_is_dropped() -> None:
    seen = observe("gyro_y:dropped")
    seen[-2, 7] = np.nan
    found = recognise([WHOLE], [AQUA.state], seen, STROKES, DRIFT, TOLERANCE)
    assert str(found.sensors) == "gyro_y:dropped"
