"""The progress of a study: a bar with the mean OBJ_FIT on a terminal, lines elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from aquafish_gym.runs.runner import Event
from eea.study.replicate import Replicate


class Tally:
    """How many of a study's replicates are finished, and their OBJ_FIT."""

    def __init__(self, total: int, documents: Mapping[Replicate, Mapping[str, Any]]) -> None:
        self.total = total
        self.scores = {job: score(document) for job, document in documents.items()}

    def __str__(self) -> str:
        return f"{len(self.scores)} of {self.total} replicates"

    @property
    def mean(self) -> str:
        """The mean OBJ_FIT in words."""
        known = [score for score in self.scores.values() if score is not None]
        return f"mean OBJ_FIT {sum(known) / len(known):.3f}" if known else "mean OBJ_FIT unknown"


def score(document: Mapping[str, Any]) -> float | None:
    """Return the last round's OBJ_FIT of a replicate's result."""
    found: float | None = document["rounds"][-1]["objective_fitness"]
    return found


@contextmanager
def shown(tally: Tally, console: Console) -> Iterator[Callable[[Event[Replicate]], None]]:
    """Show a study's progress; yield the function that takes the runner's events."""
    columns = (
        BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(tally.mean, total=tally.total, completed=len(tally.scores))

        def note(event: Event[Replicate]) -> None:
            if event.kind == "retried":
                console.print(f"{event.job.name}: {event.text}; it starts again")
            if event.kind == "done" and event.document is not None:
                tally.scores[event.job] = found = score(event.document)
                bar.update(task, completed=len(tally.scores), description=tally.mean)
                if not console.is_terminal:
                    fitness = "unknown" if found is None else f"{found:.3f}"
                    console.print(f"{event.job.name}: OBJ_FIT {fitness} ({tally})")

        yield note
