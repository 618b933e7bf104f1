from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.fixture(autouse=True)
def _in_time():
    """Fail rather than hang."""

    def hang(*_):
        pytest.fail("it hangs")

    before = signal.signal(signal.SIGALRM, hang)
    signal.alarm(120)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def start(tmp_path):
    """Start programs that find the tests' jobs, each in a session of its own; end what is left."""
    started = []

    def begin(code, *arguments, limits=None, session=True):
        script = tmp_path / f"program{len(started)}.py"
        script.write_text(f"import sys\nsys.path.insert(0, {str(HERE)!r})\n{code}")

        def limit():
            for name, value in (limits or {}).items():
                resource.setrlimit(getattr(resource, name), (value, value))

        program = subprocess.Popen(
            [sys.executable, str(script), *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=session,
            preexec_fn=limit,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
        started.append(program)
        return program

    yield begin
    for program in started:
        if program.poll() is None:
            program.kill()
        program.communicate()
