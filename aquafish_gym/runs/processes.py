"""Processes of this machine as an executor: each may die or stand still, and only its job does.

The standard library's ``ProcessPoolExecutor`` fails as a whole when one of its processes dies, and
waits for ever for one that is stopped. Here a process that dies is replaced, and its call ends with
:class:`WorkerDiedError`. One that neither sends its beat nor uses processor time for ``silence``
looks in a row, one a second, stands still, as after SIGSTOP, and is killed. A compiler that holds
the interpreter for a minute sends no beat but uses time; one that waits for a disk uses none but
beats; on a crowded machine either comes within 20 s. Looks are counted rather than time, so that a
parent that was itself stopped, or slept with its machine, finds nobody silent when it wakes.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

SILENCE = 20  # looks
_LOOK = 1.0  # s between the looks, and between the beats
# Numerical libraries that would start threads of their own in each of as many processes.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_CONTEXT = multiprocessing.get_context("spawn")

Hear = Callable[["Future[Any]", str, float], None]
_Message = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]


def _ignore(*_: object) -> None:
    """Hear what nobody is told."""


class WorkerDiedError(RuntimeError):
    """The process that did a call has died, or was killed because it stood still."""


@dataclass
class _Worker:
    process: BaseProcess
    connection: Connection
    busy: bool = False
    looks: int = 0  # without a sign of life, while it was busy
    used: float | None = None  # ticks of processor time at the last look
    stood_still: bool = False


class ProcessExecutor(Executor):
    """An executor of at most ``count`` spawned processes, one call each at a time.

    They begin as calls come, so that a first call has one of them, and can compile what all of
    them then find compiled. They do not hear Ctrl-C, which their parent answers, have one thread
    each for numerics, and end when their parent does, even by SIGKILL.
    """

    def __init__(self, count: int, silence: int = SILENCE) -> None:
        self._count = count
        self._silence = silence
        self._calls: queue.SimpleQueue[tuple[Future[Any], _Message] | None] = queue.SimpleQueue()
        self._tell: Hear = _ignore
        self._lock = threading.Lock()
        self._threads: list[threading.Thread] = []
        self._workers: list[_Worker] = []
        self._closed = self._killed = False
        self._over = threading.Event()

    def hear(self, hear: Hear | None) -> None:
        """Have what calls :func:`say`, and "" when one begins, told to it, in other threads."""
        self._tell = hear or _ignore

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have a module's function called in a process; see ``concurrent.futures.Executor``."""
        future: Future[Any] = Future()
        with self._lock:
            if self._closed:
                raise RuntimeError("cannot submit a call to an executor that was shut down")
            self._calls.put((future, (fn, args, kwargs)))
            if len(self._threads) < self._count:
                if not self._threads:
                    threading.Thread(target=self._look_after, daemon=True).start()
                thread = threading.Thread(target=self._attend, daemon=True)
                self._threads.append(thread)
                thread.start()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more calls and, once those that were taken have ended, stop the processes."""
        with self._lock:
            self._closed = True
            if cancel_futures:
                self._cancel_waiting()
            for _ in self._threads:  # more than enough of these do no harm
                self._calls.put(None)
        if wait:
            for thread in self._threads:
                thread.join()
            self._over.set()

    def kill(self) -> None:
        """End all processes now; calls that have not ended end with WorkerDiedError."""
        with self._lock:
            self._killed = True
            self._cancel_waiting()
            for worker in self._workers:
                worker.process.kill()
        self.shutdown()

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            self.kill()
        self.shutdown()

    def _cancel_waiting(self) -> None:
        while True:
            try:
                call = self._calls.get_nowait()
            except queue.Empty:
                return
            if call is not None:
                call[0].cancel()

    def _attend(self) -> None:
        """Have calls done in one process after another, in a thread of its own."""
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        worker: _Worker | None = None
        while (call := self._calls.get()) is not None:
            if call[0].set_running_or_notify_cancel():
                worker = self._do(*call, worker)
        if worker is not None:
            self._end(worker)

    def _do(self, future: Future[Any], message: _Message, worker: _Worker | None) -> _Worker | None:
        """Have a call done, by a new worker if there is none; return the worker if it lives."""
        try:
            if worker is not None and not worker.process.is_alive():  # it died while it was idle
                self._end(worker)
                worker = None
            worker = worker or self._begin()
            worker.looks, worker.busy = 0, True
            try:
                result, error = self._converse(future, message, worker)
            finally:
                worker.busy = False
        except (EOFError, ConnectionError):
            assert worker is not None
            self._end(worker)
            result, error = None, WorkerDiedError(_cause_of_death(worker))
            worker = None
        except BaseException as caught:
            result, error = None, caught
        if error is None:
            future.set_result(result)
        else:
            future.set_exception(error)
        return worker

    def _converse(
        self, future: Future[Any], message: _Message, worker: _Worker
    ) -> tuple[Any, BaseException | None]:
        """Return the call's result and what it raised."""
        worker.connection.send(message)
        self._tell(future, "", 0.0)
        while True:
            kind, *content = worker.connection.recv()
            worker.looks = 0
            if kind == "said":
                self._tell(future, *content)
            elif kind != "beat":
                return (content[0], None) if kind == "done" else (None, content[0])

    def _begin(self) -> _Worker:
        ours, theirs = _CONTEXT.Pipe()
        process = _CONTEXT.Process(target=_serve, args=(theirs,), daemon=True)
        with self._lock, theirs:
            if self._killed:
                raise WorkerDiedError("it was not begun any more")
            with _single_threaded():
                process.start()
            worker = _Worker(process, ours)
            self._workers.append(worker)
        return worker

    def _end(self, worker: _Worker) -> None:
        """Stop a process, which has nothing to lose."""
        worker.process.kill()
        worker.process.join()
        worker.connection.close()
        with self._lock:
            self._workers.remove(worker)

    def _look_after(self) -> None:
        """Kill what stands still, in a thread of its own."""
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        while not self._over.wait(_LOOK):
            with self._lock:
                for worker in filter(lambda one: one.busy, self._workers):
                    used = _processor_time(worker.process.pid)
                    worker.looks = worker.looks + 1 if used == worker.used else 0
                    worker.used = used
                    if worker.looks >= self._silence:
                        worker.stood_still = True
                        worker.process.kill()


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Let processes begin with one thread for numerics."""
    before = {name: os.environ[name] for name in _THREADS if name in os.environ}
    try:
        os.environ.update(dict.fromkeys(_THREADS, "1"))
        yield
    finally:
        for name in _THREADS:
            os.environ.pop(name, None)
        os.environ.update(before)


def _processor_time(process: int | None) -> float | None:
    """Return the ticks that a process has used; ``None`` where nobody says, as without /proc."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return float(fields[11]) + float(fields[12])  # utime and stime, proc(5)


def _cause_of_death(worker: _Worker) -> str:
    if worker.stood_still:
        return "its process stood still and was killed"
    code = worker.process.exitcode
    if code is not None and code < 0:
        return f"its process was killed by {signal.Signals(-code).name}"
    return f"its process ended with code {code}"


# In a worker: how to say something to the parent. Elsewhere nobody listens.
_said: Callable[[str, float], None] | None = None


def say(text: str, share: float) -> None:
    """Say from within a call how far it is; ``share`` of its work in [0, 1] is done."""
    if _said is not None:
        _said(text, share)


def _serve(connection: Connection) -> None:
    """Be a worker: do the calls that come until the pipe is closed, or nobody hears the beat."""
    global _said
    sending = threading.Lock()

    def send(*message: Any) -> None:
        with sending:
            connection.send(message)

    def beat() -> None:
        with suppress(OSError):
            while True:
                time.sleep(_LOOK)
                send("beat")
        os._exit(1)  # nobody listens: the parent is no more

    threading.Thread(target=beat, daemon=True).start()
    _said = lambda text, share: send("said", text, share)  # noqa: E731
    while True:
        answer: tuple[str, Any]
        try:
            function, args, kwargs = connection.recv()
        except EOFError:
            return
        except BaseException as error:  # such as a function that this process cannot find
            answer = ("raised", error)
        else:
            try:
                answer = ("done", function(*args, **kwargs))
            except BaseException as error:
                answer = ("raised", error)
        try:
            send(*answer)
        except OSError:
            return
        except Exception as error:  # it cannot be pickled
            send("raised", RuntimeError(f"{type(error).__name__}: {error}"))
