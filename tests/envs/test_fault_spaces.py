"""A broken environment is an environment: its spaces hold, and it can be specified and copied."""

from __future__ import annotations

import copy
import math
import pickle
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fault_fakes import Echo, play, swim
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

from aquafish_gym import FaultWrapper, VectorFaultWrapper
from aquafish_gym.damage import Damage
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.utils.validation import InvalidArgumentError


class Camera(gym.Env[Any, Any]):
    """Observes noise, as bytes in two dimensions; acts in whole numbers."""

    observation_space = Box(5, 255, (4, 3), np.uint8)
    action_space = Box(-3, 3, (2, 2), np.int32)

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:  # noqa: ARG002
        super().reset(seed=seed)
        return self.observation_space.low.copy(), {}

    def step(self, action: Any) -> Any:
        assert self.action_space.contains(action)
        return self.np_random.integers(5, 256, (4, 3)).astype(np.uint8), 0.0, False, False, {}


EVERYTHING = (
    "observation:noise=50; observation_0:bias=1e9; observation_1:dropped; observation_2:stuck;"
    "action:weak=0.4; action_0:reversed; action_1:seized"
)


@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version")
@pytest.mark.filterwarnings("ignore:.*value is -?infinity")
@pytest.mark.parametrize("make", [Camera, lambda: Echo(-1.0, 1.0), lambda: gym.make("Swimmer-v5")])
def test_observations_and_actions_stay_in_their_spaces(make: Any) -> None:
    env = FaultWrapper(make(), EVERYTHING)
    check_env(env, skip_render_check=True)
    rng = np.random.default_rng(0)
    seen, info = env.reset(seed=0)
    for _ in range(5):
        action = rng.uniform(-3, 3, env.action_space.shape).astype(env.action_space.dtype)
        seen, *_, info = env.step(action)
        assert seen.dtype == env.observation_space.dtype
        assert env.observation_space.contains(seen)
    assert info["observation_bias"].shape == env.observation_space.shape
    if make is Camera:
        assert (seen[0, 0], seen[0, 1], seen[0, 2]) == (255, 5, seen[0, 2])


class Sized(gym.Env[Any, Any]):
    """Acts and observes in Boxes of some shape and type: what was done, times 100."""

    def __init__(self, shape: tuple[int, ...], dtype: Any, most: float) -> None:
        self.action_space = Box(-1.0, 1.0, shape, dtype)
        self.observation_space = Box(-most, most, shape, dtype)

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:  # noqa: ARG002
        super().reset(seed=seed)
        return np.zeros(self.observation_space.shape, self.observation_space.dtype), {}

    def step(self, action: Any) -> Any:
        self.acted = action
        assert self.action_space.contains(np.asarray(action))
        seen = np.asarray(100 * action, self.observation_space.dtype)
        return seen, 0.0, False, False, {}


@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version")
@pytest.mark.filterwarnings("ignore:.*value is -?infinity")
@pytest.mark.parametrize(("dtype", "most"), [(np.float16, 100.0), (np.float64, np.inf)])
@pytest.mark.parametrize("shape", [(), (0,), (2, 1), (1, 0, 2)])
def test_boxes_of_any_shape_and_precision(shape: Any, dtype: Any, most: float) -> None:
    size = math.prod(shape)
    text = "observation:bias=1e30; action:scale=1e30" if size else "none"
    env = FaultWrapper(Sized(shape, dtype, most), text)
    check_env(env, skip_render_check=True)
    env.reset(seed=0)
    seen, *_, info = env.step(np.full(shape, 0.5, dtype))
    assert type(seen) is type(env.unwrapped.acted) is np.ndarray
    assert (seen.shape, seen.dtype) == (shape, dtype)
    assert env.observation_space.contains(seen)
    assert np.isfinite(seen).all()
    assert (seen >= 100.0).all()
    assert np.shape(info["observation_bias"]) == np.shape(info["action_gain"]) == shape
    envs = VectorFaultWrapper(SyncVectorEnv([lambda: Sized(shape, dtype, most)] * 2), text)
    envs.reset(seed=0)
    batch, *_, info = envs.step(np.full((2, *shape), 0.5, dtype))
    assert (batch == seen).all()
    assert info["observation_bias"].shape == (2, *shape)
    if not size:
        for damage in ("observation:bias=1", "action:dead", "action_0:dead", "random:mild"):
            with pytest.raises(InvalidArgumentError, match=r"one of|fits no"):
                FaultWrapper(Sized(shape, dtype, most), damage)


def test_whole_channels_pass_unchanged_even_outside_of_their_space() -> None:
    env = FaultWrapper(Echo(), "action_0:dead; observation_0:dropped")
    env.reset(seed=0)
    seen, *_ = env.step(np.array([0.5, 99.0], np.float32))
    assert seen[4] == 99.0


def test_specification_and_copies_make_the_same_environment() -> None:
    damage = Damage.parse("random:moderate@0.1-0.3; observation:noise=0.1; action_1:seized=0.3@0.2")
    wrapper = FaultWrapper.wrapper_spec(damage=str(damage), neutral=[0.1, 0.2])
    env = gym.make(replace(gym.spec("Swimmer-v5"), additional_wrappers=(wrapper,)))
    same = FaultWrapper(gym.make("Swimmer-v5"), damage, neutral=np.array([0.1, 0.2]))
    assert same.spec is not None
    again = gym.make(gym.envs.registration.EnvSpec.from_json(same.spec.to_json()))
    assert swim(env, 20) == swim(same, 20) == swim(again, 20)
    fish = FaultWrapper(AquaFishEnv(engine="numba"), "observation:noise=0.1; action_0:seized@1")
    play(fish, 7)
    for other in (copy.deepcopy(fish), pickle.loads(pickle.dumps(fish))):
        fish_too = copy.deepcopy(fish)
        for _ in range(5):
            seen = [env.step(np.ones(3, np.float32))[0] for env in (fish_too, other)]
            assert (seen[0] == seen[1]).all()
