"""When faults begin, what each episode and robot draws, and what info says of it."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fault_fakes import Echo, play, swim
from gymnasium.vector import SyncVectorEnv

from aquafish_gym import FaultWrapper, VectorFaultWrapper
from aquafish_gym.damage import TIERS, Chance, Tier
from aquafish_gym.envs.autoreset import AutoresetMode
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.vector import AquaFishVectorEnv


@pytest.mark.parametrize(
    ("name", "steps"), [("Swimmer-v5", 25), ("Pendulum-v1", 20), ("MountainCarContinuous-v0", 30)]
)
def test_times_are_in_seconds_of_the_environment(name: str, steps: int) -> None:
    damage = "action_0:dead@1"
    _, infos = play(FaultWrapper(gym.make(name), damage), 31)
    assert [info["faults"] for info in infos].index(1) == steps
    for mode in ("sync", "async"):
        envs = VectorFaultWrapper(gym.make_vec(name, 2, vectorization_mode=mode), damage)
        envs.reset(seed=0)
        still = np.zeros(envs.action_space.shape, np.float32)
        counts = [envs.step(still)[-1]["faults"].tolist() for _ in range(31)]
        envs.close()
        assert counts.index([1, 1]) == steps - 1


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


def test_the_seed_determines_what_a_batch_draws() -> None:
    """Whether it is of all robots or of each; and the noise is none of the robots' own numbers."""

    def noisy(seed: Any) -> bytes:
        envs = VectorFaultWrapper(
            SyncVectorEnv([Echo] * 3), "random:mild@1-6; observation_3:noise=0.1", dt=1
        )
        found = [envs.reset(seed=seed)[0]]
        found += [envs.step(np.zeros((3, 2), np.float32))[0] for _ in range(20)]
        return np.array(found).tobytes()

    assert noisy(0) == noisy([0, 1, 2]) != noisy(1)
    assert noisy(None) != noisy(None)
    envs = VectorFaultWrapper(SyncVectorEnv([Echo]), "observation_0:noise=1")
    seen, _ = envs.reset(seed=5)
    assert seen[0, 0] != np.float32(np.random.default_rng(5).normal())


def test_tier_of_ones_own_breaks_the_channels_that_it_names(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tier = Tier(2, (Chance("weak", 0.5, 0.1, 0.2, ("action_1",)), Chance("length", 0.5, 0.5, 1.0)))
    monkeypatch.setitem(TIERS, "tired", tier)
    _, info = FaultWrapper(Echo(), "random:tired").reset(seed=0)
    assert info["faults"] == 1  # the other way to break is the fish's
    assert info["action_gain"][0] == 1.0
    assert 0.1 <= info["action_gain"][1] <= 0.2


def test_a_tier_of_ones_own_may_be_late(monkeypatch: pytest.MonkeyPatch) -> None:
    tier = Tier(1, (Chance("delay", 1.0, 0.2, 1.0, ("gyro_x", "caudal", "observation_3")),))
    monkeypatch.setitem(TIERS, "late", tier)
    env = AquaFishEnv(damage="random:late@1-5", engine="numba")
    found = set()
    for seed in range(8):
        _, infos = play(env, 40, seed)
        late = np.concatenate([infos[-1]["sensor_delay"], infos[-1]["servo_delay"]])
        assert np.count_nonzero(late) == 1
        found.add(round(float(late.max()), 3))
    assert len(found) > 4
    wrapped = FaultWrapper(gym.make("Pendulum-v1"), "observation_0-1:delay=0.1@0.5-1")
    assert swim(wrapped, 40) == swim(wrapped, 40)


def test_a_chance_of_being_late_is_in_every_info(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of episodes in which none is drawn, and where another begins in the same step."""
    tier = Tier(1, (Chance("delay", 0.3, 1.0, 2.0, ("gyro_x",)), Chance("missing", 0.7)))
    monkeypatch.setitem(TIERS, "seldom", tier)
    envs = AquaFishVectorEnv(
        2, damage="random:seldom", frame_skip=100, autoreset_mode=AutoresetMode.SAME_STEP
    )
    _, info = envs.reset(seed=0)
    found = []
    for _ in range(100):
        found.append(info["sensor_delay"][:, 6] > 0.0)
        *_, info = envs.step(np.zeros((2, 3), np.float32))
    assert 0.05 < np.mean(found) < 0.6


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
