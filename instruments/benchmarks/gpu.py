"""The command line: ``python -m instruments.benchmarks.gpu``: the engine cuda beside the lanes.

A robot-step is one robot for one physics step of 0.01 s. The open loop holds a command; in the
closed one a network with three hidden nodes acts every 5 steps on what the IMU says, with weights
of each robot's own. A kernel's time is that of the GPU alone, a call's that of the whole method:
tables and logs go to the GPU and back in it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from numba import cuda

from aquafish_gym.engines.compiled.closed_loop import ClosedLoop
from aquafish_gym.engines.compiled.lanes import LaneBatch, pack_rows
from aquafish_gym.engines.compiled.recording import GYRO_BIT, RPY_BIT
from aquafish_gym.engines.cuda import CudaBatch
from aquafish_gym.engines.packages import available_cores, check_engine
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.command_line import run_command_line
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.storage import write_document
from aquafish_gym.utils.validation import integer
from gait.controllers.controller import Controller, program_of
from instruments.benchmarks.defaults import present_commit
from instruments.verification.trials import random_trials

MOST_LOGGED = 512_000_000  # robot-steps that are logged at once, 24 bytes each
TURNS = 3  # of which the best counts


class TimedBatch(CudaBatch):
    """A batch that notes for how long the GPU computes."""

    seconds = 0.0

    def _swim_part(self, launch: Callable[..., None], *rest: Any) -> None:
        def timed(*arguments: Any) -> None:
            begin, end = cuda.event(), cuda.event()
            begin.record()
            launch(*arguments)
            end.record()
            end.synchronize()
            self.seconds += cuda.event_elapsed_time(begin, end) / 1000

        super()._swim_part(timed, *rest)


@dataclass(frozen=True)
class GpuBench:
    """Time the engine cuda beside the lanes on all cores, and print one table."""

    robots: tuple[int, ...] = (10_000, 100_000, 1_000_000, 10_000_000)
    """How many robots swim at once."""
    steps: int = 512
    """Steps of 0.01 s, or fewer where so many logs would not fit into main memory."""
    double: int = 1_000_000
    """How many robots swim in double precision, too; 0 for none."""
    lanes: int = 100_000
    """How many robots swim in the lanes."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Where to write the numbers as JSON as well."""

    def execute(self) -> None:
        """Time, print and write."""
        check_engine("cuda", batch=True)
        for name in ("steps", "lanes"):
            integer(name, getattr(self, name), 1)
        card = cuda.get_current_device()
        name = card.name.decode() if isinstance(card.name, bytes) else card.name
        print(f"{name}, {card.MULTIPROCESSOR_COUNT} multiprocessors; {available_cores()} cores")
        rows: list[dict[str, Any]] = []
        todo = [("numba", "float32", self.lanes), ("numba", "float64", self.lanes)]
        todo += [("cuda", "float32", count) for count in self.robots]
        todo += [("cuda", "float64", self.double)] if self.double else []
        for engine, dtype, count in todo:
            for row in time_batch(engine, dtype, count, self.steps):
                rows.append(row)
                seconds = row["kernel seconds"] or row["call seconds"]
                rate = row["robots"] * row["steps"] / seconds / 1e9
                print(
                    f"{engine:6} {dtype} {count:>10,} robots, {row['steps']:3} steps, "
                    f"{row['loop']:15}: {rate:8.3f} G robot-steps/s"
                    f" ({row['call seconds']:.3f} s a call)",
                    flush=True,
                )
        if self.out is not None:
            facts = {"commit": present_commit(), "card": name, "cores": available_cores()}
            write_document(self.out, facts | {"rows": rows})


def time_batch(engine: str, dtype: str, count: int, steps: int) -> list[dict[str, Any]]:
    """Return how long B robots swim in each loop, with and without a log of the IMU."""
    steps = min(steps, max(1, MOST_LOGGED // count))
    kind = getattr(np, dtype)
    trials = random_trials(min(count, 100_000))
    some = np.arange(count) % len(trials.commands)  # drawing ten million would take a minute
    commands = trials.commands[some]
    robots = Scenario.create(trials.morphologies[some], fin_angles=trials.fin_angles[some])
    batch = (TimedBatch if engine == "cuda" else LaneBatch)(robots, kind)
    closed = closed_loop(batch)
    loops: dict[str, Callable[[int], object]] = {
        "closed, logged": lambda n: closed(n, RPY_BIT | GYRO_BIT),
        "closed": lambda n: closed(n, 0),
        "open, logged": lambda n: batch.log(commands, n, "attitude"),
        "open": lambda n: batch.advance(commands, n),
    }
    found = []
    for loop, run in loops.items():
        begun = batch.states.copy()
        run(1)  # compiles
        turns = []
        for _ in range(TURNS):
            batch.states[:] = begun
            batch.steps_done = 0
            if isinstance(batch, TimedBatch):
                batch.seconds = 0.0
            start = time.perf_counter()
            run(steps)
            taken = time.perf_counter() - start
            kernel = batch.seconds if isinstance(batch, TimedBatch) else None
            turns.append((taken, kernel))
        batch.states[:] = begun
        call, kernel = min(turns, key=lambda turn: turn[1] or turn[0])
        found.append(
            {
                "engine": engine,
                "dtype": dtype,
                "robots": count,
                "steps": steps,
                "loop": loop,
                "kernel seconds": kernel,
                "call seconds": call,
            }
        )
    return found


def closed_loop(batch: LaneBatch) -> Callable[[int, int], None]:
    """Return a function that swims robots by a network for some steps, and records some bits."""
    chance = np.random.default_rng(0)
    weights = np.zeros((6, 17))
    weights[:3, :11] = chance.standard_normal((3, 11))
    weights[3:, 11:14] = chance.standard_normal((3, 3))
    network = Controller(
        weights, np.zeros(6), np.ones(6), 0.7, Morphology.nominal(), layers=None, seed=0
    )
    program = program_of([network])
    genes = np.broadcast_to(program.weights, (len(program.weights), batch.batch))
    packed = pack_rows(genes, batch.dtype, batch.width)
    loop = ClosedLoop(batch.batch, 3, batch.width, batch.dtype, program.scratch)
    loop["gain"] = 1.0

    def run(steps: int, bits: int) -> None:
        output = batch._without_spectra(batch._logs(steps, bits))
        asking = (program.interval, 0)
        policy = (packed, program.layout)
        batch._run(program.function, policy, steps, asking, output, bits, loop)

    return run


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command_line("instruments.benchmarks.gpu", GpuBench, arguments)


if __name__ == "__main__":
    sys.exit(main())
