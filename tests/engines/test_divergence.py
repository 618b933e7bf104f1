"""A robot that diverges leaves a file, with which ``simulate`` swims it again."""

from __future__ import annotations

import copy
import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym import simulate
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.engines.divergence import MOST_FILES, Recorded
from aquafish_gym.engines.worlds import diverged_states, make_world
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.kinematics import RUNAWAY_SQUARE, has_diverged
from aquafish_gym.physics.layout import FIELDS, layout
from aquafish_gym.plans import AQUAFISH, FOUR_FINS, BodyPlan
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import Scenario
from gait.controllers.controller import Controller, program_of
from tests.contract.scenes import BEFORE_DIVERGING_SEED, ROUGH, THIN

DIVERGING_SEED = BEFORE_DIVERGING_SEED + 1
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


def swum_again(path: Path) -> tuple[dict[str, Any], ImuLog]:
    arguments = json.loads(path.read_text())
    return arguments, simulate(**arguments)


def struck(step: int) -> Scenario:
    """Return a robot that becomes thin in a rough current."""
    calm = Scenario.create(fin_angles=(0.4, -0.2, 1.0), current=(0.1, 0.0, 0.0))
    rough = replace(
        calm, body=np.array([THIN]), current=np.full((1, 3), 11.0), drag=np.full((1, 2), 10.0)
    )
    return calm.then(step, rough)


@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_an_episode_that_diverges_is_swum_again(engine: str, folder: Path) -> None:
    assert swim_until_it_diverges(engine)
    (path,) = folder.iterdir()
    arguments, log = swum_again(path)
    assert log.diverged.tolist() == [True]
    assert (arguments["engine"], arguments["begun"], arguments["steps"]) == (engine, 0, 20)
    assert path.stat().st_size < 3_000
    calm = simulate(**arguments | {"current": (0.1, 0.0, 0.0)})
    assert not calm.diverged.any()


class Told:
    """An engine whose robots diverge when somebody says so."""

    def __init__(self, engine: Any, batch: int) -> None:
        self._engine = engine
        self.diverged = np.zeros(batch, np.bool_)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._engine, name)


def recorded(kind: str, scenario: Scenario, folder: Path) -> tuple[Any, Told]:
    """Return an engine that has started, recorded, and by what its robots are told to diverge."""
    how = {"engine": kind, "dtype": "float64", "substeps": 1}
    if kind == "lanes":
        engine: Any = LaneBatch(scenario, np.float64)
        how["engine"] = "numba"
    else:
        engine = make_world(kind, scenario)
    told = Told(engine, len(scenario))
    found = Recorded(told, scenario, folder, how)
    found.start(scenario)
    return found, told


@pytest.mark.parametrize("plan", [AQUAFISH, FOUR_FINS], ids=lambda plan: plan.name)
@pytest.mark.parametrize("kind", ["numba", "pybullet", "lanes"])
def test_a_swim_is_replayed_from_its_last_change(kind: str, plan: BodyPlan, tmp_path: Path) -> None:
    """To rounding, also of servos that become strong, reversed or dead."""
    fins = len(plan.fins)
    calm = Scenario.create(
        fin_angles=(0.4, -0.2, 1.0, 2.0)[:fins], current=(0.1, 0.0, 0.0), plan=plan
    )
    gains = np.array([(-0.7, 0.0, 2.0, 1.0)[:fins]])
    broken = replace(calm, body=0.8 * calm.body, servo_gain=gains)
    engine, told = recorded(kind, calm, tmp_path)
    rng = np.random.default_rng(0)
    spins, expected = [], 0
    for step in range(60):
        if step == 43:
            engine.update(replace(broken, fin_angles=np.full((1, fins), np.nan)))
        if step == 50:
            engine.set_current(np.array([0.3, -0.2, 0.1]).reshape((1, 3) if kind == "lanes" else 3))
        command = rng.uniform(plan.command_low, plan.command_high)
        for _ in range(5):
            told.diverged[:] = (step, _) in ((41, 4), (48, 4), (59, 4))
            engine.advance(command[None] if kind == "lanes" else tuple(command))
            spins.append(np.ravel(engine.state().spin))
        if told.diverged.any():
            (path,) = tmp_path.iterdir()
            arguments, log = swum_again(path)
            path.unlink()
            engine._lost[:] = False
            begun = {41: 0, 48: 215, 59: 250}[step]
            assert arguments["steps"] == len(spins) - begun
            np.testing.assert_allclose(log.gyro[0], spins[begun:], rtol=1e-7, atol=1e-8)
            expected += 1
    assert expected == 3
    engine.close()


def test_a_robot_of_a_batch_is_swum_again_alone(tmp_path: Path) -> None:
    several = Scenario.create(fin_angles=np.arange(15.0).reshape(5, 3))
    engine, told = recorded("lanes", several, tmp_path)
    rng = np.random.default_rng(0)
    spins = []
    for step in range(60):
        if step == 40:  # another episode of robot 2
            engine.start(several.take([2]), np.array([2]))
        if step == 50:
            engine.update(several.take([1]), np.array([1]))
        told.diverged[:] = step == 59
        engine.advance(rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (5, 3)), 5)
        spins.append(np.transpose(engine.state().spin))
    begun = {}
    for path in tmp_path.iterdir():
        arguments, log = swum_again(path)
        begun[arguments["steps"]] = begun.get(arguments["steps"], 0) + 1
        robot = {100: 2, 50: 1}.get(arguments["steps"])
        if robot is not None:
            swum = np.array(spins)[-arguments["steps"] // 5 :, robot]
            np.testing.assert_allclose(log.gyro[0, 4::5], swum, rtol=1e-7, atol=1e-8)
    assert begun == {300: 3, 100: 1, 50: 1}


@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_a_rollout_that_diverges_after_a_fault_is_swum_again(engine: str, folder: Path) -> None:
    rollout(
        [lambda _, time: (np.sin(3.0 * time), 0.5, 1.0)],
        struck(333),
        engine=engine,
        seconds=5.0,
        interval=7,
    )
    (path,) = folder.iterdir()
    arguments, log = swum_again(path)
    assert log.diverged.all()
    assert arguments["engine"] == "numba"
    assert arguments["begun"] > 0


def test_a_vector_environment_records_each_robot_that_diverges(folder: Path) -> None:
    env = AquaFishVectorEnv(2, morphology=THIN, current=ROUGH, fin_angles="random", dtype="float64")
    env.reset(seed=[STEADY_SEED, DIVERGING_SEED])
    for _ in range(3):
        *_, info = env.step(np.tile(ACTION, (2, 1)))
        if info["diverged"].any():
            assert info["diverged"].tolist() == [False, True]
    (path,) = folder.iterdir()
    arguments, log = swum_again(path)
    assert log.diverged.all()
    swim_until_it_diverges("numba")  # the same robot by itself
    for other in folder.iterdir():
        assert json.loads(other.read_text())["fin_angles"] == arguments["fin_angles"]


@pytest.mark.pybullet
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


def test_a_recorded_environment_and_its_copies_return_the_same(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def swim() -> list[Any]:
        env = gym.make(
            "AquaFish-v0", engine="numba", damage="caudal:seized@1; left_pectoral:delay=0.4"
        )
        seen = [env.reset(seed=3)[0]]
        env = copy.deepcopy(pickle.loads(pickle.dumps(env)))
        return seen + [env.step(ACTION)[0] for _ in range(20)]

    found = swim()
    monkeypatch.delenv("AQUAFISH_DIVERGED")
    np.testing.assert_array_equal(found, swim())
    assert not folder.exists()


def test_a_folder_takes_ten_files_and_none_of_what_simulate_lacks(tmp_path: Path) -> None:
    several = Scenario.create(
        fin_angles=np.arange(66.0).reshape(22, 3),
        fin_density=[1.0, 2.0] * 11,
        servo_lag=[*[0.0] * 21, 0.1],
    )
    engine, told = recorded("lanes", several, tmp_path)
    for some in (np.arange(22) % 2 == 1, np.ones(22, np.bool_)):
        told.diverged[:] = some
        engine.advance(np.full((22, 3), 0.3), 2)
        assert len([*tmp_path.iterdir()]) == (MOST_FILES if some.all() else 0)


BOUND = float(np.sqrt(RUNAWAY_SQUARE))
SPEEDS = range(FIELDS["velocity"].start, FIELDS["spin"].stop)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_every_arithmetic_says_alike_who_diverged(dtype: type[np.floating]) -> None:
    """Rows, numbers, the compiled robot and lanes: about the bound, and for what is not finite."""
    states = np.tile(layout(AQUAFISH).start(np.zeros((1, 3))), 600).astype(dtype)
    rng = np.random.default_rng(0)
    about = np.nextafter(dtype(BOUND), dtype(0)), dtype(BOUND), np.nextafter(dtype(BOUND), np.inf)
    spoilt = [
        (row, x) for row in range(layout(AQUAFISH).state_numbers) for x in (np.inf, -np.inf, np.nan)
    ]
    spoilt += [(row, sign * x) for row in SPEEDS for x in (*about, 1e30) for sign in (-1, 1)]
    for robot, (row, x) in enumerate(spoilt):
        states[row, robot] = x
    rest = 600 - len(spoilt)  # of all speeds at once, about the bound
    fast = rng.normal(size=(len(SPEEDS), rest))
    fast *= (
        BOUND * (1 + rng.integers(-4, 5, rest) * np.finfo(dtype).eps) / np.linalg.norm(fast, axis=0)
    )
    states[SPEEDS.start : SPEEDS.stop, len(spoilt) :] = fast
    lost = diverged_states(layout(AQUAFISH).state(states))
    assert lost[: 3 * layout(AQUAFISH).state_numbers].all()
    assert {bool(x) for x in lost[len(spoilt) :]} == {False, True}
    lanes = LaneBatch(Scenario.create([[0.0] * 9] * 600), dtype, states=states)
    still = np.zeros(600)
    found, *_ = lanes.act(np.zeros((3, 600)), (still, still, still - 1.0), 0)
    np.testing.assert_array_equal(found, lost)
    np.testing.assert_array_equal(lanes.diverged, lost)
    if dtype is np.float64:
        world = make_world("numba", Scenario.create())
        for column, expected in zip(states.T, lost, strict=True):
            assert has_diverged(layout(AQUAFISH).state(column.tolist())) == expected
            world._numbers[: layout(AQUAFISH).state_numbers] = column[
                : layout(AQUAFISH).state_numbers
            ]  # type: ignore[attr-defined]
            world.advance((0.0, 0.0, 0.0), 0)
            assert world.diverged == expected


@pytest.mark.parametrize("drag", [0.0, 1e-5])
def test_a_rollout_without_a_task_notices_a_robot_that_ran_away(drag: float) -> None:
    """With some drag it is slow again in the end."""
    policy = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, Morphology.nominal(), 0)
    start = layout(AQUAFISH).start(np.zeros((2, 3)))
    start[FIELDS["velocity"].start + 1, 1] = 3e6
    hulls = Scenario.create(np.zeros((2, 9)), drag=(drag, drag))
    found = rollout(program_of([policy, policy]), hulls, seconds=3.0, threads=1, start=start)
    assert found.diverged.tolist() == [False, True]
    assert np.isnan(found.end[1]).all()
