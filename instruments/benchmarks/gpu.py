"""The command line: ``python -m instruments.benchmarks.gpu``: the engine cuda beside the lanes.

A robot-step is one robot for one physics step of 0.01 s. The open loop holds a command; in the
closed one a network with three hidden nodes acts every 5 steps on the IMU's observations, with
weights of each robot's own. "Compared" are spectra of the gyroscope with an observed one, as in the
EEA. A rate counts the time of the GPU alone; a call also copies tables and logs to it and back.
Rows of MJX, where it is installed with JAX for CUDA, are of MuJoCo's model of the robot, without
water.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from numba import cuda

from aquafish_gym.engines.compiled.closed_loop import ClosedLoop
from aquafish_gym.engines.compiled.lanes import LaneBatch, pack_rows
from aquafish_gym.engines.compiled.recording import GYRO_BIT, RPY_BIT
from aquafish_gym.engines.compiled.spectrum import padded
from aquafish_gym.engines.cuda import CudaBatch
from aquafish_gym.engines.packages import available_cores, check_engine
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.command_line import run_command_line
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Reals
from aquafish_gym.utils.storage import ensure_writable_directory, write_bytes, write_document
from aquafish_gym.utils.validation import integer
from gait.controllers.controller import Controller, program_of
from instruments.benchmarks.defaults import present_commit
from instruments.verification.mujoco_model import mujoco_model
from instruments.verification.trials import random_trials

MOST_LOGGED = 128_000_000  # robot-steps that are logged at once, 24 bytes each
SPECTRUM_STEPS = 512
MJX_STEPS = 64
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
    """Steps of 0.01 s, or fewer where logs would take more than 3 GB of main memory."""
    double: int = 1_000_000
    """How many robots swim in double precision, too; 0 for none."""
    lanes: int = 100_000
    """How many robots swim in the lanes."""
    mjx: tuple[int, ...] = (100_000, 1_000_000)
    """How many robots MJX steps at once, if it is installed."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIRECTORY")] = None
    """Where to write gpu.json and table.md as well."""

    def execute(self) -> None:
        """Time, print and write."""
        for name in ("robots", "mjx"):
            for count in getattr(self, name):
                integer(name, count, 1)
        for name in ("steps", "lanes"):
            integer(name, getattr(self, name), 1)
        integer("double", self.double, 0)
        check_engine("cuda", batch=True)
        if self.out is not None:
            ensure_writable_directory(self.out, "out")
        card = cuda.get_current_device()
        name = card.name.decode() if isinstance(card.name, bytes) else card.name
        lines = [f"{name}, {card.MULTIPROCESSOR_COUNT} multiprocessors; {available_cores()} cores"]
        print(lines[0])
        rows: list[dict[str, Any]] = []
        todo = [("numba", "float32", self.lanes), ("numba", "float64", self.lanes)]
        todo += [("cuda", "float32", count) for count in self.robots]
        todo += [("cuda", "float64", self.double)] if self.double else []
        todo += [("mjx", "float32", count) for count in self.mjx]
        for engine, dtype, count in todo:
            timed = (
                time_mjx(count) if engine == "mjx" else time_batch(engine, dtype, count, self.steps)
            )
            for row in timed:
                rows.append(row)
                lines.append(said(row))
                print(lines[-1], flush=True)
        if self.out is not None:
            facts = {"commit": present_commit(), "card": name, "cores": available_cores()}
            write_document(self.out / "gpu.json", facts | {"rows": rows})
            text = "```text\n" + "\n".join(lines) + "\n```\n"
            write_bytes(self.out / "table.md", text.encode())


def said(row: dict[str, Any]) -> str:
    """Return a row as a line of the table."""
    seconds = row["kernel seconds"] or row["call seconds"]
    rate = row["robots"] * row["steps"] / seconds / 1e9
    return (
        f"{row['engine']:6} {row['dtype']} {row['robots']:>10,} robots, {row['steps']:3} steps, "
        f"{row['loop']:15}: {rate:8.3f} G robot-steps/s ({row['call seconds']:.3f} s a call)"
    )


def time_mjx(count: int) -> Iterator[dict[str, Any]]:
    """Yield how long B robots swim in MJX, in no water; nothing where it is not installed."""
    try:
        jax, mjx = import_module("jax"), import_module("mujoco.mjx")
    except ImportError as error:
        print(f"no MJX is here: {error}")
        return
    model = mjx.put_model(mujoco_model(Morphology.nominal(), TIMESTEP))
    begun = mjx.make_data(model)

    def swim(speeds: Any) -> Any:
        def step(data: Any, t: Any) -> tuple[Any, None]:
            turned = data.replace(ctrl=speeds * (t + 1.0) * TIMESTEP)
            return mjx.step(model, turned), None

        return jax.lax.scan(step, begun, jax.numpy.arange(MJX_STEPS))[0].qpos

    run = jax.jit(jax.vmap(swim))
    speeds = np.linspace(0.5, 2.0, count, dtype=np.float32)[:, None] * np.ones(3, np.float32)
    run(speeds).block_until_ready()  # compiles
    turns = []
    for _ in range(TURNS):
        start = time.perf_counter()
        run(speeds).block_until_ready()
        turns.append(time.perf_counter() - start)
    yield row_of("mjx", "float32", count, MJX_STEPS, "no water", None, min(turns))


def row_of(
    engine: str, dtype: str, count: int, steps: int, loop: str, kernel: float | None, call: float
) -> dict[str, Any]:
    """Return a row; ``kernel`` and ``call`` are seconds."""
    return {
        "engine": engine,
        "dtype": dtype,
        "robots": count,
        "steps": steps,
        "loop": loop,
        "kernel seconds": kernel,
        "call seconds": call,
    }


def time_batch(engine: str, dtype: str, count: int, steps: int) -> Iterator[dict[str, Any]]:
    """Yield how long B robots swim in each loop, with and without a log of the IMU."""
    logged = min(steps, max(1, MOST_LOGGED // count))
    kind = getattr(np, dtype)
    trials = random_trials(min(count, 100_000))
    some = np.arange(count) % len(trials.commands)  # drawing ten million would take a minute
    commands = trials.commands[some]
    robots = Scenario.create(trials.morphologies[some], fin_angles=trials.fin_angles[some])
    batch = (TimedBatch if engine == "cuda" else LaneBatch)(robots, kind)
    closed = closed_loop(batch)
    which = np.zeros(count, np.intp)

    def compared(n: int) -> None:
        seen = np.zeros((1, 2, padded(n)), kind)
        batch.distances(commands, n, 1.0, seen, which)

    loops: list[tuple[str, int, Callable[[int], object]]] = [
        ("closed, logged", logged, lambda n: closed(n, RPY_BIT | GYRO_BIT)),
        ("closed", steps, lambda n: closed(n, 0)),
        ("open, logged", logged, lambda n: batch.log(commands, n, "attitude")),
        ("open, compared", SPECTRUM_STEPS, compared),
        ("open", steps, lambda n: batch.advance(commands, n)),
    ]
    begun = batch.states.copy()
    for loop, swum, run in loops:
        run(4)  # compiles
        turns = []
        for _ in range(TURNS):
            batch.states[:] = begun
            batch.steps_done = 0
            if isinstance(batch, TimedBatch):
                batch.seconds = 0.0
            start = time.perf_counter()
            run(swum)
            taken = time.perf_counter() - start
            kernel = batch.seconds if isinstance(batch, TimedBatch) else None
            turns.append((taken, kernel))
        call, kernel = min(turns, key=lambda turn: turn[1] or turn[0])
        yield row_of(engine, dtype, count, swum, loop, kernel, call)


def closed_loop(batch: LaneBatch) -> Callable[[int, int], tuple[Reals, ...]]:
    """Return a function that swims robots by a network for some steps, and returns their logs.

    It takes the steps and the bits of ``compiled/recording.py``.
    """
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

    def run(steps: int, bits: int) -> tuple[Reals, ...]:
        logs = batch._logs(steps, bits)
        output = batch._without_spectra(logs)
        asking = (program.interval, 0)
        policy = (packed, program.layout)
        batch._run(program.function, policy, steps, asking, output, bits, loop)
        return logs

    return run


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command_line("instruments.benchmarks.gpu", GpuBench, arguments)


if __name__ == "__main__":
    sys.exit(main())
