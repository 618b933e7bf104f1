"""A batch answers of its robots as Gymnasium's SyncVectorEnv of single ones does."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fault_fakes import swim
from gymnasium.vector import SyncVectorEnv

from aquafish_gym import VectorFaultWrapper
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.utils.validation import InvalidArgumentError

DAMAGE = ["none", "caudal:seized@2", "random:mild@1-3"]
KWARGS: dict[str, Any] = {"task": "waypoint", "observe_fins": True, "frame_skip": 25}
NAMES = (
    "dt", "frame_skip", "task", "render_mode", "metadata", "action_space", "observation_space",
    "np_random_seed",
)  # fmt: skip


def make(kind: str, render_mode: str | None = None) -> Any:
    kwargs = KWARGS | {"render_mode": render_mode}
    if kind == "sync":
        return SyncVectorEnv(
            [
                lambda d=d: gym.make("AquaFish-v0", engine="numba", damage=d, **kwargs)
                for d in DAMAGE
            ]
        )
    if kind == "wrapped sync":
        return VectorFaultWrapper(make("sync", render_mode), "action_0:weak=0.5")
    envs = gym.make_vec("AquaFish-v0", 3, damage=DAMAGE, dtype="float64", **kwargs)
    return VectorFaultWrapper(envs, "action_0:weak=0.5") if kind == "wrapped" else envs


KINDS = ("batch", "wrapped", "wrapped sync")


@pytest.mark.parametrize("kind", KINDS)
def test_attributes_are_those_of_the_single_environments(kind: str) -> None:
    one, two = make("sync"), make(kind)
    for envs in (one, two):
        envs.reset(seed=[5, 7, 9])
    for name in NAMES:
        assert one.get_attr(name) == two.get_attr(name) == two.call(name), name
        assert type(two.get_attr(name)) is tuple
    assert two.np_random_seed == (5, 7, 9)
    states = [
        [rng.bit_generator.state for rng in envs.get_attr("np_random")] for envs in (one, two)
    ]
    assert states[0] == states[1]
    for envs in (one, two):
        assert envs.call("has_wrapper_attr", "dt") == (True,) * 3
        assert envs.call("has_wrapper_attr", "no_such") == (False,) * 3
        assert envs.call("get_wrapper_attr", "frame_skip") == (25,) * 3
        with pytest.raises(AttributeError, match="no_such"):
            envs.get_attr("no_such")
        assert envs.call("render") == (None,) * 3
        envs.set_attr("label", ["a", "b", "c"])
        envs.set_attr("count", 3)
        assert (envs.get_attr("label"), envs.get_attr("count")) == (("a", "b", "c"), (3,) * 3)
        envs.call("set_wrapper_attr", "count", 4)
        assert envs.call("get_wrapper_attr", "count") == (4,) * 3
        with pytest.raises(ValueError, match=r"values|Values"):
            envs.set_attr("label", ["a"])


@pytest.mark.parametrize("kind", KINDS)
def test_seeds_are_those_of_the_single_environments(kind: str) -> None:
    """Drawn before the first reset, kept without a seed, changed under a mask."""
    fresh = make(kind)
    drawn = fresh.np_random_seed if kind != "wrapped sync" else fresh.get_attr("np_random_seed")
    assert len(set(drawn)) == 3
    first, _ = fresh.reset()
    again = make(kind)
    np.testing.assert_array_equal(again.reset(seed=list(drawn))[0], first)
    fresh.reset(seed=3)
    assert fresh.get_attr("np_random_seed") == (3, 4, 5)
    fresh.reset()
    assert fresh.get_attr("np_random_seed") == (3, 4, 5)
    fresh.reset(seed=[None, 8, None])
    assert fresh.get_attr("np_random_seed") == (3, 8, 5)
    rngs = [np.random.default_rng(i) for i in range(3)]
    fresh.set_attr("np_random", rngs)
    assert fresh.get_attr("np_random_seed") == (-1,) * 3
    other = make(kind)
    other.set_attr("np_random", [np.random.default_rng(i) for i in range(3)])
    np.testing.assert_array_equal(fresh.reset()[0], other.reset()[0])


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_those_of_the_single_environments(kind: str) -> None:
    one, two = make("sync", "rgb_array"), make(kind, "rgb_array")
    assert two.render_mode == "rgb_array"
    for envs in (one, two):
        envs.reset(seed=0)
    for frames in zip(one.render(), two.call("render"), two.render(), strict=True):
        np.testing.assert_array_equal(frames[0], frames[1])
        np.testing.assert_array_equal(frames[0], frames[2])


def test_a_specification_of_each_robot_makes_it_by_itself() -> None:
    envs = make("batch")
    for i, spec in enumerate(envs.get_attr("spec")):
        alone = gym.make(spec)
        assert spec.kwargs["damage"] == DAMAGE[i]
        assert swim(alone, 20) == swim(AquaFishEnv(engine="numba", damage=DAMAGE[i], **KWARGS), 20)


@pytest.mark.parametrize("name", ["task", "dt", "frame_skip", "spec", "metadata"])
def test_what_the_batch_is_made_with_cannot_be_set(name: str) -> None:
    with pytest.raises(InvalidArgumentError, match=f"{name} of robots cannot be set"):
        make("batch").set_attr(name, 1)


@pytest.mark.parametrize("name", ["reset", "step", "close"])
def test_what_the_whole_batch_does_is_not_called_of_robots(name: str) -> None:
    with pytest.raises(InvalidArgumentError, match=f"call must not be of '{name}'"):
        make("batch").call(name)


def test_a_batch_must_still_be_reset_first() -> None:
    envs = make("batch")
    assert len(envs.np_random) == 3
    with pytest.raises(gym.error.ResetNeeded):
        envs.step(np.zeros((3, 3), np.float32))
    with pytest.raises(gym.error.ResetNeeded):
        envs.reset(options={"reset_mask": np.array([True, False, False])})
    with pytest.raises(InvalidArgumentError, match="np_random must be numpy Generators"):
        envs.set_attr("np_random", 3)
