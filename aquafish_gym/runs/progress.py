"""The progress of long work: a bar on a terminal, lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

QUIET_SECONDS = 5.0  # at most, between two lines


@contextmanager
def every(seconds: float, say: Callable[[], None]) -> Iterator[None]:
    """Call a function at intervals of some seconds, from a thread, until the block ends."""
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

    The function that it yields takes how much is done, and a line about it.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(bar_width=10), MofNCompleteColumn()
    live = console.is_terminal
    tenths, said = 0, time.monotonic()
    with Progress(
        *columns, TimeElapsedColumn(), console=console, transient=True, disable=not live
    ) as bar:
        task = bar.add_task(label, total=total)

        def show(done: int, text: str) -> None:
            nonlocal tenths, said
            bar.update(task, completed=done, description=text)
            quiet = time.monotonic() - said
            if not live and (done * 10 // total > tenths or quiet > QUIET_SECONDS):
                tenths, said = done * 10 // total, time.monotonic()
                print(f"{done}/{total}  {text}", file=sys.stderr, flush=True)

        yield show


@contextmanager
def show_share(label: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """Show the progress of work whose total is only known when it has begun.

    The function that it yields takes how many of how many units are done.
    """
    with show_progress(label, 100) as show:
        yield lambda done, total: show(100 * done // total, f"{label}: {done} of {total} {unit}")
