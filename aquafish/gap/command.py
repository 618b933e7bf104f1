"""The reality-gap suite as a command: its options, its run in a folder, what it publishes there."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from aquafish.batch import do_missing, say
from aquafish.gap.job import METHODS, ORACLE, GapJob, Settings, bridge, rehearse, source_stamp
from aquafish.gap.rivals import PACKAGES
from aquafish.gap.worlds import WORLDS
from aquafish.recovery.report import LIBRARIES, versions
from aquafish_gym.command_line import Out
from aquafish_gym.engines.base import check_engine
from aquafish_gym.runs.folder import claim, described, held
from aquafish_gym.runs.runner import Event, read_result
from aquafish_gym.runs.storage import ensure_writable_directory, write_bytes, write_document
from aquafish_gym.utils.validation import (
    EngineUnavailableError,
    InvalidArgumentError,
    finite_array,
    integer,
    one_of,
)
from eea.cli.board import duration
from eea.core.config import JointConfig, recovery_config
from eea.study.presets import smoke
from gait.evolve import EvolveConfig

KIND = "a reality-gap suite"
SCHEMA = "aquafish.gap/1"
REPORT = "report.json"
MOST_SEEDS = 10_000
EVERY = 30.0  # s between two lines about the progress, where there is no terminal


@dataclass(frozen=True)
class Size:
    """How large a suite is; an option of the command each."""

    seeds: int = 25
    rounds: int = 3
    steps: int = 256
    budget: int = 10_000
    generations: int = 15
    population: int = 60
    gait_poses: int = 3
    bodies: int = 50
    poses: int = 8
    seconds: float = 20.0


SIZES = {None: Size(), "smoke": Size(2, 2, 64, 400, 2, 10, 1, 3, 2, 1.0)}


@dataclass(frozen=True)
class Gap:
    """The reality-gap suite: every method in worlds that its models do not know, on new damages.

    Into --out go report.md and report.json (means by world and method, with intervals),
    results.csv (a row a job), pictures, and runs/WORLD/METHOD/SEED.json. Stopped in whatever way,
    the same command resumes; with more seeds, worlds or methods it extends the suite.
    docs/reality_gap.md says how to read it.
    """

    out: Out = Path("out/gap")
    worlds: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="WORLD", help=f"Some of {', '.join(WORLDS)}.")
    ] = tuple(WORLDS)
    methods: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="METHOD",
            help=f"Some of {', '.join(METHODS)}. An oracle, which knows the body, always joins "
            "them.",
        ),
    ] = METHODS
    preset: Literal["smoke"] | None = None
    """smoke makes everything very small, to see whether it works. What else is given goes over
    it; the numbers below are of no preset."""
    seeds: int | None = None
    """Replicates, with seeds from 0; 25 if not given. Each has a damage and, in every world, what
    is drawn there."""
    rounds: int | None = None
    """Trials on the damaged robot, one a round; 3."""
    steps: int | None = None
    """Length of a trial in steps of 0.01 s, a power of two; 256."""
    budget: int | None = None
    """Bodies, each with nuisances and angles, that CMA-ES and the GA may each try in a round;
    10,000."""
    generations: int | None = None
    """Generations of gait evolution; 15."""
    population: int | None = None
    """Gaits a generation; 60."""
    gait_poses: int | None = None
    """Random fin poses that a gait must swim from while it evolves, besides the zero pose; 3."""
    bodies: int | None = None
    """Bodies of joint inference's posterior that its second gait is evolved on; 50."""
    poses: int | None = None
    """Random fin poses that a finished gait swims from in the target's world; 8."""
    seconds: float | None = None
    """Length of a swim; 20."""
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None
    """Processes; every core if not given. No result depends on it but the CPU times."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Address of a dask scheduler whose workers do the work, as tcp://host:8786."""
    format: tuple[Literal["png", "pdf", "svg"], ...] = ("png",)
    """What the pictures are written as."""
    other_code: bool = False
    """Go on although other code began the folder."""

    def jobs(self) -> list[GapJob]:
        """Return what is asked for, by seed, world and method.

        Raises
        ------
        InvalidArgumentError, ConfigurationError, EngineUnavailableError
            If an option is wrong, or needs a package that is not here.
        """
        for name, choices in (("worlds", WORLDS), ("methods", METHODS)):
            chosen = getattr(self, name)
            if not chosen:
                raise InvalidArgumentError(f"{name} must be one or more of {', '.join(choices)}")
            for one in chosen:
                one_of(name, one, choices)
        if not self.format:
            raise InvalidArgumentError("format must be one or more of png, pdf, svg; got none")
        for world in self.worlds:
            check_engine(WORLDS[world].engine)
        for method in self.methods:
            if method in PACKAGES and find_spec(PACKAGES[method]) is None:
                raise EngineUnavailableError(
                    f"the method {method} needs the package {PACKAGES[method]}: pip install "
                    '"aquafish-gym[compare]", or say --methods without it'
                )
        if self.workers is not None:
            integer("workers", self.workers, 1)
        size, settings = self._size(), self._settings()
        return [
            GapJob(world, method, seed, settings, source_stamp())
            for seed in range(integer("seeds", size.seeds, 1, MOST_SEEDS))
            # The oracle's gait is the same in all worlds, and a process remembers it.
            for world, method in [
                *((world, ORACLE) for world in dict.fromkeys(self.worlds)),
                *((w, m) for w in dict.fromkeys(self.worlds) for m in dict.fromkeys(self.methods)),
            ]
        ]

    def _size(self) -> Size:
        given = {f.name: getattr(self, f.name) for f in fields(Size)}
        return replace(SIZES[self.preset], **{n: v for n, v in given.items() if v is not None})

    def _settings(self) -> Settings:
        size = self._size()
        eea = recovery_config(size.steps, size.rounds)
        if self.preset == "smoke":
            few = JointConfig(bodies=16, poses=16, descents=4, polished=1, restarts=0)
            eea = replace(smoke(eea), joint=few)
        finite_array("seconds", size.seconds, (), 0.01, 3600.0, "s")
        return Settings(
            eea=eea,
            budget=integer("budget", size.budget, 1),
            gait=EvolveConfig(
                starts=1,
                polish=0,
                generations=size.generations,
                population=size.population,
                poses=integer("gait_poses", size.gait_poses, 1),  # a sample needs one
                seconds=float(size.seconds),
            ),
            bodies=integer("bodies", size.bodies, 1, 1000),
            poses=integer("poses", size.poses, 1, 1000),
        )

    def execute(self) -> None:
        """Do what is missing, and write the report and the pictures of all that is in the folder.

        If an option is wrong, or the folder holds something else, nothing has changed. If a job
        could not be done, the others are, and SystemExit has the code 1.
        """
        jobs = self.jobs()
        folder = ensure_writable_directory(self.out)
        with held(folder):
            settings, libraries = jobs[0].settings, (*LIBRARIES, *PACKAGES.values())
            code = {"source": source_stamp(), **versions(libraries)}
            claim(
                folder, KIND, settings.to_dict(), code, ("runs", REPORT), other_code=self.other_code
            )
            failures = do_missing(
                jobs, bridge, folder, rehearse, progress,
                processes=self.workers, scheduler=self.scheduler,
            )  # fmt: skip
            publish(folder, settings, self.format)
            if failures:
                say("\n".join(f"failed: {failure}" for failure in failures))
                raise SystemExit(1)


def publish(folder: Path, settings: Settings, formats: Sequence[str]) -> None:
    """Write the report and pictures of all jobs that a folder holds, asked for now or before."""
    from aquafish.gap.figures import draw_all
    from aquafish.gap.report import build_report, results, to_markdown

    outcomes = read_all(folder, settings)
    if not outcomes:
        return
    table = results(outcomes)
    code = (described(folder) or {})["code"]
    report = build_report(table, settings.to_dict(), code)
    pictures = draw_all(folder, table, report, formats)
    # Readers' programs show one of the formats, and not all of them show PDF.
    best = next(form for form in ("png", "svg", "pdf") if form in formats)
    shown = [name for name in pictures if name.endswith(best)]
    text = table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    write_bytes(folder / "results.csv", text.encode())
    write_document(folder / REPORT, report, SCHEMA)
    write_bytes(folder / "report.md", to_markdown(report, settings, shown).encode())
    print(f"report.md, report.json, results.csv and pictures are in {folder}")


def read_all(folder: Path, settings: Settings) -> list[dict[str, Any]]:
    """Return what is finished in a folder, by world, method and seed.

    Raises
    ------
    DamagedFileError
        If a file is damaged; the message names it.
    """
    outcomes = []
    for world in WORLDS:
        for method in (*METHODS, ORACLE):
            files = (folder / "runs" / world / method).glob("[0-9]*.json")
            for seed in sorted(int(file.stem) for file in files):
                outcome = read_result(folder, GapJob(world, method, seed, settings))
                if outcome is not None:
                    outcomes.append(outcome)
    return outcomes


@contextmanager
def progress(jobs: Sequence[GapJob]) -> Iterator[Callable[[Event[GapJob]], None]]:
    """Show one bar on a terminal, or a line every half a minute elsewhere."""
    console = Console(stderr=True)
    live, began = console.is_terminal, time.monotonic()
    done, told = 0, began
    columns = (
        TextColumn("{task.description}"), BarColumn(24), MofNCompleteColumn(), TimeRemainingColumn()
    )  # fmt: skip
    with Progress(*columns, console=console, disable=not live) as bars:
        bar = bars.add_task("begins", total=len(jobs))

        def tell(event: Event[GapJob]) -> None:
            nonlocal done, told
            if event.kind == "retried":
                say(f"{event.job.name}: {event.text}; it is begun again")
            if event.kind not in ("done", "failed"):
                return
            done, now = done + 1, time.monotonic()
            bars.update(bar, completed=done, description=event.job.name)
            if not live and (now > told + EVERY or done == len(jobs)):
                told, rest = now, (now - began) / done * (len(jobs) - done)
                say(f"{done} of {len(jobs)} jobs, {duration(rest)} to go")

        yield tell
