"""A recorded swim (times, gyroscope readings, executed commands), and its file."""

from __future__ import annotations

import csv
import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from io import StringIO
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import check_commands
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.plans import AQUAFISH, PLANS, BodyPlan, PlanLike, check_plan
from aquafish_gym.utils.storage import DamagedFileError, write_bytes
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    UnknownNameError,
    brief,
    finite_array,
    fits,
    flag,
    instance,
    integer,
    sequence,
)
from eea.core.angles import TURN, Floats
from eea.core.behavior import Log, gyro_samples
from eea.logs.alignment import align
from eea.logs.columns import (
    TICKS,
    Gyroscope,
    Quantity,
    found_columns,
    gyroscopes,
    possible_units,
    time_columns,
)
from eea.logs.stamps import Bunches, bunches_of, even_times, new_rows
from eea.logs.streams import Recording
from eea.logs.tables import read_recording

GYRO_COLUMNS = ("gyro_x", "gyro_y", "gyro_z")
TRIAL_COLUMN = "trial"
#: rad/s; of 8,000 random bodies of each of ``PLANS`` none turned faster than 4.4 at full speed.
FASTEST_SPIN = 10.0
#: Of the fastest fin's rate, which none of them reached 1.4 times.
FASTEST_SPIN_FACTOR = 3.0
#: s between two rows of a trial. Rows only need to outnumber the unknowns. An environment's action
#: lasts 0.2 s; in a longer gap rows are missing, and the commands are unknown.
LONGEST_GAP_SECONDS = 0.25
FEWEST_SAMPLES = 16  # samples of a trial, 48 numbers for some 30 unknowns
TIME_NAMES = {tick: unit for unit, tick in TICKS.items()}


def fastest_spin(plan: BodyPlan) -> float:
    """Return the rate, rad/s, that no fish of a plan exceeds."""
    rates = (TURN * fin.speed * (1.0 if fin.turns else fin.sweep) for fin in plan.fins)
    return max(FASTEST_SPIN, FASTEST_SPIN_FACTOR * max(rates))


def log_columns(plan: BodyPlan) -> tuple[str, ...]:
    """Return the columns of a log's file; "trial" may follow."""
    return ("time", *GYRO_COLUMNS, *plan.names)


def log_quantities(plan: BodyPlan) -> dict[str, Quantity]:
    """Return what a log must have: the rate of a servo that turns, the frequency of a sweep."""
    speeds = {"rev/s": 1.0, "Hz": 1.0, "deg/s": 1 / 360, "rad/s": 1 / TURN}
    return {
        "gyro": Quantity(GYRO_COLUMNS, {"rad/s": 1.0, "deg/s": TURN / 360.0}),
        **{servo: Quantity((servo,), speeds) for servo in plan.names},
        TRIAL_COLUMN: Quantity(
            (TRIAL_COLUMN,), {}, optional=True, with_sensor=True, advice=": number the trials"
        ),
    }


@dataclass(frozen=True, eq=False)
class SwimLog:
    """A recorded swim of one trial or several.

    A row has the gyroscope's reading at its time, and the command that the servos execute then. A
    command that is new in a row began between the row before and this one; where these are more
    than 0.01 s apart, inference finds when. A trial begins at its first row. A simulation of T
    steps of 0.01 s thus has T + 1 rows: the first at rest with the first command, and one after
    each step.

    Raises
    ------
    InvalidArgumentError
        If a field is not as stated below; the message names the row, from 1, and the column. A
        trial must have at least 17 rows and no gap of more than 0.25 s. Rates must be possible for
        this fish; rates in degrees/s mostly are not.

    Examples
    --------
    >>> log = SwimLog(0.01 * np.arange(65), np.zeros((65, 3)), np.full((65, 3), 0.4))
    >>> len(log), log.seconds
    (1, (0.64,))
    """

    time: Floats  #: (T,) in s, increasing within a trial.
    gyro: Floats  #: (T, 3) in rad/s about the body's axes: x right, y forward, z up.
    #: (T, F) as executed: of servos that turn in rev/s, of those that sweep in Hz.
    commands: Floats
    #: (T,) number of each row's trial, in blocks of rows; one trial if not given.
    trial: NDArray[Any] = field(default_factory=lambda: np.empty(0))
    remarks: tuple[str, ...] = ()  #: Sentences on how the rows were made of a recorder's.
    plan: BodyPlan = AQUAFISH

    def __post_init__(self) -> None:
        object.__setattr__(self, "plan", check_plan(self.plan))
        fins = self.plan.fins
        time = _rows("time", self.time, (None,), ("time",))
        if not len(time):
            raise InvalidArgumentError("time must have at least one row; it has none")
        gyro = _rows("gyro", self.gyro, (len(time), 3), GYRO_COLUMNS)
        commands = _rows("commands", self.commands, (len(time), len(fins)), self.plan.names)
        unnumbered = isinstance(self.trial, np.ndarray) and not self.trial.size
        given = np.ones(len(time)) if unnumbered else self.trial
        numbers = _rows(TRIAL_COLUMN, given, (len(time),), (TRIAL_COLUMN,))
        trial = numbers.astype(np.int64)
        _refuse(numbers != trial, numbers, (TRIAL_COLUMN,), "a whole number")
        remarks = tuple(sequence("remarks", self.remarks))
        for remark in remarks:
            instance("remarks", remark, str)
        object.__setattr__(self, "remarks", remarks)
        fields = {"time": time, "gyro": gyro, "commands": commands, TRIAL_COLUMN: trial}
        for name, value in fields.items():
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if len(np.unique(trial)) != len(self):
            raise InvalidArgumentError("trial must have the rows of each trial in one block")
        fastest = fastest_spin(self.plan)
        rates = f"at most {fastest:g} rad/s, which no such fish exceeds (not degrees/s)"
        for index, rows in enumerate(self.blocks):
            _check_time(time, rows, self.name(index))
        _refuse(np.abs(gyro) > fastest, gyro, GYRO_COLUMNS, rates)
        for fin, command, low, high in zip(
            fins, commands.T, self.plan.command_low, self.plan.command_high, strict=True
        ):
            wanted = f"in [{low:g}, {high:g}] {fin.unit}"
            _refuse((command < low) | (command > high), command, (fin.name,), wanted)

    @classmethod
    def of_trials(
        cls,
        commands: Sequence[ArrayLike],
        logs: Sequence[Log],
        moving: bool = False,
        plan: PlanLike = AQUAFISH,
    ) -> SwimLog:
        """Return the log of trials that were sampled every 0.01 s, such as simulated trials.

        Parameters
        ----------
        commands
            For each trial a constant command (F,) in rev/s or Hz, or a command for each sample
            (T, F), executed in the 0.01 s before the sample.
        logs
            As many logs with ``gyro`` (T, 3) or (1, T, 3), rad/s.
        moving
            Whether the trials begin in mid-swim; otherwise a row at rest precedes the samples.
        plan
            The robot's body plan.

        Raises
        ------
        TargetError, InvalidArgumentError
            If commands and logs differ in number or length, or a log is not one of this fish.
        """
        flag("moving", moving)
        plan = check_plan(plan)
        commands = sequence("commands", commands)
        logs = sequence("logs", logs)
        if not len(commands) == len(logs) > 0:
            raise InvalidArgumentError(
                "commands and logs must be equally many, and at least one; "
                f"got {len(commands)} and {len(logs)}"
            )
        parts: list[list[NDArray[Any]]] = []
        for number, (command, log) in enumerate(zip(commands, logs, strict=True), 1):
            samples = gyro_samples(log, axes=3, source=f"trial {number}")[0]
            each = check_commands(plan, command, f"commands of trial {number}")
            if len(each) not in (1, len(samples)):
                raise InvalidArgumentError(
                    f"commands of trial {number} must be one, or one for each of its "
                    f"{len(samples)} samples; got {len(each)}"
                )
            executed = np.broadcast_to(each, (len(samples), each.shape[1]))
            rows = (
                # decimals as people write them
                np.round(TIMESTEP * np.arange(len(samples) + 1), 9),
                np.concatenate([np.zeros((1, 3)), samples]),
                np.concatenate([executed, executed[-1:]]),
                np.full(len(samples) + 1, number),
            )
            parts.append([part[moving:] for part in rows])
        time, gyro, executed, trial = map(np.concatenate, zip(*parts, strict=True))
        return cls(time, gyro, executed, trial, plan=plan)

    @cached_property
    def blocks(self) -> tuple[slice, ...]:
        """The rows of each trial."""
        edges = np.flatnonzero(np.diff(self.trial)) + 1
        ends = [0, *edges.tolist(), len(self.trial)]
        return tuple(map(slice, ends, ends[1:]))

    def __len__(self) -> int:
        return len(self.blocks)

    @property
    def seconds(self) -> tuple[float, ...]:
        """The duration of each trial, s."""
        return tuple(float(np.ptp(self.time[rows])) for rows in self.blocks)

    def name(self, index: int) -> str:
        """Return the name of a trial from its index: "trial" and its number in the log."""
        row = self.blocks[integer("index", index, 0, len(self) - 1)].start
        return f"trial {self.trial[row]}"


def shown(seconds: float, digits: int = 3) -> str:
    """Return a number of seconds with some significant digits, without an exponent.

    Examples
    --------
    >>> shown(5.3249), shown(12345.6)
    ('5.32', '12346')
    """
    return f"{seconds:.0f}" if abs(seconds) >= 10**digits else f"{seconds:.{digits}g}"


def restamped(log: SwimLog) -> tuple[SwimLog, list[str]]:
    """Return a log with even times where its rows were stamped on arrival in packets.

    See :func:`eea.logs.stamps.even_times`. Also return sentences on the changes.

    Raises
    ------
    InvalidArgumentError
        If the signal does not show whether rows were sampled in bunches, or packets are missing.
    """
    time = log.time.copy()
    said: list[str] = []
    for index, rows in enumerate(log.blocks):

        def name(found: Bunches, index: int = index, first: int = rows.start) -> str:
            return f"{log.name(index)}, rows {first + found.first + 1} to {first + found.last + 1}"

        time[rows], sentences = even_times(
            log.time[rows], log.gyro[rows], TIMESTEP, LONGEST_GAP_SECONDS, name
        )
        said += sentences
    return (replace(log, time=time), said) if said else (log, said)


def new_readings(log: SwimLog, index: int) -> NDArray[np.intp]:
    """Return a trial's rows of the log but those in which a driver repeats its last reading.

    Raises
    ------
    InvalidArgumentError
        If the reading is repeated for more than 0.25 s while a servo moves.
    """
    block = log.blocks[index]
    rows = np.arange(block.start, block.stop)
    kept = new_rows(log.gyro[block], (log.commands[block] == 0.0).all(axis=1))
    new = rows[kept]
    gaps = np.diff(log.time[new])
    if not kept.all() and gaps.max() > LONGEST_GAP_SECONDS:
        last = int(np.argmax(gaps))
        raise InvalidArgumentError(
            f"row {new[last] + 2}: {', '.join(GYRO_COLUMNS)} must be new readings while "
            f"{', '.join(log.plan.names)} move; they repeat the row before for "
            f"{shown(gaps[last])} s: leave those rows out and make what follows another trial"
        )
    return new


def write_log(path: str | os.PathLike[str], log: SwimLog) -> None:
    """Write a recorded swim as CSV, whole or not at all; numbers are read back exactly.

    Raises
    ------
    CannotWriteError
        If the file cannot be written.

    Examples
    --------
    >>> log = SwimLog(0.01 * np.arange(65), np.zeros((65, 3)), np.full((65, 3), 0.4))
    >>> write_log("swim.csv", log)
    >>> read_log("swim.csv").seconds
    (0.64,)
    """
    instance("log", log, SwimLog)
    text = StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*log_columns(log.plan), TRIAL_COLUMN])
    numbers = np.column_stack([log.time, log.gyro, log.commands]).tolist()
    table.writerows([*row, trial] for row, trial in zip(numbers, log.trial.tolist(), strict=True))
    write_bytes(path, text.getvalue().encode())


def read_log(
    path: str | os.PathLike[str],
    columns: Mapping[str, str] | None = None,
    between: Sequence[float] | None = None,
    plan: PlanLike = AQUAFISH,
) -> SwimLog:
    """Return the recorded swim in a CSV, Parquet, ArduPilot BIN, PX4 ULog or MCAP file.

    By default the columns are time, gyro_x, gyro_y, gyro_z and the names of the plan's fins, in any
    order, and trial if there are several; others are ignored. See ``SwimLog`` for their meaning.
    All formats but CSV need the extra ``logs``.

    Parameters
    ----------
    path
        The file.
    columns
        Names of the columns, where they differ: from ``time``, ``gyro`` (three, joined by commas),
        a fin's name or ``trial`` to ``STREAM.COLUMN``, with a minus for the opposite sign, or to
        ``FACTOR*STREAM.COLUMN+OFFSET``. A key may end in a unit, such as ``gyro:deg/s`` or
        ``time:us``. Commands of another stream are held from each of its rows to the next, and
        averaged from a reading of the gyroscope to the next.
    between
        The part to read, s after the first reading; None for all.
    plan
        The robot's body plan, which the file does not say.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read or has no such log. The message names the file, the row, from 1,
        and the column.
    MissingExtraError
        If the format needs the extra ``logs``.

    Examples
    --------
    >>> sub = {
    ...     "gyro": "IMU.GyrY, IMU.GyrX, -IMU.GyrZ",
    ...     "left_pectoral": "0.00125*RCOU.C1-1.875",
    ...     "right_pectoral": "0.00125*RCOU.C2-1.875",
    ...     "caudal": "0.0025*RCOU.C3-3.75",
    ... }
    >>> log = read_log("00000001.BIN", sub, between=(12.0, 40.0))  # doctest: +SKIP
    """
    plan = check_plan(plan)
    names = _checked_map(columns)
    part = None
    if between is not None:
        times = finite_array("between", between, (None,), 0.0).tolist()
        if len(times) != 2 or times[0] >= times[1]:
            raise InvalidArgumentError(
                "between must be two times, s, the second later; got "
                + (" and ".join(f"{one:g}" for one in times) or "none")
            )
        part = (times[0], times[1])
    recording = read_recording(path)
    try:
        found = align(recording, log_quantities(plan), names, part, LONGEST_GAP_SECONDS)
        values = found.values
        if part is not None and len(np.unique(values.get(TRIAL_COLUMN, ()))) > 1:
            raise InvalidArgumentError(
                "between must be None where the log has several trials; leave rows out instead"
            )
        commands = np.hstack([values[servo] for servo in plan.names])
        trial = values.get(TRIAL_COLUMN, np.ones((len(found.time), 1)))[:, 0]
        remarks = (*recording.remarks, *found.remarks)
        return SwimLog(found.time, values["gyro"], commands, trial, remarks, plan)
    except UnknownNameError as error:
        command = next(iter(suggested_map(recording, path, plan)), None)
        advice = f"by --map; aquafish logs {os.fspath(path)} lists them"
        advice = advice if command is None else f"as in {command}"
        raise DamagedFileError(f"log: {path}: {error}; name the columns {advice}") from None
    except InvalidArgumentError as error:
        raise DamagedFileError(f"log: {path}: {error}") from None


def _checked_map(columns: Mapping[str, str] | None) -> dict[str, str]:
    if columns is None:
        return {}
    if not isinstance(columns, Mapping) or not all(
        isinstance(word, str) for pair in columns.items() for word in pair
    ):
        raise InvalidArgumentError(
            f"columns must be None, or a dict from names to columns; got {brief(columns)}"
        )
    return dict(columns)


def suggested_map(
    recording: Recording, path: str | os.PathLike[str], plan: BodyPlan = AQUAFISH
) -> list[str]:
    """Return the command that infers from a log, or nothing if no column may be a gyroscope."""
    command = f"aquafish infer --log {shlex.quote(os.fspath(path))}"
    for known in (plan, *PLANS.values()):
        if all(len(found_columns(recording, name)) == 1 for name in log_columns(known)):
            return [f"{command}{_plan_option(known)}"]
    gyros = gyroscopes(recording)
    if not gyros:
        return []
    gyro = shlex.quote(f"gyro{gyros[0].unit_suffix}={in_fish_axes(gyros[0])}")
    stream = gyros[0].stream
    clock = next(time_columns(stream), None)
    time = ""
    if clock is not None and not stream.clocks:
        unit = "" if clock[0] in stream.units else f":{TIME_NAMES[clock[1]]}"
        time = shlex.quote(f"time{unit}={clock[0]}") + " "
    servos = " ".join(f"{servo}=COLUMN" for servo in plan.names)
    return [f"{command}{_plan_option(plan)} --map {time}{gyro} {servos}"]


def _plan_option(plan: BodyPlan) -> str:
    """Return the option that names a plan; nothing for the paper's."""
    if plan == AQUAFISH:
        return ""
    return f" --plan {plan.name if PLANS.get(plan.name) == plan else 'FILE'}"


def in_fish_axes(gyro: Gyroscope) -> str:
    """Return the columns of a gyroscope in the order and signs of the fish's axes."""
    x, y, z = gyro.names
    return {"FRD": f"{y},{x},-{z}", "FLU": f"-{y},{x},{z}"}.get(gyro.frame, f"{x},{y},{z}")


def _rows(
    argument: str, value: ArrayLike, shape: tuple[int | None, ...], columns: Sequence[str]
) -> Floats:
    """Return a signal as an array; an error names the row and column of a NaN."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f" and fits(value.shape, shape):
        _refuse(~np.isfinite(value), value, columns, "finite")
    return finite_array(argument, value, shape)


def _refuse(wrong: NDArray[np.bool_], values: Floats, columns: Sequence[str], wanted: str) -> None:
    """Raise an InvalidArgumentError for the first wrong entry (T,) or (T, columns)."""
    where = np.argwhere(wrong)
    if len(where):
        place = tuple(where[0].tolist())
        name = f"row {place[0] + 1}: {columns[place[-1] if len(place) > 1 else 0]}"
        raise InvalidArgumentError(f"{name} must be {wanted}; got {values[place]:g}")


def _check_time(time: Floats, rows: slice, name: str) -> None:
    """Raise an InvalidArgumentError if a trial's times are too few, too slow or not increasing."""
    steps = np.diff(time[rows])
    if len(steps) < FEWEST_SAMPLES:
        raise InvalidArgumentError(
            f"{name} must have at least {FEWEST_SAMPLES + 1} rows; it has {len(steps) + 1}"
        )
    typical = float(np.median(steps))
    if typical > LONGEST_GAP_SECONDS:
        raise InvalidArgumentError(
            f"{name} must have at least {1.0 / LONGEST_GAP_SECONDS:g} rows a second, with time in "
            f"s; it has one in {shown(typical)} s"
            + "".join(f": is the time in {unit}?" for unit in possible_units(time[rows])[:1])
        )
    wrong = np.flatnonzero((steps <= 0.0) | (steps > LONGEST_GAP_SECONDS))
    if not len(wrong):
        return
    row = rows.start + int(wrong[0]) + 2
    step = float(steps[wrong[0]])
    got = f"{shown(abs(step))} s {'later' if step > 0.0 else 'earlier'} than" if step else "that of"
    hint = ""
    if bunches_of(np.maximum.accumulate(time[rows]), TIMESTEP):
        hint = (
            "; the times come in bunches, as of packets stamped on arrival: restamp the rows "
            "evenly, as they were sampled"
        )
    elif not step:
        hint = "; if a row was written twice, leave one out"
    raise InvalidArgumentError(
        f"row {row}: time must be later than the row before within {name}, by at most "
        f"{LONGEST_GAP_SECONDS:g} s; it is {got} row {row - 1}{hint}"
    )
