"""Rows of what a new process waits for: the import, the compiler, numba's cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack

from instruments.benchmarks.rows import Group, Row, Settings

_TIMED = "import time; start = time.perf_counter(); {}; print(time.perf_counter() - start)"
_FIRST_RESULT = "import aquafish_gym; aquafish_gym.simulate(None, (0.4, 0.4, 0.5), steps=1)"


def processes(_settings: Settings, cleanup: ExitStack) -> Group:
    """Return imports, and the time from the import to the first result, each in a new process."""
    folder = cleanup.enter_context(tempfile.TemporaryDirectory())
    compiled = ""

    def compile_and_run() -> float:
        nonlocal compiled
        compiled = tempfile.mkdtemp(dir=folder)
        return _run(_FIRST_RESULT, compiled)

    def load_and_run() -> float:
        return _run(_FIRST_RESULT, compiled)  # what the row before left

    gymnasium = _row("import gymnasium", "-", lambda: _run("import gymnasium"))
    first = _row("first run, compiling", "numba", compile_and_run, most_turns=1)
    return Group(
        "a new process: time",
        "process",
        [
            gymnasium,
            _row("import aquafish_gym", "-", lambda: _run("import aquafish_gym"), gymnasium),
            first,
            _row("first run, from cache", "numba", load_and_run, first),
        ],
    )


def _row(
    what: str,
    engine: str,
    call: Callable[[], float],
    against: Row | None = None,
    most_turns: int | None = None,
) -> Row:
    dtype = "-" if engine == "-" else "float32"
    return Row(what, engine, dtype, 1, 1, 1, call, against, as_time=True, own_clock=True,
               typical=True, most_turns=most_turns)  # fmt: skip


def _run(code: str, cache: str | None = None) -> float:
    """Run a line of Python in a new process and return how long it took there, in s."""
    environment = dict(os.environ) if cache is None else os.environ | {"NUMBA_CACHE_DIR": cache}
    done = subprocess.run(
        [sys.executable, "-c", _TIMED.format(code)],
        capture_output=True, text=True, check=True, env=environment,
    )  # fmt: skip
    return float(done.stdout)
