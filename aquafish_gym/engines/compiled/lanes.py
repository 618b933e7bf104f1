"""The compiled engine: thousands of robots at once, on all cores."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.compiled.closed_loop import ClosedLoop
from aquafish_gym.engines.compiled.kernel import CompiledPolicy, compile_kernel
from aquafish_gym.engines.compiled.policies import hold, perform
from aquafish_gym.engines.compiled.recording import (
    GYRO_BIT,
    POSE_BIT,
    RECORDED_CHANNELS,
    RPY_BIT,
    SPECTRUM_BIT,
)
from aquafish_gym.engines.compiled.spectrum import padded, roots_of_unity
from aquafish_gym.engines.packages import MAXIMUM_THREADS, available_cores
from aquafish_gym.imu import ImuLog
from aquafish_gym.physics.layout import (
    CONDITION_ROWS,
    CURRENT,
    FIELDS,
    ROBOT_ROWS,
    SERVO_GAIN,
    STATE_ROWS,
    angles_of_rows,
    condition_rows,
    robot_parameters,
    start_rows,
)
from aquafish_gym.physics.simd import register_bytes
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Reals
from aquafish_gym.utils.validation import InvalidArgumentError

Selection = NDArray[np.bool_] | NDArray[np.intp]

_RECORDS = {
    "nothing": 0,
    "rpy": RPY_BIT,
    "gyro": GYRO_BIT,
    "attitude": RPY_BIT | GYRO_BIT,
    "pose": RPY_BIT | GYRO_BIT | POSE_BIT,
}
_NO_LAYOUT: NDArray[np.int64] = np.zeros(1, np.int64)
# Steps of a group that are worth a thread, 0.06 ms of work: it takes 0.04 ms to wake.
_WORTH_A_THREAD = 300


def lane_width(dtype: type[np.floating]) -> int:
    """Return how many robots of this type share a register on this machine."""
    return register_bytes() // np.dtype(dtype).itemsize


def pack_rows(rows: NDArray[np.float64], dtype: type[np.floating], width: int) -> Reals:
    """Pad a table (rows, B) to whole groups by repeating its last column, and flatten it."""
    batch = rows.shape[1]
    table = np.empty((len(rows), batch + -batch % width), dtype)
    table[:, :batch] = rows
    if batch % width:
        table[:, batch:] = rows[:, -1:]
    return table.reshape(-1)


@functools.cache
def _helpers(_process: int) -> ThreadPoolExecutor:
    """Return the process's extra threads, started when needed and idle between calls.

    Starting threads takes as long as many a call's work. A fork does not carry them over, so
    they are kept by the process's number.
    """
    return ThreadPoolExecutor(MAXIMUM_THREADS, thread_name_prefix="aquafish-lanes")


_ready: set[tuple[Any, str]] = set()  # kernels that are compiled for a type


class LaneBatch:
    """The B robots of a scenario, which live in the lanes between calls.

    ``rates`` are those of the joints at the start, (B, 3) in rad/s. ``width`` is how many robots
    share a register; None takes what the machine has. No result depends on it. The scenario's lag
    and schedule are for :func:`simulate_lanes`; its sensors' faults are left to others.
    """

    def __init__(
        self,
        scenario: Scenario,
        dtype: type[np.floating] = np.float32,
        substeps: int = 1,
        threads: int | None = None,
        width: int | None = None,
        rates: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        self.batch = len(scenario)
        self.dtype = dtype
        self._dtype_name = np.dtype(dtype).name
        self.width = width or lane_width(dtype)
        self.groups = -(-self.batch // self.width)
        self.reactive = scenario.reactive
        self.substeps = substeps
        self.threads = threads or available_cores()
        self.steps_done = 0
        nothing = np.zeros((self.groups, 0), dtype)
        self._no_loop = (nothing, nothing, False)
        pack = functools.partial(pack_rows, dtype=dtype, width=self.width)
        # One table after the other: each is packed while the cache holds it.
        self._parameters = pack(
            robot_parameters(scenario.body, scenario.drag, scenario.fin_density)
        )
        self._conditions = pack(condition_rows(scenario.current, scenario.servo_gain))
        self._states = pack(_states(scenario, rates))
        self._commands = pack(np.zeros((3, self.batch)))

    def restart(self, rows: Selection, scenario: Scenario) -> None:
        """Put the robots ``rows``, a mask (B,) or numbers (n,), at the start of a scenario of n."""
        self.update(rows, scenario)
        self._table(self._states, STATE_ROWS)[:, rows] = _states(scenario)

    def update(self, rows: Selection, scenario: Scenario, keep_current: bool = False) -> None:
        """Give the robots ``rows`` the bodies, drag, water and servos of a scenario in mid-swim.

        They stay where they are and keep their velocities; with ``keep_current`` their water also
        moves on as it does.
        """
        parameters = robot_parameters(scenario.body, scenario.drag, scenario.fin_density)
        self._table(self._parameters, ROBOT_ROWS)[:, rows] = parameters
        first = SERVO_GAIN if keep_current else CURRENT
        conditions = condition_rows(scenario.current, scenario.servo_gain)
        self._table(self._conditions, CONDITION_ROWS)[first:, rows] = conditions[first:]

    def set_current(self, currents: NDArray[np.float64]) -> None:
        """Set the water's velocity for each robot, (B, 3), units/s in the world."""
        self._table(self._conditions, CONDITION_ROWS)[CURRENT : CURRENT + 3] = currents.T

    def advance(
        self,
        commands: NDArray[np.float64],
        steps: int,
        record: str = "nothing",
        lag: ArrayLike = 0.0,
        interval: int = 1,
        begun: int = 0,
    ) -> ImuLog:
        """Hold commands (B, 3) in rev/s, rev/s, Hz for ``steps`` of 0.01 s; return the log.

        Or perform a series of them, (B, K, 3), each for ``interval`` steps and the last to the end,
        which began ``begun`` steps before this batch did. The servos follow after ``lag`` () or
        (B,), in s.
        """
        series = commands[:, None] if commands.ndim == 2 else commands
        count = series.shape[1]
        if count == 1 and not np.any(lag):
            return self.run(hold, self._pack_commands(series), _NO_LAYOUT, steps, steps, record)
        samples = np.broadcast_to(np.asarray(lag) / TIMESTEP, (1, self.batch))
        weights = self._pack_commands(series, samples)
        latest = math.ceil(samples.max())
        layout = np.array([count, interval, begun, -(-latest // interval)])
        # Once the last robot obeys the last of them, the command is steady.
        early = (count - 1) * interval - begun + latest + 1 - self.steps_done
        return self.run(perform, weights, layout, steps, steps, record, early)

    def command_rows(self) -> Reals:
        """Return the table (3, B) of the commands that :meth:`swim` obeys, to be written to."""
        return self._table(self._commands, 3)

    def swim(self, steps: int, after: Callable[[int, int], None] | None = None) -> None:
        """Hold the commands of :meth:`command_rows` for ``steps``, and log nothing.

        Call ``after(i, j)`` once robots i to j - 1 have swum, on their thread.
        """
        output = self._without_spectra(self._logs())
        self._run(hold, (self._commands, _NO_LAYOUT), steps, (steps, 0), output, 0, after=after)

    def run(
        self,
        policy: CompiledPolicy,
        weights: Reals,
        layout: NDArray[np.int64],
        steps: int,
        interval: int,
        record: str = "nothing",
        early: int = 0,
        loop: ClosedLoop | None = None,
    ) -> ImuLog:
        """Let a policy (see ``kernel.py``) command the robots every ``interval`` steps.

        In the first ``early`` steps of this call it does so in each. ``loop`` is what a policy that
        is not open-loop needs. What is not recorded is None in the log. If an open-loop policy
        records the gyroscope alone, or nothing, the attitude is computed at the end only. The
        angles of ``state()`` may then differ from a log's by whole turns.
        """
        bits = _RECORDS[record]
        logs = self._logs(steps, bits)
        output = self._without_spectra(logs)
        self._run(policy, (weights, layout), steps, (interval, early), output, bits, loop)
        rpy, gyro, pose = (log.transpose(0, 2, 1) for log in logs)
        return ImuLog(
            rpy=rpy if bits & RPY_BIT and record != "gyro" else None,
            gyro=gyro if bits & GYRO_BIT else None,
            position=pose[:, :, :3] if bits & POSE_BIT else None,
            quaternion=pose[:, :, 3:7] if bits & POSE_BIT else None,
            fin_angles=pose[:, :, 7:] if bits & POSE_BIT else None,
            diverged=self.diverged(),
        )

    def spectra(self, commands: NDArray[np.float64], steps: int, scale: float = 1.0) -> Reals:
        """Hold commands (B, 3) for ``steps``, a power of two; return the spectra of the gyroscope.

        They are (B, 2, F') as in ``spectrum.py``, of ``scale`` times the rad/s about x, y and z.
        The attitude is computed only at the end, as in :meth:`run`. Spectra of robots that diverged
        are not finite.

        Raises
        ------
        InvalidArgumentError
            If ``steps`` is no power of two of at least 4.
        """
        if steps < 4 or steps & (steps - 1):
            raise InvalidArgumentError(f"steps must be a power of two of at least 4; got {steps}")
        spectra = np.empty((self.groups * self.width, 2, padded(steps)), self.dtype)
        program = (self._pack_commands(commands), _NO_LAYOUT)
        output = (self._logs(), spectra, roots_of_unity(steps, self._dtype_name), scale)
        self._run(hold, program, steps, (steps, 0), output, SPECTRUM_BIT)
        return spectra[: self.batch]

    def _logs(self, steps: int = 0, bits: int = 0) -> tuple[Reals, ...]:
        return tuple(
            np.empty((self.batch, n, steps) if bits & bit else (0, n, 0), self.dtype)
            for bit, n in RECORDED_CHANNELS.items()
        )

    def _without_spectra(self, logs: tuple[Reals, ...]) -> Any:
        # Read-only, as those of a spectrum are: numba would compile the loop twice for them.
        return logs, np.empty((0, 2, 0), self.dtype), roots_of_unity(0, self._dtype_name), 1.0

    def _pack_commands(self, commands: NDArray[np.float64], *more: NDArray[np.float64]) -> Reals:
        """Return a policy's weights: commands (B, ...), and ``more`` tables (rows, B)."""
        if len(commands) != self.batch:  # a shorter table would be read beyond its end
            raise InvalidArgumentError(
                f"commands must be those of {self.batch} robots; got {len(commands)}"
            )
        flat = commands.reshape(self.batch, math.prod(commands.shape[1:]))
        return pack_rows(np.concatenate([flat.T, *more]), self.dtype, self.width)

    def _run(
        self,
        policy: CompiledPolicy,
        program: Any,
        steps: int,
        asking: tuple[int, int],
        output: Any,
        bits: int,
        loop: ClosedLoop | None = None,
        after: Callable[[int, int], None] | None = None,
    ) -> None:
        """Run the kernel on as many threads as are worth it; ``asking`` is interval and early."""
        functions, task = (loop.functions, loop.task) if loop else (None, ())
        kernel = compile_kernel(policy, self.width, self.reactive, functions)
        program = (*program, *(loop.program if loop else self._no_loop))
        h = TIMESTEP / self.substeps
        phase = self.steps_done % asking[0] if loop else 0
        clock = (self.steps_done, steps, self.substeps, *asking, phase)

        def part(begin: int, end: int) -> None:
            tables = self._parameters, self._states, self._conditions
            kernel(*tables, program, task, h, clock, output, bits, begin, end)
            if after is not None:
                after(begin * self.width, min(end * self.width, self.batch))

        work = self.groups * steps * self.substeps
        parts = max(1, min(self.threads, self.groups, work // _WORTH_A_THREAD))
        if parts == 1:
            part(0, self.groups)
        else:
            # In this thread first, if it is not compiled: the others could not be interrupted.
            if (kernel, self._dtype_name) not in _ready:
                part(0, 0)
                _ready.add((kernel, self._dtype_name))
            # The others wake later, and so have less to do.
            early = self.groups * _WORTH_A_THREAD * 2 // (work * 3)
            rest = self.groups - early
            edges = [0, *(early + rest * i // parts for i in range(1, parts + 1))]
            others = [_helpers(os.getpid()).submit(part, *ends) for ends in pairwise(edges[1:])]
            part(0, edges[1])
            for other in others:
                other.result()
        self.steps_done += steps

    def diverged(self) -> NDArray[np.bool_]:
        """Return which robots (B,) have left the finite numbers."""
        return np.logical_not(np.isfinite(self._table(self._states, STATE_ROWS)).all(axis=0))

    def rows(self) -> NDArray[np.float64]:
        """Return a copy of the states (25, B): the numbers of ``State``, then rpy."""
        return self._table(self._states, STATE_ROWS).astype(np.float64)

    def state_rows(self) -> Reals:
        """Return the states (25, B) themselves, not a copy."""
        return self._table(self._states, STATE_ROWS)

    def place(self, rows: NDArray[np.float64]) -> None:
        """Set the states (25, B), as :meth:`rows` returns them."""
        self._table(self._states, STATE_ROWS)[:] = rows

    def close(self) -> None:
        """Do nothing: lanes hold memory alone."""

    def state(self) -> dict[str, NDArray[np.float64]]:
        """Return copies of what the robots are now, (B, 3) or (B, 4) each.

        As in :class:`~aquafish_gym.ImuLog`; ``velocity`` in the world, ``rates`` of the joints.
        """
        rows = self.rows()
        return {
            "quaternion": rows[FIELDS["orientation"]].T,
            "position": rows[FIELDS["position"]].T,
            "velocity": rows[FIELDS["velocity"]].T,
            "gyro": rows[FIELDS["spin"]].T,
            "fin_angles": angles_of_rows(rows).T,
            "rates": rows[FIELDS["rates"]].T,
            "rpy": rows[FIELDS["rpy"]].T,
        }

    def _table(self, flat: Reals, rows: int) -> Reals:
        """View a flat table as (rows, B)."""
        view: Reals = flat.reshape(rows, self.groups * self.width)[:, : self.batch]
        return view


def _states(scenario: Scenario, rates: ArrayLike = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    return start_rows(scenario.fin_angles, scenario.velocity, scenario.spin, rates)
