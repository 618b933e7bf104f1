"""The case study as a command: its options, its run in a folder, and what it publishes there."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from aquafish.batch import do_missing, say
from aquafish.recovery.held_out import damage_of
from aquafish.recovery.report import HELD_OUT, Outcomes, build_report, show, to_markdown, versions
from aquafish.recovery.treatment import (
    TREATMENTS,
    WAYS,
    Treatment,
    rehearse,
    source_stamp,
    treat,
)
from aquafish_gym import Damage
from aquafish_gym.bodies import write_bodies
from aquafish_gym.command_line import (
    BodyDamage,
    BodyFile,
    Out,
    TargetEngine,
    read_morphology,
)
from aquafish_gym.engines.api import check_engine
from aquafish_gym.runs.folder import claim, described, held
from aquafish_gym.runs.runner import Event, finished, read_result
from aquafish_gym.runs.storage import ensure_writable_directory, write_bytes, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer
from eea.core.config import MAXIMUM_ROUNDS, RECOVERY, recovery_config
from eea.fish.gap import MOST_SPIN
from gait.controller import Controller
from gait.evolve import EvolveConfig
from gait.transfer import TransferConfig

SCHEMA = "aquafish.recovery/1"
REPORT = "report.json"


@dataclass(frozen=True)
class Recover:
    """The case study: a fish is damaged, models itself, evolves a gait and swims on.

    The treatments differ in what they take for the robot's body, and in how they come to a gait:
    the old one; one for any damage; a search on the robot itself; the models of plain EEA and
    Out-of-Band EEA with NEAT, as the paper has it; what joint inference believes, with the
    recommended search, without and with its fins known; and for each search the true body. Into
    --out go report.md, report.json, pictures, a film, and for each treatment of each replicate its
    outcome with all rounds and paths, the morphology.json and the controller.json, and joint
    inference's bodies.json. The same command goes on with what is missing. (For a self-model alone:
    python -m eea recover.)
    """

    out: Out = Path("out/recovery")
    damage: BodyDamage = "left_pectoral:length=0.5"
    held_out: bool = False
    """Break each replicate's robot in another way, of the ten damages of the reality-gap suite,
    rather than by --damage."""
    morphology: BodyFile = None
    seed: int = 0
    """The first replicate's seed."""
    seeds: int = 1
    """Replicates, with seeds from `seed` upwards."""
    rounds: int = RECOVERY.rounds
    """Trials on the damaged robot, one a round."""
    joint_rounds: int = 2
    """Trials of joint inference, which needs fewer."""
    steps: int = RECOVERY.steps
    """Length of a trial in steps of 0.01 s, a power of two."""
    models: int = RECOVERY.estimation.population
    """Population of candidate bodies, for both of the EEA's self-models."""
    angle_sets: int = RECOVERY.out_of_band.inner_population
    """Population of Out-of-Band's inner search for the fins' angles."""
    sampled_models: int | None = RECOVERY.out_of_band.sampled_models
    """Bodies that judge the angles in Out-of-Band's inner search; None for all."""
    revisit: int = RECOVERY.out_of_band.revisit
    """Earlier trials whose angles each of Out-of-Band's searches infers anew; the paper's 0 locks
    them in."""
    gyro_noise: float = 0.01
    """Standard deviation of the noise of the robot's gyroscope, rad/s in each sample and axis."""
    generations: int = 60
    """Generations of NEAT, in the paper's treatments."""
    population: int = 150
    """Gaits a generation of NEAT."""
    search_generations: int = 750
    """Generations of the recommended search, CMA-ES; see python -m gait evolve --help."""
    search_population: int = 24
    """Gaits a generation of that search."""
    search_starts: int = 6
    """Starts of that search."""
    screened: int = 1200
    """Random gaits that these are chosen from."""
    direct_generations: int = 400
    """Generations of the search on the robot itself: 24 gaits of two swims each."""
    gait_poses: int = 6
    """Random fin poses that a gait must swim from while it evolves, besides the zero pose. With
    none, joint inference's gait is for its median body alone."""
    poses: int = 16
    """Random fin poses that a finished gait is scored from, besides the zero pose."""
    seconds: float = 20.0
    """Length of a swim."""
    target_engine: Annotated[TargetEngine, tyro.conf.arg(aliases=("--engine",))] = "auto"
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None
    """Processes; every core if not given. No result depends on it."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Address of a dask scheduler whose workers do the work, as tcp://host:8786."""
    format: tuple[Literal["png", "pdf", "svg"], ...] = ("png",)
    """What the pictures are written as."""
    film: bool = True
    """Also draw the film, which takes some seconds."""
    redraw: bool = False
    """Only write report and pictures anew from what a finished folder holds."""
    other_code: bool = False
    """Go on although other code began the folder; the report names both."""

    def treatments(self) -> list[Treatment]:
        """Return every treatment of every replicate, the longest first."""
        integer("seed", self.seed, 0)
        integer("seeds", self.seeds, 1, 100_000)
        if self.workers is not None:
            integer("workers", self.workers, 1)
        if not self.format:
            raise InvalidArgumentError("format must be one or more of png, pdf, svg; got none")
        integer("joint_rounds", self.joint_rounds, 1, MAXIMUM_ROUNDS)
        engine = check_engine(self.target_engine)
        body, damage = read_morphology(self.morphology, "morphology"), Damage.parse(self.damage)
        damage.apply(body)
        eea = recovery_config(self.steps, self.rounds)
        out_of_band = replace(
            eea.out_of_band,
            inner_population=self.angle_sets,
            sampled_models=self.sampled_models,
            revisit=self.revisit,
        )
        estimation = replace(eea.estimation, population=self.models)
        eea = replace(eea, estimation=estimation, out_of_band=out_of_band)
        joint = replace(eea, rounds=self.joint_rounds)
        finite_array("gyro_noise", self.gyro_noise, (), 0.0, MOST_SPIN, "rad/s")
        common: dict[str, Any] = {"seconds": self.seconds, "threads": 1}
        best = EvolveConfig(
            search="cma",
            generations=self.search_generations,
            population=self.search_population,
            restarts=self.search_starts,
            random_candidates=self.screened,
            poses=self.gait_poses,
            **common,
        )
        # As the paper has it.
        neat = EvolveConfig(
            paper=True,
            generations=self.generations,
            population=self.population,
            poses=self.gait_poses,
            **common,
        )
        # Thriftily: on the robot, each swim takes its time.
        direct = replace(
            best,
            generations=self.direct_generations,
            restarts=1,
            random_candidates=24,
            population=24,
            poses=1,
        )
        fins = replace(best, senses=("imu", "clock", "fins"))
        gaits = {"neat": neat, "best": best, "fins": fins, "direct": direct}
        swims = TransferConfig(poses=self.poses, seconds=self.seconds, target_engine=engine)
        return [
            Treatment(
                treatment=name,
                seed=seed,
                morphology=body,
                damage=damage_of(seed) if self.held_out else damage,
                eea=joint if way.model == "joint" else eea,
                gait=replace(gaits[way.search], seed=seed),
                transfer=replace(swims, seed=seed),
                gyro_noise=self.gyro_noise,
                source=source_stamp(),
            )
            for seed in range(self.seed, self.seed + self.seeds)
            # What takes longest, first.
            for name, way in sorted(WAYS.items(), key=lambda one: one[1].model != "out-of-band")
        ]

    def execute(self) -> None:
        """Do what is missing, write the report and the pictures, and print the report.

        If an option is wrong, or the folder holds something else, nothing has changed. If a
        treatment could not be done, the others are, and SystemExit has the code 1.
        """
        jobs = self.treatments()
        if self.redraw and len(finished(self.out, jobs)) < len(jobs):
            read_all(self.out, jobs)  # which says what is wrong with the first that is not whole
        folder = ensure_writable_directory(self.out)
        with held(folder):
            code = None if self.redraw else {"source": source_stamp(), **versions()}
            settings = _settings(jobs)
            claim(folder, "a case study", settings, code, (REPORT,), other_code=self.other_code)
            failures = [] if self.redraw else do_missing(
                jobs, treat, folder, rehearse, progress,
                processes=self.workers, scheduler=self.scheduler,
            )  # fmt: skip
            if failures:
                say("\n".join(f"failed: {failure}" for failure in failures))
                raise SystemExit(1)
            self._publish(jobs, folder, settings)

    def _publish(self, jobs: list[Treatment], folder: Path, settings: dict[str, Any]) -> None:
        """Write everything for people and for the next command, and print the report."""
        from aquafish.recovery.figures import draw_all

        outcomes = read_all(folder, jobs)
        # Only PyBullet can draw the robot; without it the study is whole but for two pictures.
        drawable = importlib.util.find_spec("pybullet") is not None
        pictures = draw_all(folder, jobs[0], outcomes, self.format, drawable, self.film)
        report = build_report(settings, (described(folder) or {})["code"], outcomes)
        write_document(folder / REPORT, report, SCHEMA)
        # Readers' programs show one of the formats, and not all of them show PDF.
        best = next(form for form in ("png", "svg", "pdf") if form in self.format)
        shown = [name for name in pictures if name.endswith((best, "gif"))]
        write_bytes(folder / "report.md", to_markdown(report, shown).encode())
        for job in jobs:
            outcome = outcomes[job.treatment][job.seed - jobs[0].seed]
            write_document(folder / job.folder / "morphology.json", outcome["morphology"])
            if "bodies" in outcome:
                write_bodies(folder / job.folder / "bodies.json", outcome["bodies"])
            controller = Controller.from_dict(outcome["controller"])
            controller.save(folder / job.folder / "controller.json")
        console = Console()
        show(report, console)
        console.print(f"Report and pictures: {folder}", soft_wrap=True)
        if not drawable:
            say("the bodies and the film need PyBullet, which draws the robot")


def read_all(folder: Path, jobs: Sequence[Treatment]) -> Outcomes:
    """Return all outcomes, by treatment, in the order of the seeds; InvalidArgumentError if not."""
    outcomes: dict[str, list[dict[str, Any]]] = {name: [] for name in TREATMENTS}
    for job in jobs:
        outcome = read_result(folder, job)
        if outcome is None:
            raise InvalidArgumentError(f"redraw needs a finished folder; {folder} lacks {job.name}")
        outcomes[job.treatment].append(outcome)
    return outcomes


def _settings(jobs: Sequence[Treatment]) -> dict[str, Any]:
    """Return all that the results depend on, ready for JSON."""
    job, gaits = jobs[0], {WAYS[one.treatment].search: one.gait for one in jobs}
    joint, plain = (
        next(one.eea for one in jobs if one.treatment == name) for name in ("joint", "out-of-band")
    )
    parts = {"eea": plain.to_dict(), "transfer": asdict(job.transfer)}
    parts |= {
        f"gait_{name}": {**gait.settings, "generations": gait.plan.generations}
        for name, gait in sorted(gaits.items())
    }
    for part in parts.values():
        for name in ("condition", "seed", "threads"):  # each treatment's own
            part.pop(name, None)
    several = len({one.damage for one in jobs}) > 1
    return {
        "damage": HELD_OUT if several else str(job.damage),
        "morphology": job.morphology.to_dict(),
        "first_seed": job.seed,
        "gyro_noise": job.gyro_noise,
        "joint_rounds": joint.rounds,
        **parts,
    }


@contextmanager
def progress(jobs: Sequence[Treatment]) -> Iterator[Callable[[Event[Treatment]], None]]:
    """Show a bar a treatment on a terminal, or a line a finished treatment elsewhere."""
    console = Console(stderr=True)
    width = max(len(job.name) for job in jobs)
    columns = (TextColumn("{task.description}"), BarColumn(24), TextColumn("{task.fields[text]}"))
    live = console.is_terminal
    with Progress(*columns, TimeElapsedColumn(), console=console, disable=not live) as bars:
        tasks = {
            job: bars.add_task(job.name.ljust(width), total=1.0, start=False, text="waiting")
            for job in jobs
        }

        def tell(event: Event[Treatment]) -> None:
            text = _conclusion(event.document) if event.document else event.text or "begins"
            if event.kind in ("began", "retried"):
                bars.reset(tasks[event.job])
            bars.update(tasks[event.job], completed=event.share, text=text)
            if not live and event.kind in ("done", "retried"):
                say(f"{event.job.name}: {text}")

        yield tell


def _conclusion(outcome: dict[str, Any]) -> str:
    fitness = outcome["objective_fitness"]
    return (
        ("" if fitness is None else f"OBJ_FIT {fitness:.3f}, ")
        + f"swims {outcome['native_distance']:.1f} units on its model, "
        f"{outcome['target_distance']:.1f} on the damaged robot"
    )
