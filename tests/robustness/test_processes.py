"""Other processes, copies and threads give the same bytes; what cannot travel says so."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv
from worker_jobs import ACTIONS, MAKERS, make_env, play

CLONES = [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))]


@pytest.mark.pybullet
def test_asynchronous_environments_answer_as_in_process() -> None:
    here = [make() for make in MAKERS]
    there = AsyncVectorEnv(MAKERS, context="spawn")
    try:
        seen, _ = there.reset(seed=[3, 4])
        assert [o.tobytes() for o in seen] == [
            env.reset(seed=seed)[0].tobytes() for env, seed in zip(here, (3, 4), strict=True)
        ]
        for action in ACTIONS:
            seen, rewards, *_, info = there.step(np.stack([action, action]))
            for i, env in enumerate(here):
                expected = env.step(action)
                assert seen[i].tobytes() == expected[0].tobytes()
                assert rewards[i] == expected[1]
                assert info["y_position"][i] == expected[4]["y_position"]
    finally:
        there.close()
        for env in here:
            env.close()


FORK = """
import os
import sys

import numpy as np
from worker_jobs import ACTIONS, make_env, play, run_simulate

env, other = make_env("pybullet", 1), make_env("numba", 1)
before, calm = play(env, ACTIONS[:3]), play(make_env("pybullet", 1))
also = play(other, ACTIONS[:3])
calm_other = play(make_env("numba", 1))
log = run_simulate(("numba", 0)), run_simulate(("pybullet", 0))
child = os.fork()
if child == 0:
    code = 1
    try:
        for attempt in (lambda: env.step(ACTIONS[3]), lambda: env.reset(seed=0)):
            try:
                attempt()
            except RuntimeError as error:
                assert "before a fork" in str(error), error
                assert 'engine="numba"' in str(error), error
            else:
                raise AssertionError("the child used its parent's world")
        env.close()
        env.close()
        assert play(make_env("pybullet", 1)) == calm
        assert also + play(other, ACTIONS[3:]) == calm_other  # this engine may be carried along
        assert (run_simulate(("numba", 0)), run_simulate(("pybullet", 0))) == log
        code = 0
    finally:
        sys.stdout.flush()
        os._exit(code)
_, status = os.waitpid(child, 0)
assert os.waitstatus_to_exitcode(status) == 0
assert before + play(env, ACTIONS[3:]) == calm
assert also + play(other, ACTIONS[3:]) == calm_other
env.close()
"""


@pytest.mark.pybullet
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_fork_leaves_the_parents_world_alone() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", FORK],
        capture_output=True,
        text=True,
        timeout=300,
        cwd=Path(__file__).parent,
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.pybullet
@pytest.mark.parametrize("begun", [False, True])
def test_a_pybullet_environment_refuses_to_be_copied_once_begun(begun: bool) -> None:
    env = gym.make("AquaFish-v0", engine="pybullet")
    if not begun:  # there is no world yet
        other = pickle.loads(pickle.dumps(env))
        assert other.reset(seed=0)[0].tobytes() == env.reset(seed=0)[0].tobytes()
        other.close()
    for clone in CLONES:
        env.reset(seed=0)
        with pytest.raises(TypeError, match=r"PyBullet world cannot be pickled or copied.*numba"):
            clone(env)
    env.close()
    copy.deepcopy(env).reset(seed=0)  # closed, it holds no world


@pytest.mark.pybullet
def test_an_interrupted_step_leaves_other_worlds_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C may come inside PyBullet; reset() makes that environment whole again."""
    import pybullet

    calm = play(make_env("pybullet", 2))
    env, struck = make_env("pybullet", 2), make_env("pybullet", 3)
    first = play(env, ACTIONS[:4])
    step = pybullet.stepSimulation
    calls = 0

    def interrupt(*args: Any, **kwargs: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == 3:
            raise KeyboardInterrupt
        return step(*args, **kwargs)

    with monkeypatch.context() as patch:
        patch.setattr(pybullet, "stepSimulation", interrupt)
        with pytest.raises(KeyboardInterrupt):
            struck.step(ACTIONS[0])
    assert first + play(env, ACTIONS[4:]) == calm
    struck.reset(seed=2)
    assert play(struck) == calm
    for one in (env, struck):
        one.close()
