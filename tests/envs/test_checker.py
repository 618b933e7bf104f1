"""Every id on every engine keeps Gymnasium's contract in each of a thousand steps."""

from __future__ import annotations

import hashlib
import math
import subprocess
import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from aquafish_gym import IDS, FaultWrapper
from aquafish_gym.engines.worlds import WORLDS

STEPS = 1000
COUNT = 3
SAID_OF_A_STEP = {"diverged", "x_velocity", "faults", "fin_angles", "servo_gain"}
EVERY = [(name, engine) for name in IDS for engine in WORLDS]
# What the ids differ in knows no engine, so that the slower engines swim all of them now and then.
SWUM = [
    (name, engine)
    if engine == "numba" or name == "AquaFish-v0"
    else pytest.param(name, engine, marks=pytest.mark.slow)
    for name, engine in EVERY
]


def make(name: str, engine: str = "numba", **kwargs: Any) -> gym.Env[Any, Any]:
    return gym.make(name, engine=engine, disable_env_checker=True, **kwargs).unwrapped


def check_numbers(info: dict[str, Any]) -> None:
    """That an info is plain numbers and arrays by name, and not a word of text."""
    assert info.keys() >= SAID_OF_A_STEP
    for name, value in info.items():
        assert type(value) in (bool, int, float) or (type(value) is np.ndarray and value.ndim), name
        assert np.asarray(value).dtype.kind in "bif", name
        assert np.isfinite(value).all(), name


def as_bytes(found: Any) -> bytes:
    *numbers, info = found
    return b"".join(np.asarray(value).tobytes() for value in (*numbers, *info.values()))


def check_strictly(env: gym.Env[Any, Any], steps: int) -> str:
    """Swim with random actions, and return a hash of all that was said."""
    said = hashlib.sha256()
    space = env.observation_space
    env.action_space.seed(7)
    check_numbers(env.reset(seed=3)[1])
    over, names = False, set[str]()
    for _ in range(steps):
        if over:
            said.update(as_bytes(env.reset()))
        action = env.action_space.sample()
        given = action.copy()
        found = env.step(action)
        seen, reward, terminated, truncated, info = found
        assert (action == given).all()
        assert seen.dtype == np.float32
        assert np.isfinite(seen).all()
        assert space.contains(seen)
        assert type(reward) is float
        assert math.isfinite(reward)
        assert reward == sum(info[term] for term in info if term.startswith("reward_"))
        assert type(terminated) is bool
        assert type(truncated) is bool
        assert not terminated
        check_numbers(info)
        names = names or set(info)
        assert names == set(info)
        said.update(as_bytes(found))
        over = truncated
    return said.hexdigest()


def check_batch(name: str, steps: int) -> str:
    """Do the same with a batch, whose robots begin anew by themselves."""
    said = hashlib.sha256()
    envs = gym.make_vec(name, num_envs=COUNT)
    envs.action_space.seed(7)
    envs.reset(seed=3)
    for _ in range(steps):
        found = envs.step(envs.action_space.sample())
        seen, reward, terminated, truncated, info = found
        assert envs.observation_space.contains(seen)
        assert np.isfinite(seen).all()
        assert (reward.dtype, reward.shape) == (np.float64, (COUNT,))
        assert terminated.dtype == truncated.dtype == np.bool_
        assert not terminated.any()
        terms = [info[term] for term in info if term.startswith("reward_")]
        np.testing.assert_array_equal(reward, sum(terms))
        assert {f"_{k}" for k in info if not k.startswith("_")} == {k for k in info if k[0] == "_"}
        check_numbers(info)
        said.update(as_bytes(found))
    return said.hexdigest()


@pytest.mark.parametrize(("name", "engine"), EVERY)
def test_gymnasium_and_stable_baselines_find_nothing_to_say(name: str, engine: str) -> None:
    """Warnings are errors here."""
    stable_baselines = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gym.make(name, engine=engine).unwrapped
    check_env(env, skip_render_check=True)
    stable_baselines.check_env(env)
    env.close()


@pytest.mark.parametrize(("name", "engine"), SWUM)
def test_a_thousand_steps_keep_the_contract(name: str, engine: str) -> None:
    damage = "random:severe@0-10+3"
    one = make(name, engine, fin_angles="random", observe_fins=True, damage=damage)
    check_strictly(one, STEPS)
    one.close()
    broken = FaultWrapper(make(name, engine), "action_0:weak=0.5; observation_6:noise=0.1@1")
    check_strictly(broken, 20)
    broken.close()


@pytest.mark.parametrize("name", IDS)
def test_each_step_of_a_batch_keeps_the_contract(name: str) -> None:
    """In several episodes, of 100 steps or of 300."""
    check_batch(name, 400)


def digests() -> list[str]:
    """Return what each id says, of one robot on each engine of ours, and of a batch."""
    alone = [check_strictly(make(name), 60) for name in IDS]
    return alone + [check_batch(name, 60) for name in IDS]


@pytest.mark.slow
def test_the_same_seed_is_the_same_bytes_in_another_process() -> None:
    code = f"import sys; sys.path[:0] = {sys.path!r}; import test_checker as t; print(t.digests())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(digests())


def starts(name: str, seed: int, episodes: int = 3) -> list[bytes]:
    """Return, of each robot in each episode, what it is like some seconds after its start."""
    envs = gym.make_vec(
        name, num_envs=4, fin_angles="random", autoreset_mode="Disabled", dtype="float64"
    )
    found = []
    for episode in range(episodes):
        seen, _ = envs.reset(seed=seed if episode == 0 else None)
        for _ in range(5):
            seen, *_ = envs.step(np.full(envs.action_space.shape, 0.5, np.float32))
        found += [row.tobytes() for row in seen]
    return found


@pytest.mark.parametrize("name", IDS)
def test_starts_vary_and_repeat(name: str) -> None:
    one = starts(name, 0)
    assert one == starts(name, 0)
    assert len({*one, *starts(name, 4)}) == 24  # robots 0 to 3 of seed 4 are no robots of seed 0


def test_onsets_vary_and_repeat() -> None:
    def onsets(seed: int) -> list[list[int]]:
        envs = gym.make_vec("AquaFishRecovery-v0", num_envs=8, autoreset_mode="SameStep")
        info = envs.reset(seed=seed)[1]
        assert not info["faults"].any()
        broken = [
            envs.step(np.zeros((8, 3), np.float32))[-1]["faults"].astype(int) for _ in range(600)
        ]
        episodes = np.array(broken).reshape(2, 300, 8)
        # The last step of an episode already tells of the next one, in which all is whole.
        assert (episodes[:, -1] == 0).all()
        first = episodes.argmax(axis=1)
        assert (episodes.max(axis=1) == 1).all()
        assert ((first >= 74) & (first < 150)).all()
        found: list[list[int]] = first.tolist()
        return found

    one = onsets(0)
    assert one == onsets(0)
    assert one != onsets(1)
    assert len({onset for episode in one for onset in episode}) > 8
    assert all(a != b for a, b in zip(*one, strict=True))
