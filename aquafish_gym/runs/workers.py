"""Processes that do jobs one at a time, may die at any moment, and never outlive their parent."""

from __future__ import annotations

import fcntl
import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

Job = TypeVar("Job")
Kind = Literal["began", "said", "done", "died", "failed"]
TRIES = 3  # how often a job is begun, if the processes that do it die
_WATCH = 0.2  # s between a worker's looks for its parent
_PATIENCE = 15.0  # s for the workers of a killed command to notice
# Numerical libraries that would start threads of their own in each of as many processes.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Event(Generic[Job]):
    """What happened to a job.

    Attributes
    ----------
    kind
        "began"; "said" something; is "done"; its process "died" and it will be begun again; or it
        "failed" for good, by an error or because its processes died too often.
    job
        The job.
    content
        What was said, or why it failed.
    """

    kind: Kind
    job: Job
    content: Any = None


@dataclass
class _Worker(Generic[Job]):
    process: BaseProcess
    connection: Connection
    job: Job | None = None


def do_jobs(
    jobs: Sequence[Job],
    work: Callable[[Job], Iterable[Any]],
    count: int,
    guard: Path,
    tries: int = TRIES,
) -> Generator[Event[Job], None, None]:
    """Do jobs in ``count`` processes, in their order, and yield what happens.

    A process that dies is replaced, and its job is begun again, ``tries`` times in all. When this
    iterator is closed, or its reader is interrupted, the processes are stopped.

    Parameters
    ----------
    jobs
        Anything that can be pickled and hashed.
    work
        Does a job and yields what there is to say; a function of a module, found by its name.
    count
        Processes at most.
    guard
        A file that the workers hold as long as they live; see ``wait_for_orphans``.
    tries
        See above.
    """
    waiting = list(jobs)
    count = min(count, len(waiting))
    begun: dict[Job, int] = {}
    workers: list[_Worker[Job]] = []
    try:
        while waiting or any(worker.job is not None for worker in workers):
            while waiting and len(workers) < count:
                workers.append(_start(work, guard))
            for worker in workers:
                if worker.job is None and waiting:
                    new = worker.job = waiting.pop(0)
                    begun[new] = begun.get(new, 0) + 1
                    with suppress(OSError):  # it has died: the next lines find out
                        worker.connection.send(new)
                    yield Event("began", new)
            ready = wait([worker.connection for worker in workers if worker.job is not None])
            for worker in [worker for worker in workers if worker.connection in ready]:
                job = worker.job
                if job is None:
                    continue
                try:
                    kind, content = worker.connection.recv()
                except (EOFError, OSError):
                    workers.remove(worker)
                    reason = _cause_of_death(worker.process)
                    if begun[job] < tries:
                        waiting.insert(0, job)
                        yield Event("died", job, reason)
                    else:
                        yield Event("failed", job, f"{reason}, {tries} times")
                    continue
                if kind in ("done", "failed"):
                    worker.job = None
                yield Event(kind, job, content)
    finally:
        _stop(workers)


def wait_for_orphans(guard: Path) -> bool:
    """Wait until no worker of an earlier command holds the guard; return whether none does.

    A worker looks for its parent several times a second, so this takes a moment at most.
    """
    give_up = time.monotonic() + _PATIENCE
    with guard.open("a") as file:
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                if time.monotonic() > give_up:
                    return False
                time.sleep(0.05)
            else:
                return True


def _start(work: Callable[[Job], Iterable[Any]], guard: Path) -> _Worker[Job]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(
        target=_serve, args=(theirs, work, str(guard), os.getpid()), daemon=True
    )
    with _quiet_and_single_threaded():
        process.start()
    theirs.close()
    return _Worker(process, ours)


@contextmanager
def _quiet_and_single_threaded() -> Iterator[None]:
    """Let processes begin deaf to Ctrl-C, which their parent answers, and with one thread.

    The signal is blocked rather than ignored: one that comes now reaches the parent afterwards.
    """
    before = {name: os.environ.get(name) for name in _THREADS}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        os.environ.update(dict.fromkeys(_THREADS, "1"))
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _stop(workers: list[_Worker[Job]]) -> None:
    for worker in workers:
        worker.connection.close()
        worker.process.terminate()
    for worker in workers:
        worker.process.join(1.0)
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()


def _cause_of_death(process: BaseProcess) -> str:
    process.join(5.0)
    code = process.exitcode
    if code is not None and code < 0:
        return f"its process was killed by {signal.Signals(-code).name}"
    return f"its process ended with code {code}"


def _serve(
    connection: Connection, work: Callable[[Job], Iterable[Any]], guard: str, parent: int
) -> None:
    """Be a worker: do the jobs that come until the pipe is closed."""
    threading.Thread(target=_leave_with, args=(parent,), daemon=True).start()
    with Path(guard).open("a") as held:
        fcntl.flock(held, fcntl.LOCK_SH)
        while True:
            try:
                job = connection.recv()
            except EOFError:
                return
            try:
                for content in work(job):
                    connection.send(("said", content))
            except BrokenPipeError:
                return
            except Exception as error:
                place = traceback.extract_tb(error.__traceback__)[-1]
                where = f"{Path(place.filename).name}, line {place.lineno}"
                connection.send(("failed", f"{type(error).__name__}: {error} ({where})"))
            else:
                connection.send(("done", None))


def _leave_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH)
    os._exit(1)
