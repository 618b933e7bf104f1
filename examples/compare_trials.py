"""What the choice of the trials is worth: to the sizes that are inferred, and to the gait.

    python examples/compare_trials.py --seeds 6 --out out/trials

Random fish, each size uniform in a tenth to the whole of its range, whose gyroscope is noisy, model
themselves by joint inference. After each trial a gait is evolved for 50 bodies that the trials
allow, and swims on the fish from 16 random poses, as does a gait evolved on the true body, the
oracle's. The same command goes on with what is missing.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from aquafish.gait_utility import GaitUtility
from aquafish.recovery.treatment import BODIES, source_stamp
from aquafish_gym import Morphology
from aquafish_gym.morphology import MAXIMA
from aquafish_gym.runs.folder import claim, held
from aquafish_gym.runs.runner import Event, read_result, run_jobs
from aquafish_gym.runs.storage import ensure_writable_directory
from aquafish_gym.utils.command_line import BAD_INPUT, Out, run_command_line, single_command
from aquafish_gym.utils.validation import finite_array, integer
from eea import ConfigurationError, EEAConfig, EngineTarget, fish_eea, streams
from eea.core.exploration import ExplorationConfig, Strategy
from eea.fish.gap import RealityGap
from gait import EvolveConfig, distances, evolve_gait, random_poses

LEAST, POSES = 0.1, 16  # of a range; of a gait that is scored
ORACLE = "oracle"


@dataclass(frozen=True)
class Job:
    """One fish, and how its trials are chosen; the oracle needs none."""

    how: str
    seed: int
    noise: float
    config: EEAConfig
    gait: EvolveConfig

    @property
    def name(self) -> str:
        """For people."""
        return f"seed {self.seed}, {self.how}"

    @property
    def file(self) -> str:
        """Relative to the folder."""
        return f"seed-{self.seed:03d}/{self.how}.json"


def random_body(seed: int) -> Morphology:
    """Return the fish of a seed, each size uniform in a tenth to the whole of its range."""
    sizes = np.random.default_rng(seed).uniform(LEAST, 1.0, len(MAXIMA))
    return Morphology.from_array(sizes * MAXIMA)


def compare(job: Job, say: Callable[[str, float], None]) -> dict[str, Any]:
    """Return what each trial came to: OBJ_FIT, and how far the gait then swims on the fish."""
    body = random_body(job.seed)

    def far(bodies: NDArray[np.float64]) -> float:
        gait = evolve_gait(bodies, job.gait).controller
        swims = distances([gait], body, random_poses(POSES, job.seed), threads=job.gait.threads)
        return float(swims[0, 0])

    if job.how == ORACLE:
        return {"rows": [{"distance": far(body.to_array()[None])}]}
    steps, hidden = job.config.steps, streams(job.seed)["target"]
    noisy = RealityGap(gyro_noise=job.noise)
    target = EngineTarget(body, None, hidden, steps, "numba", gap=noisy)
    method = fish_eea(
        target,
        job.config,
        job.seed,
        body,
        GaitUtility.quicker(job.gait),
        threads=job.gait.threads,
    )
    rows = []
    for record in method:
        say(f"trial {record.round}", record.round / job.config.rounds)
        found = {"objective_fitness": record.objective_fitness, "command": list(record.command)}
        rows.append(found | {"distance": far(method.result.sample(BODIES, job.seed))})
    return {"rows": rows}


@dataclass(frozen=True)
class CompareTrials:
    """Compare ways to choose the next trial."""

    out: Out = Path("out/trials")
    strategies: tuple[Strategy, ...] = ("fast", "a-optimal", "gait")
    """How commands are chosen."""
    trials: int = 3
    """Each fish's."""
    seeds: int = 6
    """Fish, with seeds from 0 upwards."""
    noise: float = 0.03
    """Standard deviation of the gyroscope's noise, rad/s."""
    steps: int = 256
    """Length of a trial in steps of 0.01 s."""
    gait: EvolveConfig = field(
        default_factory=lambda: EvolveConfig(
            generations=30, population=100, starts=1, polish=0, threads=1
        )
    )

    def jobs(self) -> list[Job]:
        """Return all that is to be done."""
        integer("seeds", self.seeds, 2)
        finite_array("noise", self.noise, (), 0.0, 1e3, "rad/s")
        config = EEAConfig("joint", steps=self.steps, rounds=self.trials)
        ways: dict[str, EEAConfig] = {
            name: replace(config, exploration=ExplorationConfig(strategy=name))
            for name in self.strategies
        }
        return [
            Job(how, seed, self.noise, ways.get(how, config), replace(self.gait, seed=seed))
            for seed in range(self.seeds)
            for how in (*ways, ORACLE)
        ]

    def execute(self) -> None:
        """Do what is missing and print a table."""
        jobs, folder = self.jobs(), ensure_writable_directory(self.out)
        settings = {"noise": self.noise, "config": jobs[-1].config.to_dict()}
        settings["gait"] = {k: v for k, v in asdict(self.gait).items() if k != "threads"}
        with (
            held(folder),
            Progress(console=Console(stderr=True)) as bar,
            ThreadPoolExecutor(1) as executor,
        ):
            claim(folder, "a comparison of trials", settings, {"source": source_stamp()})
            task = bar.add_task("fish and strategies", total=len(jobs))

            def tell(event: Event[Job]) -> None:
                bar.update(task, advance=event.kind == "done", description=event.job.name)

            failures = run_jobs(jobs, compare, folder, executor, tell)
        if failures:
            print("\n".join(failures), file=sys.stderr)
            raise SystemExit(1)
        Console().print(self._table(jobs, folder))

    def _table(self, jobs: list[Job], folder: Path) -> Table:
        rows: dict[str, list[list[dict[str, Any]]]] = {}
        for job in jobs:
            rows.setdefault(job.how, []).append((read_result(folder, job) or {})["rows"])
        best = np.array([[row["distance"] for row in one] for one in rows.pop(ORACLE)])
        table = Table(title=f"{self.seeds} random fish, noise {self.noise:g} rad/s")
        columns = ("strategy", "trials", "OBJ_FIT mean", "least", "gait's distance", "least share")
        for column in columns:
            table.add_column(column, justify="left" if column == "strategy" else "right")
        for how, fish in rows.items():
            objective, distance = (
                np.array([[row[key] for row in one] for one in fish])
                for key in ("objective_fitness", "distance")
            )
            share = distance / best
            for trial in range(self.trials):
                scores, far = objective[:, trial], distance[:, trial]
                table.add_row(
                    how if not trial else "", f"{trial + 1}", f"{scores.mean():.3f}",
                    f"{scores.min():.3f}", f"{far.mean():.2f}", f"{share[:, trial].min():.0%}",
                )  # fmt: skip
        table.add_row("oracle", "", "1.000", "1.000", f"{best.mean():.2f}", "100%")
        return table


if __name__ == "__main__":
    sys.exit(
        run_command_line(
            "compare_trials",
            single_command(CompareTrials),
            refused=(*BAD_INPUT, ConfigurationError),
        )
    )
