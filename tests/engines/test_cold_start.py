"""On a machine that has compiled nothing yet: it says so at once, and Ctrl-C ends it."""

from __future__ import annotations

import ctypes
import functools
import os
import pathlib
import signal
import subprocess
import sys
import time
import types
from typing import Any

import numba
import pytest
from numba.core import event
from numba.core.caching import IndexDataCacheFile

from aquafish_gym.physics import compiling

NOTICE = f"{compiling.NOTICE}\n"
# Enough robots that the engine takes several threads.
SWIM = """
import numpy as np, aquafish_gym
aquafish_gym.simulate(np.full((4000, 9), 0.3), (0.1, 0.1, 0.5), steps=512, threads=4)
"""
PREPARE = """
import aquafish_gym, multiprocessing
from aquafish_gym.engines.compiled.kernel import compile_kernel
from aquafish_gym.engines.compiled.policies import hold
from aquafish_gym.engines.compiled.lanes import lane_width
import numpy as np

def misses(_):
    aquafish_gym.simulate(None, (0.1, 0.1, 0.5), steps=4)
    kernel = compile_kernel(hold, lane_width(np.float32), False, None, False)
    return sum(kernel.stats.cache_misses.values())

if __name__ == "__main__":
    found = misses(0)
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        print(found, *pool.map(misses, range(2)))
"""


@pytest.fixture
def cold(tmp_path: pathlib.Path) -> dict[str, str]:
    """Return the environment of a process that finds nothing compiled."""
    return {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}


def test_ctrl_c_ends_a_cold_compile_within_seconds(cold: dict[str, str]) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", SWIM], env=cold, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == NOTICE
        time.sleep(2)
        assert process.poll() is None, "it should still compile"
        begun = time.monotonic()
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read()
        process.wait()
    assert process.returncode == -signal.SIGINT
    assert rest.rstrip().endswith("KeyboardInterrupt")
    assert time.monotonic() - begun < 20  # 2 s on an idle machine; its pool took 40


def test_no_ctrl_c_is_lost_in_llvms_callbacks() -> None:
    """ctypes drops what is raised in a callback, and LLVM makes some while it generates code."""
    dropping = ctypes.CFUNCTYPE(None)(functools.partial(signal.raise_signal, signal.SIGINT))
    compiling._listen()
    usual = sys.unraisablehook
    begun = {"dispatcher": types.SimpleNamespace(py_func=None)}

    def compile_something() -> None:
        with event.trigger_event("numba:compile", begun):
            dropping()
            time.sleep(20.0)

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        compile_something()
    assert time.monotonic() - start < 10  # within the sleep
    assert sys.unraisablehook is usual


@pytest.mark.slow  # it compiles kernels of its own
def test_what_one_process_prepared_its_workers_find(
    cold: dict[str, str], tmp_path: pathlib.Path
) -> None:
    script = tmp_path / "prepare.py"
    script.write_text(PREPARE)
    done = subprocess.run(
        [sys.executable, str(script)], env=cold, capture_output=True, text=True, check=True
    )
    assert done.stdout == "1 0 0\n"
    assert done.stderr == NOTICE, "printed once, and not by the workers"


def test_kernels_that_two_processes_compile_at_once_are_not_mixed_up(
    monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def kernel(number: int) -> Any:
        return compiling.compiled(lambda: number)

    save = IndexDataCacheFile._save_data
    first, second = kernel(1), kernel(2)

    def save_after_second(cache: IndexDataCacheFile, name: str, data: Any) -> None:
        monkeypatch.setattr(IndexDataCacheFile, "_save_data", save)
        assert second() == 2
        save(cache, name, data)

    with monkeypatch.context() as race:  # neither sees what the other has added to an index
        race.setattr(IndexDataCacheFile, "_load_index", lambda _: {})
        race.setattr(IndexDataCacheFile, "_save_data", save_after_second)
        assert first() == 1
    found = [kernel(1), kernel(2)]  # as in a new process
    assert [one() for one in found] == [1, 2]
    assert all(one.stats.cache_hits for one in found)
