"""The batched environment is the single one, many times."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

import aquafish_gym  # noqa: F401
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.validation import InvalidArgumentError

COUNT = 3


def make(**kwargs: Any) -> AquaFishVectorEnv:
    env = gym.make_vec("AquaFish-v0", **{"num_envs": COUNT, **kwargs})
    assert isinstance(env, AquaFishVectorEnv)
    return env


def actions(seed: int, steps: int) -> Any:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, COUNT, 3)).astype(np.float32)


def agree(ours: dict[str, Any], theirs: dict[str, Any]) -> None:
    """Compare infos; Gymnasium leaves out a key that no robot has, ours has an empty mask."""
    for name in ours:
        if name not in theirs:
            assert name.endswith(("reward_forward", "reward_ctrl"))
            assert not ours["_" + name.removeprefix("_")].any()
    for name, value in theirs.items():
        if isinstance(value, dict):
            agree(ours[name], value)
        elif name == "final_obs":
            assert [v is None for v in ours[name]] == [v is None for v in value]
            for a, b in zip(ours[name], value, strict=True):
                assert a is b or (a == b).all()
        elif value.dtype == object or value.dtype == bool:
            assert ours[name].dtype == value.dtype
            mask = theirs["_" + name.removeprefix("_")]
            assert (ours[name][mask] == value[mask]).all(), name
        else:
            mask = theirs["_" + name]
            np.testing.assert_allclose(ours[name][mask], value[mask], rtol=0, atol=1e-12)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_it_is_gymnasiums_sync_of_single_environments(mode: AutoresetMode) -> None:
    kwargs: dict[str, Any] = {"fin_angles": "random", "frame_skip": 125, "observe_fins": True}
    ours = make(dtype="float64", autoreset_mode=mode.value, **kwargs)
    theirs = gym.make_vec(
        "AquaFish-v0",
        num_envs=COUNT,
        engine="numba",
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        **kwargs,
    )
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.metadata["autoreset_mode"] is mode
    (a, ia), (b, ib) = ours.reset(seed=5), theirs.reset(seed=5)
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-6)
    agree(ia, ib)
    ends = 0
    for action in actions(0, 40):
        mine, other = ours.step(action), theirs.step(action)
        np.testing.assert_allclose(mine[0], other[0], rtol=0, atol=1e-6)
        for x, y in zip(mine[1:4], other[1:4], strict=True):
            np.testing.assert_array_equal(x, y)
            assert x.dtype == y.dtype
        agree(mine[4], other[4])
        ends += int(mine[3].any())
    assert ends == 2
    ours.close()
    theirs.close()


def test_single_precision_stays_close() -> None:
    envs = [make(dtype=d) for d in ("float32", "float64")]
    for env in envs:
        env.reset(seed=0)
    for action in actions(1, 40):
        a, b = (env.step(action)[0] for env in envs)
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-3)


def test_observations_and_infos_are_not_reused() -> None:
    env = make()
    seen, info = env.reset(seed=0)
    kept = copy.deepcopy((seen, info))
    for action in actions(2, 3):
        env.step(action)
    assert (seen == kept[0]).all()
    for name, value in info.items():
        assert (value == kept[1][name]).all()


def test_some_may_be_reset_and_the_others_swim_on() -> None:
    env, other = (make(autoreset_mode="Disabled", frame_skip=500) for _ in range(2))
    mask = np.array([False, True, False])
    with pytest.raises(ResetNeeded, match="first reset"):
        env.reset(options={"reset_mask": mask})
    for e in (env, other):
        e.reset(seed=0)
    for action in actions(3, 2):
        env.step(action)
        other.step(action)
    seen, info = env.reset(options={"reset_mask": mask, "damage": "caudal:missing"})
    assert seen[1].tolist() == [0, 0, 1, 0, 1, 0, 0, 0, 0]
    assert info["damage"].tolist() == ["none", "caudal:missing", "none"]
    assert info["_damage"].tolist() == mask.tolist()
    for action in actions(4, 2):
        a, _, _, truncated, _ = env.step(action)
        b = other.step(action)[0]
    assert (a[[0, 2]] == b[[0, 2]]).all()
    assert truncated.tolist() == [True, False, True]
    with pytest.raises(ResetNeeded):
        env.step(actions(5, 1)[0])
    env.reset(options={"reset_mask": ~mask})
    env.step(actions(5, 1)[0])


def test_each_may_have_a_body_of_its_own() -> None:
    bodies = [[0.4, 1.6, 0.1, 0.4, 1.6, 0.1, 0.4, 1.4, z] for z in (0.0, 0.5, 1.0)]
    env = make(morphology=bodies, damage="left_pectoral:length=0.5")
    _, info = env.reset(seed=0)
    assert info["morphology"][:, 8].tolist() == [0.0, 0.5, 1.0]
    assert info["morphology"][:, 1].tolist() == [0.8] * 3
    *_, info = env.step(np.ones((3, 3), np.float32))
    assert len(set(info["y_position"].tolist())) == 3


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_divergence_ends_one_episode_and_spares_the_others(mode: str) -> None:
    env, other = make(autoreset_mode=mode), make(autoreset_mode=mode)
    for e in (env, other):
        e.reset(seed=0)
    action = actions(6, 1)[0]
    good = env.step(action)[0]
    other.step(action)
    env._lanes._table(env._lanes._states, 25)[:, 1] = np.nan
    seen, reward, terminated, truncated, info = env.step(action)
    expected = other.step(action)[0]
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert reward[1] == 0.0
    assert (seen[[0, 2]] == expected[[0, 2]]).all()
    last = seen[1] if mode == "NextStep" else info["final_obs"][1]
    assert (last == good[1]).all()
    for _ in range(2):
        seen, _, terminated, *_ = env.step(action)
        assert not terminated.any()
        assert np.isfinite(seen).all()


def test_seeds_may_be_listed() -> None:
    env = make(fin_angles="random")
    one = env.reset(seed=[7, 8, 9])[1]["fin_angles"]
    two = env.reset(seed=7)[1]["fin_angles"]
    kept = env.reset(seed=[None, 8, None])[1]["fin_angles"]
    assert (one == two).all()
    assert (kept[1] == one[1]).all()
    assert not np.isclose(kept[[0, 2]], one[[0, 2]]).any()
    with pytest.raises(InvalidArgumentError, match="seed must be"):
        env.reset(seed=[1, 2])
    for seed, sentence in (
        (1.5, "seed must be a whole number"),
        (-1, "seed must be a whole number"),
        ("abc", "seed must be a whole number"),
        ([1, 2.5, 3], r"seed\[1\] must be a whole number"),
    ):
        with pytest.raises(InvalidArgumentError, match=sentence):
            env.reset(seed=seed)  # type: ignore[arg-type]


def test_seeds_are_for_the_robots_that_are_reset() -> None:
    kwargs: dict[str, Any] = {"fin_angles": "random"}
    ours = make(autoreset_mode="Disabled", **kwargs)
    theirs = gym.make_vec(
        "AquaFish-v0",
        num_envs=COUNT,
        engine="numba",
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode.DISABLED},
        **kwargs,
    )
    mask = np.array([False, True, False])
    for env in (ours, theirs):
        env.reset(seed=3)
        env.reset(seed=20, options={"reset_mask": mask})
    a, b = (env.reset()[1]["fin_angles"] for env in (ours, theirs))
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-6)
    theirs.close()


def test_every_robot_has_a_frame() -> None:
    env = make(num_envs=2, render_mode="rgb_array")
    env.reset()
    frames = env.render()
    assert frames is not None
    assert [f.shape for f in frames] == [(480, 640, 3)] * 2
    assert make().render() is None


@pytest.mark.parametrize(
    ("kwargs", "sentence"),
    [
        ({"num_envs": 0}, "num_envs must be"),
        ({"engine": "pybullet"}, "vectorization_mode"),
        ({"engine": "nmba"}, "did you mean 'numba'"),
        ({"dtype": "float16"}, "dtype must be one of"),
        ({"autoreset_mode": "Next"}, "did you mean 'NextStep'"),
        ({"threads": 0}, "threads must be"),
        ({"render_mode": "human"}, "shows one robot"),
        ({"morphology": [[0.0] * 9] * 2}, "one body or num_envs = 3"),
        ({"morphology": [[0.0] * 9, [0.0] * 9, [-1.0] * 9]}, "must lie in"),
        ({"frame_skip": True}, "frame_skip must be"),
        ({"frame_skip": 150}, "frame_skip must divide 2000"),
        ({"observe_fins": "no"}, "observe_fins must be True or False"),
    ],
)
def test_bad_arguments_are_refused(kwargs: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InvalidArgumentError, match=sentence):
        AquaFishVectorEnv(**{"num_envs": COUNT, **kwargs})


def test_bad_actions_and_masks_are_refused() -> None:
    env = make()
    with pytest.raises(ResetNeeded):
        env.step(actions(0, 1)[0])
    env.reset()
    bad = actions(0, 1)[0]
    bad[1, 1] = np.nan
    for action in (bad, bad[:2], np.ones(3), "swim"):
        with pytest.raises(InvalidArgumentError, match="action must"):
            env.step(action)
    for mask in ([1, 0, 0], np.zeros(3, bool), np.ones(2, bool)):
        with pytest.raises(InvalidArgumentError, match="reset_mask"):
            env.reset(options={"reset_mask": mask})
    with pytest.raises(InvalidArgumentError, match="did you mean 'damage'"):
        env.reset(options={"damages": "none"})
