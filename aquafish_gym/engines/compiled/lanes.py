"""The compiled engine: thousands of robots at once, on all cores."""

from __future__ import annotations

import functools
import math
import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.compiled.closed_loop import ClosedLoop
from aquafish_gym.engines.compiled.kernel import (
    ACT,
    PERFORM,
    CompiledPolicy,
    OpenLoop,
    compile_kernel,
    work_rows,
)
from aquafish_gym.engines.compiled.lag import GivenCommands
from aquafish_gym.engines.compiled.recording import (
    GYRO_BIT,
    POSE_BIT,
    RECORDED_CHANNELS,
    RPY_BIT,
    SPECTRUM_BIT,
)
from aquafish_gym.engines.compiled.spectrum import padded, roots_of_unity, spectral_distances
from aquafish_gym.engines.packages import MAXIMUM_THREADS, available_cores
from aquafish_gym.engines.worlds import (
    Swimmers,
    check_lags,
    diverged_states,
    longest_lags,
    remembered_steps,
)
from aquafish_gym.imu import ImuLog
from aquafish_gym.physics.compiling import check_compiler
from aquafish_gym.physics.kinematics import Numbers
from aquafish_gym.physics.layout import CURRENT, layout
from aquafish_gym.physics.simd import register_bytes
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Flags, Floats, Observations, Reals
from aquafish_gym.utils.validation import InvalidArgumentError

Selection = NDArray[np.bool_] | NDArray[np.intp]

_RECORDS = {
    "rpy": RPY_BIT,
    "gyro": GYRO_BIT,
    "attitude": RPY_BIT | GYRO_BIT,
    "pose": RPY_BIT | GYRO_BIT | POSE_BIT,
}
# One command, which is held.
_HELD: NDArray[np.int64] = np.array([1, 1, 0])
# Steps of a group that are worth a thread, 0.06 ms of work: it takes 0.04 ms to wake.
_WORTH_A_THREAD = 300


def lane_width(dtype: type[np.floating]) -> int:
    """Return how many robots of this type share a register on this machine."""
    return register_bytes() // np.dtype(dtype).itemsize


def pack_rows(rows: NDArray[np.float64], dtype: type[np.floating], width: int) -> Reals:
    """Pad a table (rows, B) to whole groups by repeating its last column, and flatten it."""
    batch = rows.shape[1]
    table = np.empty((len(rows), batch + -batch % width), dtype)
    with np.errstate(under="ignore"):  # in single precision
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


class LaneBatch(Swimmers):
    """The B robots of a scenario, which live in the lanes between calls.

    ``width`` is how many robots share a register; None takes what the machine has. No result
    depends on it. A trial that begins in mid-series has ``rates`` of the joints at the start,
    (B, F) in rad/s, and commands (B, D, F) that were ``given`` in the D steps before. Robots begin
    in ``states``, (N, B) or (N, 1) of the plan's ``layout``, if these are not None; else as the
    scenario says, which raises InvalidArgumentError if the angle of a dead servo's fin has not been
    drawn.
    """

    def __init__(
        self,
        scenario: Scenario,
        dtype: type[np.floating] = np.float32,
        substeps: int = 1,
        threads: int | None = None,
        width: int | None = None,
        rates: ArrayLike = 0.0,
        given: Floats | None = None,
        states: Floats | None = None,
    ) -> None:
        check_compiler()
        self.batch = len(scenario)
        self.plan = scenario.plan
        self.layout = layout(scenario.plan)
        self.dtype = dtype
        self._dtype_name = np.dtype(dtype).name
        self.width = width or self.lane_width(dtype)
        self.groups = -(-self.batch // self.width)
        self.reactive = scenario.reactive
        self.substeps = substeps
        self.threads = threads or available_cores()
        self.steps_done = 0
        nothing = np.zeros((self.groups, 0), dtype)
        self._no_loop = (nothing, nothing, False)
        self._step: ClosedLoop | None = (
            None  # what the kernel says of an action, once one was given
        )
        pack = functools.partial(pack_rows, dtype=dtype, width=self.width)
        robots = scenario.beginning
        # One table after the other: each is packed while the cache holds it.
        self._parameters = pack(self.layout.robots(robots.body, robots.drag, robots.fin_density))
        self._conditions = pack(_conditions(robots))
        begun = _states(scenario, rates) if states is None else states
        self._states = pack(np.broadcast_to(begun, (self.layout.state_rows, self.batch)))
        self._commands = pack(np.zeros((len(self.plan.fins), self.batch)))
        self._everyone = np.arange(self.batch)
        self._longest_lag = longest_lags(scenario).copy()
        self._given = GivenCommands(self.batch, len(self.plan.fins), self.width, dtype)
        self._remember()
        if given is not None and self._given.depth:
            self._given.put(given[:, -self._given.depth :])

    @staticmethod
    def lane_width(dtype: type[np.floating]) -> int:
        """Return how many robots of this type share a register on this machine."""
        return lane_width(dtype)

    def start(self, scenario: Scenario, rows: Selection | None = None) -> None:
        """Put the robots ``rows``, a mask (B,) or numbers (n,), at the start of a scenario of n."""
        rows = self._everyone if rows is None else rows
        self._longest_lag[rows] = longest_lags(scenario)
        self._remember()
        self._given.forget(rows)
        self.update(scenario.beginning, rows)
        self.states[:, rows] = _states(scenario)

    def update(
        self, scenario: Scenario, rows: Selection | None = None, keep_current: bool = False
    ) -> None:
        """Give the robots ``rows`` bodies, drag, water and servos of a scenario in mid-swim.

        With ``keep_current`` their water moves on as it does. Raises InvalidArgumentError as
        :class:`~aquafish_gym.engines.worlds.Swimmers` says.
        """
        rows = self._everyone if rows is None else rows
        check_lags(scenario, self._longest_lag[rows])
        tables = self.layout
        parameters = tables.robots(scenario.body, scenario.drag, scenario.fin_density)
        self._table(self._parameters, tables.robot_rows)[:, rows] = parameters
        first = tables.servo_gain.start if keep_current else CURRENT
        conditions = self._table(self._conditions, tables.condition_rows)
        conditions[first:, rows] = _conditions(scenario)[first:]

    def set_current(self, current: Floats) -> None:
        """Set the velocity of the water (B, 3) from now on, units/s in the world."""
        conditions = self._table(self._conditions, self.layout.condition_rows)
        conditions[CURRENT : CURRENT + 3] = current.T

    def advance(self, command: Floats, steps: int = 1) -> None:
        """Hold commands (B, F), in rev/s or Hz, for some steps of 0.01 s."""
        self._check_commands(command)
        self._table(self._commands, len(self.plan.fins))[:] = command.T
        output = self._without_spectra(self._logs())
        self._run(PERFORM, (self._commands, _HELD), steps, (steps, 0), output, 0)

    def act(
        self,
        action: Floats,
        followed: Numbers,
        steps: int = 1,
        task: Any = None,
        memory: Floats | None = None,
    ) -> tuple[Flags, Observations, list[Floats] | None]:
        if self._step is None:
            self._step = ClosedLoop(self.batch, len(self.plan.fins), self.width, self.dtype, 0)
            none = np.zeros((2 * len(self.plan.fins), self.batch))
            self._actions = pack_rows(none, self.dtype, self.width)
        loop = self._step
        table = self._table(self._actions, 2 * len(self.plan.fins))
        table[: len(followed)] = followed
        table[len(followed) :] = action
        loop.functions, loop.task = task or (None, ())
        if memory is not None and memory.size:
            loop.set_memory(memory)
        output = self._without_spectra(self._logs())
        self._run(ACT, (self._actions, _HELD), steps, (steps, 0), output, 0, loop)
        alive, *terms = loop["acted"]
        return alive == 0.0, loop.observed(), None if task is None else terms

    @property
    def diverged(self) -> Flags:
        """Which robots (B,) ran away or left the finite numbers."""
        return diverged_states(self.layout.state(self.states))

    def log(
        self, commands: Floats, steps: int, record: str, interval: int = 1, begun: int = 0
    ) -> ImuLog:
        """Hold commands (B, F) for ``steps``; return the log of ``record``, as of ``simulate``.

        Or perform a series of them, (B, K, F), each for ``interval`` steps and the last to the end,
        which began ``begun`` steps before this batch did. What is not recorded is None in the log.
        If the gyroscope alone is, the attitude is computed at the end only: the angles of
        ``states`` may then differ from a log's by whole turns.
        """
        series = commands[:, None] if commands.ndim == 2 else commands
        program = (self._pack_commands(series), np.array([series.shape[1], interval, begun]))
        asking = (interval, (begun + self.steps_done) % interval)
        if series.shape[1] == 1:
            asking = (steps, 0)
        bits = _RECORDS[record]
        logs = self._logs(steps, bits)
        self._run(PERFORM, program, steps, asking, self._without_spectra(logs), bits)
        rpy, gyro, pose = (log.transpose(0, 2, 1) for log in logs)
        return ImuLog(
            rpy=rpy if bits & RPY_BIT and record != "gyro" else None,
            gyro=gyro if bits & GYRO_BIT else None,
            position=pose[:, :, :3] if bits & POSE_BIT else None,
            quaternion=pose[:, :, 3:7] if bits & POSE_BIT else None,
            fin_angles=pose[:, :, 7:] if bits & POSE_BIT else None,
            diverged=self.diverged,
        )

    def run(
        self,
        policy: CompiledPolicy,
        weights: Reals,
        layout: NDArray[np.int64],
        steps: int,
        interval: int,
        loop: ClosedLoop,
    ) -> None:
        """Let a policy that observes (see ``kernel.py``) act every ``interval`` steps."""
        asking = (interval, self.steps_done % interval)
        output = self._without_spectra(self._logs())
        self._run(policy, (weights, layout), steps, asking, output, 0, loop)

    def spectra(self, commands: Floats, steps: int, scale: float = 1.0) -> Reals:
        """Hold commands (B, F) for ``steps``, a power of two; return the spectra of the gyroscope.

        They are (B, 2, F') as in ``spectrum.py``, of ``scale`` times the rad/s about x, y and z.
        The attitude is computed only at the end, as in :meth:`log`. Spectra of robots that diverged
        are not finite.

        Raises
        ------
        InvalidArgumentError
            If ``steps`` is no power of two of at least 4.
        """
        if steps < 4 or steps & (steps - 1):
            raise InvalidArgumentError(f"steps must be a power of two of at least 4; got {steps}")
        spectra = np.empty((self.groups * self.width, 2, padded(steps)), self.dtype)
        program = (self._pack_commands(commands), _HELD)
        output = (self._logs(), spectra, roots_of_unity(steps, self._dtype_name), scale)
        self._run(PERFORM, program, steps, (steps, 0), output, SPECTRUM_BIT)
        return spectra[: self.batch]

    def distances(
        self,
        commands: Floats,
        steps: int,
        scale: float,
        observed: Reals,
        which: NDArray[np.intp],
    ) -> Floats:
        """Return how far the spectra of :meth:`spectra` are from observed ones, (B,).

        See :func:`~aquafish_gym.engines.compiled.spectrum.spectral_distances`.
        """
        return spectral_distances(self.spectra(commands, steps, scale), observed, which)

    def _logs(self, steps: int = 0, bits: int = 0) -> tuple[Reals, ...]:
        counts = RECORDED_CHANNELS | {POSE_BIT: RECORDED_CHANNELS[POSE_BIT] + len(self.plan.fins)}
        return tuple(
            np.empty((self.batch, n, steps) if bits & bit else (0, n, 0), self.dtype)
            for bit, n in counts.items()
        )

    def _without_spectra(self, logs: tuple[Reals, ...]) -> Any:
        # Read-only, as those of a spectrum are: numba would compile the loop twice for them.
        return logs, np.empty((0, 2, 0), self.dtype), roots_of_unity(0, self._dtype_name), 1.0

    def _pack_commands(self, commands: Floats) -> Reals:
        """Return a policy's weights: commands (B, ...)."""
        self._check_commands(commands)
        flat = commands.reshape(self.batch, math.prod(commands.shape[1:]))
        return pack_rows(flat.T, self.dtype, self.width)

    def _check_commands(self, commands: Floats) -> None:
        if len(commands) != self.batch:  # a shorter table would be read beyond its end
            raise InvalidArgumentError(
                f"commands must be those of {self.batch} robots; got {len(commands)}"
            )

    def _remember(self) -> None:
        """Remember as many commands as the longest lag asks for."""
        longest = float(self._longest_lag.max(initial=0.0))
        if longest:
            self._given.extend(remembered_steps(longest), self.steps_done)

    def _run(
        self,
        policy: CompiledPolicy | OpenLoop,
        program: Any,
        steps: int,
        asking: tuple[int, int],
        output: Any,
        bits: int,
        loop: ClosedLoop | None = None,
    ) -> None:
        """Let a policy command the servos for some steps.

        It is asked whenever an interval is over, of which ``asking`` says its steps and how many
        have passed. One that is open-loop is also asked first.
        """
        functions, task = (loop.functions, loop.task) if loop else (None, ())
        # A series has one kernel, whether it is recorded or not.
        recorded = policy == PERFORM or bits != 0
        kind = (self.reactive, functions, self._given.depth > 0, recorded)
        program = (*program, *(loop.program if loop else self._no_loop))
        clock = (self.steps_done, steps, self.substeps, *asking)
        h = TIMESTEP / self.substeps
        self._swim(policy, kind, (program, task, h, clock, output, bits))
        self.steps_done += steps

    def _swim(
        self, policy: CompiledPolicy | OpenLoop, kind: tuple[Any, ...], arguments: tuple[Any, ...]
    ) -> None:
        """Run the kernel of a kind on as many threads as are worth it."""
        kernel = compile_kernel(self.plan, policy, self.width, *kind)
        *_, (_, steps, *_), _, bits = arguments
        rows = work_rows(bits, steps, len(self.plan.fins))

        def part(begin: int, end: int) -> None:
            tables = (self._parameters, self._states, self._conditions, self._given.table)
            space = np.empty(rows * self.width, self.dtype)
            kernel(*tables, *arguments, space, begin, end)

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

    @property
    def states(self) -> Reals:
        """The states (N, B) themselves: the rows of ``layout``.

        What is written to them is where the robots swim on.
        """
        return self._table(self._states, self.layout.state_rows)

    def close(self) -> None:
        """Do nothing: lanes hold memory alone."""

    def _table(self, flat: Reals, rows: int) -> Reals:
        """View a flat table as (rows, B)."""
        view: Reals = flat.reshape(rows, self.groups * self.width)[:, : self.batch]
        return view


def _conditions(scenario: Scenario) -> Floats:
    lag = scenario.servo_lag / TIMESTEP
    return layout(scenario.plan).conditions(scenario.current, scenario.servo_gain, lag)


def _states(scenario: Scenario, rates: ArrayLike = 0.0) -> Floats:
    scenario.check_angles()
    start = layout(scenario.plan).start
    return start(scenario.fin_angles, scenario.velocity, scenario.spin, rates)
