"""A recorded swim (times, gyroscope readings, executed commands), and its file."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from io import StringIO
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW, SERVOS, check_commands
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.utils.storage import DamagedFileError, read_bytes, write_bytes
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    fits,
    flag,
    instance,
    integer,
    sequence,
)
from eea.core.angles import Floats
from eea.core.behavior import Log, gyro_samples
from eea.fish.bunches import bunches_of

GYRO_COLUMNS = ("gyro_x", "gyro_y", "gyro_z")
LOG_COLUMNS = ("time", *GYRO_COLUMNS, *SERVOS)  # columns of the file; "trial" may follow
TRIAL_COLUMN = "trial"
FASTEST_SPIN = 10.0  # rad/s; none of 20,000 random bodies at full speed turned faster than 4.3
#: s between two rows of a trial. The commands between rows are known, so rows only need to
#: outnumber the unknowns. An environment's action lasts 0.2 s; in a longer gap rows are missing,
#: and the commands are unknown.
LONGEST_GAP_SECONDS = 0.25
#: Units of time that a logger may write, s; and the least step between rows in them, s.
UNITS = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
SHORTEST_TIME_STEP = 5e-4
FEWEST_SAMPLES = 16  # samples of a trial, 48 numbers for some 30 unknowns
MAXIMUM_LOG_BYTES = 64 * 2**20  # of a file, more than an hour at 100 rows a second


@dataclass(frozen=True, eq=False)
class SwimLog:
    """A recorded swim of one trial or several.

    A row has the gyroscope's reading at its time, and the command that the servos execute from
    this row to the next. A trial begins at its first row. A simulation of T steps of 0.01 s thus
    has T + 1 rows: the first at rest with the first command, and one after each step.

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
    #: (T, 3): left and right flipper in rev/s, tail in Hz, as executed.
    commands: Floats
    #: (T,) number of each row's trial, in blocks of rows; one trial if not given.
    trial: NDArray[Any] = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        time = _rows("time", self.time, (None,), ("time",))
        if not len(time):
            raise InvalidArgumentError("time must have at least one row; it has none")
        gyro = _rows("gyro", self.gyro, (len(time), 3), GYRO_COLUMNS)
        commands = _rows("commands", self.commands, (len(time), 3), SERVOS)
        unnumbered = isinstance(self.trial, np.ndarray) and not self.trial.size
        given = np.ones(len(time)) if unnumbered else self.trial
        numbers = _rows(TRIAL_COLUMN, given, (len(time),), (TRIAL_COLUMN,))
        trial = numbers.astype(np.int64)
        _refuse(numbers != trial, numbers, (TRIAL_COLUMN,), "a whole number")
        fields = {"time": time, "gyro": gyro, "commands": commands, TRIAL_COLUMN: trial}
        for name, value in fields.items():
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if len(np.unique(trial)) != len(self):
            raise InvalidArgumentError("trial must have the rows of each trial in one block")
        rates = f"at most {FASTEST_SPIN:g} rad/s, which no such fish exceeds (not degrees/s)"
        for index, rows in enumerate(self.blocks):
            _check_time(time, rows, self.name(index))
        _refuse(np.abs(gyro) > FASTEST_SPIN, gyro, GYRO_COLUMNS, rates)
        outside = (commands < COMMAND_LOW) | (commands > COMMAND_HIGH)
        _refuse(outside, commands, SERVOS, "in [-0.5, 0.5] rev/s, caudal in [0, 1] Hz")

    @classmethod
    def of_trials(
        cls, commands: Sequence[ArrayLike], logs: Sequence[Log], moving: bool = False
    ) -> SwimLog:
        """Return the log of trials that were sampled every 0.01 s, such as simulated trials.

        Parameters
        ----------
        commands
            For each trial a constant command (3,) in rev/s, rev/s and Hz, or a command for each
            sample (T, 3), executed in the 0.01 s before the sample.
        logs
            As many logs with ``gyro`` (T, 3) or (1, T, 3), rad/s.
        moving
            Whether the trials begin in mid-swim; otherwise a row at rest precedes the samples.

        Raises
        ------
        TargetError, InvalidArgumentError
            If commands and logs differ in number or length, or a log is not one of this fish.
        """
        flag("moving", moving)
        commands = sequence("commands", commands)
        logs = sequence("logs", logs)
        if not len(commands) == len(logs) > 0:
            raise InvalidArgumentError(
                "commands and logs must be equally many, and at least one; "
                f"got {len(commands)} and {len(logs)}"
            )
        parts = []
        for number, (command, log) in enumerate(zip(commands, logs, strict=True), 1):
            samples = gyro_samples(log, axes=3, source=f"trial {number}")[0]
            each = check_commands(command, f"commands of trial {number}")
            if len(each) not in (1, len(samples)):
                raise InvalidArgumentError(
                    f"commands of trial {number} must be one, or one for each of its "
                    f"{len(samples)} samples; got {len(each)}"
                )
            executed = np.broadcast_to(each, samples.shape)
            rows = (
                # decimals as people write them
                np.round(TIMESTEP * np.arange(len(samples) + 1), 9),
                np.concatenate([np.zeros((1, 3)), samples]),
                np.concatenate([executed, executed[-1:]]),
                np.full(len(samples) + 1, number),
            )
            parts.append([part[moving:] for part in rows])
        return cls(*map(np.concatenate, zip(*parts, strict=True)))

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
    table.writerow([*LOG_COLUMNS, TRIAL_COLUMN])
    numbers = np.column_stack([log.time, log.gyro, log.commands]).tolist()
    table.writerows([*row, trial] for row, trial in zip(numbers, log.trial.tolist(), strict=True))
    write_bytes(path, text.getvalue().encode())


def read_log(path: str | os.PathLike[str]) -> SwimLog:
    """Return the recorded swim in a CSV file.

    The file has the columns time, gyro_x, gyro_y, gyro_z, left_pectoral, right_pectoral and caudal
    in any order, and trial if there are several; others are ignored. See ``SwimLog`` for their
    meaning.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read or holds no such log. The message names the file, the row, from
        1, and the column.
    """
    content = read_bytes(path, "log", MAXIMUM_LOG_BYTES)
    try:
        return SwimLog(*_table(content))
    except (csv.Error, UnicodeDecodeError) as error:
        raise DamagedFileError(f"log: {path}: it is no CSV: {error}") from None
    except InvalidArgumentError as error:
        raise DamagedFileError(f"log: {path}: {error}") from None


def _table(content: bytes) -> list[Floats]:
    """Return the fields of a ``SwimLog`` in a CSV; errors name the column, or the row from 1."""
    table = csv.DictReader(StringIO(content.decode("utf-8-sig")))
    names = table.fieldnames = [name.strip().lower() for name in table.fieldnames or ()]
    for name in LOG_COLUMNS:
        if names.count(name) != 1:
            raise InvalidArgumentError(
                f"it must have one column {name}; it has {brief(', '.join(names))}"
            )
    used = [*LOG_COLUMNS, *([TRIAL_COLUMN] if TRIAL_COLUMN in names else [])]
    rows = []
    for number, row in enumerate(table, 1):
        try:
            rows.append([float(row[name]) for name in used])
        except (TypeError, ValueError):
            name = next(name for name in used if not _is_number(row[name]))
            found = "nothing" if not row[name] else brief(row[name])
            hint = ": number the trials" if name == TRIAL_COLUMN else ""
            raise InvalidArgumentError(
                f"row {number} must have numbers; {name} is {found}{hint}"
            ) from None
    numbers = np.array(rows).reshape(-1, len(used))
    return [numbers[:, 0], numbers[:, 1:4], numbers[:, 4:7], *numbers[:, 7:].T]


def _is_number(text: str | None) -> bool:
    try:
        return text is not None and float(text) is not None
    except ValueError:
        return False


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
        units = [
            unit
            for unit, size in UNITS.items()
            if SHORTEST_TIME_STEP < typical * size < LONGEST_GAP_SECONDS
        ]
        raise InvalidArgumentError(
            f"{name} must have at least {1.0 / LONGEST_GAP_SECONDS:g} rows a second, with time in "
            f"s; it has one in {shown(typical)} s"
            + "".join(f": is the time in {unit}?" for unit in units[:1])
        )
    wrong = np.flatnonzero((steps <= 0.0) | (steps > LONGEST_GAP_SECONDS))
    if not len(wrong):
        return
    row = rows.start + int(wrong[0]) + 2
    step = float(steps[wrong[0]])
    got = f"{shown(abs(step))} s {'later' if step > 0.0 else 'earlier'} than" if step else "that of"
    hint = ""
    if bunches_of(np.maximum.accumulate(time[rows])):
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
