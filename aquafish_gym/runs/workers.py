"""Executors of jobs: worker processes of this machine, or a dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any, Protocol

from aquafish_gym.engines.packages import available_cores
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    integer,
)

MOST_WORKERS = 1024
POLL_SECONDS = 1.0
SAID_SECONDS = 15.0  # the silence of a worker process is then reported
# A silent worker process is then killed. One that compiles is silent, too: for a minute or more
# where the machine is busy.
KILLED_SECONDS = 300.0
# Workers run numerical libraries on one thread, and import nothing from the current folder.
_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "PYTHONSAFEPATH": "1",
}


def check_workers(count: int | None, scheduler: str | None) -> None:
    """Raise for a number out of range, an address without protocol, or both arguments."""
    if count is not None and scheduler is not None:
        raise InvalidArgumentError(
            f"workers has no effect with a scheduler, whose workers are used; got {count}"
        )
    if count is not None:
        integer("workers", count, 1, MOST_WORKERS)
    if scheduler is not None and "://" not in scheduler:
        raise InvalidArgumentError(
            "scheduler must be the address of a dask scheduler, such as tcp://host:8786; got "
            f"{scheduler!r}"
        )


class Workers(Protocol):
    """Processes that run functions."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Run a function in one of the processes."""

    def check(self, say: Callable[[str], None]) -> None:
        """Check that the processes answer; call this about every ``POLL_SECONDS``.

        ``say`` is called with a sentence about a silent process. Raises OSError if none is left.
        """


@contextmanager
def workers(
    count: int | None = None,
    scheduler: str | None = None,
    work: Callable[..., Any] | None = None,
) -> Iterator[Workers]:
    """Yield workers, whose processes are killed if the block ends by an error or Ctrl-C.

    The workers are ``count`` processes of this machine, by default one for each core that this
    process may use, or the workers of a dask scheduler at an address such as ``tcp://host:8786``.
    A cluster's workers need the same versions of the libraries, and the same code of ``work``, the
    function that does the jobs; they need no shared file system.

    Raises
    ------
    InvalidArgumentError, EngineUnavailableError
        If the scheduler does not answer, has no workers or workers with other code, or dask is
        not installed.
    """
    check_workers(count, scheduler)
    if scheduler is not None:
        from aquafish_gym.runs.cluster import cluster_at

        with cluster_at(scheduler, work) as cluster:
            yield cluster
        return
    pool = _Pool(count or available_cores())
    try:
        yield pool
        pool.finish()
    finally:
        pool.kill()


class _Pool(ProcessPoolExecutor):
    """Worker processes; they leave Ctrl-C to their parent.

    Each sends a beat every second, so that a stopped process is noticed.
    """

    def __init__(self, count: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._closing = context.Pipe(duplex=False)
        self._beats = context.Pipe(duplex=False)
        super().__init__(count, context, _begin, (self._closing[0], self._beats[1]))
        self._futures: set[Future[Any]] = set()
        self._silent: dict[int, float] = {}  # process: seconds without a beat
        self._checked = time.monotonic()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        before = {name: os.environ[name] for name in _ENVIRONMENT if name in os.environ}
        os.environ.update(_ENVIRONMENT)
        try:
            with _interrupts_blocked():  # inherited by the processes that this call starts
                future = super().submit(fn, *args, **kwargs)
        finally:
            for name in _ENVIRONMENT:
                del os.environ[name]
            os.environ.update(before)
        self._futures.add(future)
        future.add_done_callback(self._futures.discard)
        return future

    def check(self, say: Callable[[str], None]) -> None:
        """Report a silent worker, and kill it after a longer silence; its jobs fail then."""
        now = time.monotonic()
        # This excludes time in which this process itself was stopped, for example by Ctrl-Z.
        passed = min(now - self._checked, 2 * POLL_SECONDS)
        self._checked = now
        beating = set()
        while self._beats[0].poll():
            beating.add(int.from_bytes(self._beats[0].recv_bytes(), "little"))
        processes = dict(getattr(self, "_processes", None) or {})
        for number, process in processes.items():
            before = self._silent.get(number, 0.0)
            silent = self._silent[number] = 0.0 if number in beating else before + passed
            if silent >= KILLED_SECONDS:
                process.kill()
            elif before < SAID_SECONDS <= silent:
                say(
                    f"worker process {number} has been silent for {SAID_SECONDS:.0f} s, as if it "
                    f"were stopped; it is killed after {KILLED_SECONDS:.0f} s"
                )

    def finish(self) -> None:
        """Wait for all submitted jobs."""
        while pending := set(self._futures):
            wait(pending, POLL_SECONDS)
            self.check(_say)

    def kill(self) -> None:
        """End all processes at once, even stopped ones."""
        for process in list((getattr(self, "_processes", None) or {}).values()):
            process.kill()
        self.shutdown(cancel_futures=True)
        for end in (*self._closing, *self._beats):
            end.close()


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C within a block of code; Windows cannot do this."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])


def _say(sentence: str) -> None:
    print(sentence, file=sys.stderr, flush=True)


def _begin(closing: Connection, beats: Connection) -> None:
    """End this process when its parent closes the pipe or dies; send beats until then."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Windows did not block Ctrl-C

    def watch() -> None:
        try:
            closing.recv()
        except EOFError:
            os._exit(1)

    def beat() -> None:
        number = os.getpid().to_bytes(8, "little")
        while True:
            beats.send_bytes(number)  # a write of so few bytes is atomic
            time.sleep(POLL_SECONDS)

    for task in (watch, beat):
        threading.Thread(target=task, daemon=True).start()
