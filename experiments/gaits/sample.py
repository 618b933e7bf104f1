"""Compare gaits for a sample of a posterior with gaits for its median body.

    python -m experiments.gaits.sample

Ten robots with the held-out damages perform one trial with a noisy gyroscope. Gaits are evolved for
the median body of the joint posterior, for fifty draws from it, and for the true body, and swim on
the true body. The same command resumes.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from rich.console import Console
from rich.table import Table
from tyro.conf import arg

from aquafish_gym import Damage, Morphology, held_out
from aquafish_gym.runs.command_line import Out, run_command_line
from aquafish_gym.utils.validation import finite_array, integer
from eea import JointConfig
from eea.core import streams
from eea.fish import EngineTarget, RealityGap, fish_eea
from experiments.tables import experiment, write_tables
from gait import EvolveConfig, distances, evolve_gait, random_poses

DAMAGES = held_out("recovery")
BODIES = 50
POSES = 32
ORACLE = "the true body"
ONE = "the median body"
KINDS = (ONE, "fifty draws")


@dataclass(frozen=True)
class Job:
    """One gait for one robot."""

    seed: int  # of the damage and of all random streams
    kind: str
    noise: float
    trials: int
    gait: EvolveConfig

    @property
    def name(self) -> str:
        """For people."""
        return f"robot {self.seed}, {self.kind}"

    @property
    def file(self) -> str:
        """The path of its result in the run's folder."""
        how = "oracle" if self.kind == ORACLE else f"{self.noise:g}-{KINDS.index(self.kind)}"
        return f"runs/{self.seed:03d}/{how}.json"


def compare(job: Job) -> dict[str, Any]:
    """Return how far the gait swims on the true body, and the median body's OBJ_FIT."""
    damage = Damage.parse(DAMAGES[job.seed % len(DAMAGES)])
    truth = damage.apply(Morphology.nominal())
    bodies = truth.to_array()[None]
    fitness: float | None = 1.0
    if job.kind != ORACLE:
        config = JointConfig(rounds=job.trials)
        hidden = streams(job.seed)["target"]
        noisy = RealityGap(gyro_noise=job.noise)
        target = EngineTarget(None, damage, hidden, config.steps, "numba", gap=noisy)
        method = fish_eea(target, config, job.seed, target.morphology, threads=1)
        for record in method:
            fitness = record.objective_fitness
        found = method.result
        bodies = found.body[None] if job.kind == ONE else found.sample(BODIES, job.seed)
    gait = evolve_gait(bodies, job.gait)
    far = distances([gait.controller], truth, random_poses(POSES, 10**6), threads=1)
    return {"distance": float(far[0, 0]), "objective_fitness": fitness}


@dataclass(frozen=True)
class CompareGaits:
    """Compare gaits for a sample of a posterior with gaits for its median body, in a table."""

    example: ClassVar[str] = "--noise 0.03 --replicates 3 --out out/sample"
    main_options: ClassVar[tuple[str, ...]] = ("out", "noise", "trials", "replicates", "workers")

    out: Out = Path("out/sample")
    noise: tuple[float, ...] = (0.03, 0.1)
    """Standard deviations of the gyroscope noise, rad/s."""
    trials: int = 1
    """Trials of each robot, of 2.56 s."""
    replicates: Annotated[int, arg(aliases=("--seeds",))] = len(DAMAGES)
    """Robots, with seeds from 0 upwards; the damages repeat after ten."""
    gait: EvolveConfig = field(default_factory=lambda: EvolveConfig(search="cma", threads=1))
    workers: int | None = None
    """Processes; every core if not given."""

    def jobs(self) -> list[Job]:
        """Return all jobs."""
        for name in ("trials", "replicates"):
            integer(name, getattr(self, name), 1)
        noises = finite_array("noise", self.noise, (None,), 0.0, 10.0, "rad/s").tolist()
        return [
            Job(seed, kind, noise, self.trials, replace(self.gait, seed=seed))
            for seed in range(self.replicates)
            for kind, noise in [(ORACLE, 0.0), *((kind, one) for one in noises for kind in KINDS)]
        ]

    def execute(self) -> None:
        """Run the missing jobs, print a table, and write it to table.md."""
        jobs = self.jobs()
        whole = {"seed": None, "generations": self.gait.choices.generations}
        settings = {"trials": self.trials, "gait": {**self.gait.settings, **whole}}
        with experiment(
            jobs, compare, self.out, "gaits for samples", settings, ("table.md",), self.workers
        ) as (folder, results):
            rows = self._rows(dict(zip(jobs, results, strict=True)))
            write_tables(folder, {"table": rows})
        table = Table(*rows[0])
        for row in rows[1:]:
            table.add_row(*row)
        Console().print(table)

    def _rows(self, results: dict[Job, dict[str, Any]]) -> list[list[str]]:
        far = {(job.seed, job.kind, job.noise): one for job, one in results.items()}
        rows = [["noise, rad/s", "gait for", "OBJ_FIT", "mean", "share, median", "share, least"]]
        for noise in self.noise:
            for kind in KINDS:
                found = [far[seed, kind, noise] for seed in range(self.replicates)]
                best = [far[seed, ORACLE, 0.0]["distance"] for seed in range(self.replicates)]
                distance = np.array([one["distance"] for one in found])
                share = distance / best
                fitness = np.median([one["objective_fitness"] for one in found])
                cells = [f"{fitness:.3f}", f"{distance.mean():.2f}"]
                cells += [f"{value:.0%}" for value in (np.median(share), share.min())]
                rows.append([f"{noise:g}", kind, *cells])
        return [*rows, ["", ORACLE, "1.000", f"{np.mean(best):.2f}", "100%", "100%"]]


if __name__ == "__main__":
    sys.exit(run_command_line("experiments.gaits.sample", CompareGaits))
