"""A recorded swim: times, gyroscope readings and executed commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW, SERVOS, check_commands
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, fits
from eea.core.angles import Floats
from eea.core.behavior import Log, gyro_samples

GYRO = ("gyro_x", "gyro_y", "gyro_z")
COLUMNS = ("time", *GYRO, *SERVOS)  # of a table; "trial" may follow
FASTEST = 10.0  # rad/s: of 20,000 random bodies at full speed none turns faster than 4.3
SLOWEST = 20.0  # samples a second: a tail at 1 Hz beats 20 times
MOST_GAP = 0.2  # s between two rows of a trial
FEWEST = 32  # samples of a trial


@dataclass(frozen=True, eq=False)
class SwimLog:
    """A recorded swim, of one trial or several.

    A row has the gyroscope's reading at its time, and the command that the servos execute from then
    until the next row. A trial begins at its first row. A simulation of T steps of 0.01 s thus has
    T + 1 rows: the first at rest with the first command, and one after each step.

    Raises
    ------
    InvalidArgumentError
        If a field is not as stated below; it names the row, from 1, and the column. A trial must
        have 33 rows or more, 20 a second or more, and no gap of more than 0.2 s; rates must be
        possible for this fish, which those in degrees/s mostly are not.

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
    #: (T,) the number of the trial that each row is of, in blocks; one trial if not given.
    trial: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def __post_init__(self) -> None:
        time = _rows("time", self.time, (None,), ("time",))
        count = len(time)
        gyro = _rows("gyro", self.gyro, (count, 3), GYRO)
        commands = _rows("commands", self.commands, (count, 3), SERVOS)
        trial = _trial_numbers(self.trial, count)
        for name, value in (("time", time), ("gyro", gyro), ("commands", commands)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "trial", trial)
        if not count:
            raise InvalidArgumentError("time must have at least one row; it has none")
        _check_time(time, self.blocks, trial)
        rates = f"at most {FASTEST:g} rad/s, which no such fish exceeds (not degrees/s)"
        _refuse(np.abs(gyro) > FASTEST, gyro, GYRO, rates)
        outside = (commands < COMMAND_LOW) | (commands > COMMAND_HIGH)
        _refuse(outside, commands, SERVOS, "in [-0.5, 0.5] rev/s, caudal in [0, 1] Hz")

    @classmethod
    def of_trials(
        cls, commands: Sequence[ArrayLike], logs: Sequence[Log], moving: bool = False
    ) -> SwimLog:
        """Return the log of trials sampled every 0.01 s, as simulated ones are.

        Parameters
        ----------
        commands
            For each trial the command that it holds, (3,) in rev/s, rev/s and Hz, or a command
            for each sample, (T, 3), executed in the 0.01 s before it.
        logs
            As many logs with ``gyro`` (T, 3) or (1, T, 3), rad/s.
        moving
            Whether the trials begin in mid-swim; otherwise a row at rest precedes the samples.

        Raises
        ------
        TargetError, InvalidArgumentError
            If commands and logs are not equally many or long, or one is no log of this fish.
        """
        if not len(commands) == len(logs) > 0:
            raise InvalidArgumentError(
                "commands and logs must be equally many, and at least one; "
                f"got {len(commands)} and {len(logs)}"
            )
        time, gyro, executed = [], [], []
        for number, (command, log) in enumerate(zip(commands, logs, strict=True), 1):
            samples = gyro_samples(log, axes=3, source=f"trial {number}")[0]
            each = check_commands(command, f"commands of trial {number}")
            if len(each) == 1:
                each = np.repeat(each, len(samples), axis=0)
            if len(each) != len(samples):
                raise InvalidArgumentError(
                    f"commands of trial {number} must be one, or one for each of its "
                    f"{len(samples)} samples; got {len(each)}"
                )
            # Rounded to what people write.
            time.append(np.round(TIMESTEP * np.arange(len(samples) + 1), 9)[moving:])
            gyro.append(np.concatenate([np.zeros((1, 3)), samples])[moving:])
            executed.append(np.concatenate([each, each[-1:]])[moving:])
        return cls(
            np.concatenate(time),
            np.concatenate(gyro),
            np.concatenate(executed),
            np.repeat(np.arange(1, len(logs) + 1), list(map(len, time))),
        )

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
        """Return the name of a trial, counted from 0, by its own number."""
        return f"trial {self.trial[self.blocks[index].start]}"


def _rows(
    argument: str, value: ArrayLike, shape: tuple[int | None, ...], columns: Sequence[str]
) -> Floats:
    """Return a signal as a read-only array; the row and column of a NaN are named."""
    array = np.asarray(value)
    if array.dtype.kind == "f" and fits(array.shape, shape):
        _refuse(~np.isfinite(array), array, columns, "finite")
    found = finite_array(argument, value, shape)
    found.setflags(write=False)
    return found


def _refuse(wrong: NDArray[np.bool_], values: Floats, columns: Sequence[str], wanted: str) -> None:
    """Raise an InvalidArgumentError for the first wrong entry (T,) or (T, columns)."""
    where = np.argwhere(wrong)
    if len(where):
        place = tuple(where[0].tolist())
        name = f"row {place[0] + 1}: {columns[place[-1] if len(place) > 1 else 0]}"
        raise InvalidArgumentError(f"{name} must be {wanted}; got {values[place]:g}")


def _trial_numbers(trial: ArrayLike, count: int) -> NDArray[np.int64]:
    if not np.size(trial):
        return np.ones(count, dtype=np.int64)
    given = finite_array("trial", trial, (count,))
    numbers = given.astype(np.int64)
    _refuse(given != numbers, given, ("trial",), "a whole number")
    begins = np.flatnonzero(np.diff(numbers, prepend=numbers[:1] - 1))
    first = {number: row for row, number in zip(begins[::-1], numbers[begins[::-1]], strict=True)}
    again = np.array([first[number] for number in numbers[begins]]) != begins
    _refuse(np.isin(np.arange(count), begins[again]), given, ("trial",), "in blocks of rows")
    return numbers


def _check_time(time: Floats, blocks: Sequence[slice], trial: NDArray[np.int64]) -> None:
    for rows in blocks:
        name, steps = f"trial {trial[rows.start]}", np.diff(time[rows])
        if len(steps) < FEWEST:
            raise InvalidArgumentError(
                f"{name} must have at least {FEWEST + 1} rows; it has {len(steps) + 1}"
            )
        typical = float(np.median(steps))
        if typical > 1.0 / SLOWEST:
            raise InvalidArgumentError(
                f"{name} must have at least {SLOWEST:g} rows a second, with time in s; it has one "
                f"in {typical:g} s"
            )
        wrong = np.zeros(len(time), dtype=np.bool_)
        wrong[rows.start + 1 : rows.stop] = (steps <= 0.0) | (steps > MOST_GAP)
        wanted = f"later than the row before within {name}, by at most {MOST_GAP:g} s"
        _refuse(wrong, time, ("time",), wanted)
