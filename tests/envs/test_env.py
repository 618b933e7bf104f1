"""AquaFish-v0 keeps Gymnasium's promises, hides what it should, and refuses nonsense."""

from __future__ import annotations

import copy
import json
import math
import pickle
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import aquafish_gym
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.engines.worlds import World
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.episode import check_action, check_single_action, observation_space
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.physics.kinematics import at_rest
from aquafish_gym.sense import observe
from aquafish_gym.utils.validation import InvalidArgumentError
from tests.comparing import assert_same

ENGINES = ("numba", "pybullet")
GO = np.array([0.8, 0.6, 0.4], np.float32)


def make(**kwargs: Any) -> AquaFishEnv:
    env = gym.make("AquaFish-v0", **{"engine": "numba", **kwargs}).unwrapped
    assert isinstance(env, AquaFishEnv)
    return env


def test_import_loads_no_engine_and_registers_once() -> None:
    code = (
        "import sys, importlib, aquafish_gym; importlib.reload(aquafish_gym); "
        "print({'numba', 'pybullet', 'matplotlib', 'torch'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "set()"


def test_a_spec_survives_json() -> None:
    env = gym.make(
        "AquaFish-v0",
        engine="numba",
        morphology=aquafish_gym.Morphology.coerce({"caudal": (0.1, 2.0, 1.0)}),
        damage=aquafish_gym.Damage.parse("left_pectoral:length=0.5;right_pectoral:missing"),
        fin_angles=(0.1, 0.2, 0.3),
    )
    assert env.spec is not None
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    (one, one_info), (two, two_info) = env.reset(seed=1), again.reset(seed=1)
    assert (one == two).all()
    assert one_info["faults"] == two_info["faults"] == 2
    assert (one_info["morphology"] == two_info["morphology"]).all()
    assert two_info["morphology"].tolist() == [0.4, 0.8, 0.1, 0, 0, 0, 0.1, 2.0, 1.0]


@pytest.mark.parametrize("frame_skip", [5, 8, 100, 2000])
def test_an_episode_lasts_twenty_seconds(frame_skip: int) -> None:
    env = make(frame_skip=frame_skip)
    env.reset()
    for _ in range(2000 // frame_skip - 1):
        assert env.step(GO)[2:4] == (False, False)
    assert env.step(GO)[2:4] == (False, True)
    with pytest.raises(ResetNeeded):
        env.step(GO)
    env.reset()
    env.step(GO)


def test_reward_is_the_sum_of_its_terms() -> None:
    env = make(task=SwimForward(forward_weight=2.0, ctrl_weight=0.1))
    _, start = env.reset()
    assert start["y_position"] == 0.0
    travelled, before = 0.0, 0.0
    for _ in range(50):
        _, reward, *_, info = env.step(GO)
        assert reward == info["reward_forward"] + info["reward_ctrl"]
        assert info["reward_ctrl"] == pytest.approx(-0.1 * float((GO.astype(float) ** 2).sum()))
        assert info["y_velocity"] == pytest.approx((info["y_position"] - before) / env.dt)
        before = info["y_position"]
        travelled += info["reward_forward"] * env.dt / 2.0
    assert travelled == pytest.approx(info["y_position"])
    where = [info[f"{axis}_position"] for axis in "xyz"]
    assert info["distance_from_origin"] == pytest.approx(np.linalg.norm(where))
    json.dumps({k: v for k, v in info.items() if not isinstance(v, np.ndarray)})


def test_fin_angles_are_in_info_and_not_observed() -> None:
    env = make()
    first, info = env.reset(options={"fin_angles": (0.0, 0.0, 0.0)})
    other, told = env.reset(options={"fin_angles": (1.0, -2.0, 3.0)})
    assert (first == other).all()
    np.testing.assert_allclose(told["fin_angles"], (1.0, -2.0, 3.0))
    np.testing.assert_allclose(info["fin_angles"], 0.0)
    seeing, _ = make(observe_fins=True).reset(options={"fin_angles": (1.0, -2.0, 3.0)})
    np.testing.assert_allclose(seeing[9:12], np.sin((1.0, -2.0, 3.0)), atol=1e-6)
    np.testing.assert_allclose(seeing[12:15], np.cos((1.0, -2.0, 3.0)), atol=1e-6)
    np.testing.assert_array_equal(seeing[:9], first)


def test_reckoned_fin_angles_are_true_without_servo_faults() -> None:
    def shown(observe_fins: object) -> Any:
        env = make(observe_fins=observe_fins, damage="left_pectoral:seized@1", fin_angles="random")
        rng = np.random.default_rng(0)
        seen = [env.reset(seed=1)[0]]
        return np.array(
            seen + [env.step(rng.uniform(-1, 1, 3).astype(np.float32))[0] for _ in range(20)]
        )

    true, reckoned = shown(np.True_), shown("reckoned")
    np.testing.assert_array_equal(true[:, :9], reckoned[:, :9])
    np.testing.assert_allclose(true[:6], reckoned[:6], atol=1e-6)
    off = np.abs(true - reckoned)[8:].max(axis=0)
    assert [i for i in range(15) if off[i] > 1e-3] == [9, 12]  # of the left flipper alone


@given(st.tuples(*[st.floats(-math.pi, math.pi)] * 3), st.floats(-100, 100))
@settings(max_examples=50, deadline=None)
def test_up_and_north_are_the_attitude(rpy: tuple[float, float, float], rate: float) -> None:
    """Yaw about z, then pitch about x, then roll about y."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    pitch = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    roll = np.array([[cr, 0, sr], [0, 1, 0], [-sr, 0, cr]])
    matrix = yaw @ pitch @ roll
    (hr, hp, hy), (gr, gp, gy) = np.cos(np.array(rpy) / 2), np.sin(np.array(rpy) / 2)
    # The product of the three half-angle quaternions, in the same order.
    quaternion = np.array(
        [
            hy * gp * hr - gy * hp * gr,
            hy * hp * gr + gy * gp * hr,
            gy * hp * hr + hy * gp * gr,
            hy * hp * hr - gy * gp * gr,
        ]
    )
    x, y, z, w = quaternion.tolist()
    state = at_rest((0.0, 0.0, 0.0))._replace(orientation=(x, y, z, w), spin=(0.0, rate, 0.0))
    seen = observe(state)
    np.testing.assert_allclose(seen[:3], matrix[2], atol=1e-6)
    np.testing.assert_allclose(seen[3:6], matrix[1], atol=1e-6)
    assert seen[7] == pytest.approx(np.clip(rate, -34.906586, 34.906586))
    assert observation_space(observe_fins=False, has_goal=False).contains(seen)


def test_options_hold_for_one_episode() -> None:
    env = make(damage="caudal:length=0.5")
    _, info = env.reset(
        options={"damage": "left_pectoral:missing", "morphology": {"caudal": [0] * 3}}
    )
    assert info["faults"] == 1
    assert info["morphology"].tolist() == [0, 0, 0, 0.4, 1.6, 0.1, 0, 0, 0]
    _, info = env.reset()
    assert info["faults"] == 1
    assert info["morphology"].tolist() == [0.4, 1.6, 0.1, 0.4, 1.6, 0.1, 0.4, 0.7, 0.6]


def test_divergence_terminates_the_episode() -> None:
    env = make()
    env.reset()
    good, *_ = env.step(GO)
    assert isinstance(env._robot.world, CompiledWorld)
    env._robot.world._numbers[11] = np.nan
    seen, reward, terminated, truncated, info = env.step(GO)
    assert (seen == good).all()
    assert (reward, terminated, truncated, info["diverged"]) == (0.0, True, False, True)
    assert math.isfinite(info["y_position"])
    with pytest.raises(ResetNeeded):
        env.step(GO)
    env.reset()
    assert not env.step(GO)[4]["diverged"]


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copy_continues_as_the_original(clone: Callable[[gym.Env], gym.Env]) -> None:  # type: ignore[type-arg]
    env = gym.make("AquaFish-v0", engine="numba", fin_angles="random", observe_fins=True)
    env.reset(seed=0)
    for _ in range(7):
        env.step(GO)
    other, third = clone(env), clone(env)
    third.step(-GO)
    for _ in range(5):
        assert_same(env.step(GO), other.step(GO))
    assert env.unwrapped._steps == other.unwrapped._steps  # type: ignore[attr-defined]
    assert_same(env.reset(), other.reset())
    assert_same(env.step(GO), other.step(GO))


@pytest.mark.parametrize("engine", ENGINES)
def test_returned_arrays_are_not_reused(engine: str) -> None:
    """Writing into it changes nothing, and nothing is written into it."""
    env, other = make(engine=engine), make(engine=engine)
    kept = []
    for e in (env, other):
        e.reset(seed=0)
    for _ in range(3):
        mine, theirs = env.step(GO), other.step(GO)
        assert_same(mine, theirs)
        kept.append((mine, copy.deepcopy(mine)))
        theirs[0][:] = np.nan
        theirs[4]["fin_angles"][:] = np.nan
        theirs[4]["morphology"][:] = np.nan
        theirs[4].clear()
    for mine, before in kept:
        assert_same(mine, before)
    env.close()
    other.close()


ENV = AquaFishEnv(engine="numba")


@given(
    st.one_of(
        hnp.arrays(np.float32, hnp.array_shapes(min_dims=0, max_dims=2, max_side=4)),
        st.lists(st.one_of(st.floats(), st.text(max_size=2), st.none()), max_size=4),
    )
)
@settings(max_examples=150, deadline=None)
def test_an_action_is_three_finite_numbers_or_refused(action: Any) -> None:
    ENV.reset()
    try:
        numbers = np.array(action, dtype=np.float64)
        fine = numbers.shape == (3,) and bool(np.isfinite(numbers).all())
        fine = fine and not any(isinstance(v, str) for v in action)
    except (TypeError, ValueError):
        fine = False
    if fine:
        seen, reward, *_ = ENV.step(action)
        assert ENV.observation_space.contains(seen)
        assert math.isfinite(reward)
    else:
        with pytest.raises(InvalidArgumentError, match="action must"):
            ENV.step(action)


@pytest.mark.parametrize(
    ("name", "kwargs", "steps"),
    [
        ("AquaFish-v0", {}, 100),
        ("AquaFish-v0", {"frame_skip": 5}, 400),
        ("AquaFishRecovery-v0", {}, 300),
        ("AquaFish-v0", {"task": SwimForward(seconds=1.0)}, 5),
    ],
)
def test_spec_has_the_length_of_an_episode(name: str, kwargs: dict[str, Any], steps: int) -> None:
    env, envs = gym.make(name, engine="numba", **kwargs), gym.make_vec(name, 2, **kwargs)
    assert env.spec is not None
    assert envs.spec is not None
    assert env.spec.max_episode_steps == envs.spec.max_episode_steps == steps
    again = gym.make(env.spec)
    again.reset(seed=0)
    ends = [again.step(GO)[3] for _ in range(min(steps, 5))]
    assert ends == [i == steps - 1 for i in range(min(steps, 5))]
    shorter = gym.make(name, engine="numba", max_episode_steps=3, **kwargs)
    assert shorter.spec is not None
    assert shorter.spec.max_episode_steps == 3


@given(st.lists(st.floats(-3, 3, width=32), min_size=3, max_size=3))
def test_fast_action_check_agrees_with_the_general_one(action: list[float]) -> None:
    for dtype in (np.float32, np.float64):
        array = np.array(action, dtype)
        assert check_single_action(array) == tuple(check_action(array, (3,)).tolist())


def test_a_world_that_is_not_finished_is_refused() -> None:
    for face in (AquaFishEnv, AquaFishVectorEnv):
        with pytest.raises(InvalidArgumentError, match="World lacks _start, _swim, _update, close"):
            face(engine=World)
