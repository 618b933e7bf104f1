"""PyBullet itself: loading it, and the clients in which its worlds live.

One client serves one world at a time, in the process that opened it.
"""

from __future__ import annotations

import functools
import os
from typing import Any

from aquafish_gym.utils.validation import EngineUnavailableError


@functools.cache
def load_pybullet() -> Any:
    """Return the module.

    Raises
    ------
    EngineUnavailableError
        If it is not installed.
    """
    try:
        return _import_quietly()
    except ImportError as error:
        raise EngineUnavailableError(
            'the engine "pybullet" needs the package pybullet, which is not installed here '
            f"({error}): pip install pybullet==3.2.7 on Linux with Python 3.9 to 3.11, or use "
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


# A client costs megabytes and connecting leaks, so clients are kept for the next world.
_idle_clients: list[int] = []


def take_client() -> int:
    """Return a DIRECT client for this process to use alone until :func:`return_client`."""
    bullet = load_pybullet()
    try:
        client = _idle_clients.pop()
    except IndexError:
        client = bullet.connect(bullet.DIRECT)
    if client < 0:
        raise EngineUnavailableError(
            "PyBullet opens no more clients in this process; close some of the environments "
            'whose engine is "pybullet"'
        )
    return int(client)


def return_client(client: int, process: int) -> None:
    """Keep a client for the next world, if this is still the process that opened it."""
    if os.getpid() == process:
        _idle_clients.append(client)


# A forked child must not touch its parent's clients.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_idle_clients.clear)
