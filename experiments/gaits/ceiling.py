"""How far bodies can swim, by controller class, senses and search.

    python -m experiments.gaits --replicates 10 --others 1

Gaits for the whole robot and a dozen damaged ones are evolved by many searches. Each gait swims
from 32 initial poses that no search has seen. The same command resumes.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from aquafish_gym import Damage, Morphology, held_out
from aquafish_gym.runs.command_line import Out
from aquafish_gym.utils.validation import integer
from experiments.tables import experiment, shortened, write_tables
from gait import EvolveConfig, distances, evolve_gait, random_poses

BODIES = ("none", "left_pectoral:length=0.5", "caudal:missing", *held_out("recovery"))
POSES = 32
FINS: dict[str, Any] = {"senses": ("imu", "clock", "fins")}
SEARCHES = {
    "NEAT, as the paper has it": EvolveConfig(paper=True),
    "NEAT": EvolveConfig(search="neat"),
    "fourier": EvolveConfig(controller="linear", senses=("clock",), harmonics=3),
    "linear": EvolveConfig(search="cma", controller="linear"),
    "mlp": EvolveConfig(search="cma", controller="mlp"),
    "recurrent": EvolveConfig(search="cma"),
    "linear, fins": EvolveConfig(search="cma", controller="linear", **FINS),
    "mlp, fins": EvolveConfig(search="cma", controller="mlp", **FINS),
    "recurrent, fins": EvolveConfig(search="cma", **FINS),
}
RECOMMENDED = ("NEAT", "recurrent", "recurrent, fins")


@dataclass(frozen=True)
class Job:
    """One search on one body."""

    damage: str
    search: str
    seed: int
    config: EvolveConfig

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.damage}, {self.search}, seed {self.seed}"

    @property
    def file(self) -> str:
        """The path of its result in the run's folder."""
        body, search = (
            "".join(c if c.isalnum() else "-" for c in text) for text in (self.damage, self.search)
        )
        return f"runs/{body}/{search}/{self.seed:03d}.json"


def climb(job: Job) -> dict[str, Any]:
    """Run a search; return the gait's mean distance from poses that it has not seen."""
    body = Damage.parse(job.damage).apply(Morphology.nominal())
    began = time.process_time()
    found = evolve_gait(body, job.config)
    spent = time.process_time() - began
    poses = random_poses(POSES, 10**6)
    far = distances([found.controller], body, poses, job.config.seconds, threads=1)
    return {
        "distance": float(far[0, 0]),
        "seconds": spent,
        "controller": found.controller.to_dict(),
    }


@dataclass(frozen=True)
class Ceiling:
    """Search gaits for the whole robot and damaged ones, in a table."""

    example: ClassVar[str] = "--replicates 2 --budget-divisor 10 --out out/ceiling"

    out: Out = Path("out/ceiling")
    replicates: Annotated[int, tyro.conf.arg(aliases=("--seeds",))] = 10
    """Replicates of the recommended searches."""
    others: int = 1
    """Replicates of the others."""
    seed: int = 0
    """The first replicate's seed."""
    searches: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="SEARCH", help=f"Some of {', '.join(SEARCHES)}.")
    ] = tuple(SEARCHES)
    bodies: tuple[str, ...] = BODIES
    """Damages, or none."""
    budget_divisor: int = 1
    """Divide all generations by this, for a quick look."""
    workers: int | None = None
    """Processes; every core if not given."""

    def jobs(self) -> list[Job]:
        """Return all jobs, the most important first."""
        for name in ("replicates", "others", "budget_divisor"):
            integer(name, getattr(self, name), 1)
        integer("seed", self.seed, 0)
        return [
            Job(
                damage,
                name,
                self.seed + k,
                shortened(replace(SEARCHES[name], seed=self.seed + k), self.budget_divisor),
            )
            for k in range(max(self.replicates, self.others))
            for damage in self.bodies
            for name in self.searches
            if k < (self.replicates if name in RECOMMENDED else self.others)
        ]

    def execute(self) -> None:
        """Run the missing jobs, print a table, and write it to table.md, the times to times.md."""
        jobs = self.jobs()
        settings = {
            "divisor": self.budget_divisor,
            "searches": {k: asdict(c) for k, c in SEARCHES.items()},
        }
        outputs = ("table.md", "times.md")
        with experiment(
            jobs, climb, self.out, "a table of gaits", settings, outputs, self.workers
        ) as (folder, results):
            tables = self._tables(jobs, results)
            write_tables(folder, tables)
        # Ten columns do not fit a terminal.
        table = Table("body", "units of 5 cm in 20 s: mean (SD over seeds)", show_lines=True)
        for name, *numbers in tables["table"][1:]:
            cells = (f"{s}: {cell}" for s, cell in zip(self.searches, numbers, strict=True))
            table.add_row(name, "; ".join(cells))
        Console().print(table)

    def _tables(self, jobs: list[Job], results: list[dict[str, Any]]) -> dict[str, list[list[str]]]:
        found: dict[tuple[str, str], list[float]] = {}
        seconds: dict[str, list[float]] = {}
        for job, result in zip(jobs, results, strict=True):
            found.setdefault((job.damage, job.search), []).append(result["distance"])
            seconds.setdefault(job.search, []).append(result["seconds"])
        rows = [["", *self.searches]]
        for damage in self.bodies:
            cells = [_cell(found[damage, name]) for name in self.searches]
            rows.append(["whole" if damage == "none" else damage, *cells])
        times = ["CPU s a gait", *(f"{np.mean(seconds[name]):.0f}" for name in self.searches)]
        return {"table": rows, "times": [["", *self.searches], times]}


def _cell(values: list[float]) -> str:
    spread = f" ({np.std(values, ddof=1):.1f})" if len(values) > 1 else ""
    return f"{np.mean(values):.1f}{spread}"
