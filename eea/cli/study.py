"""The commands ``python -m eea study`` and ``python -m eea plot``."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro
from rich.console import Console

from aquafish_gym.damage import Damage
from aquafish_gym.runs.storage import ensure_writable_directory
from aquafish_gym.runs.workers import Event
from aquafish_gym.utils.command_line import read_morphology
from eea.aquafish.fish import Orientation
from eea.cli.board import Board, shown
from eea.cli.folder import state_complaint
from eea.core.behavior import BehaviorConfig
from eea.core.checks import ConfigurationError, choice, whole
from eea.core.config import Condition, EEAConfig
from eea.core.estimation import EstimationConfig
from eea.core.exploration import ExplorationConfig
from eea.core.genetic import GeneticConfig
from eea.core.inference import InBandConfig, OutOfBandConfig
from eea.study.presets import FIGURE_ARMS, FIGURES
from eea.study.replicate import Replicate, World, look
from eea.study.study import Study, claim, extended, fill, only_here, refuse_others

Figure = Literal["5", "6", "7", "8", "9", "10", "all"]
Preset = Literal["smoke"]
PAPERS_STEPS = (128, 256, 512, 1024)
_SUFFIX = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,59}")
_REDRAW = 0.2  # s between two drawings of the table


@dataclass(frozen=True)
class ArmSettings:
    """The settings that an arm has besides its condition and the lengths of trials.

    Attributes
    ----------
    accurate
        End a replicate once the best MOD_FIT reaches this; None for never.
    exploration, estimation, genetic, behavior, in_band, out_of_band
        Settings of the parts.
    """

    accurate: float | None = None
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    genetic: GeneticConfig = field(default_factory=GeneticConfig)
    behavior: BehaviorConfig = field(default_factory=BehaviorConfig)
    in_band: InBandConfig = field(default_factory=InBandConfig)
    out_of_band: OutOfBandConfig = field(default_factory=OutOfBandConfig)

    @classmethod
    def of(cls, config: EEAConfig) -> ArmSettings:
        """Return a configuration's."""
        return cls(**{name: getattr(config, name) for name in cls.__dataclass_fields__})

    def on(self, config: EEAConfig) -> EEAConfig:
        """Return a configuration with these settings."""
        return replace(config, **{name: getattr(self, name) for name in self.__dataclass_fields__})


def smoke(config: EEAConfig) -> EEAConfig:
    """Return an arm's settings made so small that all figures take seconds."""
    inner = config.out_of_band
    return replace(
        config,
        exploration=replace(config.exploration, population=6, generations=3),
        estimation=replace(
            config.estimation,
            population=max(6, config.estimation.population // 10),
            generations=8,
        ),
        out_of_band=replace(inner, period=3, inner_population=6, inner_generations=3),
    )


@dataclass(frozen=True)
class StudyCommand:
    """Make the paper's figures, or other comparisons: many replicates of several arms.

    Say what to run with --figure, --conditions or --ablation. Into --out go study.json (what is
    run), runs/ARM/STEPS/SEED.jsonl (a line a finished round) and, at the end, results.csv,
    summary.md and figures. Stopped in whatever way, the same command goes on where it was; a
    command with more seeds, steps or arms extends the study.

    Attributes
    ----------
    out
        Directory for the study; made if need be.
    figure
        Figures of the paper to make, 5 to 10, or all of these.
    conditions
        Arms of the default settings instead, one for each of these conditions.
    ablation
        Arms of an ablation instead, by its name, or all of them.
    preset
        smoke makes everything very small, to see whether it works. What else is given goes over it.
    suffix
        Put behind the arms' names, after a hyphen (NAME-SUFFIX), so that the same arms with other
        settings fit in one study. Letters, digits, ".", "_" and "-", at most 60, the first a letter
        or digit.
    steps
        Lengths of trials in steps of 0.01 s, each a power of two; every arm runs with each. The
        paper's 128, 256, 512 and 1024 if not given, for ablations 256.
    replicates
        How many seeds each arm has.
    first_seed
        The first of them. The angles that the target hides follow from the seed alone, so the
        arms are paired.
    rounds
        Commands that the target performs in each replicate.
    settings
        Settings of the algorithm, for all arms.
    target_damage
        What broke: none, or FIN:SIZE=FACTOR or FIN:missing, joined by ";". FIN is left_pectoral,
        right_pectoral or caudal; SIZE is length, width or thickness.
    target_morphology
        JSON file of the body before the damage; without it, the nominal body.
    target_engine
        Where the target swims. In numba it swims in double precision, where it agrees with
        pybullet to 1e-9, and needs no second engine in each worker.
    target_orientation
        How the target's body lies at the start: upright and facing +y, as the models; with any
        heading; or in any attitude. Felt by the attitude signal, or in a current: the gyroscope
        in still water reads the same.
    engine
        Where the candidate models swim.
    dtype
        The compiled engine's precision, for the candidates.
    current
        Velocity of the water, units/s.
    substeps
        Physics steps in each 0.01 s.
    workers
        Processes, each with one replicate at a time on one core; None for a process a core. No
        result depends on it.
    draw
        Write results.csv, summary.md and the figures at the end, as the command plot does.
    other_code
        Go on although the code, or the version of numpy, numba or Python, has changed since the
        study began, which is else refused. Only for changes that alter no result.
    """

    out: Path
    figure: tuple[Figure, ...] = ()
    conditions: tuple[Condition, ...] = ()
    ablation: str | None = None
    preset: Preset | None = None
    suffix: str = ""
    steps: tuple[int, ...] = ()
    replicates: int = 25
    first_seed: int = 0
    rounds: int = 25
    settings: Annotated[ArmSettings, tyro.conf.arg(name="")] = field(default_factory=ArmSettings)
    target_damage: str = "none"
    target_morphology: Path | None = None
    target_engine: Literal["numba", "pybullet"] = "numba"
    target_orientation: Orientation = "upright"
    engine: Literal["numba", "pybullet"] = "numba"
    dtype: Literal["float32", "float64"] = "float32"
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    substeps: int = 1
    workers: int | None = None
    draw: bool = True
    other_code: bool = False
    words: tyro.conf.Suppress[tuple[str, ...]] = ()

    def study(self) -> Study:
        """Return what is asked for.

        Raises
        ------
        InvalidArgumentError, ConfigurationError
            If an option is wrong or contradicts another.
        """
        if self.suffix and not _SUFFIX.fullmatch(self.suffix):
            raise ConfigurationError(
                "suffix must be at most 60 letters, digits, '.', '_' and '-', the first a letter "
                f"or digit; got {self.suffix!r}"
            )
        _refuse_empty(self.words)
        chosen = {
            "--figure": bool(self.figure),
            "--conditions": bool(self.conditions),
            "--ablation": self.ablation is not None,
        }
        given = [name for name, is_given in chosen.items() if is_given]
        if len(given) > 1:
            raise ConfigurationError(
                f"{' and '.join(given)} exclude each other; run them one after the other, into "
                "one folder if you like"
            )
        if not given and self.preset is None:
            raise ConfigurationError(f"one of {', '.join(chosen)} must say what to run")
        asked = self
        if self.preset is not None:
            usual = {option.name: option.default for option in fields(self)}
            tiny: dict[str, Any] = {"steps": (128,), "replicates": 2, "rounds": 3}
            small = replace(
                self,
                **{name: tiny[name] for name in tiny if getattr(self, name) == usual[name]},
            )
            asked = self._parsed_over(small if given else replace(small, figure=("all",)))
        ending = f"-{self.suffix}" if self.suffix else ""
        arms = {f"{name}{ending}": asked._set(base) for name, base in asked._arms().items()}
        _refuse_what_has_no_say(arms, asked.settings)
        return Study(
            arms=arms,
            steps=asked.steps or ((256,) if self.ablation is not None else PAPERS_STEPS),
            rounds=asked.rounds,
            first_seed=asked.first_seed,
            replicates=asked.replicates,
            world=World(
                read_morphology(self.target_morphology, "target_morphology"),
                Damage.parse(self.target_damage),
                self.target_engine,
                self.target_orientation,
                self.engine,
                self.dtype,
                self.current,
                self.substeps,
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
        KeyboardInterrupt
            On Ctrl-C; all finished rounds are on disk.
        """
        study = self.study()
        workers = len(os.sched_getaffinity(0)) if self.workers is None else self.workers
        whole("workers", workers, 1)
        jobs = study.jobs(self.out)
        folder = ensure_writable_directory(self.out)
        refuse_others(folder)
        console = Console(highlight=False, soft_wrap=True, markup=False)
        with only_here(folder):
            document = extended(folder, study, self.other_code)
            for job in {job.cell: job for job in jobs}.values():
                job.begin()  # so that a wrong setting is refused before anything is written
            claim(folder, document)
            standings = {job: look(job) for job in jobs}
            for job, standing in standings.items():
                complaint = standing.complaint
                if complaint is None and not standing.ended:
                    complaint = state_complaint(job.state)
                if complaint is not None:
                    console.print(f"damaged: {complaint}; {job.name} is made anew")
            board = Board(standings, min(workers, len(jobs)))
            if len(board.finished) == len(jobs):
                console.print(f"{board.counts()} are complete")
            try:
                failures = _watch(board, folder, console)
            except KeyboardInterrupt:
                raise KeyboardInterrupt(
                    f"stopped with {board.counts()}; every finished round is in {folder}, and the "
                    "same command goes on from there"
                ) from None
            for failure in failures:
                console.print(f"failed: {failure}")
            if self.draw and board.finished:
                _report(folder, console)
            if failures:
                raise SystemExit(1)

    def _arms(self) -> dict[str, EEAConfig]:
        """Return the arms asked for, before the settings of the command line."""
        if self.ablation is not None:
            arms = _ablation_arms(self.ablation)
        elif self.conditions:
            arms = {condition: EEAConfig(condition=condition) for condition in self.conditions}
        else:
            figures = FIGURE_ARMS if "all" in self.figure else self.figure
            arms = {FIGURE_ARMS[figure]: FIGURES[f"fig{figure}"] for figure in figures}
        if self.preset is not None:
            arms = {name: smoke(config) for name, config in arms.items()}
        return arms

    def _set(self, base: EEAConfig) -> EEAConfig:
        """Return an arm's settings with those that the command line gives."""
        if not any(_is_a_setting(word) for word in self.words):
            return base if self.settings == ArmSettings() else self.settings.on(base)
        return self._parsed_over(replace(self, settings=ArmSettings.of(base))).settings.on(base)

    def _parsed_over(self, default: StudyCommand) -> StudyCommand:
        """Return the command line read again, with other defaults."""
        if not self.words:
            return default
        parsed = tyro.cli(StudyCommand, default=default, args=self.words[1:])
        return replace(parsed, words=self.words)


@dataclass(frozen=True)
class Plot:
    """Write results.csv, summary.md and the figures of a study anew, from what is finished.

    Attributes
    ----------
    folder
        The directory of a study.
    """

    folder: tyro.conf.Positional[Path]

    def execute(self) -> None:
        """Write the report.

        Raises
        ------
        ConfigurationError
            If the folder holds no study with a finished replicate, or a file is damaged.
        """
        _report(self.folder, Console(highlight=False, soft_wrap=True, markup=False))


def _watch(board: Board, folder: Path, console: Console) -> list[str]:
    """Make what is missing, and show how it goes."""
    drawn = [0.0]
    with shown(board, console) as live:

        def note(event: Event[Replicate]) -> None:
            board.take(event)
            if event.kind == "died":
                console.print(f"{event.job.name}: {event.content}; it goes on in another")
            if live is not None and time.monotonic() - drawn[0] > _REDRAW:
                live.refresh()
                drawn[0] = time.monotonic()
            elif live is None and event.kind == "done":
                console.print(board.line(event.job))

        return fill(board.standings, folder, board.workers, note)


def _report(folder: Path, console: Console) -> None:
    from eea.report import report

    report(folder)
    console.print(f"results.csv, summary.md and figures are in {folder}")


def _ablation_arms(name: str) -> dict[str, EEAConfig]:
    from eea.study.ablations import ABLATIONS, ablation_arms

    choice("ablation", name, [*ABLATIONS, "all"])
    return ablation_arms(None if name == "all" else [name])


def _is_a_setting(word: str) -> bool:
    option = word.partition("=")[0]
    return option.startswith("--") and ("." in option or option == "--accurate")


def _refuse_empty(words: Sequence[str]) -> None:
    """Refuse an option of the words that says none of the values it is for."""
    wanted = {
        "--figure": f"one or more of {', '.join(get_args(Figure))}",
        "--conditions": f"one or more of {', '.join(get_args(Condition))}",
        "--steps": "one or more whole numbers",
    }
    for word, after in pairwise((*words, "--")):
        if word in wanted and after.startswith("--"):
            raise ConfigurationError(f"{word} must be {wanted[word]}; got none")


def _refuse_what_has_no_say(arms: Mapping[str, EEAConfig], settings: ArmSettings) -> None:
    for part, condition in (("in_band", "in-band"), ("out_of_band", "out-of-band")):
        given, usual = asdict(getattr(settings, part)), asdict(getattr(ArmSettings(), part))
        changed = [name for name in given if given[name] != usual[name]]
        if changed and all(config.condition != condition for config in arms.values()):
            raise ConfigurationError(
                f"{part}.{changed[0]} has no say: no arm is of the condition {condition}"
            )
    behaviors = [config.behavior for config in arms.values()]
    used = any(b.signal == "attitude" and b.summary != "dft" for b in behaviors)
    if settings.behavior.timestep != BehaviorConfig().timestep and not used:
        raise ConfigurationError(
            "behavior.timestep has no say: no arm takes the mean or rms rate of the attitude"
        )
