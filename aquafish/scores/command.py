"""The command ``aquafish scores``: reference scores, any row or all, with one command."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import tyro
from numpy.typing import ArrayLike
from rich.console import Console
from rich.table import Table
from scipy.stats import trim_mean

from aquafish.batch import do_table
from aquafish.scores.entries import ENTRIES
from aquafish.scores.figure import curves_figure, scores_figure
from aquafish.scores.oracle import LIKE, oracle
from aquafish.scores.oracle import NAME as RECOVERY
from aquafish.scores.play import COLUMNS, EPISODES, play
from aquafish.scores.recurrent import RecurrentConfig
from aquafish_gym.command_line import Out
from aquafish_gym.damage.tiers import TIERS
from aquafish_gym.rendering.pictures import save_figure
from aquafish_gym.utils.validation import InvalidArgumentError, integer, one_of
from gait.baselines import BaselineConfig
from gait.learner import load

# A task that controllers are made for, and the ids that they then do.
MadeFor = Literal["forward", "station", "waypoint"]
IDS_OF: dict[MadeFor, tuple[str, ...]] = {
    "forward": ("AquaFish-v0", "AquaFishRecovery-v0"),
    "station": ("AquaFishStation-v0",),
    "waypoint": ("AquaFishWaypoint-v0",),
}
ORACLE = "oracle"  # a row of its own, of the recovery alone
ORACLE_EPISODES = 20  # the first ones of those that all others play
FIRST_SEED = 100  # of the replicates: everything was tried and tuned on lower ones
RESAMPLES = 1000
ROWS = (*ENTRIES, ORACLE)
PICTURE, CURVES = "scores.png", "curves.png"
Interval = tuple[float, float, float]  # a mean, and the ends of its interval


@dataclass(frozen=True)
class Job:
    """One controller: made for a task, then scored."""

    entry: str
    task: MadeFor
    seed: int
    shorter: int
    episodes: int

    @property
    def learns(self) -> bool:
        """Whether it takes the extra ``rl``."""
        return isinstance(ENTRIES[self.entry].config, BaselineConfig | RecurrentConfig)

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.task}, {self.entry}, seed {self.seed}"

    @property
    def file(self) -> str:
        """Its result's, in the run's folder."""
        name = "".join(c if c.isalnum() else "-" for c in self.entry)
        return f"runs/{self.task}/{name}/{self.seed:03d}.json"


@dataclass(frozen=True)
class OracleJob:
    """One episode of the recovery, with a gait for what is left of the robot."""

    tier: str
    episode: int
    shorter: int
    learns: ClassVar[bool] = False

    @property
    def name(self) -> str:
        """For people."""
        return f"recovery, {ORACLE}, {self.tier} damage, episode {self.episode}"

    @property
    def file(self) -> str:
        """Its result's, in the run's folder."""
        return f"runs/forward/{ORACLE}/{self.tier}-{self.episode:03d}.json"


def score(job: Job | OracleJob, say: Callable[[str, float], None]) -> dict[str, Any]:
    """Make a controller and play the episodes, ready for JSON."""
    if isinstance(job, OracleJob):
        began = time.process_time()
        after = oracle(job.tier, job.episode, job.shorter, say)
        return {"cpu_seconds": time.process_time() - began, "after": after}
    entry = ENTRIES[job.entry]
    began = time.process_time()
    controller, curve = entry.make(job.task, job.seed, job.shorter, say)
    spent = time.process_time() - began
    return {
        "cpu_seconds": spent,
        "curve": curve,
        "controller": None if controller is None else controller.to_dict(),
        "scores": {
            name: play(name, lambda fins: entry.player(controller, fins), job.episodes)
            for name in IDS_OF[job.task]
        },
    }


def iqm(runs: ArrayLike) -> Interval:
    """Return the interquartile mean of all episodes of runs (R, E), and its 95% interval.

    The interval is a bootstrap that draws runs, and episodes of each (Agarwal et al., Deep
    reinforcement learning at the edge of the statistical precipice, 2021).

    Examples
    --------
    >>> iqm([[1.0, 2.0, 3.0, 1000.0]])[0]
    2.5
    """
    table = np.asarray(runs, float)
    count, episodes = table.shape
    rng = np.random.default_rng(0)
    drawn = rng.integers(count, size=(RESAMPLES, count, 1))
    resampled = table[drawn, rng.integers(episodes, size=(RESAMPLES, count, episodes))]
    means = trim_mean(resampled.reshape(RESAMPLES, -1), 0.25, axis=1)
    low, high = np.quantile(means, (0.025, 0.975)).tolist()
    return float(trim_mean(table, 0.25, axis=None)), low, high


def share(ways: Sequence[Sequence[float]], best: Sequence[float]) -> str:
    """Return which share of the best way is made; a dash if that is under a unit in the mean.

    Examples
    --------
    >>> share([[1.0, 2.0]], [3.0, 3.0]), share([[1.0]], [0.5])
    ('50%', '-')
    """
    whole = float(np.mean(best))
    return "-" if whole < 1.0 else f"{np.concatenate(ways).mean() / whole:.0%}"


@dataclass(frozen=True)
class Scores:
    """Score simple, evolved and learned controllers at every task, whole and under each tier.

    Each controller is made for a task by its own seed, and then plays a hundred episodes that are
    the same for all, from fins that stand anywhere. The table shows interquartile means of the
    returns, as any trainer counts them, with 95% bootstrap intervals over seeds and episodes.

    Controllers for AquaFishRecovery-v0 are those that were made for AquaFish-v0. Of it the table
    also shows the way after the onset, in units, then which share that is of the undamaged twin's
    way, then of the oracle's: of a gait evolved for the very robot that is left, in the first 20
    episodes; a dash where that way is no unit long.

    Into --out go table.md, scores.png, curves.png, and a file for each controller with its weights,
    its curve and all returns. A curve has the actions of all robots so far and what they earned
    while they learned; or generations, and the best gait's score in each. What is there is not done
    again: the same command goes on, and one for fewer rows shows these.
    """

    out: Out = Path("out/scores")
    entries: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME", help=f"Some of {'; '.join(ROWS)}.")
    ] = ROWS
    tasks: tuple[MadeFor, ...] = tuple(IDS_OF)
    """What they are made for; those made for "forward" also recover."""
    seeds: int = 5
    """Replicates of what is evolved or learned, with seeds from 100 upwards."""
    episodes: int = EPISODES
    shorter: int = 1
    """Divide what is evolved or learned by this, to see whether it works."""
    workers: int | None = None
    """Processes; every core if not given. No result depends on it."""

    def jobs(self) -> list[Job | OracleJob]:
        """Return all that is to be done."""
        for name in ("seeds", "episodes", "shorter"):
            integer(name, getattr(self, name), 1)
        known: dict[str, Iterable[str]] = {"entries": ROWS, "tasks": IDS_OF}
        for name, choices in known.items():
            given = [one_of(name, one, choices) for one in getattr(self, name)]
            if not given or len(set(given)) < len(given):
                raise InvalidArgumentError(
                    f"{name} must be one or more, each named once; got {', '.join(given) or 'none'}"
                )
        jobs: list[Job | OracleJob] = [
            Job(name, task, FIRST_SEED + seed, self.shorter, self.episodes)
            for seed in range(self.seeds)
            for task in self.tasks
            for name in self.entries
            if name in ENTRIES and (not seed or ENTRIES[name].config)
        ]
        if ORACLE in self.entries and "forward" in self.tasks:
            few = min(self.episodes, ORACLE_EPISODES)
            jobs += [OracleJob(tier, i, self.shorter) for tier in TIERS for i in range(few)]
        return jobs

    def execute(self) -> None:
        """Do what is missing, print a table, and write it to table.md."""
        jobs = self.jobs()
        if any(job.learns and not (self.out / job.file).exists() for job in jobs):
            load("sb3_contrib")  # or say now what is missing, and not after the first rows
        entries = {
            name: {**asdict(entry.config), "damage": entry.damage}
            for name, entry in ENTRIES.items()
            if entry.config
        }
        settings = {
            "shorter": self.shorter, "episodes": self.episodes, "entries": entries,
            ORACLE: [LIKE, ORACLE_EPISODES],
        }  # fmt: skip
        rows = do_table(
            jobs, score, self.out, "reference scores", settings,
            lambda results: self._rows(jobs, results), self.workers, (PICTURE, CURVES),
        )  # fmt: skip
        head, *body = rows
        for name, several in groupby(body, key=lambda row: row[0]):
            table = Table(*head[1:], title=name)
            for row in several:
                table.add_row(*row[1:])
            Console().print(table)

    def _rows(
        self, jobs: Sequence[Job | OracleJob], results: Sequence[dict[str, Any]]
    ) -> list[list[str]]:
        made: dict[tuple[str, str], list[dict[str, Any]]] = {}
        best: dict[str, list[float]] = {tier: [] for tier in TIERS}
        spent: list[float] = []
        for job, result in zip(jobs, results, strict=True):
            if isinstance(job, OracleJob):
                best[job.tier].append(result["after"])
                spent.append(result["cpu_seconds"])
            else:
                made.setdefault((job.entry, job.task), []).append(result)
        rows = [["environment", "controller", "hears", *COLUMNS, "CPU s"]]
        scored: dict[tuple[str, str], list[Interval]] = {}
        for task in self.tasks:
            for name in IDS_OF[task]:
                for entry in (e for e in self.entries if e in ENTRIES):
                    of = [found["scores"][name] for found in made[entry, task]]
                    ends = [iqm([run[column]["returns"] for run in of]) for column in COLUMNS]
                    cells, scored[name, entry] = [_said(each) for each in ends], ends
                    cpu = np.mean([found["cpu_seconds"] for found in made[entry, task]])
                    rows.append([name, entry, ENTRIES[entry].knows, *cells, f"{cpu:.0f}"])
        if scored:
            save_figure(scores_figure(scored), self.out / PICTURE)
        curves: dict[tuple[str, str], list[Any]] = {
            (task, entry): [found["curve"] for found in several]
            for (entry, task), several in made.items()
            if several[0].get("curve")
        }
        if curves:
            save_figure(curves_figure(curves), self.out / CURVES)
        if "forward" not in self.tasks:
            return rows
        after = f"{RECOVERY}, after the onset"
        for entry in (e for e in self.entries if e in ENTRIES):
            of = [found["scores"][RECOVERY] for found in made[entry, "forward"]]
            cells = [_after([run[tier] for run in of], best[tier]) for tier in TIERS]
            rows.append([after, entry, ENTRIES[entry].knows, "", *cells, ""])
        if spent:
            cells = [_said(iqm([best[tier]])) for tier in TIERS]
            knows = "what is left of the robot"
            rows.append([after, ORACLE, knows, "", *cells, f"{np.mean(spent):.0f}"])
        return rows


def _said(interval: Interval) -> str:
    middle, low, high = interval
    return f"{middle:z.1f} [{low:z.1f}, {high:z.1f}]"


def _after(runs: Sequence[dict[str, list[float]]], best: list[float]) -> str:
    ways, few = [run["after"] for run in runs], len(best)
    shares = [share(ways, np.concatenate([run["twin"] for run in runs]).tolist())]
    if best:
        shares.append(share([way[:few] for way in ways], best))
    return ", ".join([_said(iqm(ways)), *shares])
