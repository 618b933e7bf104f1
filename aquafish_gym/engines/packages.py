"""What this machine has: the engines, the meaning of "auto", and the cores."""

from __future__ import annotations

import functools
import os
from importlib.util import find_spec
from typing import Any

from aquafish_gym.utils.validation import (
    EngineUnavailableError,
    InvalidArgumentError,
    install_advice,
    one_of,
)

# One robot in one water, to rounding.
NAMES = ("numba", "pybullet")
GPU = "cuda"  # the compiled engine on a GPU, of batches alone
MAXIMUM_THREADS = 1024
# Whichever of the two this machine has, PyBullet first; see ``resolve_engine``.
AUTO = "auto"


def resolve_engine(argument: str, name: object, batch: bool = False) -> str:
    """Return an engine's own name; ``"auto"`` is resolved by what is installed.

    It is PyBullet where it is installed, else the compiled engine, which is the same robot to 1e-9.
    ``argument`` is the engine's name in messages; a ``batch`` may also swim on ``"cuda"``.
    :func:`check_engine` checks that a named engine can be used here.
    """
    known = one_of(argument, name, (AUTO, *NAMES, *([GPU] if batch else [])))
    if known != AUTO:
        return known
    return "numba" if find_spec("pybullet") is None else "pybullet"


def check_engine(engine: object, batch: bool = False) -> str:
    """Return the engine's name if it can be used here; see :func:`resolve_engine` for "auto".

    An unknown name is an :class:`UnknownNameError`, a missing package an
    :class:`EngineUnavailableError`.
    """
    name = resolve_engine("engine", engine, batch)
    if name == "pybullet":
        load_pybullet()
    if name == GPU:
        check_gpu()
    return name


def refuse_threads(engine: str, threads: int | None) -> None:
    """Refuse a number of threads with the engine "cuda"."""
    if engine == GPU and threads is not None:
        raise InvalidArgumentError(
            f'threads must be None for the engine "{engine}", which takes the whole GPU; '
            f"got {threads}"
        )


@functools.cache
def check_gpu() -> None:
    """Raise EngineUnavailableError if the package, the driver or the GPU is missing."""
    otherwise = 'or use engine="numba", the same robots on this machine\'s cores'
    if find_spec("numba_cuda") is None:
        raise EngineUnavailableError(
            f'the engine "cuda" needs the package numba-cuda, which is not installed here: '
            f"{install_advice('gpu')}, {otherwise}"
        )
    from numba import cuda

    try:
        found = len(cuda.gpus)
    except ImportError as error:  # the driver's
        said = " ".join(str(error).split()).rstrip(": ")
        raise EngineUnavailableError(
            f'the engine "cuda" needs the driver of an NVIDIA GPU, which does not load ({said}): '
            f"install it, {otherwise}"
        ) from None
    if not found:
        raise EngineUnavailableError(
            f'the engine "cuda" needs an NVIDIA GPU, and the driver finds none: choose a machine '
            f"with one, {otherwise}"
        )


@functools.cache
def load_pybullet() -> Any:
    """Return the module; :class:`EngineUnavailableError` if it is not installed."""
    try:
        return _import_quietly()
    except ImportError as error:
        raise EngineUnavailableError(
            'the engine "pybullet" needs the package pybullet, which is not installed here '
            f"({error}): {install_advice('pybullet')} on Linux x86-64 with Python 3.11, or use "
            'engine="numba", the same robot compiled'
        ) from None


def _import_quietly() -> Any:
    """Import pybullet without the line that its C code prints to stderr."""
    try:
        kept = os.dup(2)
    except OSError:  # no stderr to keep clean
        return __import__("pybullet")
    try:
        with open(os.devnull, "wb") as nowhere:  # noqa: PTH123
            os.dup2(nowhere.fileno(), 2)
        return __import__("pybullet")
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def machine_memory() -> int | None:
    """Return this machine's memory in bytes; None if the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None


def available_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # macOS and Windows bind no process to cores
