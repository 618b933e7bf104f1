"""Interrupts that arrive where Python drops them: in destructors and callbacks."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from typing import Any

SECONDS_UNTIL_ASKED_AGAIN = 0.05  # by then the callback is over


@contextlib.contextmanager
def kept_interrupts() -> Iterator[None]:
    """Raise in the block each KeyboardInterrupt that Python drops; only in the main thread.

    Python prints what is raised in a destructor, in the callback of a weak reference, as those of
    imports, or in a callback of a C library, as LLVM's, and goes on. Here the signal is sent again
    a moment later, or at the end of the block.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = sys.unraisablehook
    again: list[threading.Timer] = []

    def ask_again(found: Any) -> None:
        if isinstance(found.exc_value, KeyboardInterrupt):
            again.append(threading.Timer(SECONDS_UNTIL_ASKED_AGAIN, _interrupt))
            again[-1].start()
        else:
            before(found)

    sys.unraisablehook = ask_again
    raised = False
    try:
        yield
    except KeyboardInterrupt:
        raised = True
        raise
    finally:
        sys.unraisablehook = before
        waiting = [timer for timer in again if timer.is_alive()]
        for timer in waiting:
            timer.cancel()
            timer.join()
        if waiting and not raised:
            raise KeyboardInterrupt


def _interrupt() -> None:
    """Send the main thread a signal that Python handles, which also ends its sleep."""
    main = threading.main_thread().ident
    for number in (signal.SIGINT, signal.SIGTERM):
        # Python has a function for it; a background job of a shell script ignores Ctrl-C.
        if main is not None and callable(signal.getsignal(number)):
            signal.pthread_kill(main, number)
            return
