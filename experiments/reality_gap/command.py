"""The reality-gap suite: every method in worlds that its models do not know, on held-out damages.

    python -m experiments.reality_gap --replicates 25 --out out/gap

DIR holds report.md and report.json (means by world and method, with intervals), times.md (CPU s),
results.csv (a row for each job), pictures, and runs/WORLD/METHOD/SEED.json. The same command
resumes; with more replicates, worlds or methods it extends the suite. docs/reality_gap.md explains
the report.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import tyro

from aquafish_gym.engines.api import check_engine
from aquafish_gym.runs.command_line import Out
from aquafish_gym.runs.jobs import read_result
from aquafish_gym.runs.manifest import read_manifest
from aquafish_gym.runs.markdown import shown_format
from aquafish_gym.utils.storage import write_bytes, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer, one_of
from eea.core.config import JointConfig, recovery_config
from eea.study.presets import smoke
from experiments.reality_gap.figures import draw_all
from experiments.reality_gap.job import METHODS, ORACLE, GapJob, Settings, run_job, warm_up
from experiments.reality_gap.report import build_report, results, times_rows, to_markdown
from experiments.reality_gap.worlds import WORLDS
from experiments.tables import experiment, write_tables
from gait.search.evolve import EvolveConfig

KIND = "a reality-gap suite"
SCHEMA = "aquafish.gap/1"
REPORT = "report.json"
MOST_SEEDS = 10_000


@dataclass(frozen=True)
class Gap:
    """Compare the methods in worlds that their models do not know, on held-out damages."""

    example: ClassVar[str] = "--worlds drag --replicates 2 --out out/gap"
    main_options: ClassVar[tuple[str, ...]] = (
        "out", "worlds", "methods", "replicates", "rounds", "generations", "smoke", "workers",
    )  # fmt: skip

    out: Out = Path("out/gap")
    worlds: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="WORLD", help=f"Some of {', '.join(WORLDS)}.")
    ] = tuple(WORLDS)
    methods: Annotated[
        tuple[str, ...],
        tyro.conf.arg(metavar="METHOD", help=f"Some of {', '.join(METHODS)}; the oracle is added."),
    ] = METHODS
    replicates: Annotated[int, tyro.conf.arg(aliases=("--seeds",))] = 25
    """Replicates, with seeds from 0 upwards. A seed has a damage and a reality gap in each
    world."""
    rounds: int = 3
    """Trials on the damaged robot, one a round."""
    steps: int = 256
    """Length of a trial in steps of 0.01 s, a power of two."""
    generations: int = 15
    """Generations of gait evolution."""
    population: int = 60
    """Gaits a generation."""
    gait_poses: int = 3
    """Random initial poses that a gait is evolved on, besides the zero pose."""
    bodies: int = 50
    """Bodies of joint inference's posterior that its second gait is evolved on."""
    poses: int = 8
    """Random initial poses that a finished gait is scored from."""
    seconds: float = 20.0
    """Length of a swim."""
    smoke: bool = False
    """Make the methods themselves very small, to see whether the suite works."""
    workers: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None
    """Processes; every core if not given. No result depends on it."""
    format: tuple[Literal["png", "pdf", "svg"], ...] = ("png",)
    """File formats of the pictures."""

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
        if self.workers is not None:
            integer("workers", self.workers, 1)
        settings = self._settings()
        return [
            GapJob(world, method, seed, settings)
            for seed in range(integer("replicates", self.replicates, 1, MOST_SEEDS))
            # The oracle's gait is the same in all worlds, and a process remembers it.
            for world, method in [
                *((world, ORACLE) for world in dict.fromkeys(self.worlds)),
                *((w, m) for w in dict.fromkeys(self.worlds) for m in dict.fromkeys(self.methods)),
            ]
        ]

    def _settings(self) -> Settings:
        eea = replace(recovery_config(self.steps, self.rounds), condition="out-of-band")
        joint = JointConfig(steps=self.steps, rounds=self.rounds)
        if self.smoke:
            eea = smoke(eea)
            joint = replace(joint, bodies=16, poses=16, descents=4, polished=1, restarts=0)
        finite_array("seconds", self.seconds, (), 0.01, 3600.0, "s")
        return Settings(
            eea=eea,
            joint=joint,
            gait=EvolveConfig(
                paper=True,
                generations=self.generations,
                population=self.population,
                poses=integer("gait_poses", self.gait_poses, 1),  # a sample needs one
                seconds=float(self.seconds),
            ),
            bodies=integer("bodies", self.bodies, 1, 1000),
            poses=integer("poses", self.poses, 1, 1000),
        )

    def execute(self) -> None:
        """Do what is missing, and write the report and the pictures of all that is in the folder.

        If an option is wrong, or the folder holds something else, nothing has changed. If a job
        could not be done, the others are, nothing is written, and SystemExit has the code 1.
        """
        jobs = self.jobs()
        settings = jobs[0].settings
        with experiment(
            jobs, run_job, self.out, KIND, settings.to_dict(), ("runs", REPORT), self.workers,
            warm_up=warm_up,
        ) as (folder, _):  # fmt: skip
            publish(folder, settings, self.format)


def publish(folder: Path, settings: Settings, formats: Sequence[str]) -> None:
    """Write the report and pictures of all finished jobs in a folder."""
    table = results(read_all(folder, settings))
    code = (read_manifest(folder) or {}).get("versions", [])
    report = build_report(table, settings.to_dict(), code)
    pictures = draw_all(folder, table, report, formats)
    shown = [name for name in pictures if name.endswith(shown_format(formats))]
    text = table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    write_bytes(folder / "results.csv", text.encode())
    write_tables(folder, {"times": times_rows(table)})
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
            files = (folder / "runs" / world / method).glob("*.json")
            for seed in sorted(int(file.stem) for file in files if file.stem.isdigit()):
                job = GapJob(world, method, seed, settings)
                outcome = read_result(folder, job)
                if outcome is not None:
                    outcomes.append(outcome)
    return outcomes
