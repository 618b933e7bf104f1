"""How a study goes: a live table on a terminal, a line a finished replicate elsewhere."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.table import Table

from aquafish_gym.runs.runner import Event
from eea.study.cost import cost
from eea.study.replicate import Replicate

_REDRAW = 0.2  # s between two drawings of the table


class Board:
    """What is done, running and left of a study's replicates.

    ``documents`` are the results of those that were complete when the command began; ``clock``
    returns seconds.
    """

    def __init__(
        self,
        jobs: Sequence[Replicate],
        documents: Mapping[Replicate, Mapping[str, Any]],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.jobs = jobs
        self.scores = {job: _score(document) for job, document in documents.items()}
        self.running: dict[Replicate, tuple[str, float]] = {}  # what it said, and its share
        self.failed: set[Replicate] = set()
        self._clock = clock
        self._began: dict[Replicate, float] = {}
        self._start = 0.0
        self._done = 0.0  # work done in this sitting

    def start(self) -> None:
        """Note that the work begins."""
        self._start = self._clock()

    def take(self, event: Event[Replicate]) -> None:
        """Note what happened."""
        job = event.job
        if event.kind == "began":
            self._began[job] = self._clock()
            self.running[job] = ("", 0.0)
        elif event.kind == "said":
            self.running[job] = (event.text, event.share)
        else:
            self.running.pop(job, None)
        if event.kind == "failed":
            self.failed.add(job)
        if event.kind == "done" and event.document is not None:
            self.scores[job] = _score(event.document)
            self._done += cost(job.config)

    @property
    def to_go(self) -> float | None:
        """Seconds until all is done, if the speed of this sitting holds; None before any is known.

        A replicate that runs counts by the share of its rounds, early ones being quicker.
        """
        running = sum(share * cost(job.config) for job, (_, share) in self.running.items())
        left = [job for job in self.jobs if job not in self.scores and job not in self.failed]
        rest = sum(cost(job.config) for job in left) - running
        done = self._done + running
        return rest / done * (self._clock() - self._start) if done else None

    def counts(self) -> str:
        """Return how many replicates are complete, and the time to go."""
        rest = self.to_go
        going = "" if rest is None else f", {duration(rest)} to go"
        return f"{len(self.scores)} of {len(self.jobs)} replicates{going}"

    def line(self, job: Replicate, document: Mapping[str, Any]) -> str:
        """Return a sentence about a replicate that has just been finished."""
        score = "unknown" if self.scores[job] is None else f"{self.scores[job]:.3f}"
        began = self._began.get(job)  # a cluster does not tell
        took = "" if began is None else f", {self._clock() - began:.1f} s"
        return (
            f"{job.name}: OBJ_FIT {score} after {len(document['rounds'])} rounds{took} "
            f"({self.counts()})"
        )

    def __rich__(self) -> Table:
        table = Table(title=self.counts(), title_justify="left", box=None, pad_edge=False)
        for name in ("arm", "steps", "done", "left", "mean OBJ_FIT"):
            table.add_column(name, justify="left" if name == "arm" else "right", no_wrap=True)
        table.add_column("running: seed and round", overflow="ellipsis", no_wrap=True)
        cells: dict[tuple[str, int], list[Replicate]] = defaultdict(list)
        for job in self.jobs:
            cells[job.arm, job.config.steps].append(job)
        for (arm, steps), jobs in cells.items():
            done = [job for job in jobs if job in self.scores]
            running = [f"{j.seed}: {self.running[j][0]}" for j in jobs if j in self.running]
            scores = [score for job in done if (score := self.scores[job]) is not None]
            table.add_row(
                arm,
                str(steps),
                str(len(done)),
                str(len(jobs) - len(done) - len(running)),
                f"{sum(scores) / len(scores):.3f}" if scores else "",
                ", ".join(running),
            )
        return table


def _score(document: Mapping[str, Any]) -> float | None:
    score: float | None = document["rounds"][-1]["objective_fitness"]
    return score


def duration(seconds: float) -> str:
    """Return a time as people say it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 90 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


@contextmanager
def shown(board: Board, console: Console) -> Iterator[Callable[[Event[Replicate]], None]]:
    """Show the board while there is work to do; yield what is to be told of each event."""
    live = Live(board, console=console, auto_refresh=False) if console.is_terminal else None
    drawn = 0.0
    board.start()

    def note(event: Event[Replicate]) -> None:
        nonlocal drawn
        board.take(event)
        if event.kind == "retried":
            console.print(f"{event.job.name}: {event.text}; it is begun again")
        if live is None:
            if event.kind == "done" and event.document is not None:
                console.print(board.line(event.job, event.document))
        elif time.monotonic() - drawn > _REDRAW:  # by the thread that notes what happens
            live.refresh()
            drawn = time.monotonic()

    if live is None:
        yield note
        return
    with live:
        yield note
        live.refresh()
