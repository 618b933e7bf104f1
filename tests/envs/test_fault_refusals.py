"""Damage, environments and lists of damage that do not fit each other are refused."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fault_fakes import Echo
from gymnasium.spaces import Discrete
from gymnasium.vector import SyncVectorEnv

from aquafish_gym import FaultWrapper, VectorFaultWrapper
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.fish.target import EngineTarget


def refused(words: str) -> Any:
    return pytest.raises(InvalidArgumentError, match=words)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ("motor:dead", "damage part must be one of .*action, observation; got 'motor'"),
        ("caudal:dead", "must be one of action, action_0 to action_1, observation, .*'caudal'"),
        ("actoin_0:dead", "^damage part must be action, .*; got 'actoin_0'"),
        ("observation_3-:dead", "^damage part must be observation, "),
        ("action_2:dead", "action_0 to action_1.*; got 'action_2'"),
        ("observation_3-9:stuck", "got 'observation_3-9'"),
        ("observation_3-1:stuck", "got 'observation_3-1'; did you mean 'observation_1-3'"),
        ("action_0:dead+3", "did you mean 'action_0:dead@0[+]3'"),
        ("action_0:stuck", "damage must be one of weak, .*; got 'stuck'"),
        ("action_0:weak", "needs a number"),
        ("action:seized=11", r"action:seized\[0\] must lie in \[-10, 10\]; got 11"),
        ("observation:noise=-1", "must lie in"),
        ("action:delay=0", "action:delay must lie in"),
        ("action_0:dead@1", "does not say how long a step is: give dt in s, or dt=1"),
        ("random:mild@1-2", "does not say how long a step is"),
        ("observation:hold=3", "does not say how long a step is"),
        (["action:dead", "none"], "damage must be one text.*'action_0:dead'.*: join texts .* by ;"),
    ],
)
def test_damage_that_does_not_fit_is_refused(damage: Any, words: str) -> None:
    with refused(words):
        FaultWrapper(Echo(), damage)
    env = FaultWrapper(Echo())
    with refused(words):
        env.reset(options={"damage": damage})


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ("observation_0:delay=0.5", "delay must be at least a step, 1 s; got 0.5 s"),
        ("action:hold=1", "hold must be longer than a step, 1 s; got 1 s"),
        ("action:delay=1e5", "delay must be at most 10000 steps of 1 s"),
    ],
)
def test_times_that_fit_no_step_are_refused(damage: str, words: str) -> None:
    with refused(words):
        FaultWrapper(Echo(), damage, dt=1)


def test_times_that_fit_no_step_of_the_fish_are_refused() -> None:
    for make in (AquaFishEnv, AquaFishVectorEnv):
        with refused(r"at least a step, 0.2 s; got 0.1 s"):
            make(damage="gyro_x:delay=0.1@1")
        env: Any = make()
        with refused(r"longer than a step, 0.2 s; got 0.2 s"):
            env.reset(options={"damage": "caudal:hold=0.2@1-3"})
    with refused(r"RealityGap\(lag"):
        EngineTarget(None, "caudal:delay=0.2", engine="numba")


def of_a_dictionary() -> Any:
    env = Echo()
    env.observation_space = gym.spaces.Dict(a=Discrete(2))  # type: ignore[assignment]
    return FaultWrapper(env)


def of_no_mode() -> Any:
    envs = SyncVectorEnv([Echo] * 2)
    envs.metadata = {}
    return VectorFaultWrapper(envs)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: FaultWrapper(gym.make("CartPole-v1")), "the action space must be a Box of num"),
        (of_a_dictionary, "the observation space must be a Box"),
        (of_no_mode, "autoreset_mode"),
        (
            lambda: FaultWrapper(gym.wrappers.TimeLimit(FaultWrapper(Echo(), "action:dead"), 5)),
            "join the faults",
        ),
        (
            lambda: VectorFaultWrapper(VectorFaultWrapper(SyncVectorEnv([Echo]))),
            "join the faults",
        ),
        (
            lambda: VectorFaultWrapper(SyncVectorEnv([lambda: FaultWrapper(Echo())])).reset(),
            "join the faults",
        ),
        (
            lambda: FaultWrapper(gym.make("Swimmer-v5"), "action:dead@40"),
            "before the episode ends at 40 s",
        ),
        (lambda: FaultWrapper(Echo(), neutral=11.0), "neutral"),
        (lambda: FaultWrapper(Echo(), neutral=[0.0]), "neutral"),
        (
            lambda: VectorFaultWrapper(SyncVectorEnv([Echo] * 2), ["action:dead"] * 3),
            "damage must be one for all robots",
        ),
        (lambda: AquaFishEnv(damage="action_0:dead"), "give it to FaultWrapper"),
    ],
)
def test_what_cannot_be_wrapped_is_refused(make: Any, words: str) -> None:
    with refused(words):
        make()


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_a_list_of_faults_is_no_damage_of_a_wrapped_robot(make: Any) -> None:
    more = {} if make is gym.make else {"vectorization_mode": "sync"}
    with refused("faults of one robot"):
        make("AquaFish-v0", engine="numba", damage=["caudal:missing", "none"], **more)


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_options_of_the_fish_that_contradict_each_other_are_refused(make: Any) -> None:
    for damage in ("caudal:missing@20", "random:mild@15-30"):
        with refused("before the episode ends at 20 s; got"):
            make("AquaFish-v0", damage=damage)
        make("AquaFishRecovery-v0", damage=damage)
    for name, task in (("Station", "HoldStation"), ("Return", "ReturnToBuoys")):
        with refused(f"^current must be 0 .*{task}"):
            make(f"AquaFish{name}-v0", current=(0.1, 0.0, 0.0))


def test_actions_of_another_shape_change_nothing() -> None:
    env = FaultWrapper(Echo(), "action_0:delay=2", dt=1)
    env.reset()
    with refused(r"action must"):
        env.step(np.zeros(3))
    assert env.unwrapped.steps == 0  # type: ignore[attr-defined]
