"""Workers of a dask cluster with the same code and versions as this process."""

from __future__ import annotations

import asyncio
import functools
import logging
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from typing import Any

from aquafish_gym.runs.code import code_hash
from aquafish_gym.runs.manifest import versions
from aquafish_gym.runs.version import PACKAGE
from aquafish_gym.utils.validation import (
    EngineUnavailableError,
    InvalidArgumentError,
    brief,
    install_advice,
)

ANSWER_SECONDS = 20.0  # limit for a scheduler to answer, and for workers to appear or to return


class OtherCodeError(RuntimeError):
    """A worker has other code or versions than the sender of its jobs."""


@functools.cache
def computing(work: Callable[..., Any] | None) -> dict[str, str]:
    """Return the versions, and the hash of a function's code, which determine its results."""
    found = versions()
    found["python"] = ".".join(found["python"].split(".")[:2])
    if work is not None:
        del found[PACKAGE]  # another commit may have the same code
        found["code"] = code_hash(work)
    return found


def difference(there: dict[str, str], here: dict[str, str]) -> str:
    """Return the first difference of two results of ``computing`` in words, or ""."""
    for name in [*here, *there]:
        if there.get(name) != here.get(name):
            return f"{name} {there.get(name)} there, {here.get(name)} here"
    return ""


def run_alike(
    here: dict[str, str], work: Callable[..., Any] | None, function: Callable[..., Any], *args: Any
) -> Any:
    """Run a function, or raise OtherCodeError on a worker that differs from the sender."""
    if found := difference(computing(work), here):
        raise OtherCodeError(f"the worker is another: {found}")
    return function(*args)


class _Cluster:
    """The workers of a connected client; see ``workers.Workers``."""

    def __init__(self, client: Any, executor: Executor, work: Callable[..., Any] | None) -> None:
        self._work = work
        self._client = client
        self._executor = executor
        self._beats: dict[str, float] = {}
        self._answered = time.monotonic()

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        return self._executor.submit(run_alike, computing(self._work), self._work, fn, *args)

    def check(self, say: Callable[[str], None]) -> None:  # noqa: ARG002
        """Raise OSError if no worker has answered for ``ANSWER_SECONDS``."""
        known = self._client.scheduler_info().get("workers", {})
        beats = {name: worker.get("last_seen", 0.0) for name, worker in known.items()}
        if self._client.status == "running" and any(
            self._beats.get(name) != beat for name, beat in beats.items()
        ):
            self._answered = time.monotonic()
        self._beats = beats
        if time.monotonic() - self._answered > ANSWER_SECONDS:
            raise OSError(
                f"the workers have gone: none has answered for {ANSWER_SECONDS:.0f} s; the same "
                "command resumes"
            )


@contextmanager
def cluster_at(address: str, work: Callable[..., Any] | None) -> Iterator[_Cluster]:
    """Yield the workers of the dask scheduler at an address, for jobs that ``work`` does.

    Raises
    ------
    InvalidArgumentError, EngineUnavailableError
        If the scheduler does not answer within ``ANSWER_SECONDS``, has no workers or workers with
        other code, or dask is not installed.
    """
    try:
        from distributed import Client, rpc
        from distributed.security import Security
    except ImportError as error:
        raise EngineUnavailableError(
            f"a scheduler needs dask, which is not installed here ({error}): "
            f"{install_advice('cluster')}"
        ) from None

    async def ask() -> None:
        """Wait for a scheduler with a worker, because a client without one cannot be closed."""
        secret = Security().get_connection_args("client")
        async with rpc(address, connection_args=secret, timeout=ANSWER_SECONDS) as scheduler:
            while not (await scheduler.identity())["workers"]:
                await asyncio.sleep(0.2)

    def connect() -> Any:
        asyncio.run(asyncio.wait_for(ask(), ANSWER_SECONDS))
        client: Any = Client(address, timeout=ANSWER_SECONDS, set_as_default=False)
        return client, client.run(computing, work, on_error="return")

    try:
        client, found = _within(connect, ANSWER_SECONDS + 5.0)
    except Exception as error:  # errors of dask, asyncio and the operating system
        raise InvalidArgumentError(
            f"scheduler: no worker answers at {brief(address)} ({type(error).__name__})"
        ) from None
    try:
        for name, there in found.items():
            failed = isinstance(there, Exception)
            words = brief(there) if failed else difference(there, computing(work))
            if words:
                raise InvalidArgumentError(
                    f"scheduler: the worker {name} must have the code and versions of this "
                    f"command: {words}"
                )
        yield _Cluster(client, client.get_executor(pure=False), work)
    finally:
        with suppress(Exception):  # a lost cluster cannot be closed in order
            _within(client.close, 5.0)


def _within(function: Callable[[], Any], seconds: float) -> Any:
    """Return a function's result, or raise TimeoutError if it takes too long.

    dask's own timeouts do not cover a server that accepts a connection and stays silent. dask's
    logs are hidden meanwhile: the caller reports the error in one line.
    """
    outcome: list[Any] = []

    def run() -> None:
        try:
            outcome.extend((function(), None))
        except BaseException as error:
            outcome.extend((None, error))

    logger = logging.getLogger("distributed")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        thread.join(seconds)
    finally:
        logger.setLevel(level)
    if not outcome:
        raise TimeoutError(f"no answer within {seconds:.0f} s")
    result, error = outcome
    if error is not None:
        raise error
    return result
