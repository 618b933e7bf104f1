"""The paper's case study, from damage to recovery (Sec. 5).

    python examples/damage_recovery.py --out out/recovery

A robot fish loses half of a pectoral fin. From a few blind trials it works out its new body,
evolves a gait for that body in its head, and swims on. Four treatments differ in the body that
the gait is evolved on; each gait is then swum on the damaged robot. Everything is written to
``--out``: ``report.md`` and ``report.json``, figures, a film, and a folder a replicate with all
rounds, controllers and paths. An interrupted run goes on where it stopped.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import queue
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.markdown import Markdown
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from aquafish_gym import Damage
from aquafish_gym.commandline import BAD_INPUT, read_morphology, run_command_line, single_command
from aquafish_gym.engines.base import find_engine
from aquafish_gym.storage import ensure_writable_directory, read_records, write_json
from aquafish_gym.validation import InvalidArgumentError, integer
from eea import ConfigurationError, EEAConfig
from eea.estimation import EstimationConfig
from eea.genetic import GeneticConfig
from eea.inference import OutOfBandConfig
from gait.evolve import EvolveConfig
from gait.transfer import TransferConfig
from recovery import figures
from recovery.report import build_report, markdown, write_report
from recovery.treatments import (
    MODELLED,
    ROUNDS_FILE,
    TREATMENTS,
    Job,
    read_outcome,
    run_job,
)

CONFIG_FILE = "config.json"
FIGURES = ("bodies.png", "paths.png", "fitness.png", "distances.png", "film.gif")


@dataclass(frozen=True)
class DamageRecovery:
    """Damage a fish, let it model itself, evolve a gait, and score it on the damaged fish."""

    out: Path = Path("out/recovery")
    """Where everything is written; an interrupted run there goes on."""
    damage: str = "left_pectoral:length=0.5"
    """What breaks."""
    morphology: Path | None = None
    """A JSON file of the healthy body; the prototype if not given."""
    seed: int = 0
    """The first replicate's seed."""
    seeds: int = 1
    """Replicates, with seeds from `seed` upwards."""
    rounds: int = 16
    """Trials on the damaged robot, one a round."""
    steps: int = 256
    """Length of a trial in steps of 0.01 s, a power of two."""
    models: int = 25
    """Population of candidate bodies, for both self-models."""
    angle_sets: int = 25
    """Population of Out-of-Band's inner search for the fins' angles."""
    sampled_models: int = 5
    """Bodies that judge the angles in Out-of-Band's inner search, as in the paper's Fig. 10."""
    revisit: int = 5
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
        eea = EEAConfig(
            rounds=self.rounds,
            steps=self.steps,
            estimation=EstimationConfig(population=self.models),
            # Measured better than uniform for Out-of-Band, whatever else was set.
            genetic=GeneticConfig(crossover="two_point"),
            out_of_band=OutOfBandConfig(
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

    def settings(self) -> dict[str, Any]:
        """Return what the results depend on, ready for JSON."""
        free = ("out", "workers", "film", "seeds", "morphology")
        kept = {k: v for k, v in asdict(self).items() if k not in free}
        return kept | {"morphology": self.jobs()[0].morphology.to_dict()}

    def execute(self) -> None:
        """Run, write and show everything."""
        jobs = self.jobs()
        ensure_writable_directory(self.out)
        _claim(self.out, self.settings())
        run_jobs([job for job in jobs if not job.finished], self.workers)
        self.publish(jobs)

    def publish(self, jobs: list[Job]) -> None:
        """Write figures and report from the outcomes on disk."""
        outcomes = {
            t: [read_outcome(job.directory) for job in jobs if job.treatment == t]
            for t in TREATMENTS
        }
        first = {t: next(j.directory for j in jobs if j.treatment == t) for t in TREATMENTS}
        rounds = {
            t: [read_records(j.directory / ROUNDS_FILE) for j in jobs if j.treatment == t]
            for t in MODELLED
        }
        target, drawn = jobs[0].target, [f for f in FIGURES if self.film or f != "film.gif"]
        figures.draw_bodies(self.out / "bodies.png", target, outcomes)
        figures.draw_paths(self.out / "paths.png", first)
        figures.draw_fitness(self.out / "fitness.png", target, rounds)
        figures.draw_distances(self.out / "distances.png", outcomes)
        if self.film:
            figures.film(self.out / "film.gif", jobs[0].morphology, target, first)
        seeds = [j.seed for j in jobs if j.treatment == "oracle"]
        report = build_report(self.settings(), seeds, outcomes)
        write_report(self.out, report, drawn)
        text = markdown(report, []).split("## Figures")[0]
        Console().print(Markdown(text), f"Report, figures and film: {self.out}", sep="\n")


def _claim(out: Path, settings: dict[str, Any]) -> None:
    """Note the settings in the folder, or refuse one that holds another study."""
    path = out / CONFIG_FILE
    if path.exists():
        held = json.loads(path.read_text(encoding="utf-8"))
        differs = [k for k in settings if held.get(k) != settings[k]]
        if differs:
            raise InvalidArgumentError(
                f"out: {out} holds a study with {differs[0]} {held.get(differs[0])!r}, not "
                f"{settings[differs[0]]!r}; choose another folder"
            )
    else:
        write_json(path, settings)


def run_jobs(jobs: list[Job], workers: int | None) -> None:
    """Run jobs in processes of their own and show how each goes.

    Raises
    ------
    KeyboardInterrupt
        After the processes have been stopped; what is finished stays on disk.
    """
    if not jobs:
        return
    count = min(len(jobs), workers or len(os.sched_getaffinity(0)))
    context = multiprocessing.get_context("spawn")
    messages: Any = context.Manager().Queue()
    pool = ProcessPoolExecutor(count, context, _ignore_interrupts)
    try:
        futures = {pool.submit(_work, job, messages): job for job in jobs}
        with _progress(jobs) as show:
            for name, text, share in _messages(messages, futures):
                show(name, text, share)
    except BaseException:
        for process in (pool._processes or {}).values():
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _ignore_interrupts() -> None:
    # Ctrl-C reaches the whole process group; the parent answers it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _work(job: Job, messages: Any) -> dict[str, Any]:
    return run_job(job, lambda text, share: messages.put((job.name, text, share)))


def _messages(
    messages: Any, futures: dict[Future[dict[str, Any]], Job]
) -> Iterator[tuple[str, str, float]]:
    """Yield what the workers say until all are done."""
    waiting = set(futures)
    while waiting:
        try:
            yield messages.get(timeout=0.2)
        except queue.Empty:
            for future in [f for f in waiting if f.done()]:
                waiting.remove(future)
                outcome = future.result()
                yield futures[future].name, _conclusion(outcome), 1.0


def _conclusion(outcome: dict[str, Any]) -> str:
    return (
        f"OBJ_FIT {outcome['objective_fitness']:.3f}, swims {outcome['native_distance']:.1f} units "
        f"on its model, {outcome['target_distance']:.1f} on the damaged robot"
    )


@contextmanager
def _progress(jobs: list[Job]) -> Iterator[Any]:
    """Show a bar a job on a terminal, or a line a finished job elsewhere."""
    console = Console(stderr=True)
    width = max(len(job.name) for job in jobs)
    columns = (TextColumn("{task.description}"), BarColumn(24), TextColumn("{task.fields[text]}"))
    live = console.is_terminal
    with Progress(*columns, TimeElapsedColumn(), console=console, disable=not live) as bars:
        tasks = {
            job.name: bars.add_task(job.name.ljust(width), total=1.0, start=False, text="waiting")
            for job in jobs
        }
        started: set[str] = set()

        def show(name: str, text: str, share: float) -> None:
            if name not in started:
                started.add(name)
                bars.start_task(tasks[name])
            bars.update(tasks[name], completed=share, text=text)
            if share == 1.0 and not live:
                print(f"{name}: {text}", file=sys.stderr, flush=True)

        yield show


if __name__ == "__main__":
    sys.exit(
        run_command_line(
            "damage_recovery",
            single_command(DamageRecovery),
            refused=(*BAD_INPUT, ConfigurationError),
        )
    )
