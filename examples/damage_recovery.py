"""The paper's case study, from damage to recovery (Sec. 5).

    python examples/damage_recovery.py --out out/recovery

A robot fish loses half of a pectoral fin. From a few blind trials it works out its new body,
evolves a gait for that body in its head, and swims on. Four treatments differ in the body that
the gait is evolved on; each gait is then swum on the damaged robot. Everything is written to
``--out``: ``report.md`` and ``report.json``, figures, a film, and a folder a replicate with all
rounds, controllers and paths. An interrupted run goes on where it stopped.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.markdown import Markdown

from aquafish_gym import Damage
from aquafish_gym.engines.base import find_engine
from aquafish_gym.runs.locks import only_here
from aquafish_gym.runs.storage import ensure_writable_directory, read_records
from aquafish_gym.utils.command_line import (
    BAD_INPUT,
    read_morphology,
    run_command_line,
    single_command,
)
from aquafish_gym.utils.validation import InvalidArgumentError, integer
from eea import ConfigurationError, recovery_config
from eea.core.config import RECOVERY
from gait.evolve import EvolveConfig
from gait.transfer import TransferConfig
from recovery import figures
from recovery.report import build_report, markdown, versions, write_report
from recovery.running import claim, held_settings, run_jobs, source_stamp
from recovery.statistics import Outcomes
from recovery.treatments import (
    MODELLED,
    ROUNDS_FILE,
    TREATMENTS,
    Job,
    read_outcome,
)

FIGURES = ("bodies.png", "paths.png", "fitness.png", "distances.png", "film.gif")


@dataclass(frozen=True)
class DamageRecovery:
    """Damage a fish, let it model itself, evolve a gait, and score it on the damaged fish."""

    out: Path = Path("out/recovery")
    """Where everything is written. An interrupted run there goes on: all rounds of self-models and
    all generations of gaits are kept."""
    damage: str = "left_pectoral:length=0.5"
    """What breaks: FIN:SIZE=FACTOR or FIN:missing, several joined by ";". FIN is left_pectoral,
    right_pectoral or caudal; SIZE is length, width or thickness."""
    morphology: Path | None = None
    """A JSON file of the healthy body; the prototype if not given."""
    seed: int = 0
    """The first replicate's seed."""
    seeds: int = 1
    """Replicates, with seeds from `seed` upwards."""
    rounds: int = RECOVERY.rounds
    """Trials on the damaged robot, one a round."""
    steps: int = RECOVERY.steps
    """Length of a trial in steps of 0.01 s, a power of two."""
    models: int = RECOVERY.estimation.population
    """Population of candidate bodies, for both self-models."""
    angle_sets: int = RECOVERY.out_of_band.inner_population
    """Population of Out-of-Band's inner search for the fins' angles."""
    sampled_models: int | None = RECOVERY.out_of_band.sampled_models
    """Bodies that judge the angles in Out-of-Band's inner search; None for all."""
    revisit: int = RECOVERY.out_of_band.revisit
    """Earlier trials whose angles each of Out-of-Band's searches infers anew; the paper's 0 locks
    them in."""
    generations: int = 60
    """Generations of gait evolution."""
    population: int = 150
    """Gaits a generation."""
    gait_poses: int = 8
    """Random fin poses that a gait must swim from while it evolves, besides the zero pose."""
    poses: int = 16
    """Random fin poses that a finished gait is scored from, besides the zero pose."""
    seconds: float = 20.0
    """Length of a swim."""
    engine: str = "pybullet"
    """Where the damaged robot lives: pybullet or numba."""
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None
    """Processes; every core if not given. No result depends on it."""
    film: bool = True
    """Also draw the film, which takes some seconds."""
    redraw: bool = False
    """Only write report and pictures anew from what a finished folder holds."""

    def jobs(self) -> list[Job]:
        """Return every treatment of every replicate, the longest first.

        Raises
        ------
        InvalidArgumentError, ConfigurationError, EngineUnavailableError
            If a setting is wrong; the message names it.
        """
        integer("seed", self.seed, 0)
        integer("seeds", self.seeds, 1)
        if self.workers is not None:
            integer("workers", self.workers, 1)
        find_engine(self.engine)
        body = read_morphology(self.morphology, "morphology")
        damage = Damage.coerce(self.damage)
        damage.apply(body)
        eea = recovery_config(self.steps, self.rounds)
        eea = replace(
            eea,
            estimation=replace(eea.estimation, population=self.models),
            out_of_band=replace(
                eea.out_of_band,
                inner_population=self.angle_sets,
                sampled_models=self.sampled_models,
                revisit=self.revisit,
            ),
        )
        order = ("out-of-band", "none", "undamaged", "oracle")
        return [
            Job(
                treatment=treatment,
                seed=seed,
                morphology=body,
                damage=damage,
                eea=eea,
                gait=EvolveConfig(
                    seed=seed,
                    generations=self.generations,
                    population=self.population,
                    poses=self.gait_poses,
                    seconds=self.seconds,
                    threads=1,
                ),
                transfer=TransferConfig(
                    poses=self.poses,
                    seed=seed,
                    seconds=self.seconds,
                    target_engine=self.engine,
                ),
                directory=self.out / f"seed-{seed:03d}" / treatment,
            )
            for seed in range(self.seed, self.seed + self.seeds)
            for treatment in order
        ]

    def settings(self, jobs: list[Job]) -> dict[str, Any]:
        """Return all that the results depend on, ready for JSON."""
        job = jobs[0]
        parts = {
            "eea": job.eea.to_dict(),
            "gait": asdict(job.gait),
            "transfer": asdict(job.transfer),
        }
        for part in parts.values():
            for name in ("condition", "seed", "threads"):  # each job's own
                part.pop(name, None)
        return {
            "damage": str(job.damage),
            "morphology": job.morphology.to_dict(),
            "first_seed": self.seed,
            **parts,
            "versions": versions(),
            "source": source_stamp(),
        }

    def execute(self) -> None:
        """Run, write and show everything."""
        jobs = self.jobs()
        settings = self.settings(jobs)
        unfinished = [job for job in jobs if not job.finished]
        if self.redraw:
            if unfinished:
                raise InvalidArgumentError(
                    f"redraw needs a finished folder; {self.out} lacks {unfinished[0].name}"
                )
            # The numbers are those of the code that made them, which the folder names.
            settings |= {k: held_settings(self.out)[k] for k in ("versions", "source")}
        ensure_writable_directory(self.out)
        with only_here(self.out):
            claim(self.out, settings)
            run_jobs(unfinished, self.workers)
            self.publish(jobs, settings)

    def publish(self, jobs: list[Job], settings: dict[str, Any]) -> None:
        """Write report and figures from the outcomes on disk."""
        outcomes = {
            t: [read_outcome(job.directory) for job in jobs if job.treatment == t]
            for t in TREATMENTS
        }
        seeds = [j.seed for j in jobs if j.treatment == "oracle"]
        # Only PyBullet can draw the robot; without it the study is whole but for two pictures.
        drawable = importlib.util.find_spec("pybullet") is not None
        wanted = {"bodies.png": drawable, "film.gif": drawable and self.film}
        drawn = [name for name in FIGURES if wanted.get(name, True)]
        report = build_report(settings, seeds, outcomes)
        write_report(self.out, report, drawn)
        self.draw(jobs, outcomes, drawn)
        text = markdown(report, []).split("## Figures")[0]
        Console().print(Markdown(text), f"Report and pictures: {self.out}", sep="\n")
        if not drawable:
            print("bodies.png and film.gif need PyBullet, which draws the robot", file=sys.stderr)

    def draw(self, jobs: list[Job], outcomes: Outcomes, names: list[str]) -> None:
        """Write the figures of these names."""
        first = {t: next(j.directory for j in jobs if j.treatment == t) for t in TREATMENTS}
        rounds = {
            t: [read_records(j.directory / ROUNDS_FILE) for j in jobs if j.treatment == t]
            for t in MODELLED
        }
        body, target = jobs[0].morphology, jobs[0].target
        draw: dict[str, Callable[[Path], None]] = {
            "bodies.png": lambda path: figures.draw_bodies(path, target, outcomes),
            "paths.png": lambda path: figures.draw_paths(path, first),
            "fitness.png": lambda path: figures.draw_fitness(path, target, rounds),
            "distances.png": lambda path: figures.draw_distances(path, outcomes),
            "film.gif": lambda path: figures.film(path, body, target, first),
        }
        for name in names:
            draw[name](self.out / name)


if __name__ == "__main__":
    sys.exit(
        run_command_line(
            "damage_recovery",
            single_command(DamageRecovery),
            refused=(*BAD_INPUT, ConfigurationError),
        )
    )
