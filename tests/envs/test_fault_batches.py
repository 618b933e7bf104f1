"""Damage of vector environments: that of single ones, in any autoreset mode, by the seed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fault_fakes import Echo
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from aquafish_gym import VectorFaultWrapper

MODES = list(AutoresetMode)


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
