"""AquaFish-v0 keeps Gymnasium's promises, hides what it should, and refuses nonsense."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym.engines.worlds import World
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.episode import observation_space
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.kinematics import at_rest
from aquafish_gym.plans import FOUR_FINS, TAIL_FISH, BodyPlan
from aquafish_gym.sense import limits, observe
from aquafish_gym.utils.validation import InvalidArgumentError
from tests.contract.scenes import BEFORE_DIVERGING_SEED, ROUGH, THIN
from tests.plans import ODD

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
    assert observation_space(limits()).contains(seen)


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


def test_divergence_ends_the_episode_without_a_reward() -> None:
    env = make(morphology=THIN, current=ROUGH)
    seen, _ = env.reset(seed=BEFORE_DIVERGING_SEED + 1)
    last, reward, terminated, truncated, info = env.step(np.array([0.3, 0.5, 0.9]))
    assert (last == seen).all()
    assert (reward, terminated, truncated, info["diverged"]) == (0.0, True, False, True)
    assert math.isfinite(info["y_position"])
    with pytest.raises(ResetNeeded):
        env.step(GO)
    env.reset(seed=0)
    assert not env.step(GO)[4]["diverged"]


def test_a_world_that_is_not_finished_is_refused() -> None:
    for face in (AquaFishEnv, AquaFishVectorEnv):
        with pytest.raises(InvalidArgumentError, match="World lacks _start, _swim, _update, close"):
            face(engine=World)


@pytest.mark.parametrize(
    ("plan", "reactive"),
    [  # kernels that FourFins-v0 and TailFish-v0 have, too
        (FOUR_FINS, False), (TAIL_FISH, True), pytest.param(ODD, True, marks=pytest.mark.slow),
    ],
    ids=["four-fins", "tail-fish", "odd"],
)  # fmt: skip
def test_a_fish_of_any_plan_swims_alone_and_in_a_batch(plan: BodyPlan, reactive: bool) -> None:
    fins = len(plan.fins)
    damage = f"{plan.names[-1]}:weak=0.5; {plan.names[0]}:missing@0.4; random:severe@0.2"
    kwargs = {"plan": plan, "damage": damage, "observe_fins": "reckoned", "reactive": reactive}
    one = gym.make("AquaFish-v0", engine="numba", **kwargs)
    many = gym.make_vec("AquaFish-v0", num_envs=2, dtype="float64", **kwargs)
    seen, info = one.reset(seed=7)
    all_seen, _ = many.reset(seed=7)
    assert seen.shape == (9 + 2 * fins,)
    assert one.action_space.shape == info["fin_angles"].shape == info["servo_gain"].shape == (fins,)
    one.action_space.seed(0)
    for _ in range(5):
        action = one.action_space.sample()
        seen, reward, *_, info = one.step(action)
        all_seen, rewards, *_, infos = many.step(np.stack([action, -action]))
        np.testing.assert_array_equal(all_seen[0], seen)
        assert rewards[0] == pytest.approx(reward, abs=1e-12)
        assert {"morphology", "fin_angles", "servo_gain"} <= info.keys() <= infos.keys()
        for name, value in info.items():
            np.testing.assert_allclose(infos[name][0], value, rtol=0, atol=1e-12, err_msg=name)
    assert not info["morphology"][:3].any()  # it is missing
    again = gym.make(EnvSpec.from_json(one.spec.to_json()))
    assert again.unwrapped.plan == plan == many.get_attr("plan")[0]
    again.close()
    one.close()
    many.close()


def test_what_is_of_another_plan_is_refused_when_it_is_made() -> None:
    cases = {
        "plan must be one of .* did you mean 'four-fins'": {"plan": "four"},
        "damage part must be one of fore_left": {"damage": "caudal:missing"},
        "damage part must be one of fore_left.*got 'tail'": {"damage": "tail:missing@2-4"},
        r"morphology must have shape \(12,\)": {"morphology": np.ones(9)},
        r"fin_angles must have shape \(4,\)": {"fin_angles": np.zeros(3)},
        "morphology must be of the plan four-fins": {"morphology": Morphology.nominal()},
    }
    for message, kwargs in cases.items():
        with pytest.raises(InvalidArgumentError, match=message):
            gym.make("FourFins-v0", engine="numba", **kwargs)
    env = gym.make("TailFish-v0", engine="numba")
    assert env.unwrapped.plan == TAIL_FISH
    with pytest.raises(InvalidArgumentError, match="damage part must be one of tail"):
        env.reset(options={"damage": "caudal:missing"})
