"""A robot that diverges leaves a file, from which its last second is swum again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.engines.compiled.recorded_lanes import RecordedLanes
from aquafish_gym.engines.divergence import MOST_FILES, RECORDED_STEPS
from aquafish_gym.engines.swim_again import is_divergence, swim_again
from aquafish_gym.engines.worlds import diverged_states, make_world
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.kinematics import RUNAWAY_SQUARE, has_diverged
from aquafish_gym.physics.layout import FIELDS, STATE_NUMBERS, start_rows, state_from_numbers
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.__main__ import main
from gait.controllers.controller import Controller, program_of

# A body and a current in which one start in twelve diverges within a second.
THIN = [1.0, 2.0, 0.0, 0.0, 2.0, 0.5, 0.5, 0.0, 0.0]
ROUGH = (20.0, 20.0, 20.0)
DIVERGING_SEED = 10
STEADY_SEED = 0
ACTION = np.array([0.3, 0.5, 0.9], np.float32)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder that files are written to."""
    found = tmp_path / "diverged"
    monkeypatch.setenv("AQUAFISH_DIVERGED", str(found))
    return found


def swim_until_it_diverges(engine: str, seed: int = DIVERGING_SEED) -> bool:
    env = gym.make("AquaFish-v0", engine=engine, morphology=THIN, current=ROUGH)
    env.reset(seed=seed)
    diverged = [env.step(ACTION)[4]["diverged"]]
    env.close()
    return diverged[0]


def struck(step: int, lag: float = 0.0) -> Scenario:
    """Return a robot whose drag becomes too great for the time step."""
    calm = Scenario.create(fin_angles=(0.4, -0.2, 1.0), current=(0.1, 0.0, 0.0), servo_lag=lag)
    rough = replace(calm, drag=np.full((1, 2), 1e6))
    return calm.then(step, rough)


@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_an_episode_that_diverges_is_swum_again(engine: str, folder: Path) -> None:
    assert swim_until_it_diverges(engine)
    (path,) = folder.iterdir()
    again = swim_again(path)
    assert is_divergence(path)
    assert again.first_step == 0
    assert again.runaway is not None
    assert 1 < again.runaway <= 20
    assert path.stat().st_size < 2_000
    lost = diverged_states(again.states.T)
    assert not lost[: again.runaway].any()
    assert lost[again.runaway]


@pytest.mark.parametrize("lag", [0.0, 0.13])
@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_the_last_second_of_a_long_swim_has_the_same_bits(
    engine: str, lag: float, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (swum,) = rollout(
        [lambda _, time: (np.sin(3.0 * time), 0.5, 1.0)],
        struck(333, lag),
        engine=engine,
        seconds=5.0,
        interval=7,
    ).paths
    monkeypatch.delenv("AQUAFISH_DIVERGED")
    again = swim_again(next(folder.iterdir()))
    assert again.runaway == RECORDED_STEPS
    assert 333 < again.first_step + again.runaway < 340
    before = slice(1, again.runaway)
    expected = swum.gyro[again.first_step : again.first_step + again.runaway - 1]
    np.testing.assert_array_equal(again.states[before, FIELDS["spin"]], expected)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_robot_of_a_batch_is_swum_again_alone(dtype: type[np.floating], folder: Path) -> None:
    several = Scenario.create(fin_angles=np.arange(15.0).reshape(5, 3))
    lanes = RecordedLanes(several, dtype, None, folder)
    rng = np.random.default_rng(0)
    states = []
    for step in range(60):
        if step == 40:  # another episode of robot 2
            lanes.start(several.take([2]), np.array([2]))
        if step == 57:
            rough = replace(several, drag=np.full((5, 2), 1e6)).take([1, 2])
            lanes.update(rough, np.array([1, 2]))
        lanes.set_current(0.1 * rng.normal(size=(5, 3)))
        states.append(lanes.states[:STATE_NUMBERS].copy())
        action = rng.uniform(-1.0, 1.0, (3, 5))
        lanes.act(action, (action[0], action[1], action[2]), 5)
    steps = {}
    for path in folder.iterdir():
        again = swim_again(path)
        steps[again.first_step] = again
    assert sorted(steps) == [(58 - 40) * 5 - 90, (58 - 20) * 5]  # of robots 2 and 1
    for first, robot, begun in ((0, 2, 40), (190, 1, 0)):
        again = steps[first]
        for step in range(begun + first // 5, 58):
            index = (step - begun) * 5 - first
            np.testing.assert_array_equal(again.states[index], states[step][:, robot])
    assert steps[190].runaway > 95


def test_a_vector_environment_records_each_robot_that_diverges(folder: Path) -> None:
    env = AquaFishVectorEnv(
        2, engine="numba", morphology=THIN, current=ROUGH, fin_angles="random", dtype="float64"
    )
    env.reset(seed=[STEADY_SEED, DIVERGING_SEED])
    for _ in range(3):
        *_, info = env.step(np.tile(ACTION, (2, 1)))
        if info["diverged"].any():
            assert info["diverged"].tolist() == [False, True]
    (path,) = folder.iterdir()
    swim_until_it_diverges("numba")  # the same robot by itself
    again = swim_again(path)
    for other in folder.iterdir():
        np.testing.assert_array_equal(swim_again(other).states, again.states)


def test_worlds_of_a_batch_on_pybullet_are_recorded(folder: Path) -> None:
    env = AquaFishVectorEnv(2, engine="pybullet", morphology=THIN, current=ROUGH)
    env.reset(seed=[STEADY_SEED, DIVERGING_SEED])
    env.step(np.tile(ACTION, (2, 1)))
    env.close()
    assert len([*folder.iterdir()]) == 1


def test_nothing_is_recorded_without_the_variable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("AQUAFISH_DIVERGED", raising=False)
    monkeypatch.chdir(tmp_path)
    assert swim_until_it_diverges("numba")
    assert [*tmp_path.iterdir()] == []
    assert type(make_world("numba", Scenario.create())).__name__ == "CompiledWorld"


def test_a_swim_that_stays_finite_leaves_no_folder(folder: Path) -> None:
    assert not swim_until_it_diverges("numba", STEADY_SEED)
    assert not folder.exists()


def test_a_recorded_environment_returns_the_same(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def swim() -> list[Any]:
        env = gym.make(
            "AquaFish-v0", engine="numba", damage="caudal:seized@1; left_pectoral:delay=0.4"
        )
        seen = [env.reset(seed=3)[0]]
        return seen + [env.step(ACTION)[0] for _ in range(20)]

    recorded = swim()
    monkeypatch.delenv("AQUAFISH_DIVERGED")
    np.testing.assert_array_equal(recorded, swim())
    assert not folder.exists()


def test_a_folder_takes_ten_files(folder: Path) -> None:
    batch = Scenario.create(fin_angles=np.arange(60.0).reshape(20, 3))
    lanes = RecordedLanes(replace(batch, drag=np.full((20, 2), 1e6)), np.float64, None, folder)
    lanes.advance(np.full((20, 3), 0.3), 20)
    assert len([*folder.iterdir()]) == MOST_FILES


def test_film_says_when_and_what_was_not_finite(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    swim_until_it_diverges("numba")
    (path,) = folder.iterdir()
    page = tmp_path / "swim.html"
    assert main(["film", str(path), "--html", str(page)]) == 0
    said = capsys.readouterr().out
    assert f"{path.stem}: It runs away in step 6 (0.06 s of its swim)." in said
    assert "Not finite in step 6: orientation." in said
    assert page.stat().st_size < 500_000


@pytest.mark.parametrize("option", ["--seconds=2", "--damage=none", "--engine=numba"])
def test_film_refuses_options_that_the_file_states(
    option: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    swim_until_it_diverges("numba")
    assert main(["film", str(next(folder.iterdir())), option]) == 2
    assert "has no effect on swims that diverged" in capsys.readouterr().err


@pytest.mark.parametrize(
    "change",
    [
        {"engine": "mujoco"},
        {"dtype": "int8"},
        {"commands": []},
        {"robots": []},
        {"state": [0.0]},
        {"commands": [{"robot": 3, "current": [0, 0, 0], "command": [0, 0, 0], "steps": 1}]},
        {"commands": [{"robot": 0, "current": [0, 0], "command": [0, 0, 0], "steps": 1}]},
    ],
)
def test_a_damaged_file_is_refused(change: dict[str, Any], folder: Path) -> None:
    swim_until_it_diverges("numba")
    (path,) = folder.iterdir()
    content = json.loads(path.read_text())
    del content["checksum"]
    path.write_text(json.dumps(content | change))
    with pytest.raises(InvalidArgumentError, match="is damaged"):
        swim_again(path)


@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_a_robot_whose_servo_died_in_mid_swim_is_swum_again(engine: str, folder: Path) -> None:
    robot = struck(33)
    (change,) = robot.schedule
    dead = replace(change.to, fin_angles=np.array([[0.0, 0.0, np.nan]]))  # as Damage.edit says it
    rollout(
        [lambda *_: (0.0, 0.5, 1.0)],
        replace(robot, schedule=(change._replace(to=dead),)),
        engine=engine,
        seconds=1.0,
    )
    assert swim_again(next(folder.iterdir())).runaway is not None


BOUND = float(np.sqrt(RUNAWAY_SQUARE))
SPEEDS = range(FIELDS["velocity"].start, FIELDS["spin"].stop)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_every_arithmetic_says_alike_who_diverged(dtype: type[np.floating]) -> None:
    """Rows, numbers, the compiled robot and lanes: about the bound, and for what is not finite."""
    states = np.tile(start_rows(np.zeros((1, 3))), 600).astype(dtype)
    rng = np.random.default_rng(0)
    about = np.nextafter(dtype(BOUND), dtype(0)), dtype(BOUND), np.nextafter(dtype(BOUND), np.inf)
    spoilt = [(row, x) for row in range(STATE_NUMBERS) for x in (np.inf, -np.inf, np.nan)]
    spoilt += [(row, sign * x) for row in SPEEDS for x in (*about, 1e30) for sign in (-1, 1)]
    for robot, (row, x) in enumerate(spoilt):
        states[row, robot] = x
    rest = 600 - len(spoilt)  # of all speeds at once, about the bound
    fast = rng.normal(size=(len(SPEEDS), rest))
    fast *= (
        BOUND * (1 + rng.integers(-4, 5, rest) * np.finfo(dtype).eps) / np.linalg.norm(fast, axis=0)
    )
    states[SPEEDS.start : SPEEDS.stop, len(spoilt) :] = fast
    lost = diverged_states(states)
    assert lost[: 3 * STATE_NUMBERS].all()
    assert {bool(x) for x in lost[len(spoilt) :]} == {False, True}
    lanes = LaneBatch(Scenario.create([[0.0] * 9] * 600), dtype, states=states)
    still = np.zeros(600)
    found, *_ = lanes.act(np.zeros((3, 600)), (still, still, still - 1.0), 0)
    np.testing.assert_array_equal(found, lost)
    np.testing.assert_array_equal(lanes.diverged, lost)
    if dtype is np.float64:
        world = make_world("numba", Scenario.create())
        for column, expected in zip(states.T, lost, strict=True):
            assert has_diverged(state_from_numbers(column.tolist())) == expected
            world._numbers[:STATE_NUMBERS] = column[:STATE_NUMBERS]  # type: ignore[attr-defined]
            world.advance((0.0, 0.0, 0.0), 0)
            assert world.diverged == expected


@pytest.mark.parametrize("drag", [0.0, 1e-5])
def test_a_rollout_without_a_task_notices_a_robot_that_ran_away(drag: float) -> None:
    """With some drag it is slow again in the end."""
    policy = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, Morphology.nominal(), 0)
    start = start_rows(np.zeros((2, 3)))
    start[FIELDS["velocity"].start + 1, 1] = 3e6
    hulls = Scenario.create(np.zeros((2, 9)), drag=(drag, drag))
    found = rollout(program_of([policy, policy]), hulls, seconds=3.0, threads=1, start=start)
    assert found.diverged.tolist() == [False, True]
    assert np.isnan(found.end[1]).all()
