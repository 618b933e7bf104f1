"""Environments leave no memory, client or file behind."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads /proc")

# Each case has a process of its own: memory that other tests freed would hide a leak.
HEAD = """
import gc, json, os, sys
from pathlib import Path

import gymnasium as gym
import numpy as np

import aquafish_gym
from aquafish_gym.engines.bullet import world as bullet_world
from aquafish_gym.engines.packages import load_pybullet
from aquafish_gym.plans import AQUAFISH

engine, first, then = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
rng = np.random.default_rng(0)
GO = np.array([0.8, -0.3, 0.4], np.float32)


def resident():
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def connected():
    if engine != "pybullet":
        return 0
    bullet = load_pybullet()
    return sum(bullet.isConnected(client) for client in range(1024))


def measure(work):
    work(first)
    before, files = resident(), len(os.listdir("/proc/self/fd"))
    open_clients = connected()
    work(then)
    print(json.dumps({
        "bytes": resident() - before,
        "files": len(os.listdir("/proc/self/fd")) - files,
        "clients": connected() - open_clients,
        "idle": len(bullet_world._idle_clients),
        "connected": connected(),
    }))
"""

ENVIRONMENTS = """
def work(times):
    for _ in range(times):
        env = gym.make("AquaFish-v0", engine=engine)
        env.reset(seed=0)
        env.step(GO)
        env.close()


measure(work)
"""

DROPPED = ENVIRONMENTS.replace("env.close()", "del env")

MANY_AT_ONCE = """
def work(times):
    envs = [gym.make("AquaFish-v0", engine=engine) for _ in range(times)]
    for env in envs:
        env.reset(seed=0)
        env.step(GO)
    for env in envs:
        env.close()


measure(work)
"""


def left_behind(work: str, engine: str, first: int, then: int) -> dict[str, int]:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", HEAD + work, engine, str(first), str(then)],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, int] = json.loads(done.stdout)
    return found


def check(found: dict[str, int], megabytes: float = 5.0) -> None:
    assert found["bytes"] < megabytes * 1e6
    assert found["files"] == 0
    assert found["clients"] == 0


@pytest.mark.parametrize(
    ("work", "engine"),
    [
        (DROPPED, "numba"),
        pytest.param(ENVIRONMENTS, "pybullet", marks=pytest.mark.slow),
        pytest.param(DROPPED, "pybullet", marks=pytest.mark.slow),
    ],
    ids=["dropped, numba", "closed, pybullet", "dropped, pybullet"],
)
def test_a_hundred_environments_leave_nothing(work: str, engine: str) -> None:
    found = left_behind(work, engine, 20, 100)
    check(found, megabytes=2.5)
    # One after another, they shared one client, and it is free again.
    assert found["connected"] == found["idle"] == (engine == "pybullet")


@pytest.mark.slow
@pytest.mark.pybullet
def test_clients_of_many_at_once_are_all_given_back() -> None:
    found = left_behind(MANY_AT_ONCE, "pybullet", 20, 20)
    check(found)
    assert found["connected"] == found["idle"] == 20
