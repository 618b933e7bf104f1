"""Executors of jobs: worker processes of this machine, or a dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any

from aquafish_gym.utils.validation import (
    EngineUnavailableError,
    InvalidArgumentError,
    install_advice,
    integer,
)

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


def check_workers(count: int | None, scheduler: str | None) -> None:
    """Refuse a number out of range, an address without its protocol, and both."""
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
    context = multiprocessing.get_context("spawn")
    reader, writer = context.Pipe(duplex=False)
    pool = _Pool(count or cores or 1, context, _exit_with, (reader,))
    try:
        yield pool
        pool.shutdown()
    finally:
        writer.close()  # ends the workers
        pool.shutdown(cancel_futures=True)
        reader.close()


class _Pool(ProcessPoolExecutor):
    """Processes with the environment of workers, which leave Ctrl-C to their parent."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        before = {name: os.environ[name] for name in _ENVIRONMENT if name in os.environ}
        os.environ.update(_ENVIRONMENT)
        # Processes that this call starts inherit the mask.
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            return super().submit(fn, *args, **kwargs)
        finally:
            for name in _ENVIRONMENT:
                del os.environ[name]
            os.environ.update(before)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])


def _exit_with(pipe: Connection) -> None:
    """Have this process end when its parent closes the pipe, or dies, even by SIGKILL."""

    def watch() -> None:
        try:
            pipe.recv()
        except EOFError:
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError as error:
        raise EngineUnavailableError(
            f"a scheduler needs dask, which is not installed here ({error}): "
            f"{install_advice('cluster')}"
        ) from None
    try:
        client: Any = Client(address, timeout=_PATIENCE, set_as_default=False)
        client.wait_for_workers(1, timeout=_PATIENCE)
    except (OSError, ValueError, TypeError) as error:  # TimeoutError is an OSError
        raise InvalidArgumentError(
            f"scheduler: no worker answers at {address} ({type(error).__name__})"
        ) from None
    with client:
        yield client.get_executor(pure=False)
