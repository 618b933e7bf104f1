"""The progress of long work: a bar on a terminal, lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread
from typing import TypeVar

T = TypeVar("T")

QUIET_SECONDS = 5.0  # longest time between two lines
BEAT_SECONDS = 0.5  # interval of the clock


@contextmanager
def every(seconds: float, say: Callable[[], None]) -> Iterator[None]:
    """Call a function every few seconds, from a thread, until the block ends."""
    ended = Event()

    def repeat() -> None:
        while not ended.wait(seconds):
            say()

    thread = Thread(target=repeat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@contextmanager
def show_progress(label: str, total: int) -> Iterator[Callable[[int, str], None]]:
    """Show a progress bar on stderr; without a terminal, a line every tenth or five seconds.

    It yields a function that takes the number of finished units and a line about them.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(bar_width=10), MofNCompleteColumn()
    if console.is_terminal:
        with Progress(*columns, TimeElapsedColumn(), console=console, transient=True) as bar:
            task = bar.add_task(label, total=total)
            yield lambda done, text: bar.update(task, completed=done, description=text)
        return
    lines = _Lines(label, total)
    with every(BEAT_SECONDS, lines.beat):
        yield lines.show


class _Lines:
    """Lines of progress on stderr, at most ``QUIET_SECONDS`` apart.

    A thread calls ``beat`` meanwhile, so that a longer step is not silent.
    """

    def __init__(self, label: str, total: int) -> None:
        self._done = 0
        self._text = label
        self._total = total
        self._began = self._said = time.monotonic()
        self._lock = Lock()

    def show(self, done: int, text: str) -> None:
        """Take the number of finished units and a line; print the line after each tenth."""
        with self._lock:
            tenths = self._done * 10 // self._total
            self._done = done
            self._text = text
            if done * 10 // self._total > tenths:
                self._print(text)

    def beat(self) -> None:
        """Print if nothing was printed for ``QUIET_SECONDS``."""
        with self._lock:
            if time.monotonic() - self._said > QUIET_SECONDS - BEAT_SECONDS:
                self._print(f"{self._text}, {time.monotonic() - self._began:.0f} s")

    def _print(self, text: str) -> None:
        self._said = time.monotonic()
        print(f"{self._done}/{self._total}  {text}", file=sys.stderr, flush=True)


def track(items: Iterable[T], label: str, total: int) -> Iterator[T]:
    """Yield ``total`` items and show the number of finished items."""
    with show_progress(label, total) as show:
        for done, item in enumerate(items, 1):
            yield item
            show(done, label)


@contextmanager
def show_share(label: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """Show the progress of work; its total is known only after the start.

    It yields a function that takes the number of finished units and of all units.
    """
    with show_progress(label, 100) as show:
        yield lambda done, total: show(100 * done // total, f"{label}: {done} of {total} {unit}")
