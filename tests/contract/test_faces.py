"""Every face of the environments is the single robot: each call of two faces returns the same.

The single robot is the reference. Batches in each autoreset mode are Gymnasium's batches of it, a
batch in stable-baselines3 is that library's own, and wrappers break what the robot's own damage
breaks. ``test_rollouts.py`` compares what has no environment.
"""

from __future__ import annotations

import copy
import importlib
import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from aquafish_gym import FaultWrapper, VectorFaultWrapper
from aquafish_gym.command import still_action
from aquafish_gym.engines.compiled import lanes
from aquafish_gym.envs.autoreset import AutoresetMode
from aquafish_gym.plans import AQUAFISH, FOUR_FINS, TAIL_FISH, BodyPlan
from tests.comparing import assert_overwritten, assert_same, overwrite
from tests.contract.scenes import COUNT, ENDS, MODES, Scene, damages_of_channels, scenes
from tests.envs.fault_fakes import Echo, random_damages
from tests.envs.tensor_robots import Arms, array_of
from tests.plans import COMPILED_PLANS

NAME = "AquaFish-v0"
EXAMPLES = settings(max_examples=12, suppress_health_check=[HealthCheck.too_slow])
PLAN = pytest.mark.parametrize("plan", COMPILED_PLANS[:3])
Comparer = Callable[[Any, Any], None]


def single(scene: Scene, damage: str, engine: str) -> gym.Env[Any, Any]:
    return gym.make(NAME, damage=damage, engine=engine, disable_env_checker=True, **scene.options)


def singles(scene: Scene, engine: str = "numba") -> Any:
    """Return single robots in Gymnasium's batch."""
    makers = [lambda d=d: single(scene, d, engine) for d in scene.damages]
    return SyncVectorEnv(makers, autoreset_mode=scene.mode)


def batch(scene: Scene, **options: Any) -> Any:
    """Return the robots as a batch of this project, in double precision."""
    usual = {"damage": list(scene.damages), "autoreset_mode": scene.mode.value, "dtype": "float64"}
    return gym.make_vec(NAME, COUNT, **usual | scene.options | options)


def arrays(envs: Any, numbers: Any) -> Any:
    """Return a copy of numbers as an array of the library whose arrays ``envs`` step."""
    return getattr(envs.unwrapped, "array", np.copy)(numbers)


def assert_faces_agree(
    one: Any,
    two: Any,
    scene: Scene,
    same: Comparer = assert_same,
    turned: Callable[[Any], Any] = lambda envs: envs,
) -> int:
    """Play a scene by two faces and compare all that they return; return how many episodes ended.

    In mid-episode the second face becomes what ``turned`` makes of it. What the first returns is
    its reader's: it is written into, which changes nothing, and never written into again.
    """
    first = one.reset(seed=scene.seed)
    same(first, two.reset(seed=scene.seed))
    given = overwrite(first)
    over = np.zeros(len(scene.actions[0]), np.bool_)
    ends = 0
    for i, actions in enumerate(scene.actions):
        if scene.mode is AutoresetMode.DISABLED and over.any():
            same(*(envs.reset(options={"reset_mask": arrays(envs, over)}) for envs in (one, two)))
        if i == 3:
            two = turned(two)
        actions = actions.astype(one.single_action_space.dtype)
        found, want = (envs.step(arrays(envs, actions)) for envs in (one, two))
        same(found, want)
        assert_overwritten(given)
        given = overwrite(found)
        over = want[2] | want[3]
        ends += int(over.sum())
    for envs in (one, two):
        envs.close()
    return ends


@pytest.mark.parametrize(
    ("plan", "end"),
    [
        *((AQUAFISH, end) for end in ENDS),
        *(
            pytest.param(plan, end, marks=pytest.mark.slow)
            for plan in (FOUR_FINS, TAIL_FISH)
            for end in ("time", "success")  # no body of theirs diverges
        ),
    ],
    ids=lambda one: getattr(one, "name", one),
)
@EXAMPLES
@given(st.data())
def test_a_batch_is_its_single_robots(end: str, plan: BodyPlan, data: st.DataObject) -> None:
    """To the last bit, in each autoreset mode."""
    scene = data.draw(scenes(end, plan=plan))
    assert assert_faces_agree(batch(scene), singles(scene), scene) > 0


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@settings(EXAMPLES, max_examples=8)
@given(scene=scenes())
def test_no_result_depends_on_threads(dtype: str, scene: Scene) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lanes, "_WORTH_A_THREAD", 1)
        one, two = (batch(scene, dtype=dtype, threads=threads) for threads in (1, 2))
        assert_faces_agree(one, two, scene)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@settings(EXAMPLES, max_examples=8)
@given(scene=scenes(), pickled=st.booleans())
def test_a_copy_continues_as_the_original(dtype: str, scene: Scene, pickled: bool) -> None:
    """In mid-episode, and over an episode's end; a batch, and single robots."""

    def copied(envs: Any) -> Any:
        other = pickle.loads(pickle.dumps(envs)) if pickled else copy.deepcopy(envs)
        envs.step(-scene.actions[0])  # the copy knows nothing of it
        return other

    assert_faces_agree(batch(scene, dtype=dtype), batch(scene, dtype=dtype), scene, turned=copied)


@PLAN
@pytest.mark.pybullet
@settings(EXAMPLES, max_examples=5)
@given(data=st.data())
def test_both_engines_are_the_same(plan: BodyPlan, data: st.DataObject) -> None:
    """A batch on PyBullet is its single robots, which are those of the other engine to 2e-6."""
    scene = data.draw(scenes(plan=plan))
    scene = replace(scene, damages=tuple(d if "noise" not in d else "none" for d in scene.damages))
    bullet = batch(scene, engine="pybullet")
    nearly = partial(assert_same, atol=1e-12)
    assert assert_faces_agree(bullet, singles(scene, "pybullet"), scene, nearly) > 0
    alike = partial(assert_same, atol=2e-6)
    assert_faces_agree(singles(scene), singles(scene, "pybullet"), scene, alike)


@settings(EXAMPLES, max_examples=8)
@given(scene=scenes(mode=AutoresetMode.DISABLED))
def test_a_batch_in_stable_baselines3_is_its_own(scene: Scene) -> None:
    """Of robots whose episode goes on, the information is in arrays beside the step."""
    pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.vec_env import DummyVecEnv

    adapter = importlib.import_module("gait.learning.sb3_env")
    ours = adapter.SB3VecEnv(batch(scene))
    theirs = DummyVecEnv([lambda d=d: single(scene, d, "numba") for d in scene.damages])
    ends = 0
    for envs in (ours, theirs):
        envs.seed(scene.seed)
    assert_same(ours.reset(), theirs.reset())
    for actions in scene.actions:
        assert_same(ours.reset_infos, theirs.reset_infos)
        *found, infos = ours.step(actions)
        *want, expected = theirs.step(actions)
        assert_same(found, want)
        on = np.flatnonzero(~want[2])
        for robot, info in zip(on, adapter.info_of_each(ours.info, on), strict=True):
            assert infos[robot] == {"TimeLimit.truncated": False}
            infos[robot] |= info
        assert_same(infos, expected)
        ends += COUNT - len(on)
    assert ends > 0


@PLAN
@EXAMPLES
@given(data=st.data())
def test_a_wrapper_breaks_what_the_robots_own_damage_breaks(
    plan: BodyPlan, data: st.DataObject
) -> None:
    """Around a batch and around single robots."""
    scene = data.draw(scenes(plan=plan))
    neutral = list(still_action(plan))
    # Reckoned fins are those of the actions that the robot was given.
    scene.options["observe_fins"] = bool(scene.options["observe_fins"])
    dt = scene.options["frame_skip"] / 100
    built_in, channels = zip(
        *(data.draw(damages_of_channels(dt, scene.limit, plan)) for _ in range(COUNT)), strict=True
    )
    whole, broken = replace(scene, damages=("none",) * COUNT), replace(scene, damages=built_in)

    def same(found: Any, want: Any) -> None:
        """Compare without rewards of other actions than were taken, and what names channels."""
        assert_same(found[0], want[0])
        if not any("action" in one for one in channels):
            assert_same(found[:-1], want[:-1])
        for name in ("faults", "x_position", "fin_angles"):
            assert_same(found[-1][name], want[-1][name])
        if "final_obs" in want[-1]:
            ended = want[-1]["_final_obs"]
            assert_same(found[-1]["final_obs"], want[-1]["final_obs"])
            for name in ("faults", "x_position"):
                mine, other = (info[-1]["final_info"][name][ended] for info in (found, want))
                assert_same(mine, other)

    one = VectorFaultWrapper(batch(whole), list(channels), neutral=neutral)
    assert_faces_agree(one, batch(broken), scene, same)
    makers = [
        lambda d=d: FaultWrapper(single(whole, "none", "numba"), d, neutral=neutral)
        for d in channels
    ]
    two = SyncVectorEnv(makers, autoreset_mode=scene.mode)
    assert_faces_agree(two, singles(broken), scene, same)


def others(mode: AutoresetMode, seed: int, limit: int = 12) -> Scene:
    """Return a scene of robots of others, which have two actions."""
    return Scene({}, ("",) * COUNT, mode, limit, seed, size=2)


NOISE = "observation:noise=0.1@1-2+30"  # of which a generator draws many numbers at once


@pytest.mark.parametrize("mode", MODES)
@settings(EXAMPLES, max_examples=4)
@given(seed=st.integers(0, 2**16))
def test_a_wrapper_around_a_batch_is_one_around_each_environment(
    mode: AutoresetMode, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    drawn = rng.choice(["", "random:severe@1-4", "random:mild", NOISE], COUNT)
    pairs = zip(drawn, random_damages(rng, COUNT), strict=True)
    damages = ["; ".join(filter(None, pair)) or "none" for pair in pairs]
    makers = [lambda i=i: Echo(length=5 + i) for i in range(COUNT)]
    broken = [lambda i=i: FaultWrapper(Echo(length=5 + i), damages[i], dt=1) for i in range(COUNT)]
    one = VectorFaultWrapper(SyncVectorEnv(makers, autoreset_mode=mode), damages, dt=1)
    two = SyncVectorEnv(broken, autoreset_mode=mode)
    assert assert_faces_agree(one, two, others(mode, seed, limit=36)) > 9


@pytest.mark.parametrize(
    ("like", "mode"),
    [
        *(("torch-float64", mode) for mode in MODES),
        ("torch-float32", AutoresetMode.NEXT_STEP),
        ("torch-float64-unbounded", AutoresetMode.SAME_STEP),
        # jax compiles each function for seconds.
        pytest.param("jax-float32", AutoresetMode.SAME_STEP, marks=pytest.mark.slow),
    ],
)
def test_a_wrapper_breaks_tensors_as_it_breaks_arrays(like: str, mode: AutoresetMode) -> None:
    library, dtype, *unbounded = like.split("-")
    likes = array_of(library, dtype), np.zeros(1, dtype)

    def same(found: Any, want: Any) -> None:
        """Compare; info, which is in single precision on devices, to rounding."""
        assert_same(found[:-1], want[:-1], 0.0 if dtype == "float64" else 1e-6)
        assert_same(found[-1], want[-1], 1e-6)

    for seed in range(1 if library == "jax" else 3):
        damages = random_damages(np.random.default_rng(seed), COUNT)
        arms = [Arms(array, mode, bounded=not unbounded) for array in likes]
        one, two = (VectorFaultWrapper(each, damages, dt=1) for each in arms)
        assert assert_faces_agree(one, two, others(mode, seed), same) > 9
