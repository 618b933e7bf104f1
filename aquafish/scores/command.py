"""The command ``aquafish scores``: reference scores, any row or all, with one command."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from numpy.typing import ArrayLike
from rich.console import Console
from rich.table import Table
from scipy.stats import trim_mean

from aquafish.batch import do_table
from aquafish.scores.entries import ENTRIES
from aquafish.scores.play import COLUMNS, EPISODES, play
from aquafish_gym.utils.command_line import Out
from aquafish_gym.utils.validation import integer, one_of
from gait.config import TaskName

# A task that controllers are made for, and the ids that they then do.
IDS_OF: dict[TaskName, tuple[str, ...]] = {
    "forward": ("AquaFish-v0", "AquaFishRecovery-v0"),
    "station": ("AquaFishStation-v0",),
    "waypoint": ("AquaFishWaypoint-v0",),
}
FIRST_SEED = 100  # of the replicates: everything was tried and tuned on lower ones
RESAMPLES = 1000


@dataclass(frozen=True)
class Job:
    """One controller: made for a task, then scored."""

    entry: str
    task: TaskName
    seed: int
    shorter: int
    episodes: int

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.task}, {self.entry}, seed {self.seed}"

    @property
    def file(self) -> str:
        """Its result's, in the run's folder."""
        name = "".join(c if c.isalnum() else "-" for c in self.entry)
        return f"runs/{self.task}/{name}/{self.seed:03d}.json"


def score(job: Job, say: Callable[[str, float], None]) -> dict[str, Any]:
    """Make a controller and play the episodes, ready for JSON."""
    entry = ENTRIES[job.entry]
    began = time.process_time()
    controller = entry.make(job.task, job.seed, job.shorter, say)
    spent = time.process_time() - began
    return {
        "cpu_seconds": spent,
        "controller": None if controller is None else controller.to_dict(),
        "scores": {
            name: play(name, lambda fins: entry.player(controller, fins), job.episodes)
            for name in IDS_OF[job.task]
        },
    }


def iqm(runs: Sequence[ArrayLike]) -> tuple[float, float, float]:
    """Return the interquartile mean of all episodes of some runs, and its 95% interval.

    The interval is a bootstrap that draws runs, and episodes of each (Agarwal et al., Deep
    reinforcement learning at the edge of the statistical precipice, 2021).

    Examples
    --------
    >>> iqm([[1.0, 2.0, 3.0, 1000.0]])[0]
    2.5
    """
    each = [np.asarray(run, float) for run in runs]
    rng = np.random.default_rng(0)
    means = []
    for _ in range(RESAMPLES):
        drawn = [each[i] for i in rng.integers(len(each), size=len(each))]
        means.append(trim_mean(np.concatenate([rng.choice(run, len(run)) for run in drawn]), 0.25))
    low, high = np.quantile(means, (0.025, 0.975)).tolist()
    return float(trim_mean(np.concatenate(each), 0.25)), low, high


def kept(runs: Sequence[dict[str, list[float]]]) -> float | None:
    """Return which share of its whole twin's way a robot makes after something broke.

    None where that one makes no way either: not a unit of 5 cm in an episode.
    """
    after, twin = (np.concatenate([run[key] for run in runs]) for key in ("after", "twin"))
    return None if twin.mean() < 1.0 else float(after.mean() / twin.mean())


@dataclass(frozen=True)
class Scores:
    """Score simple, evolved and learned controllers at every task, whole and under each tier.

    Each controller is made for a task by its own seed, and then plays a hundred episodes that are
    the same for all, from fins that stand anywhere. The table shows interquartile means of the
    returns, as any trainer counts them, with 95% bootstrap intervals over seeds and episodes; of
    AquaFishRecovery-v0 also which share of its undamaged twin's way it makes after the onset, where
    that one makes any.
    Controllers for AquaFishRecovery-v0 are those that were made for AquaFish-v0.

    Into --out go table.md, and a file for each controller with its weights and all returns. What is
    there is not done again: the same command goes on, and one for fewer rows shows these.
    """

    out: Out = Path("out/scores")
    entries: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME", help=f"Some of {'; '.join(ENTRIES)}.")
    ] = tuple(ENTRIES)
    tasks: tuple[TaskName, ...] = tuple(IDS_OF)
    """What they are made for."""
    seeds: int = 5
    """Replicates of what is evolved or learned, with seeds from 100 upwards."""
    episodes: int = EPISODES
    shorter: int = 1
    """Divide what is evolved or learned by this, to see whether it works."""
    workers: int | None = None
    """Processes; every core if not given. No result depends on it."""

    def jobs(self) -> list[Job]:
        """Return all that is to be done."""
        for name in ("seeds", "episodes", "shorter"):
            integer(name, getattr(self, name), 1)
        for name in self.entries:
            one_of("entries", name, ENTRIES)
        for task in self.tasks:
            one_of("tasks", task, IDS_OF)
        return [
            Job(name, task, FIRST_SEED + seed, self.shorter, self.episodes)
            for seed in range(self.seeds)
            for task in self.tasks
            for name in self.entries
            if not seed or ENTRIES[name].config
        ]

    def execute(self) -> None:
        """Do what is missing, print a table, and write it to table.md."""
        jobs = self.jobs()
        entries = {
            name: {**asdict(entry.config), "damage": entry.damage}
            for name, entry in ENTRIES.items()
            if entry.config
        }
        settings = {"shorter": self.shorter, "episodes": self.episodes, "entries": entries}
        rows = do_table(
            jobs, score, self.out, "reference scores", settings,
            lambda results: self._rows(jobs, results), self.workers,
        )  # fmt: skip
        head, *body = rows
        for name, several in groupby(body, key=lambda row: row[0]):
            table = Table(*head[1:], title=name)
            for row in several:
                table.add_row(*row[1:])
            Console().print(table)

    def _rows(self, jobs: list[Job], results: list[dict[str, Any]]) -> list[list[str]]:
        rows = [["environment", "controller", "hears", *COLUMNS, "CPU s"]]
        for task in self.tasks:
            for name in IDS_OF[task]:
                for entry in self.entries:
                    found = [
                        result
                        for job, result in zip(jobs, results, strict=True)
                        if (job.entry, job.task) == (entry, task)
                    ]
                    cells = [
                        _cell([result["scores"][name][column] for result in found])
                        for column in COLUMNS
                    ]
                    spent = np.mean([result["cpu_seconds"] for result in found])
                    rows.append([name, entry, ENTRIES[entry].knows, *cells, f"{spent:.0f}"])
        return rows


def _cell(runs: list[dict[str, list[float]]]) -> str:
    middle, low, high = iqm([run["returns"] for run in runs])
    said = f"{middle:.1f} [{low:.1f}, {high:.1f}]"
    share = kept(runs) if "after" in runs[0] else None
    return said if share is None else f"{said}, {share:.0%}"
