"""Damage of vector environments: that of single ones, in any autoreset mode, by the seed."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fault_fakes import Echo
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

from aquafish_gym import FaultWrapper, VectorFaultWrapper
from aquafish_gym.envs.vector import AquaFishVectorEnv

MODES = list(AutoresetMode)
NOISELESS = "action_0:weak=0.5@2+3; observation_0:stuck@1; observation_2:bias=1@4+2"


def batch(damages: list[str], mode: AutoresetMode, inside: bool) -> VectorEnv[Any, Any, Any]:
    def one(i: int) -> gym.Env[Any, Any]:
        env = Echo(length=5 + i)
        return FaultWrapper(env, damages[i], dt=1) if inside else env

    envs = SyncVectorEnv([lambda i=i: one(i) for i in range(3)], autoreset_mode=mode)
    return envs if inside else VectorFaultWrapper(envs, damages, dt=1)


def equal(one: Any, two: Any) -> None:
    if isinstance(one, dict):
        assert one.keys() == two.keys()
        for name in one:
            mask = one.get(f"_{name}", slice(None))
            if isinstance(one[name], dict):
                equal(one[name], two[name])
            else:
                equal(list(one[name][mask]), list(two[name][mask]))
    elif isinstance(one, tuple):
        for a, b in zip(one, two, strict=True):
            equal(a, b)
    else:
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("mode", MODES)
def test_batch_equals_single_environments(mode: AutoresetMode) -> None:
    damages = [NOISELESS, "none", "action:seized@3; observation:dropped@4; observation_1:stuck@2+1"]
    one, two = (batch(damages, mode, inside) for inside in (True, False))
    equal(one.reset(seed=0), two.reset(seed=0))
    rng, over = np.random.default_rng(0), np.zeros(3, np.bool_)
    ends = 0
    for _ in range(30):
        if mode is AutoresetMode.DISABLED and over.any():
            equal(*(envs.reset(options={"reset_mask": over.copy()}) for envs in (one, two)))
        actions = rng.uniform(-1, 1, (3, 2)).astype(np.float32)
        a, b = one.step(actions), two.step(actions)
        equal(a, b)
        over = a[2] | a[3]
        ends += over.sum()
        assert ("final_obs" in b[-1]) == (mode is AutoresetMode.SAME_STEP and over.any())
    assert ends > 9


@pytest.mark.parametrize("mode", MODES)
def test_batch_of_fish_has_the_same_faults_to_the_bit(mode: AutoresetMode) -> None:
    built_in = ["up_x:stuck@2+3; gyro_z:bias=0.5@1+9", "left_pectoral:reversed@4"]
    channels = ["observation_0:stuck@2+3; observation_8:bias=0.5@1+9", "action_0:reversed@4"]
    kwargs: dict[str, Any] = {"frame_skip": 100, "autoreset_mode": mode, "dtype": "float64"}
    one = AquaFishVectorEnv(2, damage=built_in, **kwargs)
    two = VectorFaultWrapper(AquaFishVectorEnv(2, **kwargs), channels)
    equal(one.reset(seed=0)[0], two.reset(seed=0)[0])
    rng = np.random.default_rng(0)
    for step in range(45):
        if mode is AutoresetMode.DISABLED and step in (20, 40):
            equal(one.reset()[0], two.reset()[0])
        actions = rng.uniform(-1, 1, (2, 3)).astype(np.float32)
        a, b = one.step(actions), two.step(actions)
        equal(a[:4], b[:4])
        equal(a[-1]["faults"], b[-1]["faults"])
        if "final_obs" in a[-1]:
            equal(list(a[-1]["final_obs"]), list(b[-1]["final_obs"]))
            equal(a[-1]["final_info"]["faults"], b[-1]["final_info"]["faults"])


def noisy(mode: AutoresetMode, seed: Any) -> bytes:
    envs = VectorFaultWrapper(
        SyncVectorEnv([Echo] * 3, autoreset_mode=mode),
        "random:mild@1-6; observation_3:noise=0.1", dt=1,
    )  # fmt: skip
    found = [envs.reset(seed=seed)[0]]
    for step in range(20):
        if mode is AutoresetMode.DISABLED and step in (8, 16):
            envs.reset()
        found.append(envs.step(np.zeros((3, 2), np.float32))[0])
    return np.array(found).tobytes()


@pytest.mark.parametrize("mode", MODES)
def test_same_seed_is_same_bytes(mode: AutoresetMode) -> None:
    assert noisy(mode, 0) == noisy(mode, 0) != noisy(mode, 1)
    assert noisy(mode, [0, 1, 2]) == noisy(mode, [0, 1, 2])
    assert noisy(mode, None) != noisy(mode, None)


def test_noise_is_no_copy_of_what_the_environment_draws() -> None:
    """The first environment has the same seed as the wrapper."""
    envs = VectorFaultWrapper(SyncVectorEnv([Echo]), "observation_0:noise=1")
    seen, _ = envs.reset(seed=5)
    assert seen[0, 0] != np.float32(np.random.default_rng(5).normal())


def test_nothing_that_is_returned_is_kept() -> None:
    envs = VectorFaultWrapper(SyncVectorEnv([Echo] * 2), "observation:stuck; action:seized")
    seen, info = envs.reset(seed=0)
    for array in (seen, *(value for value in info.values())):
        array[...] = 7
    seen, *_, info = envs.step(np.ones((2, 2), np.float32))
    assert (seen[:, :3] == 0.0).all()
    assert info["faults"].tolist() == [2, 2]
