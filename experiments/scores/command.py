"""Reference scores: simple, evolved and learned controllers at every task, whole and damaged.

    python -m experiments.scores --out out/scores

Each controller is made for a task with a seed of its own, and then plays a hundred episodes that
are the same for all, from random fin angles. The table shows interquartile means of the returns
with 95% bootstrap intervals over seeds and episodes. Controllers for AquaFishRecovery-v0 and
AquaFishReturn-v0 are those made for AquaFish-v0. For the return the table also shows the share of
successes with Wilson's 95% interval, in the episodes of all seeds. For the recovery it also shows
the distance after the onset, in units, and that distance as a share of the same controller's in an
undamaged episode, and of the oracle's in the first 20 episodes (a dash where the reference is under
one unit). The oracle is a gait evolved for the broken robot itself, its servo gains included, and
refined from its state at the onset.

DIR holds table.md, return.md for AquaFishReturn-v0, times.md, scores.png, curves.png, and a file
for each controller with its weights, learning curve and returns. The same command resumes; one for
fewer rows shows these.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from aquafish_gym import IDS
from aquafish_gym.damage.tiers import TIERS
from aquafish_gym.plans import AQUAFISH, check_plan
from aquafish_gym.rendering.pictures import save_figure
from aquafish_gym.runs.command_line import Out
from aquafish_gym.runs.jobs import read_result
from aquafish_gym.utils.validation import InvalidArgumentError, integer, one_of
from experiments.scores.entries import ENTRIES, ORACLE_CONFIG, oracle
from experiments.scores.episodes import COLUMNS, IDS_OF, RECOVERY, RETURN, MadeFor, play
from experiments.scores.figures import curves_figure, scores_figure
from experiments.tables import experiment, interval_text, write_tables
from gait.controllers.controller import Controller
from gait.learning.train import LearningConfig, load_extra
from gait.swims.evaluation import EPISODES, Interval, interquartile_mean, success_rate

TASKS_OF_AQUAFISH: tuple[MadeFor, ...] = ("forward", "station", "waypoint")
ORACLE = "oracle"
ORACLE_EPISODES = 20  # the first ones of those that all others play
FIRST_SEED = 100  # of the replicates: everything was tried and tuned on lower ones
ROWS = (*ENTRIES, ORACLE)
PICTURE = "scores.png"
CURVES = "curves.png"


@dataclass(frozen=True)
class Job:
    """One controller: made for a task, then scored."""

    entry: str
    task: MadeFor
    seed: int
    divisor: int
    episodes: int
    earlier: str = ""  #: Folder of an earlier run, whose controller plays.

    @property
    def learns(self) -> bool:
        """Whether it needs the extra ``rl``."""
        return not self.earlier and isinstance(ENTRIES[self.entry].config, LearningConfig)

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.task}, {self.entry}, seed {self.seed}"

    @property
    def file(self) -> str:
        """The path of its result in the run's folder."""
        name = "".join(c if c.isalnum() else "-" for c in self.entry)
        return f"runs/{self.task}/{name}/{self.seed:03d}.json"


@dataclass(frozen=True)
class OracleJob:
    """One episode of the recovery with a gait for the broken robot."""

    tier: str
    episode: int
    divisor: int
    learns: ClassVar[bool] = False

    @property
    def name(self) -> str:
        """For people."""
        return f"recovery, {ORACLE}, {self.tier} damage, episode {self.episode}"

    @property
    def file(self) -> str:
        """The path of its result in the run's folder."""
        return f"runs/forward/{ORACLE}/{self.tier}-{self.episode:03d}.json"


def score(job: Job | OracleJob) -> dict[str, Any]:
    """Make a controller and play the episodes; return the scores ready for JSON."""
    began = time.process_time()
    if isinstance(job, OracleJob):
        after = oracle(job.tier, job.episode, job.divisor)
        return {"seconds": time.process_time() - began, "after": after}
    entry = ENTRIES[job.entry]
    controller: Controller | None
    if job.earlier and entry.config:
        kept = read_result(Path(job.earlier), job) or {}
        controller, curve = Controller.from_dict(kept["controller"]), kept["curve"]
        seconds = kept["seconds"]
    else:
        controller, curve = entry.make(job.task, job.seed, job.divisor)
        seconds = time.process_time() - began
    plan = check_plan(IDS[IDS_OF[job.task][0]].get("plan", AQUAFISH))
    agent = entry.fixed(plan) if controller is None else controller
    return {
        "seconds": seconds,
        "curve": curve,
        "controller": None if controller is None else controller.to_dict(),
        "scores": {name: play(name, agent, job.episodes) for name in IDS_OF[job.task]},
    }


def share(distances: Sequence[Sequence[float]], best: Sequence[float]) -> str:
    """Return the mean distance as a share of the best; a dash if that is under one unit.

    Examples
    --------
    >>> share([[1.0, 2.0]], [3.0, 3.0]), share([[1.0]], [0.5])
    ('50%', '-')
    """
    whole = float(np.mean(best))
    return "-" if whole < 1.0 else f"{np.concatenate(distances).mean() / whole:.0%}"


@dataclass(frozen=True)
class Scores:
    """Score simple, evolved and learned controllers at every task, whole and under each tier."""

    example: ClassVar[str] = "--tasks forward --replicates 1 --budget-divisor 20 --out out/scores"

    out: Out = Path("out/scores")
    entries: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME", help=f"Some of {'; '.join(ROWS)}.")
    ] = ROWS
    tasks: tuple[MadeFor, ...] = TASKS_OF_AQUAFISH
    """Tasks, or other fish that swim forward, that controllers are made for; those made for
    "forward" also play the recovery and the return."""
    replicates: int = 5
    """Replicates of what is evolved or learned, with seeds from 100 upwards."""
    episodes: int = EPISODES
    """Episodes that each controller plays of each task."""
    budget_divisor: int = 1
    """Divide the cost of evolution and learning by this, for a quick look."""
    controllers: Path | None = None
    """Folder of an earlier run: its controllers play, and none is made. Entries without a file
    there are left out."""
    workers: int | None = None
    """Processes; every core if not given. No result depends on it."""

    def jobs(self) -> list[Job | OracleJob]:
        """Return all jobs."""
        for name in ("replicates", "budget_divisor"):
            integer(name, getattr(self, name), 1)
        integer("episodes", self.episodes, 1, EPISODES)  # of which there are held-out damages
        known: dict[str, Iterable[str]] = {"entries": ROWS, "tasks": IDS_OF}
        for name, choices in known.items():
            given = [one_of(name, one, choices) for one in getattr(self, name)]
            if not given or len(set(given)) < len(given):
                raise InvalidArgumentError(
                    f"{name} must be one or more, each named once; got {', '.join(given) or 'none'}"
                )
        earlier = str(self.controllers or "")
        jobs: list[Job | OracleJob] = [
            Job(name, task, FIRST_SEED + seed, self.budget_divisor, self.episodes, earlier)
            for seed in range(self.replicates)
            for task in self.tasks
            for name in self.entries
            if name in ENTRIES and (not seed or ENTRIES[name].config)
        ]
        if self.controllers:
            return [job for job in jobs if self._is_kept(job)]
        if ORACLE in self.entries and "forward" in self.tasks:
            few = min(self.episodes, ORACLE_EPISODES)
            jobs += [OracleJob(tier, i, self.budget_divisor) for tier in TIERS for i in range(few)]
        return jobs

    def _is_kept(self, job: Job | OracleJob) -> bool:
        """Whether a job needs no controller, or has one in the folder of the earlier run."""
        fixed = isinstance(job, Job) and not ENTRIES[job.entry].config
        return fixed or (Path(self.controllers or "") / job.file).exists()

    def execute(self) -> None:
        """Do the missing jobs, print a table, and write it to table.md, return.md and times.md."""
        jobs = self.jobs()
        if any(job.learns and not (self.out / job.file).exists() for job in jobs):
            load_extra("stable_baselines3")  # a missing package is refused before the first job
        entries = {
            name: {**asdict(entry.config), "damage": entry.damage}
            for name, entry in ENTRIES.items()
            if entry.config
        }
        settings = {
            "divisor": self.budget_divisor, "episodes": self.episodes, "entries": entries,
            ORACLE: [asdict(ORACLE_CONFIG), ORACLE_EPISODES],
        } | ({"controllers": str(self.controllers)} if self.controllers else {})  # fmt: skip
        outputs = ("table.md", "return.md", "times.md", PICTURE, CURVES)
        with experiment(
            jobs, score, self.out, "reference scores", settings, outputs, self.workers
        ) as (folder, results):
            tables = self._tables(jobs, results)
            write_tables(folder, tables)
        head, *body = tables["table"]
        body += tables.get("return", [])[1:]
        for name, several in groupby(body, key=lambda row: row[0]):
            table = Table(*head[1:], title=name)
            for row in several:
                table.add_row(*row[1:])
            Console().print(table)

    def _tables(
        self, jobs: Sequence[Job | OracleJob], results: Sequence[dict[str, Any]]
    ) -> dict[str, list[list[str]]]:
        """Return the tables of scores and of times, and draw the pictures."""
        made: dict[tuple[str, str], list[dict[str, Any]]] = {}
        best: dict[str, list[float]] = {tier: [] for tier in TIERS}
        spent: list[float] = []
        for job, result in zip(jobs, results, strict=True):
            if isinstance(job, OracleJob):
                best[job.tier].append(result["after"])
                spent.append(result["seconds"])
            else:
                made.setdefault((job.entry, job.task), []).append(result)
        rows = [["environment", "controller", "observes", *COLUMNS]]
        times = [["controller", *(f"CPU s, {task}" for task in self.tasks)]]
        scored: dict[tuple[str, str], list[Interval]] = {}
        names = [name for name in self.entries if name in ENTRIES]
        for entry in names:
            taken = [[one["seconds"] for one in made.get((entry, task), ())] for task in self.tasks]
            times.append([entry, *(f"{np.mean(some):.0f}" if some else "-" for some in taken)])
        if spent:
            own = f"{np.mean(spent):.0f}"
            times.append([ORACLE, *(own if task == "forward" else "-" for task in self.tasks)])
        for task in self.tasks:
            for name in IDS_OF[task]:
                for entry in names:
                    found = made.get((entry, task))
                    if found is None:  # not among the controllers of an earlier run
                        continue
                    intervals = [
                        interquartile_mean([one["scores"][name][c]["returns"] for one in found])
                        for c in COLUMNS
                    ]
                    scored[name, entry] = intervals
                    rows.append(
                        [name, entry, ENTRIES[entry].observes, *map(interval_text, intervals)]
                    )
        if scored:
            save_figure(scores_figure(scored), self.out / PICTURE)
        curves: dict[tuple[str, str], list[Any]] = {
            (task, entry): [one["curve"] for one in found]
            for (entry, task), found in made.items()
            if found[0].get("curve")
        }
        if curves:
            save_figure(curves_figure(curves), self.out / CURVES)
        if "forward" not in self.tasks:
            return {"table": rows, "times": times}
        names = [entry for entry in names if (entry, "forward") in made]
        for entry in names:
            runs = [one["scores"][RETURN] for one in made[entry, "forward"]]
            cells = [_rate([run[column]["successes"] for run in runs], self) for column in COLUMNS]
            rows.append([f"{RETURN}, success", entry, ENTRIES[entry].observes, *cells])
        after = f"{RECOVERY}, after the onset"
        for entry in names:
            runs = [one["scores"][RECOVERY] for one in made[entry, "forward"]]
            cells = [_after([run[tier] for run in runs], best[tier]) for tier in TIERS]
            rows.append([after, entry, ENTRIES[entry].observes, "", *cells])
        if spent:
            cells = [interval_text(interquartile_mean([best[tier]])) for tier in TIERS]
            rows.append([after, ORACLE, "the broken robot", "", *cells])
        head, *body = rows
        returned = [row for row in body if row[0].startswith(RETURN)]
        others = [row for row in body if row not in returned]
        return {"table": [head, *others], "return": [head, *returned], "times": times}


def _rate(successes: Sequence[int], command: Scores) -> str:
    """Return a cell: the share of successes in the episodes of all runs, with its interval."""
    share, low, high = success_rate(sum(successes), len(successes) * command.episodes)
    return f"{share:.0%} [{low:.0%}, {high:.0%}]"


def _after(runs: Sequence[dict[str, list[float]]], best: list[float]) -> str:
    """Return a cell: the distance after the onset, its share of the twin's and the oracle's."""
    distances = [run["after"] for run in runs]
    few = len(best)
    shares = [share(distances, np.concatenate([run["twin"] for run in runs]).tolist())]
    if best:
        shares.append(share([one[:few] for one in distances], best))
    return ", ".join([interval_text(interquartile_mean(distances)), *shares])
