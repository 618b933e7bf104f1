"""The progress bar of long commands, with the figure that matters."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn


class _PlainConsole(Console):
    """A console that leaves a broken pipe to the command line."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


def plain_console(stderr: bool = False) -> Console:
    """Return a console that prints lines as they are."""
    return _PlainConsole(highlight=False, soft_wrap=True, markup=False, stderr=stderr)


def progress_bar(console: Console, unit: str) -> Progress:
    """Return a bar of counted steps, for terminals; a task's description is the figure."""
    return Progress(
        TextColumn(unit), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"),
        TimeRemainingColumn(), console=console, disable=not console.is_terminal,
    )  # fmt: skip
