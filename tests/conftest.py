"""Settings of all tests: what needs PyBullet is left out where it has no wheel (Python 3.12 and
later, macOS), no example is too slow on a shared machine, and kernels compile once."""

from __future__ import annotations

import gc
import hashlib
import os
import signal
import subprocess
import sys
from importlib.util import find_spec
from typing import Any

import pytest
from filelock import lock_descriptor
from hypothesis import settings

from tests.skips import pytest_make_collect_report, pytest_runtest_makereport  # noqa: F401

# A shared machine may stall any example; time is no property under test here.
settings.register_profile("shared-machine", deadline=None, max_examples=40)
settings.load_profile("shared-machine")

# A parent may have had this process ignore Ctrl-C, which some tests send.
signal.signal(signal.SIGINT, signal.default_int_handler)


# What is imported is no garbage, and looking for some in a million objects takes seconds.
gc.disable()


def pytest_collection_finish() -> None:
    """Look for garbage among what tests make."""
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what needs PyBullet where it is not installed: marked tests, and parameters."""
    if find_spec("pybullet") is not None:
        return
    absent = pytest.mark.skip(reason="PyBullet is not installed")
    for item in items:
        call = getattr(item, "callspec", None)
        given = [] if call is None else [one for one in call.params.values() if type(one) is str]
        if item.get_closest_marker("pybullet") or "pybullet" in given:
            item.add_marker(absent)


# What compiles the kernels that the tests use, in a process for each type of number: kernels of
# one type share most of their functions, which are compiled once in a process.
_LANES = """
import numpy as np
from aquafish_gym import Morphology, simulate
from gait import Controller, scores
command = [0.1, 0.1, 0.5]
for commands, reactive in (([command], False), ([[command] * 2], False), ([command], True)):
    simulate(None, commands, steps=4, engine="numba", dtype="{dtype}", reactive=reactive)
network = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, Morphology.nominal(), seed=0)
scores([network], None, seconds=0.1, dtype="{dtype}")
"""
_ONE_BY_ONE = """
from importlib.util import find_spec
import gymnasium, aquafish_gym
from eea import PaperConfig, estimate_morphology
for engine in ("numba", "pybullet") if find_spec("pybullet") else ("numba",):
    for reactive in (False, True):
        env = gymnasium.make("AquaFish-v0", engine=engine, reactive=reactive)
        env.reset(seed=0)
        env.step(env.action_space.sample())
estimate_morphology(config=PaperConfig(rounds=2, steps=16), target_engine="numba")
"""
_KERNELS = (_LANES.format(dtype="float32"), _LANES.format(dtype="float64"), _ONE_BY_ONE)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile before processes share the tests, so that none waits for another's kernels."""
    if session.config.getoption("numprocesses", None):
        processes = [subprocess.Popen([sys.executable, "-c", code]) for code in _KERNELS]
        assert [process.wait() for process in processes] == [0] * len(processes)


@pytest.fixture(scope="session", autouse=True)
def _kernels_compile_once(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Let one of the parallel test processes compile a kernel, and the others wait for its cache.

    Compiling takes most of a cold run's time, and numba has no lock across processes.
    """
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    from numba.core.dispatcher import Dispatcher

    compile_now = Dispatcher.compile
    place = tmp_path_factory.getbasetemp().parent / "kernels"
    place.mkdir(exist_ok=True)
    held: set[str] = set()  # a test compiles a kernel within the compilation of the same

    def compile_alone(self: Any, signature: Any) -> Any:
        name = f"{self.py_func.__module__}.{self.py_func.__qualname__}{signature}"
        if name in held:
            return compile_now(self, signature)
        held.add(name)
        try:
            with (place / hashlib.sha256(name.encode()).hexdigest()).open("w") as lock:
                lock_descriptor(lock.fileno())
                return compile_now(self, signature)
        finally:
            held.discard(name)

    Dispatcher.compile = compile_alone
