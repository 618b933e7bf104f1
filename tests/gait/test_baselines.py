"""Learned baselines: what was learned is a controller, and an interruption changes no byte."""

from __future__ import annotations

import importlib
import pickle
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from aquafish_gym.bodies import body_array, read_bodies
from aquafish_gym.damage import Damage
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError, MissingExtraError, UnknownNameError
from gait import learner
from gait.baselines import (
    CHECKPOINT_FILE,
    CURVE_FILE,
    FILES,
    Baseline,
    BaselineConfig,
    _Run,
    train_baseline,
)
from gait.controller import Controller
from gait.network import OUTPUTS, Senses, forward
from gait.records import BODIES_FILE, CONTROLLER_FILE
from gait.rollout import random_poses, stream, swim_all
from gait.search.templates import Template
from gait.task import perform
from gait.transfer import TransferConfig, transfer
from gait_fakes import contents

HALF = Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal())
# Three legs of twenty actions of each of three robots.
CONFIG = BaselineConfig(
    steps=180, environments=3, interval=100, senses=("imu", "clock", "fins"), hidden=(8, 5), seed=7
)


def robots(count: int, senses: Senses, interval: int = 100, seconds: float = 20.0) -> Any:
    """Robots that are rewarded for nothing but their speed."""
    pytest.importorskip("stable_baselines3")
    env = importlib.import_module("gait.sb3_env").LaneVecEnv
    task = SwimForward(seconds=seconds, ctrl_weight=0.0)
    return env(count, HALF.to_array()[None], senses, 0.7, interval, task)


def swum(env: Any, act: Any, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return from where robots swam under a function of what they feel, and how far."""
    env.seed(seed)
    felt = env.reset()
    poses, done = env._fins.copy(), np.zeros(1)
    while not done.any():
        felt, _, done, _ = env.step(act(felt))
    return poses, env.earned


def answer(controller: Controller, felt: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a controller's actions for what several robots feel, in plain Python."""
    genes, layout = controller.genes().tolist(), controller.layout().tolist()
    rest = [0.0] * 2 * controller.nodes
    rows = [forward(genes, layout, row.tolist() + rest, 0, 1, 0.0) for row in felt]
    return np.array(rows, np.float32)


@pytest.mark.parametrize("algorithm", ["PPO", "SAC", "TD3"])
@pytest.mark.parametrize("hidden", [(8, 5), ()])
def test_what_was_learned_is_a_controller(algorithm: str, hidden: tuple[int, ...]) -> None:
    """It does what the library's own policy does, without noise, and swims as far."""
    pytest.importorskip("stable_baselines3")
    run = _Run(HALF.to_array()[None], replace(CONFIG, algorithm=algorithm, hidden=hidden), Damage())
    untrained = run.controller(run._learner.network())
    for _ in range(2):
        run.step(lambda _steps, _curve: None)
    model, controller = run._learner.model, run.controller(run._learner.network())

    def act(felt: NDArray[np.float32]) -> NDArray[np.float32]:
        heard = model.get_vec_normalize_env().normalize_obs(felt)
        return np.asarray(model.predict(heard, deterministic=True)[0])

    felt = np.random.default_rng(0).uniform(-1, 1, (50, 17)).astype(np.float32)
    wanted = act(felt)
    np.testing.assert_allclose(answer(controller, felt), wanted, atol=2e-6)
    assert np.abs(answer(untrained, felt) - wanted).max() > 1e-3
    poses, far = swum(robots(4, CONFIG.felt), act, 3)
    np.testing.assert_allclose(swim_all([controller], HALF, poses)[0], far, atol=1e-3)
    assert np.ptp(far) > 1e-2


@pytest.mark.parametrize(
    "senses", [Senses(), Senses(False, 3), Senses(False, 0, True), Senses(True, 2, True)]
)
def test_robots_feel_what_a_controller_does(senses: Senses) -> None:
    template = Template.of_class("mlp", senses, 5)
    vector = template.random(1, np.random.default_rng(2))[0]
    mlp = template.controller(vector, 0.7, HALF, 0).to_dict()
    controller = Controller.from_dict(mlp | {"interval": 20, "clock": 0.7})
    poses, far = swum(robots(5, senses, 20, 4.0), lambda felt: answer(controller, felt), 4)
    np.testing.assert_allclose(swim_all([controller], HALF, poses, 4.0)[0], far, atol=1e-5)
    assert np.ptp(far) > 1e-2


def test_the_lanes_are_an_environment_of_the_library() -> None:
    env = robots(2, Senses())
    env.seed(5)
    first = env.reset()
    for step in range(20):
        observations, rewards, done, infos = env.step(np.zeros((2, 3), np.float32))
        assert observations.shape == (2, 11)
        assert env.observation_space.contains(observations[0])
        assert (rewards.shape, rewards.dtype) == ((2,), np.float32)
        assert done.all() == (step == 19)
    assert [info["TimeLimit.truncated"] for info in infos] == [True, True]
    assert not np.array_equal(infos[0]["terminal_observation"], observations[0])
    np.testing.assert_array_equal(observations, first)  # upright again, at rest, the clock at 0
    assert env.env_is_wrapped(object) == [False, False]
    for call in (env.set_attr, env.env_method):
        with pytest.raises(AttributeError, match="share one environment"):
            call("interval", 1)


def test_a_robot_that_diverged_begins_anew_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    env = robots(3, Senses(False, 1))
    env.reset()
    step = env._env.step
    env.step(np.zeros((3, 3), np.float32))

    def lost(actions: NDArray[np.float32]) -> tuple[Any, ...]:
        felt, rewards, terminated, truncated, info = step(actions)
        return felt, rewards, terminated | (np.arange(3) == 1), truncated, info

    monkeypatch.setattr(env._env, "step", lost)
    felt, _, done, infos = env.step(np.zeros((3, 3), np.float32))
    assert done.tolist() == [False, True, False]
    assert not infos[1]["TimeLimit.truncated"]
    assert np.isfinite(env.earned).tolist() == done.tolist()
    np.testing.assert_array_equal(felt[1], [0.0, 1.0])  # its clock; the others' go on
    np.testing.assert_allclose(felt[::2], [[np.sin(2.8 * np.pi), np.cos(2.8 * np.pi)]] * 2, 1e-6)


@pytest.mark.parametrize("algorithm", ["PPO", "TD3"])
def test_an_interruption_changes_no_byte(tmp_path: Path, algorithm: str) -> None:
    pytest.importorskip("stable_baselines3")
    config = replace(CONFIG, algorithm=algorithm)
    train_baseline(HALF, config, out=tmp_path / "whole")

    def stop(steps: int, _curve: Any) -> None:
        if steps >= 140:  # in the third leg
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train_baseline(HALF, config, out=tmp_path / "stopped", on_step=stop)
    seen = []
    train_baseline(
        HALF, config, out=tmp_path / "stopped", on_step=lambda steps, _: seen.append(steps)
    )
    # TD3 has a buffer besides, and begins again.
    assert seen[0] == (120 if algorithm == "PPO" else 3)
    assert contents(tmp_path / "stopped") == contents(tmp_path / "whole")


def test_more_steps_prolong_it_and_what_a_kill_left_is_mended(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    once = train_baseline(HALF, CONFIG, out=whole)
    for steps in (1, 100, 100, 180):
        last = train_baseline(HALF, replace(CONFIG, steps=steps), out=parts)
        (parts / CONTROLLER_FILE).unlink()
    assert (last.score, last.curve) == (once.score, once.curve)
    train_baseline(HALF, CONFIG, out=parts)
    assert contents(parts) == contents(whole)
    assert set(contents(whole)) == {*FILES, "settings.json"}
    with pytest.raises(InvalidArgumentError, match="steps must be at least the 180 that out"):
        train_baseline(HALF, replace(CONFIG, steps=120), out=whole)
    with pytest.raises(InvalidArgumentError, match="with clock"):
        train_baseline(HALF, replace(CONFIG, clock=0.8), out=whole)


def test_the_best_is_kept_and_the_curve_reads_back(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    found = train_baseline(HALF, CONFIG, out=tmp_path)
    assert [leg.steps for leg in found.curve] == [60, 120, 180]
    assert found.score == max(leg.score for leg in found.curve)
    controller = Controller.load(tmp_path / CONTROLLER_FILE)
    assert controller.to_dict() == found.controller.to_dict()
    assert (controller.morphology, controller.seed, controller.sample) == (HALF, 7, None)
    poses = random_poses(32, stream(7, 1))
    assert swim_all([controller], HALF, poses).mean() == found.score
    head, *lines = (tmp_path / CURVE_FILE).read_text().splitlines()
    assert head == "steps,training,score"
    assert [float(line.split(",")[2]) for line in lines] == [leg.score for leg in found.curve]
    config = TransferConfig(poses=1, seconds=2.0, target_engine="numba")
    both = transfer(controller, Morphology.nominal(), config)
    assert both.native.distance != both.target.distance


def test_no_file_is_a_pickle_and_none_is_read(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    train_baseline(HALF, replace(CONFIG, steps=1), out=tmp_path)
    path = tmp_path / CHECKPOINT_FILE
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    assert {"adam.0.exp_avg_sq", "policy.log_std", "returns.var", "best.bias"} <= set(arrays)
    for content in (pickle.dumps({"a": 1}), path.read_bytes()[:-100]):
        path.write_bytes(content)
        with pytest.raises(DamagedFileError, match=r"whole archive of arrays.*delete it to start"):
            train_baseline(HALF, CONFIG, out=tmp_path)
    np.savez(path, **(arrays | {"best.bias": np.zeros(3)}))
    with pytest.raises(DamagedFileError, match=r"must have best\.bias of shape \(16,\)"):
        train_baseline(HALF, CONFIG, out=tmp_path)
    np.savez(path, **(arrays | {"curve": np.zeros((0, 3))}))
    with pytest.raises(DamagedFileError, match="holds no leg"):
        train_baseline(HALF, CONFIG, out=tmp_path)


def test_robots_have_the_bodies_of_a_sample_in_turn(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    bodies = [HALF, Morphology.nominal()]
    found = train_baseline(bodies, replace(CONFIG, steps=1), out=tmp_path)
    assert read_bodies(tmp_path / BODIES_FILE) == tuple(bodies)
    assert str(found.controller.sample).startswith("2 bodies, ")
    other = train_baseline(HALF, replace(CONFIG, steps=1))
    assert found.curve[0].training != other.curve[0].training
    env = importlib.import_module("gait.sb3_env").LaneVecEnv
    dealt = env(3, body_array(bodies), Senses(), 0.7, 100)
    dealt.reset()
    _, _, _, _, info = dealt._env.step(np.zeros((3, 3), np.float32))
    np.testing.assert_array_equal(info["morphology"], body_array([*bodies, HALF]))
    # Each body swims from as many of the poses.
    poses = random_poses(32, stream(7, 1))
    far = swim_all([found.controller], np.resize(body_array(bodies), (32, 9)), poses)
    assert far.mean() == found.score
    with pytest.raises(InvalidArgumentError, match=r"morphologies must be 1 to 3 .* got 4"):
        train_baseline([HALF] * 4, CONFIG)


def test_nobody_elses_random_numbers_are_touched() -> None:
    torch = pytest.importorskip("torch")
    pytest.importorskip("stable_baselines3")

    def drawn() -> tuple[float, ...]:
        return random.random(), np.random.random(), float(torch.rand(1))  # noqa: NPY002

    def reseed() -> None:
        random.seed(1)
        np.random.seed(1)  # noqa: NPY002
        torch.manual_seed(1)

    reseed()
    wanted = drawn()
    reseed()
    found = train_baseline(None, replace(CONFIG, steps=1, environments=2))
    assert drawn() == wanted
    assert train_baseline(None, replace(CONFIG, steps=1, environments=2)).score == found.score
    other = train_baseline(None, replace(CONFIG, steps=1, environments=2, seed=8))
    assert other.score != found.score


def test_a_missing_library_is_named_with_its_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def absent(module: str) -> object:
        raise ModuleNotFoundError(f"No module named {module!r}")

    monkeypatch.setattr(learner, "import_module", absent)
    with pytest.raises(MissingExtraError, match=r'pip install "\.\[rl\]"'):
        train_baseline(out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_baseline_says_how_far_it_came() -> None:
    controller = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, HALF, seed=0)
    assert repr(Baseline(controller, 1.5, ())).startswith("Baseline(score 1.50, Controller(3 nodes")


def test_bad_settings_are_refused_by_name() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'PPO'"):
        BaselineConfig(algorithm="PPA")
    with pytest.raises(UnknownNameError, match="did you mean 'fins'"):
        BaselineConfig(senses=("imu", "fin"))  # type: ignore[arg-type]
    with pytest.raises(InvalidArgumentError, match=r"got 7; the nearest is 5$"):
        BaselineConfig(interval=7)
    for name, value in (
        ("steps", 0),
        ("steps", 10**400),
        ("environments", 0),
        ("environments", 10**8),
        ("interval", 2000),
        ("interval", 5.0),
        ("clock", -1.0),
        ("senses", ()),
        ("seed", -1),
        ("hidden", (0,)),
        ("hidden", (500, 498)),
        ("hidden", 64),
    ):
        with pytest.raises(InvalidArgumentError, match=f"^{name} must"):
            BaselineConfig(**{name: value})  # type: ignore[arg-type]


def test_frames_are_a_memory_of_the_controllers_own() -> None:
    """It hears what the library's policy hears, the inputs of the last times, and answers alike."""
    pytest.importorskip("stable_baselines3")
    stack = importlib.import_module("stable_baselines3.common.vec_env").VecFrameStack
    config = replace(CONFIG, frames=3, senses=("imu", "clock"), interval=20)
    run = _Run(HALF.to_array()[None], config, Damage())
    run.step(lambda _steps, _curve: None)
    model, controller = run._learner.model, run.controller(run._learner.network())
    assert controller.layers == (8, 5, 2 * 11, 3)

    def act(felt: NDArray[np.float32]) -> NDArray[np.float32]:
        heard = model.get_vec_normalize_env().normalize_obs(felt)
        return np.asarray(model.predict(heard, deterministic=True)[0])

    env = robots(4, config.felt, 20, 4.0)
    stacked, done = stack(env, 3), np.zeros(1)
    env.seed(3)
    felt = stacked.reset()
    poses = env._fins.copy()
    while not done.any():
        felt, _, done, _ = stacked.step(act(felt))
    far = swim_all([controller], HALF, poses, 4.0)[0]
    np.testing.assert_allclose(far, env.earned, atol=2e-5)
    forgets = controller.weights.copy()
    forgets[-len(OUTPUTS) - 22 : -len(OUTPUTS)] = 0.0
    without = replace(controller, weights=forgets)
    assert np.abs(swim_all([without], HALF, poses, 4.0)[0] - far).max() > 2e-4


def test_a_task_is_learned_with_damage_of_each_episode(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    config = replace(CONFIG, task="waypoint", steps=1, environments=2)
    found = train_baseline(HALF, config, damage="random:severe", out=tmp_path)
    assert found.controller.senses.goal
    calm = train_baseline(HALF, config)
    assert found.curve[0].training != calm.curve[0].training
    with pytest.raises(InvalidArgumentError, match="random:severe"):
        train_baseline(HALF, config, out=tmp_path)
    controller = Controller.load(tmp_path / CONTROLLER_FILE)
    poses = random_poses(32, stream(7, 1))
    earned = perform([controller], HALF, poses, task="waypoint", damage="random:severe")
    assert earned.mean() == found.score
