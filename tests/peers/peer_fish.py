"""A pytest plugin with which other projects' tests run on AquaFish; see ``test_peers.py``.

``PEER_IDS`` lists ids that become AquaFish-v0 in Gymnasium's registry: ``NAME``, or
``NAME=discrete`` with Gymnasium's DiscretizeAction of two bins, for tests of Discrete actions.
``PEER_EXPECTED`` is a JSON file from the end of a test's name to the reason why it must fail: a
test that passes in spite of it fails the run, unless the reason begins with "by chance".
``PEER_AT_LEAST`` is the number of tests in which a fish must have been made or reset; with fewer
the run fails, too.
"""

from __future__ import annotations

import functools
import json
import multiprocessing
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
from gymnasium.wrappers import DiscretizeAction

import aquafish_gym

#: Further environments that Gymnasium's own collection of specifications meets.
VARIANTS: dict[str, dict[str, Any]] = {
    "AquaFishBullet-v0": {"engine": "pybullet"},
    "AquaFishLate-v0": {"damage": "left_pectoral:delay=0.4; gyro:noise=0.05"},
    "AquaFishReactive-v0": {"reactive": True, "current": (0.5, 0.0, 0.0), "observe_fins": True},
    "AquaFishSevere-v0": {"damage": "random:severe@2-8", "frame_skip": 10},
}
LONGEST = 100  # steps of an episode where tests expect a short one
calls = 0
took_part: set[str] = set()


def install() -> None:
    """Register the fish under Gymnasium's own package, and as other environments."""
    sys.modules["gymnasium.envs.aquafish"] = aquafish_gym
    places = {
        "entry_point": "gymnasium.envs.aquafish:AquaFishEnv",
        "vector_entry_point": "gymnasium.envs.aquafish:AquaFishVectorEnv",
    }
    for name in aquafish_gym.IDS:
        old = gym.registry[name]
        gym.registry[name] = replace(old, kwargs={"engine": "numba", **old.kwargs}, **places)
    fish = gym.registry["AquaFish-v0"]
    for name, kwargs in VARIANTS.items():
        gym.registry[name] = replace(fish, id=name, kwargs={"engine": "numba", **kwargs})
    for entry in filter(None, os.environ["PEER_IDS"].split(",")):
        name, _, kind = entry.partition("=")
        limit = gym.registry[name].max_episode_steps if name in gym.registry else None
        gym.registry[name] = replace(
            fish,
            id=name,
            additional_wrappers=(DiscretizeAction.wrapper_spec(bins=2),) if kind else (),
            max_episode_steps=None if limit is None else min(limit, LONGEST),
        )
    for kind in (aquafish_gym.AquaFishEnv, aquafish_gym.AquaFishVectorEnv):
        for name in ("__init__", "reset"):
            setattr(kind, name, counted(getattr(kind, name)))
    if "forkserver" in multiprocessing.get_all_start_methods():
        multiprocessing.set_forkserver_preload(["__main__", "aquafish_gym", __name__])


def counted(method: Any) -> Any:
    """Return a method that counts its calls."""

    @functools.wraps(method)
    def call(*arguments: Any, **options: Any) -> Any:
        global calls
        calls += 1
        return method(*arguments, **options)

    return call


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Expect the failures that are listed."""
    expected = json.loads(Path(os.environ["PEER_EXPECTED"]).read_text())
    for item in items:
        for end, reason in expected.items():
            if item.nodeid.endswith(end) or item.nodeid.partition("[")[0].endswith(end):
                strict = not reason.startswith("by chance")
                item.add_marker(pytest.mark.xfail(reason=reason, strict=strict))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Any:
    """Note whether a fish takes part in a test."""
    before = calls
    try:
        return (yield)
    finally:
        if calls > before:
            took_part.add(item.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail if the fish took part in too few tests."""
    if len(took_part) < int(os.environ["PEER_AT_LEAST"]):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how many tests the fish took part in."""
    terminalreporter.write_line(f"took part: {len(took_part)}")


install()
