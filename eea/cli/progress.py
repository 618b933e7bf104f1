"""The progress bar of long commands, with the figure that matters."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn


def plain_console(stderr: bool = False) -> Console:
    """Return a console that prints lines as they are."""
    return Console(highlight=False, soft_wrap=True, markup=False, stderr=stderr)


def progress_bar(console: Console, unit: str) -> Progress:
    """Return a bar of counted steps, for terminals; a task's description is the figure."""
    return Progress(
        TextColumn(unit), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"),
        TimeRemainingColumn(), console=console, disable=not console.is_terminal,
    )  # fmt: skip
