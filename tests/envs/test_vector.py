"""The batched environment is the single one, many times."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import SyncVectorEnv

import aquafish_gym  # noqa: F401
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.engines.packages import load_pybullet
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.tasks import Step, SwimForward, Task
from aquafish_gym.envs.vector import AquaFishVectorEnv
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


def test_returned_arrays_are_not_reused() -> None:
    env, other = make(), make()
    for e in (env, other):
        _, info = e.reset(seed=0)
    for action in actions(9, 3):
        mine, theirs = env.step(action), other.step(action)
        assert_same(mine, theirs)
        theirs[0][:] = np.nan
        for value in theirs[4].values():
            value[...] = None if value.dtype == object else 0
    info["morphology"][:] = 0.0
    assert_same(env.step(action), other.step(action))


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


def test_reset_mask_resets_some_robots() -> None:
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
    assert info["faults"].tolist() == [0, 1, 0]
    assert info["_faults"].tolist() == mask.tolist()
    for action in actions(4, 2):
        a, _, _, truncated, _ = env.step(action)
        b = other.step(action)[0]
    assert (a[[0, 2]] == b[[0, 2]]).all()
    assert truncated.tolist() == [True, False, True]
    with pytest.raises(ResetNeeded):
        env.step(actions(5, 1)[0])
    env.reset(options={"reset_mask": ~mask})
    env.step(actions(5, 1)[0])


def flood(env: Any, robot: int, speed: float) -> None:
    """Let the water of one robot flow at a speed that no door admits."""
    water = np.zeros((env.num_envs, 3))
    water[robot] = speed
    env._swimmers.set_current(water)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_divergence_terminates_one_robot(mode: str) -> None:
    env, other = make(autoreset_mode=mode), make(autoreset_mode=mode)
    for e in (env, other):
        e.reset(seed=0)
    action = actions(6, 1)[0]
    good = env.step(action)[0]
    other.step(action)
    flood(env, 1, 1e30)
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


@pytest.mark.parametrize("speed", [1e3, 1e5, 1e6, -1e30, np.inf, np.nan])
def test_divergence_is_detected_before_overflow(speed: float) -> None:
    """As the single environment tells it."""
    env = make(dtype="float64", frame_skip=1)
    single = gym.make("AquaFish-v0", engine="numba", frame_skip=1).unwrapped
    action = actions(0, 1)[0]
    env.reset(seed=0)
    single.reset(seed=1)
    good, *_ = env.step(action)
    single.step(action[1])
    flood(env, 1, speed)
    single._robot.world.set_current((speed,) * 3)  # type: ignore[attr-defined]
    seen, reward, terminated, _, info = env.step(action)
    one, score, ended, _, told = single.step(action[1])
    assert terminated.tolist() == [False, ended, False]
    assert (seen[1] == one).all()
    assert reward[1] == score
    assert info["diverged"][1] == told["diverged"] == ended
    if abs(reward[1]) > 1e6 or not np.isfinite(speed):
        assert ended
        assert (seen[1] == good[1]).all()


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
