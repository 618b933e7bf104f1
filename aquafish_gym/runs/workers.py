"""Executors of jobs: worker processes of this machine, or a dask cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from typing import Any

from aquafish_gym.utils.validation import EngineUnavailableError, InvalidArgumentError, integer

MOST_WORKERS = 1024
_PATIENCE = 20.0  # s for a scheduler to answer
# In a worker, numerical libraries start no threads of their own, and Python imports nothing from
# the current folder.
_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "PYTHONSAFEPATH": "1",
}
_CONTEXT = multiprocessing.get_context("spawn")


class WorkerDiedError(RuntimeError):
    """The process that ran a call has died."""


def check_workers(count: int | None, scheduler: str | None) -> None:
    """Refuse a number out of range, or an address without its protocol."""
    if count is not None:
        integer("workers", count, 1, MOST_WORKERS)
    if scheduler is not None and not re.fullmatch(r"[a-z]+://\S+", scheduler):
        raise InvalidArgumentError(
            "scheduler must be the address of a dask scheduler, such as tcp://host:8786; got "
            f"{scheduler!r}"
        )


@contextmanager
def workers(count: int | None = None, scheduler: str | None = None) -> Iterator[Executor]:
    """Yield an executor, whose processes are killed if the block ends by an error or Ctrl-C.

    It has ``count`` processes of this machine, by default one for each core that this process may
    use; or the workers of the dask scheduler at an address such as ``tcp://host:8786``. Those need
    this package, but no shared file system.

    Raises
    ------
    InvalidArgumentError, EngineUnavailableError
        If the scheduler does not answer or has no workers, or dask is not installed.
    """
    check_workers(count, scheduler)
    if scheduler is not None:
        with _cluster(scheduler) as cluster:
            yield cluster
        return
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    executor = ProcessExecutor(count or cores or 1)
    try:
        yield executor
        executor.shutdown()
    finally:
        executor.kill()


class ProcessExecutor(Executor):
    """An executor of at most ``count`` processes; one that dies fails only its own call.

    The standard library's pool fails as a whole when one of its processes dies. So each process is
    a pool of one, fed by a thread, and is replaced when it dies. Processes start as calls come,
    ignore Ctrl-C, which their parent handles, and end when their parent does.
    """

    def __init__(self, count: int) -> None:
        self._threads = ThreadPoolExecutor(count, initializer=_block_interrupts)
        self._own = threading.local()  # a thread's pool
        self._pools: dict[ProcessPoolExecutor, int] = {}  # with the id of its process
        self._lock = threading.Lock()
        self._killed = False

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a function of a module in a process; a death is a :class:`WorkerDiedError`."""
        return self._threads.submit(self._call, fn, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more calls; stop the processes once those that were taken have ended."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            for pool in list(self._pools):
                pool.shutdown()

    def kill(self) -> None:
        """Kill all processes now; calls that have not ended fail."""
        with self._lock:
            self._killed = True
            for process in self._pools.values():
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
        self.shutdown(cancel_futures=True)

    def _call(self, fn: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        try:
            pool = getattr(self._own, "pool", None) or self._start()
            return pool.submit(fn, *args, **kwargs).result()
        except BrokenProcessPool:
            with self._lock:
                self._pools.pop(self._own.pool, None)
            self._own.pool.shutdown()
            self._own.pool = None
            raise WorkerDiedError("its process died") from None

    def _start(self) -> ProcessPoolExecutor:
        pool = self._own.pool = ProcessPoolExecutor(1, _CONTEXT, initializer=_die_with_parent)
        with self._lock, _environment():
            process = pool.submit(os.getpid)  # which starts it
        number = process.result()
        with self._lock:
            self._pools[pool] = number
            if self._killed:
                os.kill(number, signal.SIGKILL)
        return pool


def _block_interrupts() -> None:
    """Keep Ctrl-C from this thread, and from the processes that it starts."""
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])


def _die_with_parent() -> None:
    """Have this process end when its parent does, even by SIGKILL."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _environment() -> Iterator[None]:
    """Start processes with the environment of workers."""
    before = {name: os.environ[name] for name in _ENVIRONMENT if name in os.environ}
    os.environ.update(_ENVIRONMENT)
    try:
        yield
    finally:
        for name in _ENVIRONMENT:
            del os.environ[name]
        os.environ.update(before)


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        import distributed
    except ImportError as error:
        raise EngineUnavailableError(
            f'a scheduler needs dask, which is not installed here ({error}): the extra "cluster" '
            "of this package brings it"
        ) from None
    # distributed logs whole stacks about workers that die; the runner reports them in a line.
    for name in [*logging.root.manager.loggerDict]:
        if name.startswith("distributed"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    connect: Any = distributed.Client
    try:
        client = connect(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InvalidArgumentError(
            f"scheduler: no answer at {address} ({type(error).__name__})"
        ) from None
    try:
        try:
            client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError:
            raise InvalidArgumentError(f"scheduler: {address} has no workers") from None
        yield client.get_executor(pure=False)
    finally:
        with suppress(OSError, TimeoutError):
            client.close(timeout=_PATIENCE)


@contextmanager
def interrupts() -> Iterator[None]:
    """Have SIGTERM raise KeyboardInterrupt, as Ctrl-C does; outside the main thread, do nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
