"""How fast the engines are: ``python -m aquafish_gym.bench``.

Machines are shared and noisy, so every row is run in turn with the others, several times over,
and stands beside its ratio to PyBullet in this same run. A row's figure is its best turn.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table

from aquafish_gym.commandline import run_command_line, single_command
from aquafish_gym.engines.base import MAXIMUM_STEPS, check_engine, simulate
from aquafish_gym.morphology import MAXIMA
from aquafish_gym.storage import ensure_writable_directory, write_json
from aquafish_gym.validation import InvalidArgumentError, integer

FEW_ROBOTS = 16  # in the lanes' smallest batch


@dataclass(frozen=True)
class Bench:
    """Time the engines and print robot-steps a second.

    A robot-step is one robot for one physics step of 0.01 s. Every row of the table is one engine
    at one precision, and x PyBullet is its rate over PyBullet's in this same run.
    """

    robots: int = 4096
    """Robots in a batch of the compiled engine, numba."""
    steps: int = 512
    """Physics steps of 0.01 s that each robot takes."""
    bullet_robots: int = 8
    """Robots in PyBullet's batch."""
    turns: int = 5
    """How often each row is run; its best turn counts."""
    seed: int = 0
    """The random bodies, commands and fin angles follow from it."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """A JSON file to write as well."""

    def execute(self) -> None:
        """Time, print one table and write what was asked for."""
        integer("robots", self.robots, 1)
        integer("steps", self.steps, 1, MAXIMUM_STEPS)
        integer("bullet_robots", self.bullet_robots, 1)
        integer("turns", self.turns, 1)
        integer("seed", self.seed, 0)
        check_engine("pybullet")
        if self.out is not None:
            if self.out.is_dir():
                raise InvalidArgumentError(f"out must be a file; {self.out} is a directory")
            ensure_writable_directory(self.out.parent, "out")
        records = measure(self)
        show(
            records,
            f"{self.steps} steps of 0.01 s, best of {self.turns} turn{'s'[: self.turns > 1]}",
        )
        if self.out is not None:
            config = {k: v for k, v in asdict(self).items() if k != "out"}
            write_json(self.out, {"config": config, "rows": records})


_LEAST = 0.1  # s; a short call is repeated for so long in each turn


@dataclass(frozen=True)
class Row:
    """One thing to time: a call that takes ``steps`` steps of each of ``robots`` robots."""

    engine: str
    dtype: str
    robots: int
    threads: int
    record: str
    steps: int
    call: Callable[[], object]


def rows(config: Bench) -> list[Row]:
    """Return what is timed; the first row is what the others are compared with."""
    rng = np.random.default_rng(config.seed)
    count = max(config.robots, config.bullet_robots, FEW_ROBOTS)
    bodies = rng.uniform(0, 1, (count, 9)) * MAXIMA
    commands = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (count, 3))
    angles = rng.uniform(-np.pi, np.pi, (count, 3))

    def run(engine: str, robots: int, dtype: str, threads: int, record: str) -> Row:
        def call() -> object:
            few = slice(robots)
            return simulate(
                bodies[few], commands[few], angles[few], steps=config.steps, engine=engine,
                dtype=dtype, threads=threads, record=record,
            )  # fmt: skip

        return Row(engine, dtype, robots, threads, record, config.steps, call)

    cores = len(os.sched_getaffinity(0))
    found = [run("pybullet", config.bullet_robots, "float64", 1, "attitude")]
    for dtype in ("float32", "float64"):
        found.append(run("numba", config.robots, dtype, 1, "rpy"))
        found.append(run("numba", config.robots, dtype, 1, "attitude"))
        if cores > 1:
            found.append(run("numba", config.robots, dtype, cores, "attitude"))
    found.append(run("numba", FEW_ROBOTS, "float32", 1, "attitude"))
    return found


def _seconds(call: Callable[[], object], repeats: int) -> float:
    """Return how long one call takes, over some in a row."""
    start = time.perf_counter()
    for _ in range(repeats):
        call()
    return (time.perf_counter() - start) / repeats


def measure(config: Bench) -> list[dict[str, object]]:
    """Time every row in turn and return a record of each."""
    timed = rows(config)
    best = [np.inf] * len(timed)
    repeats = []
    for row in timed:
        row.call()  # compiles, and warms the caches
        repeats.append(max(1, round(_LEAST / _seconds(row.call, 1))))
    for _ in track(range(config.turns), description="turns"):
        for i, row in enumerate(timed):
            best[i] = min(best[i], _seconds(row.call, repeats[i]))
    rates = [row.robots * row.steps / seconds for row, seconds in zip(timed, best, strict=True)]
    return [
        {
            "engine": row.engine,
            "dtype": row.dtype,
            "robots": row.robots,
            "threads": row.threads,
            "record": row.record,
            "robot_steps_per_second": rate,
            "ratio_to_pybullet": rate / rates[0],
        }
        for row, rate in zip(timed, rates, strict=True)
    ]


def show(records: list[dict[str, object]], title: str) -> None:
    """Print one table."""
    table = Table(title=title)
    for column in ("engine", "dtype", "robots", "threads", "recorded"):
        table.add_column(column, justify="left" if column in ("engine", "dtype") else "right")
    table.add_column("steps/s", justify="right")
    table.add_column("x PyBullet", justify="right")
    for r in records:
        table.add_row(
            *(str(r[key]) for key in ("engine", "dtype", "robots", "threads", "record")),
            f"{r['robot_steps_per_second']:,.0f}",
            f"{r['ratio_to_pybullet']:,.1f}",
        )
    Console().print(table)


if __name__ == "__main__":
    sys.exit(run_command_line("aquafish_gym.bench", single_command(Bench)))
