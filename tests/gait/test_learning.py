"""Learned controllers: the exported network does what the library's policy does."""

from __future__ import annotations

import importlib
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
from aquafish_gym.plans import FOUR_FINS
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.controller import Controller
from gait.controllers.network import Senses, forward
from gait.files import BODIES_FILE, CONTROLLER_FILE
from gait.learning.train import CURVE_FILE, CurvePoint, LearningConfig, _Learner, train
from gait.search.templates import Template
from gait.swims.poses import random_poses, stream
from gait.swims.scores import scores
from gait_fakes import contents

HALF = Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal())
# Three epochs of twenty actions of each of three robots.
CONFIG = LearningConfig(
    steps=180, environments=3, interval=100, senses=("imu", "clock", "fins"), seed=7
)


def robots(
    count: int,
    senses: Senses,
    interval: int = 100,
    seconds: float = 20.0,
    body: Morphology = HALF,
) -> Any:
    """Return robots whose reward is their speed alone."""
    pytest.importorskip("stable_baselines3")
    env = importlib.import_module("gait.learning.sb3_env").LaneVecEnv
    task = SwimForward(seconds=seconds, ctrl_weight=0.0)
    sizes = body.to_array()[None]
    return env(count, sizes, senses, 0.7, interval, task, plan=body.plan)


def swum(env: Any, stacked: Any, act: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the poses from which robots swam an episode under a policy, and how far."""
    env.seed(3)
    observed = stacked.reset()
    poses, done = env._inputs.fin_angles.copy(), np.zeros(1)
    while not done.any():
        observed, _, done, _ = stacked.step(act(observed))
    return poses, env.earned


def answer(controller: Controller, observed: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a controller's actions for several rows of inputs, in plain Python."""
    genes, layout = controller.genes().tolist(), controller.layout().tolist()
    rest = [0.0] * 2 * controller.nodes
    rows = [row.tolist() + rest for row in observed]
    for row in rows:
        forward(genes, layout, row, 0, 1, 0.0)
    last = observed.shape[1] + controller.nodes
    first = last - len(controller.plan.fins)
    return np.array([row[first:last] for row in rows], np.float32)


def learned(config: LearningConfig) -> tuple[Any, Controller, Controller]:
    """Return a learned policy, and the controllers exported before and after."""
    pytest.importorskip("stable_baselines3")
    learner = _Learner(HALF.to_array()[None], config, Damage())
    before = learner.controller()
    for seed in range(2):
        learner.learn(seed)

    def act(observed: NDArray[np.float32]) -> NDArray[np.float32]:
        normal = learner.model.get_vec_normalize_env().normalize_obs(observed)
        return np.asarray(learner.model.predict(normal, deterministic=True)[0])

    return act, before, learner.controller()


def test_exported_controller_acts_and_swims_as_the_policy() -> None:
    act, before, controller = learned(CONFIG)
    inputs = np.random.default_rng(0).uniform(-1, 1, (50, 17)).astype(np.float32)
    np.testing.assert_allclose(answer(controller, inputs), act(inputs), atol=2e-6)
    assert np.abs(answer(before, inputs) - act(inputs)).max() > 1e-3
    env = robots(4, CONFIG.inputs)
    poses, far = swum(env, env, act)
    np.testing.assert_allclose(scores([controller], HALF, poses)[0], far, atol=1e-3)
    assert np.ptp(far) > 1e-2


@pytest.mark.parametrize(
    ("senses", "body"),
    [
        (Senses(), HALF),
        (Senses(False, 3), HALF),
        (Senses(False, 0, True), HALF),
        (Senses(True, 2, True), HALF),
        (Senses(True, 2, True), Morphology.nominal("four-fins")),
    ],
)
def test_robots_observe_a_controllers_inputs(senses: Senses, body: Morphology) -> None:
    template = Template.of_class("mlp", senses, 5, plan=body.plan)
    vector = template.random(1, np.random.default_rng(2))[0]
    mlp = template.controller(vector, 0.7, body, 0).to_dict()
    controller = Controller.from_dict(mlp | {"interval": 20, "clock": 0.7})
    env = robots(5, senses, 20, 4.0, body)
    poses, far = swum(env, env, lambda observed: answer(controller, observed))
    np.testing.assert_allclose(scores([controller], body, poses, 4.0)[0], far, atol=1e-5)
    assert np.ptp(far) > 1e-2


def test_vector_env_has_the_librarys_interface() -> None:
    env = robots(2, Senses())
    env.seed(5)
    first = env.reset()
    for step in range(20):
        observations, rewards, done, infos = env.step(np.zeros((2, 3), np.float32))
        assert env.observation_space.contains(observations[0])
        assert (rewards.shape, rewards.dtype) == ((2,), np.float32)
        assert done.all() == (step == 19)
    assert [info["TimeLimit.truncated"] for info in infos] == [True, True]
    assert not np.array_equal(infos[0]["terminal_observation"], observations[0])
    np.testing.assert_array_equal(observations, first)  # upright again, at rest, the clock at 0
    assert env.env_is_wrapped(object) == [False, False]


def test_diverged_robot_restarts_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    env = robots(3, Senses(False, 1))
    env.reset()
    step = env.envs.step
    env.step(np.zeros((3, 3), np.float32))

    def diverging(actions: NDArray[np.float32]) -> tuple[Any, ...]:
        observed, rewards, terminated, truncated, info = step(actions)
        return observed, rewards, terminated | (np.arange(3) == 1), truncated, info

    monkeypatch.setattr(env.envs, "step", diverging)
    observed, _, done, infos = env.step(np.zeros((3, 3), np.float32))
    assert done.tolist() == [False, True, False]
    assert not infos[1]["TimeLimit.truncated"]
    np.testing.assert_array_equal(observed[1], [0.0, 1.0])  # its clock; the others' go on
    np.testing.assert_allclose(observed[0], [np.sin(2.8 * np.pi), np.cos(2.8 * np.pi)], 1e-6)


def test_result_is_the_best_epoch_and_files_hold_it(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    found = train(HALF, CONFIG, out=tmp_path / "a")
    assert [point.steps for point in found.curve] == [60, 120, 180]
    assert found.score == max(point.score for point in found.curve)
    controller = Controller.load(tmp_path / "a" / CONTROLLER_FILE)
    assert controller.to_dict() == found.controller.to_dict()
    assert (controller.morphology, controller.seed, controller.sample) == (HALF, 7, None)
    assert scores([controller], HALF, random_poses(32, stream(7, 1))).mean() == found.score
    head, *lines = (tmp_path / "a" / CURVE_FILE).read_text().splitlines()
    assert head == "steps,training,score"
    assert [float(line.split(",")[2]) for line in lines] == [p.score for p in found.curve]
    train(HALF, CONFIG, out=tmp_path / "b")
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    with pytest.raises(InvalidArgumentError, match="with seed"):
        train(HALF, replace(CONFIG, seed=8), out=tmp_path / "a")


def test_interruption_keeps_the_best_controller(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")

    def stop(point: CurvePoint) -> None:
        if point.steps == 120:  # after the second epoch
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(HALF, CONFIG, out=tmp_path, on_epoch=stop)
    Controller.load(tmp_path / CONTROLLER_FILE)
    assert len((tmp_path / CURVE_FILE).read_text().splitlines()) == 3


def test_robots_have_the_bodies_of_a_sample_in_turn(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    bodies = [HALF, Morphology.nominal()]
    found = train(bodies, replace(CONFIG, steps=1), out=tmp_path)
    assert read_bodies(tmp_path / BODIES_FILE) == tuple(bodies)
    assert str(found.controller.sample).startswith("2 bodies, ")
    env = importlib.import_module("gait.learning.sb3_env").LaneVecEnv
    dealt = env(3, body_array(bodies), Senses(), 0.7, 100)
    dealt.reset()
    _, _, _, _, info = dealt.envs.step(np.zeros((3, 3), np.float32))
    np.testing.assert_array_equal(info["morphology"], body_array([*bodies, HALF]))
    poses = random_poses(32, stream(7, 1))
    far = scores([found.controller], np.resize(body_array(bodies), (32, 9)), poses)
    assert far.mean() == found.score
    with pytest.raises(InvalidArgumentError, match=r"morphologies must be 1 to 3 .* got 4"):
        train([HALF] * 4, CONFIG)


def test_task_is_learned_with_other_damage_in_each_episode() -> None:
    pytest.importorskip("stable_baselines3")
    config = replace(CONFIG, task="waypoint", steps=1, environments=2)
    found = train(HALF, config, damage="random:severe")
    assert found.curve[0].training != train(HALF, config).curve[0].training
    poses = random_poses(32, stream(7, 1))
    earned = scores([found.controller], HALF, poses, task="waypoint", damage="random:severe")
    assert earned.mean() == found.score


def test_a_fish_of_another_plan_learns() -> None:
    pytest.importorskip("stable_baselines3")
    found = train(config=replace(CONFIG, plan="four-fins", steps=1))
    assert found.controller.plan == FOUR_FINS
    poses = random_poses(32, stream(7, 1), FOUR_FINS)
    assert scores([found.controller], fin_angles=poses).mean() == found.score


def test_global_random_generators_are_restored() -> None:
    torch = pytest.importorskip("torch")
    pytest.importorskip("stable_baselines3")
    drawn = []
    for learns in (False, True):
        random.seed(1)
        np.random.seed(1)  # noqa: NPY002
        torch.manual_seed(1)
        if learns:
            train(None, replace(CONFIG, steps=1, environments=2))
        drawn.append((random.random(), np.random.random(), float(torch.rand(1))))  # noqa: NPY002
    assert drawn[0] == drawn[1]


@pytest.mark.parametrize("task", ["forward", "waypoint"])
def test_ppo_learns_from_one_robot_of_long_actions(task: Any) -> None:
    """It takes no batch of one action."""
    config = LearningConfig(environments=1, interval=1000, steps=1, task=task)
    assert np.isfinite(train(None, config).score)
