"""The compiled engine on a GPU: the loop of the lanes, with a thread for each lane.

Sixteen threads in a row are a register of the lanes' loop (``compiled/kernel.py``, ``simd.py``).
Its numbers are rounded as on the processor, so that every robot has the bits of the lanes. A batch
that does not fit into the GPU's memory swims in parts, one after the other.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import cuda
from numba.cuda.cudadrv.driver import CudaAPIError
from numba.cuda.models import models, register_model
from numpy.typing import NDArray

from aquafish_gym.engines.compiled.kernel import CompiledPolicy, OpenLoop, time_loop, work_rows
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.engines.compiled.spectrum import PARTIAL_SUMS, partial_distances
from aquafish_gym.physics.arithmetic import put
from aquafish_gym.physics.compiling import say
from aquafish_gym.physics.simd import Lanes, zero_lanes
from aquafish_gym.plans import BodyPlan
from aquafish_gym.utils.array_types import Floats, Reals
from aquafish_gym.utils.validation import EngineUnavailableError

WIDTH = PARTIAL_SUMS  # of a register: sums over coefficients need sixteen lanes
THREADS = 128  # of a block
# A thread's at most, in 32 bits: fewer let more threads swim at once, but some numbers then have to
# go to memory.
REGISTERS = {"float32": 168, "float64": 255}
SHARE_OF_MEMORY = 0.9  # of what is free; the rest is for code, and for what others take meanwhile
OUT_OF_MEMORY = 2  # CUDA's number of this error


@register_model(Lanes)
class _ThreadModel(models.PrimitiveModel):  # type: ignore[misc]
    """A thread's lane: a bare number."""

    def __init__(self, dmm: Any, fe_type: Lanes) -> None:
        super().__init__(dmm, fe_type, dmm.lookup(fe_type.base).get_value_type())


@functools.cache
def loop_kernel(
    plan: BodyPlan,
    policy: CompiledPolicy | OpenLoop,
    reactive: bool,
    functions: Any,
    late: bool,
    records: bool,
    dtype: str,
) -> Any:
    """Return the kernel of :func:`~aquafish_gym.engines.compiled.kernel.time_loop`.

    Its ``works`` are a row of ``work`` for each register that swims at the same time.
    """
    swim, _ = time_loop(plan, policy, WIDTH, reactive, functions, late, records)

    def swim_registers(
        parameters: Any, states: Any, conditions: Any, given: Any, program: Any, task: Any,
        h: float, clock: Any, output: Any, record: int, works: Any, groups: int,
    ) -> None:  # fmt: skip
        register = cuda.grid(1) // WIDTH
        registers = cuda.gridsize(1) // WIDTH
        for group in range(register, groups, registers):
            swim(
                parameters, states, conditions, given, program, task, h, clock, output, record,
                works[register], group, group + 1,
            )  # fmt: skip

    return cuda.jit(swim_registers, max_registers=REGISTERS[dtype])


@functools.cache
def distance_kernel() -> Any:
    """Return the kernel of ``partial_distances``, into (B, 16) partial sums, flat."""

    def compare(spectra: Any, observed: Any, which: Any, rows: int, partial: Any) -> None:
        zero = zero_lanes(partial, WIDTH)
        register = cuda.grid(1) // WIDTH
        registers = cuda.gridsize(1) // WIDTH
        for b in range(register, len(which), registers):
            put(partial, b, partial_distances(spectra, b, observed, which[b], rows, zero))

    return cuda.jit(compare)


@functools.cache
def announce() -> None:
    """Say once that kernels are compiled, which numba keeps for a process alone."""
    say("compiling the physics for the GPU, in every process: ten to thirty seconds a kernel ...")


def at_once(dtype: str) -> int:
    """Return how many registers of lanes the GPU computes at the same time."""
    device = cuda.get_current_device()
    blocks = device.MAX_REGISTERS_PER_MULTIPROCESSOR // (THREADS * REGISTERS[dtype])
    return int(device.MULTIPROCESSOR_COUNT * blocks * (THREADS // WIDTH))


def launched(kernel: Any, registers: int) -> Callable[..., None]:
    """Return what launches a kernel for this many registers of lanes, or a few more."""
    with warnings.catch_warnings():  # few robots do not fill a GPU, and need not
        warnings.simplefilter("ignore")
        launch: Callable[..., None] = kernel[-(-registers * WIDTH // THREADS), THREADS]
    return launch


class CudaBatch(LaneBatch):
    """A :class:`LaneBatch` that swims on the GPU; between calls its tables are in main memory."""

    _compared: tuple[Reals, NDArray[np.intp], Floats] | None = None

    @staticmethod
    def lane_width(_dtype: type[np.floating]) -> int:
        return WIDTH

    def distances(
        self,
        commands: Floats,
        steps: int,
        scale: float,
        observed: Reals,
        which: NDArray[np.intp],
    ) -> Floats:
        found = np.empty(self.batch)
        self._compared = observed, which, found
        try:
            self.spectra(commands, steps, scale)
        finally:
            self._compared = None
        return found

    def _swim(
        self, policy: CompiledPolicy | OpenLoop, kind: tuple[Any, ...], arguments: tuple[Any, ...]
    ) -> None:
        if not self.groups:
            return
        announce()
        kernel = loop_kernel(self.plan, policy, *kind, self._dtype_name)
        try:
            self._swim_in_parts(kernel, *arguments)
        except CudaAPIError as error:
            if error.code != OUT_OF_MEMORY:
                raise
            raise EngineUnavailableError(
                f"the GPU has not enough free memory for {self.batch} robots at once: take fewer "
                'robots or steps, or engine="numba", the same robots in main memory'
            ) from None

    def _swim_in_parts(
        self, kernel: Any, program: Any, task: Any, h: float, clock: Any, output: Any, bits: int
    ) -> None:
        """Swim as many registers of robots at once as fit into the memory that is free."""
        weights, layout, *by_register, broken = program
        logs, spectra, roots, unit = output
        rows = work_rows(bits, clock[1], len(self.plan.fins))
        registers = min(at_once(self._dtype_name), self.groups)
        launch = launched(kernel, registers)
        works = cuda.device_array(
            (registers + -registers % (THREADS // WIDTH), rows * WIDTH), self.dtype
        )
        shared = (works, cuda.to_device(layout), cuda.to_device(roots), unit, broken, task)
        tables = [
            table.reshape(-1, self.groups, WIDTH)
            for table in (self._parameters, self._states, self._conditions, weights)
        ]
        by_register = [self._given.table, *by_register]
        by_robot = [*logs, spectra]
        size = sum(table.nbytes for table in tables + by_register + by_robot) / self.groups
        free = cuda.current_context().get_memory_info().free
        fitting = max(1, int(SHARE_OF_MEMORY * free / size))
        for first in range(0, self.groups, fitting):
            some = slice(first, first + fitting)
            robots = slice(first * WIDTH, (first + fitting) * WIDTH)
            read = [table[:, some] for table in tables] + [table[some] for table in by_register]
            written = [table[robots] for table in by_robot]
            self._swim_part(launch, read, written, shared, (h, clock, bits), robots)

    def _swim_part(
        self,
        launch: Callable[..., None],
        read: list[Reals],
        written: list[Reals],
        shared: Any,
        numbers: Any,
        robots: slice,
    ) -> None:
        """Swim some registers of robots, of which these are the tables."""
        works, layout, roots, unit, broken, task = shared
        h, clock, bits = numbers
        sent = [cuda.to_device(np.ascontiguousarray(table)) for table in read]
        made = [cuda.device_array(table.shape, table.dtype) for table in written]
        parameters, states, conditions, weights = (table.reshape(table.size) for table in sent[:4])
        given, episodes, noises = sent[4:]
        program = (weights, layout, episodes, noises, broken)
        output = (tuple(made[:-1]), made[-1], roots, unit)
        registers = read[0].shape[1]
        launch(
            parameters, states, conditions, given, program, task, h, clock, output, bits, works,
            registers,
        )  # fmt: skip
        for which in (1, 2, 4, 5):  # states, conditions, given commands, episodes: the loop's own
            read[which][...] = sent[which].copy_to_host()
        if self._compared is not None:
            self._compare(made.pop(), robots)
        for table, on_gpu in zip(written, made, strict=False):
            if table.size:
                on_gpu.copy_to_host(table)

    def _compare(self, spectra: Any, robots: slice) -> None:
        """Compare a part's spectra, which are on the GPU, with observed ones."""
        assert self._compared is not None
        observed, which, found = self._compared
        chosen = which[robots]
        partial = cuda.device_array(len(chosen) * WIDTH, self.dtype)
        flat, seen = spectra.reshape(spectra.size), cuda.to_device(observed.reshape(-1))
        rows = spectra.shape[2] // WIDTH
        launch = launched(distance_kernel(), min(at_once(self._dtype_name), len(chosen)))
        launch(flat, seen, cuda.to_device(chosen), rows, partial)
        sums = partial.copy_to_host().reshape(-1, WIDTH).astype(np.float64)
        total = np.zeros(len(chosen))
        for column in sums.T:  # in the order of the lanes
            total += column
        found[robots] = total
