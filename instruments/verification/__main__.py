"""Verify the simulator: ``python -m instruments.verification``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from aquafish_gym.engines.api import check_engine
from aquafish_gym.plans import AQUAFISH, check_plan
from aquafish_gym.runs.command_line import Plan, run_command_line
from aquafish_gym.utils.storage import ensure_writable_directory, write_document
from aquafish_gym.utils.validation import install_advice, integer, one_of
from instruments.verification.report import (
    OF_ANY_PLAN,
    QUICK,
    STUDIES,
    Effort,
    make_report,
    tables_of,
)


@dataclass(frozen=True)
class Verification:
    """Compare the simulator with its oracles and print what was found.

    The engines with each other, single with double precision, the scheme with RK4, the drag
    law's few points with the whole surface, the reactive terms with potential flow, and, if it is
    installed, with MuJoCo the mechanics and the water.
    """

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIRECTORY")] = None
    """Where to write report.json and the pictures as well. `make pages` then fills the tables of
    the pages from docs/physics."""
    seed: int = 0
    """All that is random follows from it."""
    quick: bool = False
    """Run each study on next to nothing, to see that it runs."""
    markdown: bool = False
    """Print the tables in Markdown."""
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="STUDY ...")] = ()
    """Some of the studies: agreement, single_precision, convergence, quadrature, mechanics,
    strokes, reactive, real_fish, foreign; of another fish than aquafish, one of the first five."""
    plan: Plan = "aquafish"

    def execute(self) -> None:
        """Run the studies, print the tables and write what was asked for."""
        integer("seed", self.seed, 0)
        plan = check_plan(self.plan)
        known = STUDIES if plan == AQUAFISH else OF_ANY_PLAN
        names = [one_of("only", name, known) for name in self.only] or list(known)
        if self.out is not None:
            ensure_writable_directory(self.out, "out")
        if "agreement" in names:
            check_engine("pybullet")
        report = make_report(QUICK if self.quick else Effort(), self.seed, names, plan)
        tables = tables_of(report)
        console = Console(highlight=False)
        for table in tables.values():
            if self.markdown:
                print(f"\n{table.title}\n\n{table.markdown()}")
            else:
                console.print(table.rich())
        left_out = [name for name, part in report.items() if part is None]
        if left_out:
            print(f"MuJoCo is not installed, so these are left out: {', '.join(left_out)}; "
                  f"{install_advice('mujoco')}")  # fmt: skip
        if self.out is not None:
            from instruments.verification.plots import save_pictures

            write_document(self.out / "report.json", report)
            save_pictures(report, self.out)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command_line("instruments.verification", Verification, arguments)


if __name__ == "__main__":
    sys.exit(main())
