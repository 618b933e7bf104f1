"""The clients in which PyBullet's worlds live.

One client serves one world at a time, in the process that opened it.
"""

from __future__ import annotations

import os

from aquafish_gym.engines.packages import load_pybullet
from aquafish_gym.utils.validation import EngineUnavailableError

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
