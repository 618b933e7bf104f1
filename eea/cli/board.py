"""How a study goes: a live table on a terminal, a line a finished replicate elsewhere."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from rich.console import Console
from rich.live import Live
from rich.table import Table

from aquafish_gym.runs.workers import Event
from eea.study.replicate import Progress, Replicate, Standing
from eea.study.study import cost, cost_left

Cell = tuple[str, int]  # an arm and the steps of its trials


@dataclass
class Board:
    """What is done, running and left.

    Attributes
    ----------
    standings
        How far the replicates were when the command began.
    workers
        Processes that share the work.
    """

    standings: Mapping[Replicate, Standing]
    workers: int
    done: dict[Replicate, int] = field(init=False)
    objective: dict[Replicate, float] = field(default_factory=dict)
    running: dict[Replicate, int] = field(default_factory=dict)
    seconds: dict[Replicate, float] = field(default_factory=dict)
    failed: set[Replicate] = field(default_factory=set)
    finished: set[Replicate] = field(init=False)

    def __post_init__(self) -> None:
        self.done = {job: len(standing.records) for job, standing in self.standings.items()}
        self.finished = {job for job, standing in self.standings.items() if standing.ended}
        for job, standing in self.standings.items():
            if standing.records and standing.records[-1]["objective_fitness"] is not None:
                self.objective[job] = standing.records[-1]["objective_fitness"]
        # Work done in this sitting by cell, and the seconds it took.
        self._work: dict[Cell, float] = defaultdict(float)
        self._seconds: dict[Cell, float] = defaultdict(float)

    def take(self, event: Event[Replicate]) -> None:
        """Note what happened."""
        job = event.job
        if event.kind == "began":
            self.running[job] = self.done[job]
        elif event.kind in ("died", "failed", "done"):
            self.running.pop(job, None)
            if event.kind == "failed":
                self.failed.add(job)
            if event.kind == "done":
                self.finished.add(job)
        elif isinstance(event.content, Progress):
            progress: Progress = event.content
            self.done[job] = self.running[job] = progress.round
            if progress.objective_fitness is not None:
                self.objective[job] = progress.objective_fitness
            if progress.wall:
                self.seconds[job] = self.seconds.get(job, 0.0) + progress.wall
                self._work[job.cell] += cost(job, progress.round)
                self._seconds[job.cell] += progress.wall

    @property
    def to_go(self) -> float | None:
        """Seconds until all is done, if the measured speed holds; ``None`` before a round is."""
        work = sum(self._work.values())
        if not work:
            return None
        usual = sum(self._seconds.values()) / work
        seconds = [
            cost_left(job, self.done[job])
            * (self._seconds[job.cell] / self._work[job.cell] if self._work[job.cell] else usual)
            for job in self.standings
            if job not in self.finished | self.failed
        ]
        return max([sum(seconds) / self.workers, *seconds], default=0.0)

    def counts(self) -> str:
        """Return how many replicates are complete, and the time to go."""
        rest = self.to_go
        going = "" if rest is None else f", {duration(rest)} to go"
        return f"{len(self.finished)} of {len(self.standings)} replicates{going}"

    def line(self, job: Replicate) -> str:
        """Return a sentence about a finished replicate."""
        objective = self.objective.get(job)
        score = "unknown" if objective is None else f"{objective:.3f}"
        return (
            f"{job.name}: OBJ_FIT {score} after {self.done[job]} rounds, "
            f"{self.seconds.get(job, 0.0):.1f} s ({self.counts()})"
        )

    def __rich__(self) -> Table:
        table = Table(title=self.counts(), title_justify="left", box=None, pad_edge=False)
        for name in ("arm", "steps", "done", "left", "mean OBJ_FIT"):
            table.add_column(name, justify="left" if name == "arm" else "right", no_wrap=True)
        table.add_column("running: seed and round", overflow="ellipsis", no_wrap=True)
        cells: dict[Cell, list[Replicate]] = defaultdict(list)
        for job in self.standings:
            cells[job.cell].append(job)
        for (arm, steps), jobs in cells.items():
            done = [job for job in jobs if job in self.finished]
            running = [job for job in jobs if job in self.running]
            scores = [self.objective[job] for job in done if job in self.objective]
            table.add_row(
                arm,
                str(steps),
                str(len(done)),
                str(len(jobs) - len(done) - len(running)),
                f"{sum(scores) / len(scores):.3f}" if scores else "",
                ", ".join(
                    f"{job.seed}: {self.running[job]}/{job.config.rounds}" for job in running
                ),
            )
        return table


def duration(seconds: float) -> str:
    """Return a time as people say it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 90 * 60:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


@contextmanager
def shown(board: Board, console: Console) -> Iterator[Live | None]:
    """Show the board while there is work to do, if the console is a terminal."""
    if not console.is_terminal or len(board.finished) == len(board.standings):
        yield None
        return
    # Drawn when something has happened, by the thread that notes it.
    with Live(board, console=console, auto_refresh=False) as live:
        live.refresh()
        yield live
