"""Jobs without worker processes, each of which would import and compile everything by itself.

``tests/runs/test_jobs.py`` tests the processes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from typing import Any
from unittest import mock


class _Here:
    """An executor that has run a job when ``submit`` returns."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(fn(*args))
        return future

    def check(self, say: Callable[[str], None]) -> None:
        """Nothing can have died."""


@contextmanager
def _here(*_: Any) -> Iterator[_Here]:
    yield _Here()


def jobs_in_process() -> Any:
    """Return a context, or decorator, in which ``run_jobs`` runs jobs in this process."""
    return mock.patch("aquafish_gym.runs.jobs.workers", _here)
