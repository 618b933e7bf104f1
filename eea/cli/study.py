"""The commands ``aquafish study`` and ``aquafish plot``."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import tyro
from tyro.conf import FlagCreatePairsOff, arg

from aquafish_gym.damage import Damage
from aquafish_gym.engines.packages import resolve_engine
from aquafish_gym.runs.command_line import (
    AnyDamage,
    Given,
    Out,
    Plan,
    Reactive,
    TargetEngine,
    TargetMorphology,
    read_morphology,
)
from aquafish_gym.runs.jobs import exit_if_failed, finished, run_jobs
from aquafish_gym.runs.manifest import lock
from aquafish_gym.runs.workers import check_workers
from aquafish_gym.utils.storage import ensure_writable_directory
from aquafish_gym.utils.validation import printable
from eea.cli.options import SeveralOptions
from eea.core.checks import ConfigurationError
from eea.core.config import Condition
from eea.fish import RealityGap
from eea.study.arms import ARMS, FIGURE_ARMS, variants
from eea.study.method import ArmConfig, MethodConfig
from eea.study.presets import smoke
from eea.study.replicate import StudyWorld, replicate, warm_up_replicates
from eea.study.study import Study, extended, write_description

Figure = Literal["5", "6", "7", "8", "9", "10", "all"]
Format = Literal["png", "pdf", "svg"]
_PAPERS_STEPS = (128, 256, 512, 1024)


@dataclass(frozen=True)
class StudyCommand(Given):
    """Make the paper's figures, or compare conditions: many replicates of several arms.

    --figure or --conditions selects the arms, and --method adds one's own. Several values of a
    setting, such as --in-band.best 3 5, make an arm for each. --out receives study.json (the plan),
    runs/ARM/STEPS/SEED.json (one for each finished replicate) and, at the end, results.csv,
    summary.md and figures. The same command resumes an interrupted study; a command with more
    seeds, steps or arms extends it.
    """

    example: ClassVar[str] = "--figure 9 --replicates 5 --out out/study"
    main_options: ClassVar[tuple[str, ...]] = (
        "out", "figure", "conditions", "method", "preset", "steps", "replicates", "seed", "damage",
        "workers", "scheduler",
    )  # fmt: skip

    out: Out = Path("out/study")
    #: Figures of the paper to make, 5 to 10, or all of these.
    figure: tuple[Figure, ...] | None = None
    #: Conditions to compare instead, with default settings, one arm each.
    conditions: tuple[Condition, ...] | None = None
    #: Methods of one's own beside them, each an arm: functions of the target, the number of rounds,
    #: the seed and the settings that yield a body a round (docs/howto/method.md).
    method: Annotated[tuple[str, ...] | None, arg(metavar="MODULE:FUNCTION")] = None
    #: smoke makes everything very small, as a trial run; other options override it.
    preset: Literal["smoke"] | None = None
    #: Lengths of trials in steps of 0.01 s, powers of two; every arm runs with each. The paper's
    #: 128, 256, 512 and 1024 by default, for smoke 128.
    steps: tuple[int, ...] | None = None
    #: Seeds of each arm; 25 by default, for smoke 2, with --held-out 10, which is all of its list.
    replicates: int | None = None
    #: The first seed. Hidden angles follow from the seed alone, so arms are compared in pairs.
    seed: Annotated[int, arg(aliases=("--first-seed",))] = 0
    #: Commands that the target performs in each replicate; 25 by default, for smoke 3.
    rounds: tuple[int, ...] | None = None
    settings: Annotated[SeveralOptions, arg(name="")] = field(default_factory=SeveralOptions)
    plan: Plan = "aquafish"
    damage: AnyDamage = "none"
    #: Held-out damages in place of --damage, each seed the next: of the list "recovery", or of
    #: another plan's list "PLAN recovery".
    held_out: FlagCreatePairsOff[bool] = False
    target_morphology: TargetMorphology = None
    target_engine: TargetEngine = "numba"
    #: Velocity of the water, units/s, for target and models.
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    #: Differences of the target's world from the models' world.
    gap: RealityGap = field(default_factory=RealityGap)
    reactive: Reactive = False
    #: Processes, each with one replicate at a time on one core; None for one a core. Results do not
    #: depend on it.
    workers: int | None = None
    #: Address of a dask scheduler, such as tcp://host:8786, whose workers are used instead of
    #: processes (extra "cluster").
    scheduler: str | None = None
    #: File formats of the figures.
    format: tuple[Format, ...] = ("png",)

    def study(self) -> Study:
        """Return the study that the options describe."""
        for name, values in (
            ("steps", self.steps), ("format", self.format), ("rounds", self.rounds),
        ):  # fmt: skip
            if values == ():
                raise ConfigurationError(f"--{name} must have one value or more; got none")
        small = self.preset == "smoke"
        usual = 2 if small else 10 if self.held_out else 25
        return Study(
            arms=self._arms(),
            steps=self.steps or ((128,) if small else _PAPERS_STEPS),
            first_seed=self.seed,
            replicates=usual if self.replicates is None else self.replicates,
            world=StudyWorld(
                read_morphology(self.target_morphology, "target_morphology", self.plan),
                Damage.parse(self.damage),
                resolve_engine("target_engine", self.target_engine),
                self.current,
                self.gap,
                self.held_out,
                self.reactive,
            ),
        )

    def _arms(self) -> dict[str, ArmConfig]:
        """Return the arms of the paper's figures, of the conditions and of the methods, by name."""
        figure = self.figure
        small = self.preset == "smoke"
        if small and not (figure or self.conditions or self.method):
            figure = ("all",)
        if bool(figure and self.conditions) or not (figure or self.conditions or self.method):
            raise ConfigurationError(
                "either --figure or --conditions must have one value or more, as --figure all, or "
                "--method one; --preset smoke needs none"
            )
        numbers = FIGURE_ARMS if "all" in (figure or ()) else figure or ()
        arms = [FIGURE_ARMS[number] for number in numbers]
        arms += [ARMS[condition] for condition in self.conditions or ()]
        found = {arm.name: smoke(arm.config) if small else arm.config for arm in arms}
        _add_folder()
        for place in self.method or ():
            name = place.rpartition(":")[2].replace("_", "-")
            if name in (*ARMS, *found):
                raise ConfigurationError(
                    f"--method must have functions of different names, and none of a condition; "
                    f"got {place}"
                )
            found[name] = MethodConfig.of(place)
        rounds = self.rounds or ((3,) if small else (25,))
        return variants(found, {**self.settings.values(self.given), "rounds": rounds})

    def execute(self) -> None:
        """Make the replicates that are missing, and write the study's report.

        Nothing is written if an option is wrong or the folder holds something else. A failed
        replicate does not stop the others; the exit code is then 1.
        """
        study = self.study()
        check_workers(self.workers, self.scheduler)
        folder = ensure_writable_directory(self.out)
        with lock(folder):
            document = extended(folder, study)
            jobs = study.jobs()
            done = finished(folder, jobs)
            missing = [job for job in jobs if job not in done]
            if missing:
                warm_up_replicates(missing)
            write_description(folder, document)
            jobs.sort(key=lambda job: -job.config.steps)  # the longest replicates first
            failures = run_jobs(
                jobs, replicate, folder, count=self.workers, scheduler=self.scheduler,
                describe=_objective_fitness,
            )  # fmt: skip
            if len(failures) < len(jobs):
                _report(folder, self.format)
            exit_if_failed(failures)


def _add_folder() -> None:
    """Let methods be imported from the current folder, after all others."""
    if str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))


def _objective_fitness(result: dict[str, Any]) -> str:
    found = result["rounds"][-1]["objective_fitness"]
    return "" if found is None else f"OBJ_FIT {found:.3f}"


@dataclass(frozen=True)
class Plot:
    """Write the tables and figures of a study from its finished replicates."""

    example: ClassVar[str] = "out/study --format png pdf"

    folder: tyro.conf.Positional[Path]  #: The directory of a study.
    format: tuple[Format, ...] = ("png",)  #: File formats of the figures.

    def execute(self) -> None:
        """Write the report; raises as ``eea.study.report.report``."""
        _report(self.folder, self.format)


def _report(folder: Path, formats: tuple[Format, ...]) -> None:
    from eea.study.report import report

    report(folder, formats)
    print(printable(f"results.csv, summary.md and figures are in {folder}"))
