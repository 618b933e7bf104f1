"""Batches in stable-baselines3 do what its DummyVecEnv does with as many single environments."""

from __future__ import annotations

import copy
import importlib
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import vector as several

from aquafish_gym import VectorFaultWrapper
from aquafish_gym.utils.validation import InvalidArgumentError
from gait import evaluate
from tests.comparing import assert_same

pytest.importorskip("stable_baselines3")
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecVideoRecorder

ADAPTER = importlib.import_module("gait.learning.sb3_env")
SHORT = {"max_episode_steps": 6}
NOT_OVER = {"TimeLimit.truncated": False}
STILL = "left_pectoral:seized; right_pectoral:seized; caudal:seized"


def batch(count: int = 2, **options: Any) -> Any:
    return gym.make_vec("AquaFish-v0", count, autoreset_mode="Disabled", **SHORT | options)


def adapted(count: int = 2, **options: Any) -> Any:
    return ADAPTER.SB3VecEnv(batch(count, dtype="float64", **options))


def dummy(count: int = 2, **options: Any) -> Any:
    make = [lambda: gym.make("AquaFish-v0", engine="numba", **SHORT | options)] * count
    return DummyVecEnv(make)


@pytest.mark.parametrize(
    "options",
    [
        {"damage": STILL, "fin_angles": [0.1, 0.2, 0.3]},
        [{"damage": STILL}, {}, {"morphology": {"caudal": (0.0, 0.0, 0.0)}}],
        [{}, {"damage": "gyro:noise=0.3"}, {"damage": "random:severe@0-1"}],
    ],
)
def test_options_are_of_the_next_reset_alone(options: Any) -> None:
    """As of single environments; ``tests/contract`` compares the steps without options."""
    both = adapted(3), dummy(3)
    action = np.full((3, 3), 0.5, np.float32)
    for begins in range(3):
        for envs in both:
            if begins == 0:
                assert envs.seed(4) == [4, 5, 6]
            if begins < 2:
                envs.set_options(copy.deepcopy(options))
        assert_same(*(envs.reset() for envs in both))
        assert_same(*(envs.reset_infos for envs in both))
        for _ in range(8):  # beyond an episode's end
            mine, other = (envs.step(action) for envs in both)
            assert_same(mine[:3], other[:3])
            assert_same(*(envs.reset_infos for envs in both))


def test_options_that_cannot_arrive_are_refused() -> None:
    envs = adapted()
    with pytest.raises(InvalidArgumentError, match=r"options must be one .* 2 of them; got 3"):
        envs.set_options([{}, {}, {}])
    with pytest.raises(InvalidArgumentError, match="options must not have reset_mask"):
        envs.set_options({"reset_mask": np.array([True, False])})
    with pytest.raises(InvalidArgumentError, match="options must be of type dict"):
        envs.set_options(["caudal:missing", "caudal:missing"])
    envs.set_options({"damge": "caudal:missing"})
    with pytest.raises(ValueError, match="did you mean 'damage'"):
        envs.reset()


def test_information_is_plain_and_that_of_its_step_whenever_it_is_read() -> None:
    envs, kept = adapted(), []
    envs.seed(0)
    envs.reset()
    for _ in range(13):
        infos = envs.step(np.full((2, 3), 0.5, np.float32))[3]
        kept.append((infos, copy.deepcopy(infos), envs.info["x_position"]))
    assert [sorted(one[0]) == [*NOT_OVER] for one, _, _ in kept] == [
        *[*[True] * 5, False] * 2,
        True,
    ]
    for infos, then, _ in kept:
        assert [type(info) for info in infos] == [dict, dict]
        assert_same(infos, then)
    last = [then for _, then, _ in kept if "x_position" in then[0]]
    assert [one[0]["x_position"] for one in last] == [kept[i][2][0] for i in (5, 11)]


def test_an_entry_that_some_robots_lack_is_left_out() -> None:
    info = {
        "x": np.array([1.0, 2.0, 3.0]),
        "there": np.array([False, True, True]),
        "_there": np.array([False, True, False]),
        "episode": {"r": np.array([0.5, 0.0, 1.5]), "l": np.array([3, 0, 4])},
        "_episode": np.array([True, False, True]),
        "fins": np.arange(9.0).reshape(3, 3),
        "name": "all",
    }
    first, third = ADAPTER.info_of_each(info, np.array([0, 2]))
    assert first.pop("fins").tolist() == [0.0, 1.0, 2.0]
    assert third.pop("fins").tolist() == [6.0, 7.0, 8.0]
    assert first == {"x": 1.0, "episode": {"r": 0.5, "l": 3}, "name": "all"}
    assert third == {"x": 3.0, "episode": {"r": 1.5, "l": 4}, "name": "all"}
    (second,) = ADAPTER.info_of_each(info, np.array([1]))
    assert second.pop("fins").tolist() == [3.0, 4.0, 5.0]
    assert second == {"x": 2.0, "there": True, "name": "all"}


def test_what_was_given_is_stepped() -> None:
    """A wrapper's faults, rewards, actions, spaces and statistics reach the trainer."""
    faulty = ADAPTER.SB3VecEnv(
        VectorFaultWrapper(batch(fin_angles="zero"), ["none", "action: dead"])
    )
    faulty.reset()
    for _ in range(4):
        faulty.step(np.full((2, 3), 1.0, np.float32))
    assert faulty.info["faults"].tolist() == [0, 1]
    assert np.linalg.norm(np.diff(faulty.info["fin_angles"], axis=0)) > 1
    faulty.set_options([{"damage": "action: dead"}, {}])
    faulty.reset()
    assert [info["faults"] for info in faulty.reset_infos] == [1, 1]

    plain = adapted(fin_angles="zero")
    scaled = ADAPTER.SB3VecEnv(
        several.RescaleAction(
            several.TransformReward(batch(dtype="float64", fin_angles="zero"), lambda r: 10.0 * r),
            np.full(3, -2.0, np.float32),
            np.full(3, 2.0, np.float32),
        )
    )
    assert scaled.action_space.high.tolist() == [2.0] * 3
    for envs in (plain, scaled):
        envs.reset()
    actions = np.full((2, 3), 0.5, np.float32)
    np.testing.assert_allclose(10 * plain.step(actions)[1], scaled.step(2 * actions)[1], rtol=1e-6)

    counted = ADAPTER.SB3VecEnv(several.RecordEpisodeStatistics(batch()))
    watched = VecMonitor(adapted())
    for envs in (counted, watched):
        envs.seed(1)
        envs.reset()
    for step in range(12):
        ours, theirs = (envs.step(actions)[3] for envs in (counted, watched))
        for mine, other in zip(ours, theirs, strict=True):
            assert ("episode" in mine) == ("episode" in other) == (step % 6 == 5)
            if "episode" in mine:
                assert mine["episode"]["l"] == other["episode"]["l"] == 6
                assert abs(mine["episode"]["r"] - other["episode"]["r"]) < 1e-4

    listed = ADAPTER.SB3VecEnv(several.DictInfoToList(batch()))
    listed.reset()
    infos = [listed.step(actions)[3][1] for _ in range(6)]
    assert ["x_position" in info for info in infos] == [*[False] * 5, True]
    assert "x_position" in listed.info[1]
    assert VecMonitor(listed).info is listed.info
    assert listed.reset_infos[0]["faults"] == 0


def test_gymnasiums_own_batch_is_stepped_too() -> None:
    envs = gym.make_vec(
        "Pendulum-v1", 2, "sync", {"autoreset_mode": gym.vector.AutoresetMode.DISABLED},
        max_episode_steps=3,
    )  # fmt: skip
    both: Any = (
        ADAPTER.SB3VecEnv(envs),
        DummyVecEnv([lambda: gym.make("Pendulum-v1", max_episode_steps=3)] * 2),
    )
    for one in both:
        one.seed(0)
        one.set_options([{"x_init": 0.1}, {"y_init": 0.2}])
    np.testing.assert_array_equal(*(one.reset() for one in both))
    for _ in range(7):
        mine, other = (one.step(np.ones((2, 1), np.float32)) for one in both)
        for a, b in zip(mine[:3], other[:3], strict=True):
            np.testing.assert_array_equal(a, b)
        over = bool(mine[2][0])
        assert mine[3][0].keys() == (other[3][0].keys() if over else NOT_OVER.keys())
    for one in both:
        one.set_attr("dt", 0.01, indices=[1])
        assert one.get_attr("dt") == [0.05, 0.01]
        assert one.get_attr("dt", indices=1) == [0.01]
        assert one.env_is_wrapped(gym.wrappers.TimeLimit) == [True, True]
        assert one.env_method("has_wrapper_attr", "dt") == [True, True]
    with pytest.raises(NotImplementedError, match="indices must be None"):
        both[0].env_method("has_wrapper_attr", "dt", indices=[0])
    both[0].close()
    assert envs.closed


def test_attributes_are_the_robots_own_or_refused() -> None:
    envs = ADAPTER.SB3VecEnv(several.TransformReward(batch(observe_fins=True), np.negative))
    assert envs.get_attr("observation_space") == [envs.observation_space] * 2
    assert envs.get_attr("dt", indices=[1]) == [0.2]
    if hasattr(envs, "has_attr"):  # since 2.6
        assert not envs.has_attr("velocity_of_light")
    with pytest.raises(AttributeError):
        envs.env_method("fly")
    assert envs.env_is_wrapped(several.TransformReward) == [True, True]
    assert envs.env_is_wrapped(VectorFaultWrapper, indices=0) == [False]


def test_frames_and_a_video(tmp_path: Path) -> None:
    envs = adapted(render_mode="rgb_array")
    assert envs.render_mode == "rgb_array"
    assert envs.metadata["render_fps"] == 5
    envs.seed(0)
    envs.reset()
    assert [frame.shape for frame in envs.get_images()] == [(480, 640, 3)] * 2
    assert np.ptp(envs.render()) > 0
    blind = adapted()
    with pytest.warns(UserWarning, match="render_mode of envs must be"):
        assert blind.get_images() == [None, None]
    pytest.importorskip("moviepy")
    video = VecVideoRecorder(envs, str(tmp_path), lambda step: step == 0, 3)
    video.reset()
    for _ in range(4):
        video.step(np.zeros((2, 3), np.float32))
    video.close()
    (film,) = tmp_path.glob("*.mp4")
    assert film.stat().st_size > 1000


def test_a_policy_with_a_memory_learns_and_is_scored() -> None:
    contrib = pytest.importorskip("sb3_contrib")
    model = contrib.RecurrentPPO(
        "MlpLstmPolicy", adapted(), n_steps=8, batch_size=8, n_epochs=1, device="cpu", seed=0
    )
    model.learn(16)
    found = evaluate(model, episodes=2, seed=0, **SHORT)
    envs = batch()
    seen, _ = envs.reset(seed=0)
    state, returns = None, np.zeros(2)
    for step in range(SHORT["max_episode_steps"]):
        action, state = model.predict(seen, state, np.full(2, step == 0), deterministic=True)
        seen, reward, *_ = envs.step(action)
        returns += reward
    np.testing.assert_allclose(found.returns, returns, rtol=1e-5, atol=1e-6)
