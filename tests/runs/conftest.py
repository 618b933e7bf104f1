from __future__ import annotations

import signal

import pytest


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
