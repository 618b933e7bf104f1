"""The command line: ``python -m instruments.benchmarks``."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from aquafish_gym.engines.api import MAXIMUM_STEPS
from aquafish_gym.runs.command_line import run_command_line
from aquafish_gym.runs.progress import show_progress
from aquafish_gym.utils.storage import ensure_writable_directory, write_bytes, write_document
from aquafish_gym.utils.validation import finite_array, integer, one_of
from instruments.benchmarks.defaults import present_commit, say_defaults, work_defaults
from instruments.benchmarks.measure import LEAST_SECONDS, Timing, measure
from instruments.benchmarks.report import as_text, machine_facts, make_records, make_table
from instruments.benchmarks.rows import GROUPS, Group, Settings, load_provider

_QUICK = {"robots": 64, "steps": 32, "turns": 2}


@dataclass(frozen=True)
class Bench:
    """Time engines, bodies, gaits, environments, pictures and new processes, and print one table.

    A robot-step is one robot for one physics step of 0.01 s. "861 x #1" says: 861 times as fast as
    row 1, which took turns with this row in this same run.
    """

    robots: int = 4096
    """Robots in the largest batch of the open loop; few shrink the other groups, too."""
    steps: int = 512
    """Physics steps of 0.01 s that each robot takes in the rows of the open loop."""
    turns: int = 5
    """How often each row is run; its best turn counts, of a new process the median."""
    seconds: float = LEAST_SECONDS
    """How long a turn lasts at least. Where others use the processors, many turns of a few
    milliseconds find out what an idle one would do."""
    seed: int = 0
    """The random bodies, commands, fin angles and networks follow from it."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIRECTORY")] = None
    """Where to write bench.json and table.md as well."""
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="GROUP ...")] = ()
    """Some of the groups: physics, widths, bodies, mujoco, neat, environments, resets, faults,
    learning, training, tasks, pictures, starting, replicate."""
    quick: bool = False
    """At most 64 robots, 32 steps and 2 turns: to see that it runs, not how fast."""

    def execute(self) -> None:
        """Time, print the tables and write what was asked for."""
        integer("robots", self.robots, 1)
        integer("steps", self.steps, 1, MAXIMUM_STEPS)
        integer("turns", self.turns, 1)
        finite_array("seconds", self.seconds, (), 0.0, 60.0, "s")
        integer("seed", self.seed, 0)
        names = tuple(dict.fromkeys(one_of("only", name, GROUPS) for name in self.only))
        names = names or tuple(GROUPS)
        if self.out is not None:
            ensure_writable_directory(self.out, "out")
        facts = {"commit": present_commit(), "machine": machine_facts()}
        text, document = self._measure(names)
        if self.out is not None:
            write_document(self.out / "bench.json", facts | document)
            shown = f"```text\n{text.rstrip()}\n```\n\n{say_defaults(names)}\n"
            write_bytes(self.out / "table.md", shown.encode())

    def _measure(self, names: tuple[str, ...]) -> tuple[str, dict[str, Any]]:
        """Time groups and print their table; return it as text and as a document."""
        if self.quick:
            limits = {name: min(getattr(self, name), most) for name, most in _QUICK.items()}
        else:
            limits = {name: getattr(self, name) for name in _QUICK}
        turns = limits.pop("turns")
        cores = len(os.sched_getaffinity(0))
        settings = Settings(**limits, seed=self.seed, cores=cores, quick=self.quick)
        groups, records = time_groups(list(names), settings, turns, self.seconds)
        console = Console()
        title = f"best of {turns} turn{'s'[: turns > 1]}, {settings.steps} steps in open loop"
        table = make_table(title, groups, records)
        console.print(table)
        for note in dict.fromkeys(note for group in groups.values() for note in group.notes):
            console.print(note, highlight=False, markup=False, soft_wrap=True)
        config = {
            **asdict(settings),
            "turns": turns,
            "seconds": self.seconds,
            "groups": list(groups),
        }
        notes = {name: group.notes for name, group in groups.items()}
        document = {"config": config, "defaults": work_defaults(names), "notes": notes}
        return as_text(table), document | {"rows": records}


def time_groups(
    names: list[str], settings: Settings, turns: int, seconds: float = LEAST_SECONDS
) -> tuple[dict[str, Group], list[dict[str, Any]]]:
    """Time the groups of these names and show progress; return them and all their records."""
    least = 0.0 if settings.quick else seconds
    groups: dict[str, Group] = {}
    records: list[dict[str, Any]] = []
    for name in names:
        with ExitStack() as cleanup:
            with show_progress(f"{name}: preparing", 1):
                group = groups[name] = load_provider(name)(settings, cleanup)
            timings = _time_group(name, group, turns, least)
        records += make_records(name, group, timings, len(records) + 1)
    return groups, records


def _time_group(name: str, group: Group, turns: int, least_seconds: float) -> list[Timing]:
    """Time the rows of a group and show progress."""
    ticks = count(1)
    with show_progress(name, len(group.rows) * (turns + 1)) as show:
        return measure(group, turns, least_seconds, lambda: show(next(ticks), name))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command_line("instruments.benchmarks", Bench, arguments)


if __name__ == "__main__":
    sys.exit(main())
