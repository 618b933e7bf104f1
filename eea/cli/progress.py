"""The progress bar of long commands, with their main result."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from aquafish_gym.runs.progress import every
from aquafish_gym.utils.validation import printable

MOST_SILENCE = 4.0  # s


class _Plain(Console):
    """A console that shows the control characters of a text instead of sending them."""

    def print(self, *things: Any, **options: Any) -> None:
        """Print texts, or anything else that rich can draw."""
        super().print(
            *(printable(one) if isinstance(one, str) else one for one in things), **options
        )


def plain_console(stderr: bool = False) -> Console:
    """Return a console that prints lines as they are, with control characters as escapes."""
    return _Plain(highlight=False, soft_wrap=True, markup=False, stderr=stderr)


def progress_bar(console: Console, unit: str) -> Progress:
    """Return a bar of counted steps, for terminals; a task's description is the main result."""
    return Progress(
        TextColumn(unit), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"),
        TimeRemainingColumn(), console=console, disable=not console.is_terminal,
    )  # fmt: skip


@contextmanager
def waiting(task: str) -> Iterator[Callable[[str], None]]:
    """Show a running ``task`` on standard error; yield a function that takes its present step.

    A terminal shows one moving line. Elsewhere a line is printed at once and every four seconds.
    """
    console = plain_console(stderr=True)
    if console.is_terminal:
        with console.status(task) as status:
            yield lambda doing: status.update(f"{task}: {doing}")
        return
    console.print(f"{task} ...")
    began = time.monotonic()
    doing = [""]

    def say() -> None:
        detail = f": {doing[0]}" if doing[0] else ""
        console.print(f"{time.monotonic() - began:.0f} s{detail} ...")

    with every(MOST_SILENCE, say):
        yield lambda words: doing.__setitem__(0, words)
