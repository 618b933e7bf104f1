"""Interrupts that arrive where Python drops them: in destructors and callbacks."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

SECONDS_UNTIL_ASKED_AGAIN = 0.05  # by then the callback is over


@contextlib.contextmanager
def kept_interrupts() -> Iterator[None]:
    """Raise in the block each KeyboardInterrupt that Python drops; only in the main thread.

    Python prints what is raised in a destructor, in the callback of a weak reference, as those of
    imports, or in a callback of a C library, as LLVM's, and goes on. Here the signal is sent again
    a moment later, until Python has handled it, or KeyboardInterrupt is raised at the block's end.
    """
    if not _in_main_thread():
        yield
        return
    before = sys.unraisablehook
    dropped: list[_Again] = []

    def ask_again(found: Any) -> None:
        if isinstance(found.exc_value, KeyboardInterrupt) and _in_main_thread():
            dropped.append(_Again())
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
        waiting = [again for again in dropped if not again.handled]
        for again in reversed(waiting):  # each puts back the handler that it found
            again.stop()
        if waiting and not raised:
            raise KeyboardInterrupt


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


class _Again:
    """Sends the main thread a signal until Python handles it; made in the main thread.

    Once is not enough: a signal that comes just before a sleep does not end it.
    """

    def __init__(self) -> None:
        self.handled = False
        # Python has a function for it; a background job of a shell script ignores Ctrl-C.
        handlers = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
        self._number = next((n for n, handler in handlers.items() if callable(handler)), None)
        if self._number is None:
            return
        self._handler: Any = handlers[self._number]
        signal.signal(self._number, self._handle)
        self._thread = threading.Thread(target=self._send, args=(self._number,), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Send it no more."""
        if self._number is None:
            return
        if signal.getsignal(self._number) == self._handle:
            signal.signal(self._number, self._handler)
        self._thread.join()

    def _handle(self, number: int, frame: Any) -> None:
        self.handled = True
        signal.signal(number, self._handler)
        self._handler(number, frame)

    def _send(self, number: signal.Signals) -> None:
        main = threading.main_thread().ident
        time.sleep(SECONDS_UNTIL_ASKED_AGAIN)
        # Another's handler, which the block may have set, is not sent anything.
        while main is not None and signal.getsignal(number) == self._handle:
            signal.pthread_kill(main, number)
            time.sleep(SECONDS_UNTIL_ASKED_AGAIN)
