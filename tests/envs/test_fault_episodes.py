"""When faults begin, what is drawn for each episode, and what info tells of it."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from fault_fakes import Echo, play
from gymnasium.vector import SyncVectorEnv

from aquafish_gym import FaultWrapper, VectorFaultWrapper
from aquafish_gym.damage import TIERS, Chance, Tier
from aquafish_gym.envs.env import AquaFishEnv


def test_times_are_in_seconds_of_the_environment() -> None:
    for name, steps in (("Swimmer-v5", 25), ("Pendulum-v1", 20), ("MountainCarContinuous-v0", 30)):
        damage = "action_0:dead@1"
        _, infos = play(FaultWrapper(gym.make(name), damage), 31)
        assert [info["faults"] for info in infos].index(1) == steps
        envs = VectorFaultWrapper(gym.make_vec(name, 2, vectorization_mode="sync"), damage)
        envs.reset(seed=0)
        still = np.zeros(envs.action_space.shape, np.float32)
        counts = [envs.step(still)[-1]["faults"].tolist() for _ in range(31)]
        assert counts.index([1, 1]) == steps - 1


def test_a_step_is_as_long_in_every_vectorization_mode() -> None:
    """Pendulum's dt is 0.05 s, and its films have 30 frames a second."""
    for mode in ("sync", "async"):
        envs = gym.make_vec("Pendulum-v1", num_envs=2, vectorization_mode=mode)
        envs = VectorFaultWrapper(envs, "action_0:dead@0.1")
        envs.reset(seed=0)
        active = [envs.step(np.zeros((2, 1), np.float32))[-1]["faults"].tolist() for _ in range(3)]
        envs.close()
        assert active == [[0, 0], [1, 1], [1, 1]]


def test_onsets_and_tiers_are_drawn_in_each_episode() -> None:
    env = FaultWrapper(Echo(length=20), "random:severe@2-9", dt=1)
    env.reset(seed=0)
    found = set()
    for _ in range(30):
        env.reset()
        infos = [env.step(np.zeros(2, np.float32))[-1] for _ in range(12)]
        counts = [info["faults"] for info in infos]
        assert set(counts) == {0, 2}
        last = infos[-1]
        found.add((counts.index(2), *last["action_gain"], *last["observation_lost"]))
    assert len(found) > 15


def test_tier_of_ones_own_breaks_the_channels_that_it_names(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tier = Tier(2, (Chance("weak", 0.5, 0.1, 0.2, ("action_1",)), Chance("length", 0.5, 0.5, 1.0)))
    monkeypatch.setitem(TIERS, "tired", tier)
    _, info = FaultWrapper(Echo(), "random:tired").reset(seed=0)
    assert info["faults"] == 1  # the other way to break is the fish's
    assert info["action_gain"][0] == 1.0
    assert 0.1 <= info["action_gain"][1] <= 0.2


def test_damage_of_one_episode_comes_with_reset() -> None:
    env = FaultWrapper(Echo(), "action:dead", dt=1)
    _, info = env.reset(options={"damage": "observation:stuck", "own": 1})
    assert env.unwrapped.options == {"own": 1}
    assert (info["faults"], info["action_gain"].tolist()) == (1, [1, 1])
    assert env.reset()[1]["action_gain"].tolist() == [0, 0]
    envs = VectorFaultWrapper(SyncVectorEnv([Echo] * 2), "action:dead")
    _, info = envs.reset(options={"damage": ["none", "action:weak=0.5"]})
    assert info["action_gain"].tolist() == [[1, 1], [0.5, 0.5]]
    envs.step(np.zeros((2, 2)))
    mask = np.array([True, False])
    _, info = envs.reset(options={"reset_mask": mask})
    assert info["action_gain"][0].tolist() == [0, 0]
    assert info["_action_gain"].tolist() == [True, False]


def test_info_counts_the_environments_own_faults() -> None:
    env = FaultWrapper(AquaFishEnv(damage="caudal:missing", engine="numba"), "action:dead@1")
    _, infos = play(env, 5)
    assert [info["faults"] for info in infos] == [1] * 5 + [2]
    assert infos[-1]["servo_gain"].tolist() == [1, 1, 1]
