"""The command: draw mutants, judge those that are left, and report the survivors."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro
from rich.console import Console

from aquafish_gym.runs.jobs import exit_if_failed, read_result, run_jobs
from aquafish_gym.runs.manifest import lock, write_manifest
from aquafish_gym.utils.storage import ensure_writable_directory, write_bytes
from aquafish_gym.utils.validation import integer, one_of
from instruments.mutants.targets import GROUPS, Mutant, draw_mutants, sources_of
from instruments.mutants.trial import KILLED, OUT_OF_TIME, SURVIVED, Trial
from instruments.verification.tables import Table

REPORT = "report.md"


@dataclass(frozen=True)
class Mutants:
    """Change the source in one place at a time, and count the changes that the tests notice.

    The mutants are of physics, joint inference and the damage grammar, equally many of each. Tests
    run in copies of the clone. Results are kept: the same command goes on where it was stopped, and
    a larger count adds mutants.
    """

    example: ClassVar[str] = "--count 200 --out out/mutants"

    count: int = 200
    """Number of mutants."""
    seed: int = 0
    """Seed of the draw."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/mutants")
    """Directory of every mutant's result and of report.md, which has the survivors."""
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="GROUP ...")] = ()
    """Some of the groups: physics, inference, damage."""
    survivors: bool = False
    """Whether survivors are judged again, such as by new tests."""
    cpu_seconds: int = 1800
    """Processor time of a mutant's tests, s; one that takes longer counts as killed."""
    workers: int = 1
    """Mutants that are judged at the same time."""
    repository: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path()
    """The clone whose tracked files are copied."""

    def execute(self) -> None:
        """Judge the mutants that have no result, print the table and write the report."""
        integer("count", self.count, 1)
        integer("seed", self.seed, 0)
        integer("cpu_seconds", self.cpu_seconds, 1)
        integer("workers", self.workers, 1)
        groups = list(dict.fromkeys(one_of("only", name, GROUPS) for name in self.only))
        root = self.repository.resolve()
        mutants = draw_mutants(root, groups or list(GROUPS), self.count, self.seed)
        folder = ensure_writable_directory(self.out, "out").resolve()
        whole = [Mutant(g, "", 0, None) for g in dict.fromkeys(m.group for m in mutants)]
        with lock(folder):
            sources = {group: _digest(root, group) for group in GROUPS}
            write_manifest(folder, "mutants", {"seed": self.seed, "sources": sources}, (REPORT,))
            if self.survivors:
                self._forget_survivors(folder, mutants)
            trial = Trial(root, folder / "kernels", self.cpu_seconds)
            # First the source as it is, which must pass: else every mutant would seem killed.
            for jobs in (whole, mutants):
                failures = run_jobs(jobs, trial, folder, count=self.workers, describe=_describe)
                exit_if_failed(failures)
            results = [(mutant, read_result(folder, mutant) or {}) for mutant in mutants]
            table = verdict_table(results)
            write_bytes(folder / REPORT, report_text(root, table, results).encode())
        Console(highlight=False).print(table.rich())
        for mutant, result in results:
            if result["verdict"] == SURVIVED:
                print(f"survived: {mutant.name}")

    def _forget_survivors(self, folder: Path, mutants: Sequence[Mutant]) -> None:
        for mutant in mutants:
            result = read_result(folder, mutant)
            if result is not None and result["verdict"] == SURVIVED:
                (folder / mutant.file).unlink()


Results = Sequence[tuple[Mutant, Mapping[str, Any]]]


def verdict_table(results: Results) -> Table:
    """Return how many mutants of each group were killed."""
    counts = Counter((mutant.group, result["verdict"]) for mutant, result in results)
    rows = []
    groups = list(dict.fromkeys(mutant.group for mutant, _ in results))
    for name in [*groups, "all"]:
        killed, slow, survived = (
            sum(counts[group, verdict] for group in groups if name in (group, "all"))
            for verdict in (KILLED, OUT_OF_TIME, SURVIVED)
        )
        total = killed + slow + survived
        share = f"{(killed + slow) / total:.0%}"
        rows.append((name, str(total), str(killed), str(slow), str(survived), share))
    return Table(
        "mutants", ("group", "mutants", KILLED, OUT_OF_TIME, SURVIVED, "share killed"), rows
    )


def report_text(root: Path, table: Table, results: Results) -> str:
    """Return the table and the survivors' differences as Markdown."""
    parts = ["# Mutants", table.markdown()]
    for mutant, result in results:
        if result["verdict"] == SURVIVED and mutant.edit is not None:
            source = (root / mutant.path).read_text(encoding="utf-8")
            difference = mutant.edit.diff(source, mutant.path).rstrip()
            parts.append(f"## {mutant.name}\n\n```diff\n{difference}\n```")
    return "\n\n".join(parts) + "\n"


def _describe(result: Mapping[str, Any]) -> str:
    return str(result["verdict"])


def _digest(root: Path, group: str) -> str:
    """Return a hash of a group's sources: other sources have other mutants."""
    whole = "\0".join(f"{path}\0{text}" for path, text in sources_of(root, group).items())
    return hashlib.sha256(whole.encode()).hexdigest()[:16]
