"""The batched environment, its attributes and tasks, is the single one, many times."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fault_fakes import swim
from gymnasium.vector import SyncVectorEnv

from aquafish_gym import Damage, VectorFaultWrapper
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.engines.packages import load_pybullet
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.tasks import Step, SwimForward, Task
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import EngineUnavailableError, InvalidArgumentError
from tests.comparing import assert_same

COUNT = 3


def make(**kwargs: Any) -> AquaFishVectorEnv:
    env = gym.make_vec("AquaFish-v0", **{"num_envs": COUNT, **kwargs})
    assert isinstance(env, AquaFishVectorEnv)
    return env


def actions(seed: int, steps: int) -> Any:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, COUNT, 3)).astype(np.float32)


def test_a_task_set_later_is_obeyed() -> None:
    env, other = make(), make(task=SwimForward(forward_weight=2.0))
    for e in (env, other):
        e.reset(seed=0)
    env.task = SwimForward(forward_weight=2.0)
    assert_same(env.step(actions(0, 1)[0]), other.step(actions(0, 1)[0]))


def test_threads_work_after_a_fork() -> None:
    code = """
import copy
import os
import numpy as np
from aquafish_gym.engines.compiled import lanes
from aquafish_gym.envs.vector import AquaFishVectorEnv
lanes._WORTH_A_THREAD = 1
env = AquaFishVectorEnv(64, threads=2)
env.reset(seed=0)
action = np.ones((64, 3), np.float32)
expected = copy.deepcopy(env).step(action)[0]
child = os.fork()
assert (env.step(action)[0] == expected).all()
if child:
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
"""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        stderr=subprocess.PIPE,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@dataclass(frozen=True)
class Drifting(Task):
    """What numbers a task returns, and what rows, is its own affair."""

    kept: int = 2

    def begin(self, rng: np.random.Generator) -> tuple[float, ...]:
        """See Task."""
        return (float(rng.uniform(0.1, 0.3)), 0.0)

    def current(self, memory: Any, seconds: Any) -> Any:  # noqa: ARG002
        """See Task."""
        return (memory[0], 0.0, 0.1)

    def remember(self, step: Step) -> Any:
        """See Task."""
        return (step.memory[0], 1.0)[: self.kept]

    def reward_terms(self, step: Step) -> Any:
        """See Task."""
        return {"reward_along": step.velocity[0], "reward_always": 1.0}


def test_a_task_may_return_numbers_for_all_robots() -> None:
    envs = AquaFishVectorEnv(3, task=Drifting(), dtype="float64")
    single = SyncVectorEnv([lambda: AquaFishEnv(engine="numba", task=Drifting())] * 3)
    envs.reset(seed=0)
    single.reset(seed=0)
    for _ in range(3):
        actions = np.zeros((3, 3), np.float32)
        assert (envs.step(actions)[1] == single.step(actions)[1]).all()


@dataclass(frozen=True)
class Once(Task):
    """Sets the water in the first step alone, and rewards what it does."""

    named: str = "reward_forward"

    def current(self, memory: Any, seconds: Any) -> Any:  # noqa: ARG002
        """See Task."""
        return (0.0, 1.0, 0.0) if np.all(np.asarray(seconds) == 0.0) else None

    def reward_terms(self, step: Step) -> Any:
        """See Task."""
        return {self.named: step.velocity[1]}


@pytest.mark.parametrize("engine", ["numba", pytest.param("pybullet", marks=pytest.mark.pybullet)])
def test_the_water_of_a_task_stays_as_it_is_when_something_breaks(engine: str) -> None:
    still = np.array([0.0, 0.0, -1.0], np.float32)
    far = {}
    for damage in ("none", "gyro_x:bias=0.1@1.1", "left_pectoral:missing@1.1"):
        options: dict[str, Any] = {
            "task": Once(), "damage": damage, "engine": engine, "fin_angles": (0.0, 0.0, 0.0)
        }  # fmt: skip
        env = AquaFishEnv(**options)
        env.reset(seed=0)
        envs = AquaFishVectorEnv(
            2, **options, **({"dtype": "float64"} if engine == "numba" else {})
        )
        envs.reset(seed=0)
        for _ in range(20):
            info = env.step(still)[4]
            infos = envs.step(np.tile(still, (2, 1)))[4]
        scenario = Scenario.create()
        robot = Damage.parse(damage).edit(scenario, 20) if damage != "none" else scenario
        rolled = rollout(
            [lambda _observation, _time: still], robot, Once(), engine=engine, seconds=4.0,
            interval=20, rngs=[np.random.default_rng(0)],
        )  # fmt: skip
        far[damage] = info["y_position"]
        assert infos["y_position"].tolist() == pytest.approx([far[damage]] * 2, abs=1e-4)
        assert rolled.paths[0].position[-1, 1] == pytest.approx(far[damage], abs=1e-4)
        env.close()
        envs.close()
    assert far["gyro_x:bias=0.1@1.1"] == far["none"] > 0.5
    assert far["left_pectoral:missing@1.1"] > 0.9 * far["none"]


def test_the_water_of_a_task_has_three_numbers() -> None:
    class Flat(Once):
        def current(self, memory: Any, seconds: Any) -> Any:  # noqa: ARG002
            return (0.1, 0.2)

    for env, action in (
        (AquaFishEnv(task=Flat(), engine="numba"), np.zeros(3)),
        (AquaFishVectorEnv(2, task=Flat()), np.zeros((2, 3))),
    ):
        env.reset(seed=0)
        with pytest.raises(ValueError, match="not enough values to unpack"):
            env.step(action)


@pytest.mark.parametrize("name", ["faults", "servo_delay", "is_success"])
def test_a_term_of_the_reward_has_a_name_of_its_own_in_info(name: str) -> None:
    said = f"reward_terms must have other names than info has, such as reward_{name}; got {name}"
    for make in (
        lambda: AquaFishEnv(task=Once(name), engine="numba"),
        lambda: AquaFishVectorEnv(2, task=Once(name)),
    ):
        with pytest.raises(InvalidArgumentError, match=said):
            make().reset(seed=0)


def test_a_task_that_remembers_too_little_is_refused() -> None:
    envs = AquaFishVectorEnv(3, task=Drifting(kept=1))
    envs.reset(seed=0)
    with pytest.raises(ValueError, match="shorter"):
        envs.step(np.zeros((3, 3), np.float32))


def test_a_task_states_its_length_in_the_class_or_as_a_field() -> None:
    class Longer(Drifting):
        seconds = 30.0

    @dataclass(frozen=True, slots=True)
    class Field(Drifting):
        seconds: float = 30.0

    for task in (Longer(), Field(), Field(seconds=30.0)):
        assert AquaFishEnv(engine="numba", task=task).spec is None
        assert AquaFishEnv(engine="numba", task=task)._last == 150
    with pytest.raises(InvalidArgumentError, match=r"^task.seconds must lie in \[0.01, 3600\] s"):
        AquaFishEnv(engine="numba", task=Field(seconds=0.0))


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"dtype": "float32"}, 'dtype must be "float64" or None'),
        ({"threads": 2}, "threads has no effect"),
    ],
)
def test_what_other_engines_have_not_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidArgumentError, match=words):
        make(engine="pybullet", **options)


@pytest.mark.pybullet
def test_a_closed_batch_on_pybullet_refuses_to_work() -> None:
    """Its clients may serve other robots by then."""
    env = make(engine="pybullet")
    env.reset(seed=0)
    env.close()
    env.close()
    other = make(engine="pybullet")
    other.reset(seed=0)
    for act in (lambda: env.step(actions(0, 1)[0]), lambda: env.reset(seed=0)):
        with pytest.raises(RuntimeError, match="PyBullet world is closed"):
            act()
    other.close()


@pytest.mark.pybullet
def test_too_many_robots_for_pybullet_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    from aquafish_gym.engines.bullet import world

    with pytest.raises(InvalidArgumentError, match="num_envs must be at most 1024"):
        make(engine="pybullet", num_envs=1025)
    monkeypatch.setattr(world, "machine_memory", lambda: 5 * world.CLIENT_BYTES)
    make(engine="pybullet", num_envs=5).close()
    with pytest.raises(InvalidArgumentError, match="num_envs must be at most 5"):
        make(engine="pybullet", num_envs=6)


@pytest.mark.pybullet
def test_clients_are_given_back_when_pybullet_has_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    pybullet = load_pybullet()
    from aquafish_gym.engines.bullet import world

    class Full:
        """PyBullet with all its clients in use."""

        def __getattr__(self, name: str) -> Any:
            return (lambda _: -1) if name == "connect" else getattr(pybullet, name)

    make(engine="pybullet", num_envs=2).close()
    idle = sorted(world._idle_clients)
    monkeypatch.setattr(world, "load_pybullet", Full)
    with pytest.raises(EngineUnavailableError, match="opens no more clients") as caught:
        make(engine="pybullet", num_envs=len(idle) + 1)
    # The error still holds the frames in which the batch was made.
    assert sorted(world._idle_clients) == idle, caught


@pytest.mark.parametrize("engine", ["pybullet", CompiledWorld])
def test_the_specs_of_robots_have_the_engine_of_the_batch(engine: Any) -> None:
    env = make(engine=engine)
    assert [spec.kwargs["engine"] for spec in env.get_attr("spec")] == [engine] * COUNT
    env.close()
    for given in ({}, {"engine": "auto"}):
        assert make(**given).get_attr("spec")[0].kwargs["engine"] == "numba"


DAMAGE = ["none", "caudal:seized@2", "random:mild@1-3"]
KWARGS: dict[str, Any] = {"task": "waypoint", "observe_fins": True, "frame_skip": 25}
NAMES = (
    "dt", "frame_skip", "task", "render_mode", "metadata", "action_space", "observation_space",
    "np_random_seed",
)  # fmt: skip


def batch_of(kind: str, render_mode: str | None = None) -> Any:
    kwargs = KWARGS | {"render_mode": render_mode}
    if kind == "sync":
        return SyncVectorEnv(
            [
                lambda d=d: gym.make("AquaFish-v0", engine="numba", damage=d, **kwargs)
                for d in DAMAGE
            ]
        )
    if kind == "wrapped sync":
        return VectorFaultWrapper(batch_of("sync", render_mode), "action_0:weak=0.5")
    envs = gym.make_vec("AquaFish-v0", 3, damage=DAMAGE, dtype="float64", **kwargs)
    return VectorFaultWrapper(envs, "action_0:weak=0.5") if kind == "wrapped" else envs


KINDS = ("batch", "wrapped", "wrapped sync")


@pytest.mark.parametrize("kind", KINDS)
def test_attributes_are_those_of_the_single_environments(kind: str) -> None:
    one, two = batch_of("sync"), batch_of(kind)
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
    fresh = batch_of(kind)
    drawn = fresh.np_random_seed if kind != "wrapped sync" else fresh.get_attr("np_random_seed")
    assert len(set(drawn)) == 3
    first, _ = fresh.reset()
    again = batch_of(kind)
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
    other = batch_of(kind)
    other.set_attr("np_random", [np.random.default_rng(i) for i in range(3)])
    np.testing.assert_array_equal(fresh.reset()[0], other.reset()[0])


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_those_of_the_single_environments(kind: str) -> None:
    one, two = batch_of("sync", "rgb_array"), batch_of(kind, "rgb_array")
    assert two.render_mode == "rgb_array"
    for envs in (one, two):
        envs.reset(seed=0)
    for frames in zip(one.render(), two.call("render"), two.render(), strict=True):
        np.testing.assert_array_equal(frames[0], frames[1])
        np.testing.assert_array_equal(frames[0], frames[2])


def test_a_specification_of_each_robot_makes_it_by_itself() -> None:
    envs = batch_of("batch")
    for i, spec in enumerate(envs.get_attr("spec")):
        alone = gym.make(spec)
        assert spec.kwargs["damage"] == DAMAGE[i]
        assert swim(alone, 20) == swim(AquaFishEnv(engine="numba", damage=DAMAGE[i], **KWARGS), 20)


@pytest.mark.parametrize("name", ["task", "dt", "frame_skip", "spec", "metadata"])
def test_what_the_batch_is_made_with_cannot_be_set(name: str) -> None:
    with pytest.raises(InvalidArgumentError, match=f"{name} of robots cannot be set"):
        batch_of("batch").set_attr(name, 1)


@pytest.mark.parametrize("name", ["reset", "step", "close"])
def test_what_the_whole_batch_does_is_not_called_of_robots(name: str) -> None:
    with pytest.raises(InvalidArgumentError, match=f"call must not be of '{name}'"):
        batch_of("batch").call(name)


def test_a_batch_must_still_be_reset_first() -> None:
    envs = batch_of("batch")
    assert len(envs.np_random) == 3
    with pytest.raises(gym.error.ResetNeeded):
        envs.step(np.zeros((3, 3), np.float32))
    with pytest.raises(gym.error.ResetNeeded):
        envs.reset(options={"reset_mask": np.array([True, False, False])})
    with pytest.raises(InvalidArgumentError, match="np_random must be numpy Generators"):
        envs.set_attr("np_random", 3)
