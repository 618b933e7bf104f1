"""What a release brings to other places works: LeRobot's EnvHub and Minari."""

from __future__ import annotations

import importlib.util
import json
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import cloudpickle
import gymnasium as gym
import numpy as np
import pytest

from aquafish.online.gaits import load_library
from aquafish_gym import IDS
from gait.controllers.agents import ControllerAgent

RELEASE = Path(__file__).parents[1] / "release"


def load_as_lerobot(path: Path, **arguments: Any) -> dict[str, dict[int, gym.vector.VectorEnv]]:
    """Return what LeRobot makes of an env.py.

    It is its documented contract (https://huggingface.co/docs/lerobot/envhub): load the file as a
    module, call ``make_env(n_envs=..., use_async_envs=...)``, and take a mapping as it is. LeRobot
    itself brings gigabytes.
    """
    spec = importlib.util.spec_from_file_location("hub_env_owner_aquafish", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    made = module.make_env(**arguments)
    assert isinstance(made, dict)
    return made


def roll_out(envs: gym.vector.VectorEnv, steps: int) -> tuple[Any, Any]:
    """Step as ``lerobot-eval`` does, with what it reads; return observations and rewards."""
    observation, _ = envs.reset(seed=[3, 4], options={"lerobot_new_rollout": True})
    seen = [observation]
    rewards = []
    envs.action_space.seed(0)
    for _ in range(steps):
        observation, reward, terminated, truncated, _ = envs.step(envs.action_space.sample())
        assert terminated.shape == truncated.shape == (2,)
        seen.append(observation)
        rewards.append(reward)
    return seen, rewards


def test_lerobot_gets_every_task_with_what_it_reads() -> None:
    tasks = load_as_lerobot(RELEASE / "envhub" / "env.py", n_envs=2, use_async_envs=False)
    assert list(tasks) == ["aquafish"]
    names = [envs.call("task")[0] for envs in tasks["aquafish"].values()]
    # A policy of LeRobot's has one action space: the paper's fish, in all its tasks.
    assert names == [name for name in IDS if "plan" not in IDS[name]]
    for name, envs in zip(names, tasks["aquafish"].values(), strict=True):
        assert envs.unwrapped.metadata["render_fps"] == 5
        assert envs.call("task_description")[0].endswith(".")
        alone = gym.make(name, engine="numba")
        assert envs.call("_max_episode_steps")[0] == alone.spec.max_episode_steps
        seen, _ = roll_out(envs, 3)
        assert envs.observation_space.contains(seen[-1])
        first, _ = alone.reset(seed=3)
        np.testing.assert_array_equal(seen[0]["agent_pos"][0], first)
        envs.close()
    forward = load_as_lerobot(RELEASE / "envhub" / "env.py", n_envs=1)["aquafish"][0]
    forward.reset(seed=0)
    assert forward.call("render")[0].dtype == np.uint8
    forward.close()


@pytest.mark.parametrize(("number", "succeeds"), [(0, False), (4, True)])
def test_lerobot_counts_a_success_and_no_other_end(number: int, succeeds: bool) -> None:
    """It reads ``final_info``, and counts a task as done that says nothing of success."""
    envs = load_as_lerobot(RELEASE / "envhub" / "env.py", n_envs=2)["aquafish"][number]
    seen, info = envs.reset(seed=[60_000, 60_001])
    agent = ControllerAgent(load_library()[0])
    agent.reset(info)
    while "final_info" not in info:
        seen, _, terminated, truncated, info = envs.step(
            np.asarray(agent.act(seen["agent_pos"]), np.float32)
        )
    over = terminated | truncated
    np.testing.assert_array_equal(info["final_info"]["_is_success"], over)
    assert set(info["final_info"]["is_success"][over].tolist()) == {succeeds}
    envs.close()


def test_lerobots_processes_step_the_same_fish() -> None:
    class Config:
        damage = "caudal:seized@0.4"

    found = []
    for use_async_envs in (False, True):
        tasks = load_as_lerobot(
            RELEASE / "envhub" / "env.py", n_envs=2, use_async_envs=use_async_envs, cfg=Config()
        )["aquafish"]
        found.append(roll_out(tasks[0], 4))
        for envs in tasks.values():
            envs.close()
    for here, there in zip(*found, strict=True):
        for one, other in zip(here, there, strict=True):
            np.testing.assert_equal(one, other)


def test_lerobots_processes_need_not_be_forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on macOS, and on Linux from Python 3.14."""
    makers: list[Any] = []
    monkeypatch.setattr(gym.vector, "AsyncVectorEnv", lambda fish, **_: makers.extend(fish))
    load_as_lerobot(RELEASE / "envhub" / "env.py", use_async_envs=True)
    code = "import sys, cloudpickle; print(cloudpickle.load(sys.stdin.buffer)().task)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=cloudpickle.dumps(makers[0]),
        capture_output=True,
        check=True,
    )
    assert done.stdout == b"AquaFish-v0\n"


def test_the_minari_dataset_has_the_fields_that_minari_asks_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("minari")
    out = tmp_path / "minari"
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(out))
    program = runpy.run_path(str(RELEASE / "minari.py"))
    program["copy_dataset"]("someone", "someone@example.org", out)
    held = json.loads((out / program["DATASET"] / "data" / "metadata.json").read_text())
    assert held["author"] == ["The AquaFish authors"]
    assert held["author_email"] == ["someone@example.org"]
    assert held["code_permalink"].startswith("https://github.com/someone/aquafish/blob/")
    assert held["code_permalink"].endswith("/examples/minari_dataset.py")
    assert {"algorithm_name", "description"} <= held.keys()
    committed = RELEASE.parent / "docs" / "results" / "minari" / program["DATASET"] / "data"
    before = json.loads((committed / "metadata.json").read_text())
    changed = {"author", "author_email", "code_permalink", "algorithm_name", "description"}
    assert {n: v for n, v in held.items() if n not in changed} == {
        n: v for n, v in before.items() if n not in changed
    }
