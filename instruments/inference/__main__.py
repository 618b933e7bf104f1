"""Measure joint inference: ``python -m instruments.inference``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from aquafish_gym.runs.command_line import run_command_line
from aquafish_gym.runs.manifest import read_manifest
from aquafish_gym.utils.storage import write_bytes, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, integer, one_of
from experiments.tables import experiment
from instruments.inference.cases import Case, measure
from instruments.inference.logs import LOGS, summarise_logs
from instruments.inference.plots import save_pictures
from instruments.inference.settings import EVERY, FOREIGN_SETTINGS, SETTINGS
from instruments.inference.strangers import DRAWS, KINDS, summarise_strangers
from instruments.inference.summary import split_times, summarise
from instruments.inference.swims import SWIMS, summarise_swims
from instruments.inference.tables import make_tables
from instruments.verification.mujoco_model import load_mujoco

SCHEMA = "aquafish.inference/1"
REPORT = "report.json"


@dataclass(frozen=True)
class Inference:
    """Infer many random robots and print errors, coverage, missed optima and alarms.

    Results are kept: the same command goes on where it was stopped.
    """

    out: Annotated[Path, tyro.conf.arg(metavar="DIRECTORY")] = Path("out/inference")
    """Directory of every robot's result, report.json and the pictures. `make pages` fills the
    tables of the pages from docs/inference."""
    bodies: Annotated[float, tyro.conf.arg(metavar="SHARE")] = 1.0
    """Number of robots, as a share of each setting's own."""
    seed: int = 0
    """Seed of all that is random."""
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="SETTING ...")] = ()
    """Some of the settings: exact, quiet, loud, prior, world, edges, reactive, mujoco, foreign for
    all foreign worlds or one such as law-0.01; of the swims: window, unchanged, struck, recovery;
    rows, logs of 100 to 10 rows a second; and strangers for all robots of other people, or one
    such as solver. By default all but foreign, rows and strangers."""
    workers: int | None = None
    """Processes, of one thread each; a core each by default."""

    def cases(self) -> dict[str, list[Case]]:
        """Return the robots of each setting."""
        integer("seed", self.seed, 0)
        if not 0.0 < self.bodies <= 100.0:
            raise InvalidArgumentError(f"bodies must be over 0, 100 at most; got {self.bodies}")
        sizes = {name: setting.robots for name, setting in EVERY.items()} | SWIMS | LOGS
        sizes |= DRAWS
        groups = {"foreign": tuple(FOREIGN_SETTINGS), "strangers": tuple(KINDS)}
        names = [
            each
            for name in self.only
            for each in (groups[name] if name in groups else [one_of("only", name, sizes)])
        ] or [*SETTINGS, *SWIMS]
        if "mujoco" in names:
            load_mujoco()
        counts = {name: round(self.bodies * sizes[name]) for name in names}
        least = {name: 10 if name == "prior" else 2 for name in names}  # for ranks
        return {
            name: [Case(name, i, self.seed) for i in range(max(least[name], count))]
            for name, count in counts.items()
        }

    def execute(self) -> None:
        """Infer the robots that are missing, and print the tables."""
        cases = self.cases()
        found = [case for some in cases.values() for case in some]
        with experiment(
            found, measure, self.out, "a measurement of inference", {"seed": self.seed},
            workers=self.workers, warm_up=_warm_up,
        ) as (folder, results):  # fmt: skip
            read = dict(zip(found, results, strict=True))

            def part(kinds: Collection[str], summary: Callable[..., Any]) -> dict[str, Any]:
                return {
                    name: summary(name, [read[case] for case in some])
                    for name, some in cases.items()
                    if name in kinds
                }

            report: dict[str, Any] = {
                "seed": self.seed,
                "code": (read_manifest(folder) or {}).get("versions", []),
                "settings": part(EVERY, summarise),
                "swims": part(SWIMS, summarise_swims),
                "logs": part(LOGS, lambda _, documents: summarise_logs(documents)),
                "strangers": part(KINDS, lambda _, documents: summarise_strangers(documents)),
            }
            every = [read[case] for case in found if case.setting in KINDS]
            if every:
                report["strangers"]["all"] = summarise_strangers(every)
            numbers, times = split_times(report)
            write_document(folder / REPORT, numbers, SCHEMA)
            write_document(folder / "times.json", times, SCHEMA)
            save_pictures(report, folder)
        tables = make_tables(report)
        console = Console(highlight=False)
        for name, table in tables.items():
            console.print(table.rich())
            write_bytes(folder / f"{name}.md", f"{table.markdown()}\n".encode())


def _warm_up(cases: Sequence[Case]) -> None:
    measure(cases[0])


if __name__ == "__main__":
    sys.exit(run_command_line("instruments.inference", Inference))
