"""A task that can be achieved: it terminates, says so in ``info``, and pays for it once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from aquafish.online.gaits import load_library
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.tasks import ReturnToBuoys
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.agents import ControllerAgent

# So near, and in so little current, that the tail alone reaches the line within seconds.
NEAR = ReturnToBuoys(seconds=6.0, pace=0.003, slowest=0.0, fastest=0.001)
TAIL = np.array([0.0, 0.0, 1.0], np.float32)
STILL = np.array([0.0, 0.0, -1.0], np.float32)


@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_an_episode_ends_with_success_and_says_so(engine: str) -> None:
    env = AquaFishEnv(task=NEAR, engine=engine)
    _, info = env.reset(seed=0)
    assert info["is_success"] is False
    terminated = False
    count = 0
    while not terminated:
        assert info["is_success"] is False
        _, reward, terminated, truncated, info = env.step(TAIL)
        assert not truncated
        count += 1
    assert 1 < count < 30
    assert info["is_success"] is True
    assert info["diverged"] is False
    assert info["reward_reached"] == 10.0 < reward
    with pytest.raises(ResetNeeded):
        env.step(TAIL)
    env.close()


def test_time_runs_out_without_success() -> None:
    env = AquaFishEnv(task=NEAR, engine="numba")
    env.reset(seed=0)
    for _ in range(30):
        _, _, terminated, truncated, info = env.step(STILL)
    assert (terminated, truncated, info["is_success"]) == (False, True, False)


def test_other_tasks_say_nothing_of_success() -> None:
    env = AquaFishEnv(engine="numba")
    assert "is_success" not in env.reset(seed=0)[1]
    assert "is_success" not in env.step(TAIL)[-1]
    assert "is_success" not in AquaFishVectorEnv(2).reset(seed=0)[1]


def test_a_whole_robot_has_thirty_percent_of_the_time_to_spare() -> None:
    envs: Any = gym.make_vec("AquaFishReturn-v0", num_envs=100, damage="none", threads=1)
    seen, info = envs.reset(seed=60_000)
    agent = ControllerAgent(load_library()[0])
    agent.reset(info)
    arrived = np.full(100, np.nan)
    for step in range(1, 301):
        seen, _, terminated, _, info = envs.step(np.asarray(agent.act(seen), np.float32))
        np.testing.assert_array_equal(terminated, info["is_success"])
        arrived[terminated & np.isnan(arrived)] = step / 300
    assert np.isfinite(arrived).all()
    assert np.median(arrived) == pytest.approx(0.7, abs=0.02)
    assert arrived.max() < 0.8


def test_the_current_of_every_episode_is_against_the_robot() -> None:
    task = ReturnToBuoys()
    drawn = np.array([task.begin(np.random.default_rng(seed)) for seed in range(200)])
    speeds = np.hypot(drawn[:, 0], drawn[:, 1])
    assert (speeds.min() > 0.05, speeds.max() < 0.2) == (True, True)
    assert drawn[:, 1].max() < -0.025  # within 60 degrees of -y
    np.testing.assert_allclose(drawn[:, 2], 1.0 + 42.0 * (0.7 + drawn[:, 1]))
    env = AquaFishEnv(task="return", engine="numba")
    env.reset(seed=0)
    for _ in range(300):
        *_, info = env.step(STILL)
    assert info["y_position"] < -0.5


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"pace": 0.2}, r"pace must be more than fastest, 0.2 units/s; got 0.2"),
        ({"slowest": 0.3}, r"fastest must lie in \[0.3, 20\]"),
    ],
)
def test_a_line_that_nobody_reaches_is_refused(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        ReturnToBuoys(**wrong)
    with pytest.raises(InvalidArgumentError, match="current must be 0"):
        AquaFishEnv(task=replace(NEAR), current=(0.1, 0.0, 0.0))


def test_stable_baselines_counts_successes() -> None:
    pytest.importorskip("stable_baselines3")
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env

    envs = make_vec_env("AquaFishReturn-v0", 2, env_kwargs={
        "task": NEAR, "damage": "none", "engine": "numba"
    })  # fmt: skip
    model = PPO("MlpPolicy", envs, n_steps=160, batch_size=64, n_epochs=1, device="cpu", seed=0)
    model.learn(640)
    assert model.ep_success_buffer is not None
    assert len(model.ep_success_buffer) > 10
    assert {bool(one) for one in model.ep_success_buffer} == {True, False}
