"""Damage, environments and actions that do not fit are refused, with what would."""

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
from aquafish_gym.utils.validation import InvalidArgumentError


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("motor:dead", "damage part must be one of .*action, observation; got 'motor'"),
        (
            "caudal:dead",
            "must be one of action, action_0 to action_1, observation, .* got 'caudal'",
        ),
        ("action_2:dead", "action_0 to action_1.*; got 'action_2'"),
        ("observation_3-9:stuck", "got 'observation_3-9'"),
        ("observation_3-1:stuck", "got 'observation_3-1'; did you mean 'observation_1-3'"),
        ("action_0:dead+3", "got 'action_0:dead[+]3'; did you mean 'action_0:dead@0[+]3'"),
        ("action_0:weak=0.5+3", "did you mean 'action_0:weak=0.5@0[+]3'"),
        ("action_0:stuck", "damage must be one of weak, reversed, seized, dead, .*; got 'stuck'"),
        ("action_0:weak=nan", "must be finite"),
        ("action_0:weak", "needs a number"),
        ("action:seized=11", r"damage action:seized\[0\] must lie in \[-10, 10\]; got 11"),
        ("observation:noise=-1", "must lie in"),
        ("action_0:dead@1", "does not say how long a step is: give dt in s, or dt=1"),
        ("random:mild@1-2", "does not say how long a step is"),
        (["action:dead", "none"], "damage must be one text.*'action_0:dead'.*: join texts .* by ;"),
    ],
)
def test_damage_that_does_not_fit_is_refused(damage: Any, message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        FaultWrapper(Echo(), damage)
    env = FaultWrapper(Echo())
    with pytest.raises(InvalidArgumentError, match=message):
        env.reset(options={"damage": damage})


@pytest.mark.parametrize("part", ["action0", "actoin_0", "ACTION_0", "observation_3-"])
def test_a_mistyped_channel_is_answered_with_channels(part: str) -> None:
    with pytest.raises(
        InvalidArgumentError, match=r"damage part must be (action|observation), "
    ) as it:
        FaultWrapper(Echo(), f"{part}:dead")
    assert "caudal" not in str(it.value)


def test_what_cannot_be_wrapped_is_refused() -> None:
    discrete, env = gym.make("CartPole-v1"), Echo()
    with pytest.raises(InvalidArgumentError, match="the action space must be a Box of numbers"):
        FaultWrapper(discrete)
    env.observation_space = gym.spaces.Dict(a=Discrete(2))  # type: ignore[assignment]
    with pytest.raises(InvalidArgumentError, match="the observation space must be a Box"):
        FaultWrapper(env)
    with pytest.raises(InvalidArgumentError, match="join the faults"):
        FaultWrapper(gym.wrappers.TimeLimit(FaultWrapper(Echo(), "action:dead"), 5))
    with pytest.raises(InvalidArgumentError, match="join the faults"):
        VectorFaultWrapper(VectorFaultWrapper(SyncVectorEnv([Echo])))
    with pytest.raises(InvalidArgumentError, match="join the faults"):
        VectorFaultWrapper(SyncVectorEnv([lambda: FaultWrapper(Echo())])).reset()
    with pytest.raises(InvalidArgumentError, match="before the episode ends at 40 s"):
        FaultWrapper(gym.make("Swimmer-v5"), "action:dead@40")
    for neutral in (11.0, [0.0], "no", np.nan):
        with pytest.raises(InvalidArgumentError, match="neutral"):
            FaultWrapper(Echo(), neutral=neutral)  # type: ignore[arg-type]
    for dt in (0.0, -1.0, "1"):
        with pytest.raises(InvalidArgumentError, match="dt must"):
            FaultWrapper(Echo(), dt=dt)  # type: ignore[arg-type]
    envs = SyncVectorEnv([Echo] * 2)
    with pytest.raises(InvalidArgumentError, match="damage must be one for all robots"):
        VectorFaultWrapper(envs, ["action:dead"] * 3)
    envs.metadata = {}
    with pytest.raises(InvalidArgumentError, match="autoreset_mode"):
        VectorFaultWrapper(envs)
    with pytest.raises(InvalidArgumentError, match="give it to FaultWrapper"):
        AquaFishEnv(damage="action_0:dead")


@pytest.mark.parametrize("action", [[0.0], [np.nan, 0.0], "up", None])
def test_bad_actions_are_refused(action: Any) -> None:
    env = FaultWrapper(Echo())
    env.reset()
    with pytest.raises(InvalidArgumentError, match="action must"):
        env.step(action)
