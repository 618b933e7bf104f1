"""Where jobs are done: processes of this machine, or a dask cluster."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from typing import Any

from aquafish_gym.runs.processes import ProcessExecutor
from aquafish_gym.utils.validation import EngineUnavailableError, InvalidArgumentError, integer

MOST_WORKERS = 1024
_PATIENCE = 20.0  # s for a scheduler to answer


@contextmanager
def workers(count: int | None = None, scheduler: str | None = None) -> Iterator[Executor]:
    """Give an executor; when left by an error or Ctrl-C, its processes are stopped at once.

    It has ``count`` processes of this machine, by default one for each core that this process may
    use; or the workers, which need this package but no shared file system, of the dask scheduler at
    an address such as ``tcp://host:8786``.

    Raises
    ------
    InvalidArgumentError, EngineUnavailableError
        If nobody answers at the address or it has no workers, or dask is not installed.
    """
    if scheduler is not None:
        with _cluster(scheduler) as cluster:
            yield cluster
        return
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    number = integer("workers", count if count is not None else (cores or 1), 1, MOST_WORKERS)
    executor = ProcessExecutor(number)
    try:
        yield executor
        executor.shutdown()
    finally:
        executor.kill()


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        import distributed
    except ImportError as error:
        raise EngineUnavailableError(
            f'a scheduler needs dask, which is not installed here ({error}): the extra "cluster" '
            "of this package brings it"
        ) from None
    # Its own words on workers that die, whole stacks, are no news: the runner says what matters.
    for name in [*logging.root.manager.loggerDict]:
        if name.startswith("distributed"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        connect: Any = distributed.Client
        client = connect(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InvalidArgumentError(
            f"scheduler must be the address of a dask scheduler, such as tcp://host:8786; nobody "
            f"answers at {address!r} ({type(error).__name__})"
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
