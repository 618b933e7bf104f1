"""The commands ``python -m eea study``, ``plot`` and ``merge``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from concurrent.futures import Executor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro
from rich.console import Console

from aquafish_gym.command_line import (
    AnyDamage,
    ModelEngine,
    Out,
    TargetEngine,
    TargetMorphology,
    read_morphology,
)
from aquafish_gym.damage import Damage
from aquafish_gym.engines.packages import resolve_engine
from aquafish_gym.runs.executors import MOST_WORKERS, workers
from aquafish_gym.runs.folder import held
from aquafish_gym.runs.processes import WorkerDiedError
from aquafish_gym.runs.runner import read_result, run_jobs
from aquafish_gym.runs.storage import ensure_writable_directory
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.cli.arms import (
    ArmSettings,
    Figure,
    asked_arms,
    given_settings,
    refuse_empty,
    refuse_what_has_no_say,
)
from eea.cli.board import Board, shown
from eea.core.checks import ConfigurationError, whole
from eea.core.config import Condition
from eea.fish import Orientation, RealityGap
from eea.study.cost import cost
from eea.study.folder import claim, extended, merge, read_description
from eea.study.presets import smoke
from eea.study.replicate import Replicate, World, rehearse, replicate
from eea.study.study import Study

Format = Literal["png", "pdf", "svg"]
_PATIENCE = 5.0  # s of silence
_PAPERS_STEPS = (128, 256, 512, 1024)
_SUFFIX = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,59}")


@dataclass(frozen=True)
class StudyCommand:
    """Make the paper's figures, or other comparisons: many replicates of several arms.

    Say what to run with --figure or --conditions. Into --out go study.json (what is
    run), runs/ARM/STEPS/SEED.json (a finished replicate each) and, at the end, results.csv,
    summary.md and figures. Stopped in whatever way, the same command resumes; a command with more
    seeds, steps or arms extends the study.

    Attributes
    ----------
    figure
        Figures of the paper to make, 5 to 10, or all of these.
    conditions
        Arms of the default settings instead, one for each of these conditions.
    preset
        smoke makes everything very small, to see whether it works. What else is given goes over it.
    suffix
        Put behind the arms' names, after a hyphen (NAME-SUFFIX), so that the same arms with other
        settings fit in one study. Letters, digits, ".", "_" and "-", at most 60, the first a letter
        or digit.
    steps
        Lengths of trials in steps of 0.01 s, each a power of two; every arm runs with each. The
        paper's 128, 256, 512 and 1024 if not given, for smoke 128.
    replicates
        How many seeds each arm has; 25 if not given, for smoke 2.
    first_seed
        The first of them. The angles that the target hides follow from the seed alone, so the
        arms are paired.
    rounds
        Commands that the target performs in each replicate; 25 if not given, for smoke 3.
    settings
        Settings of the algorithm, for all arms.
    target_orientation
        How the target's body lies at the start: upright and facing +y, as the models; with any
        heading; or in any attitude. Felt by the attitude signal, or in a current: the gyroscope
        in still water reads the same.
    dtype
        The compiled engine's precision, for the candidates.
    current
        Velocity of the water, units/s, for target and candidates.
    substeps
        Physics steps in each 0.01 s, for target and candidates.
    gap
        How the target's world differs from the candidates', which they do not know.
    workers
        Processes, each with one replicate at a time on one core; None for a process a core. No
        result depends on it.
    scheduler
        Address of a dask scheduler, as tcp://host:8786, whose workers are used in place of
        processes (extra "cluster"). They need this package, and no shared file system.
    draw
        Write results.csv, summary.md and the figures at the end, as the command plot does.
    format
        Of the figures.
    other_code
        Go on although the code, or the version of numpy, numba or Python, has changed since the
        study began, which is else refused. Only for changes that alter no result.
    """

    out: Out
    figure: tuple[Figure, ...] | None = None
    conditions: tuple[Condition, ...] | None = None
    preset: Literal["smoke"] | None = None
    suffix: str = ""
    steps: tuple[int, ...] | None = None
    replicates: int | None = None
    first_seed: int = 0
    rounds: int | None = None
    settings: Annotated[ArmSettings, tyro.conf.arg(name="")] = field(default_factory=ArmSettings)
    target_damage: AnyDamage = "none"
    target_morphology: TargetMorphology = None
    target_engine: TargetEngine = "numba"
    target_orientation: Orientation = "upright"
    engine: ModelEngine = "numba"
    dtype: Literal["float32", "float64"] = "float32"
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    substeps: int = 1
    gap: RealityGap = field(default_factory=RealityGap)
    workers: int | None = None
    scheduler: str | None = None
    draw: bool = True
    format: tuple[Format, ...] = ("png",)
    other_code: bool = False
    words: tyro.conf.Suppress[tuple[str, ...]] = ()

    def study(self) -> Study:
        """Return what is asked for.

        Raises
        ------
        InvalidArgumentError, ConfigurationError
            If an option is wrong, or it is not said what to run.
        """
        if self.suffix and not _SUFFIX.fullmatch(self.suffix):
            raise ConfigurationError(
                "suffix must be at most 60 letters, digits, '.', '_' and '-', the first a letter "
                f"or digit; got {self.suffix!r}"
            )
        ending = f"-{self.suffix}" if self.suffix else ""
        small = self.preset == "smoke"
        figure = self.figure
        if small and figure is None and self.conditions is None:
            figure = ("all",)
        bases = asked_arms(figure, self.conditions)
        if small:
            bases = {name: smoke(base) for name, base in bases.items()}
        arms = {
            f"{name}{ending}": given_settings(base, self.settings, self.words)
            for name, base in bases.items()
        }
        refuse_what_has_no_say(arms, self.settings)
        if self.steps is not None:
            refuse_empty("--steps", self.steps, "whole numbers")
        refuse_empty("--format", self.format, f"of {', '.join(get_args(Format))}")
        return Study(
            arms=arms,
            steps=self.steps or ((128,) if small else _PAPERS_STEPS),
            rounds=(3 if small else 25) if self.rounds is None else self.rounds,
            first_seed=self.first_seed,
            replicates=(2 if small else 25) if self.replicates is None else self.replicates,
            world=World(
                read_morphology(self.target_morphology, "target_morphology"),
                Damage.parse(self.target_damage),
                resolve_engine("target_engine", self.target_engine),
                self.target_orientation,
                resolve_engine("engine", self.engine),
                self.dtype,
                self.current,
                self.substeps,
                self.gap,
            ),
        )

    def execute(self) -> None:
        """Make what is missing of the study, and write its report.

        Raises
        ------
        InvalidArgumentError, EngineUnavailableError, ConfigurationError
            If an option is wrong, or the folder holds something else; nothing has changed then.
        SystemExit
            With code 1, if a replicate could not be completed. The others are.
        """
        study = self.study()
        if self.workers is not None:
            whole("workers", self.workers, 1, MOST_WORKERS)
        folder = ensure_writable_directory(self.out)
        console = _console()
        with held(folder):
            document = extended(folder, study, self.other_code)
            jobs = study.jobs()
            board = Board(jobs, _finished(folder, jobs, console))
            try:
                failures = self._fill(folder, document, board, console)
            except KeyboardInterrupt:
                raise KeyboardInterrupt(
                    f"stopped with {board.counts()}; every finished replicate is in {folder}, and "
                    "the same command resumes"
                ) from None
            for failure in failures:
                console.print(f"failed: {failure}")
            if self.draw and board.scores:
                _report(folder, self.format, console)
            if failures:
                raise SystemExit(1)

    def _fill(
        self, folder: Path, document: dict[str, Any], board: Board, console: Console
    ) -> list[str]:
        """Make what is missing, the longest first; return what could not be made."""
        left = [job for job in board.jobs if job not in board.scores]
        if not left:
            claim(folder, document)
            console.print(f"{board.counts()} are complete")
            return []
        left.sort(key=lambda job: -cost(job.config))
        with workers(self.workers, self.scheduler) as executor:
            _prepare(executor, left, console)
            claim(folder, document)
            with shown(board, console) as note:
                return run_jobs(left, replicate, folder, executor, note)


@dataclass(frozen=True)
class Plot:
    """Write results.csv, summary.md and the figures of a study anew, from what is finished.

    Attributes
    ----------
    folder
        The directory of a study.
    format
        Of the figures.
    """

    folder: tyro.conf.Positional[Path]
    format: tuple[Format, ...] = ("png",)

    def execute(self) -> None:
        """Write the report; raises as ``report``."""
        _report(self.folder, self.format, _console())


@dataclass(frozen=True)
class Merge:
    """Add the results of one study that are in another folder, as from another machine.

    Attributes
    ----------
    folder
        The directory of a study, which is extended.
    other
        Another part of it: other arms, lengths of trials or seeds of the same settings.
    other_code
        Merge although the two are of other code, or other versions of numpy, numba or Python.
    """

    folder: tyro.conf.Positional[Path]
    other: tyro.conf.Positional[Path]
    other_code: bool = False

    def execute(self) -> None:
        """Copy what is missing; raises as ``eea.study.folder.merge``."""
        read_description(self.folder)
        with held(self.folder):
            count = merge(self.folder, self.other, self.other_code)
        _console().print(
            f"{count} replicates of {self.other} were added to {self.folder}; "
            f"python -m eea plot {self.folder} draws them"
        )


def _console() -> Console:
    return Console(highlight=False, soft_wrap=True, markup=False)


def _prepare(executor: Executor, jobs: Sequence[Replicate], console: Console) -> None:
    """Have wrong settings refused before anything is written, and the engine compiled once."""
    one_each = {(job.arm, job.config.steps): job for job in jobs}
    rehearsal = executor.submit(rehearse, list(one_each.values()))
    if not wait([rehearsal], _PATIENCE).done:
        console.print("preparing: the engine is compiled, once on each machine, in about a minute")
    try:
        rehearsal.result()
    except WorkerDiedError as error:
        raise OSError(f"no replicate was begun: {error}") from None


def _finished(
    folder: Path, jobs: Sequence[Replicate], console: Console
) -> dict[Replicate, dict[str, Any]]:
    """Return the results that are there, and name what is damaged."""
    found = {}
    for job in jobs:
        try:
            document = read_result(folder, job)
        except InvalidArgumentError as error:
            console.print(f"damaged: {error}; {job.name} is made anew")
        else:
            if document is not None:
                found[job] = document
    return found


def _report(folder: Path, formats: tuple[Format, ...], console: Console) -> None:
    from eea.report import report

    report(folder, formats)
    console.print(f"results.csv, summary.md and figures are in {folder}")
