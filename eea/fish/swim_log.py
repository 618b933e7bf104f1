"""A swim that was recorded: when, what the gyroscope said, and what the servos were told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW, SERVOS, check_commands
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer
from eea.core.angles import Floats
from eea.core.behavior import Log, gyro_samples
from eea.core.experiment import RecordedLog
from eea.core.replay import ReplayTarget

GYRO = ("gyro_x", "gyro_y", "gyro_z")
COLUMNS = ("time", *GYRO, *SERVOS)  # of a table; "trial" may follow
UNITS = ("rev/s", "rev/s", "Hz")
FASTEST = 10.0  # rad/s: of 20,000 random bodies at full speed none turns faster than 4.3
SLOWEST = 20.0  # samples a second: a tail at 1 Hz beats 20 times
MOST_GAP = 0.2  # s: what was commanded meanwhile is anybody's guess
FEWEST = 32  # samples of a trial


@dataclass(frozen=True, eq=False)
class SwimLog:
    """A recorded swim, of one trial or several.

    The gyroscope's sample of a row is what it said at the row's time; the row's command is what
    the servos did from then until the next row. A trial begins at its first row. A robot that
    ``aquafish_gym.simulate`` simulates for T steps of 0.01 s therefore has T + 1 rows: the first,
    at rest, with the first command, and one after each step.

    Raises
    ------
    InvalidArgumentError
        If something is not as stated below; it names the row, from 1, and the column. Trials of
        fewer than 32 rows are refused, fewer than 20 rows a second, gaps of more than 0.2 s, and
        rates that no such fish reaches, of which most are in degrees/s.

    Examples
    --------
    >>> log = SwimLog(0.01 * np.arange(65), np.zeros((65, 3)), np.full((65, 3), 0.4))
    >>> len(log), log.seconds
    (1, (0.64,))
    """

    time: Floats  #: (T,) in s; it grows within a trial.
    gyro: Floats  #: (T, 3) in rad/s about the body's axes: x right, y forward, z up.
    #: (T, 3): left and right flipper in rev/s, tail in Hz; what they did rather than were told.
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
            raise InvalidArgumentError("there must be rows; there is none")
        _check_time(time, self.blocks, trial)
        _check_rates(gyro)
        _check_servos(commands)

    @classmethod
    def of_trials(
        cls, commands: Sequence[ArrayLike], logs: Sequence[Log], moving: bool = False
    ) -> SwimLog:
        """Return the log of trials that were sampled each 0.01 s, as simulated ones are.

        Parameters
        ----------
        commands
            Of each trial the one that it holds, (3,) in rev/s, rev/s and Hz, or those (T, 3) in
            force in the 0.01 s that end with its samples.
        logs
            As many, with ``gyro`` (T, 3), as ``estimate_from_logs`` takes them; a swim of
            ``gait.swim`` is one.
        moving
            Whether the trials begin in mid-swim, a trial's first row being its first sample;
            else it is the rest from which it began.

        Raises
        ------
        ConfigurationError, TargetError, InvalidArgumentError
            If commands and logs are not equally many or long, or one is no log of this fish.
        """
        ReplayTarget(np.zeros((len(commands), 3)), logs)  # refuses what is not equally many
        time, gyro, told = [], [], []
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
            time.append(_ends(len(samples) + 1)[moving:])
            gyro.append(np.concatenate([np.zeros((1, 3)), samples])[moving:])
            told.append(np.concatenate([each, each[-1:]])[moving:])
        return cls(
            np.concatenate(time),
            np.concatenate(gyro),
            np.concatenate(told),
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
        """How long each trial lasts."""
        return tuple(float(np.ptp(self.time[rows])) for rows in self.blocks)

    def name(self, index: int) -> str:
        """Return what a trial, from 0, is called: by its own number."""
        return f"trial {self.trial[self.blocks[index].start]}"

    def trials(self, steps: int) -> tuple[Floats, list[RecordedLog]]:
        """Return commands (E, 3) and logs of ``steps`` samples of 0.01 s, for any condition.

        The gyroscope's samples are interpolated linearly where they were not taken each 0.01 s,
        which makes the noise of neighbours alike: ``infer_log`` looks at the log as it is.

        Raises
        ------
        InvalidArgumentError
            If a trial is shorter, or its command changes.
        """
        ends = _ends(integer("steps", steps, 2) + 1)[1:]
        held, logs = [], []
        for index, rows in enumerate(self.blocks):
            time, told = self.time[rows] - self.time[rows.start], self.commands[rows]
            if time[-1] < ends[-1] - 0.5 * TIMESTEP:
                raise InvalidArgumentError(
                    f"steps must be at most {round(time[-1] / TIMESTEP)}, as many as "
                    f"{self.name(index)} has; got {steps}"
                )
            if (told[:-1] != told[0]).any():
                raise InvalidArgumentError(
                    f"{self.name(index)} must hold one command; it changes, which only joint "
                    "inference follows: infer_log"
                )
            felt = np.stack([np.interp(ends, time, axis) for axis in self.gyro[rows].T], axis=1)
            held.append(told[0])
            logs.append(RecordedLog(gyro=felt))
        return np.array(held), logs


def _ends(count: int) -> Floats:
    """Return when steps end (count,), in s, from 0: as people write them, 0.07 rather than more."""
    return np.round(TIMESTEP * np.arange(count), 9)


def _rows(
    argument: str, value: ArrayLike, shape: tuple[int | None, ...], columns: Sequence[str]
) -> Floats:
    """Return a signal as an array that may be written to by nobody; its first NaN is named."""
    array = np.asarray(value)
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        row = int(np.argwhere(~np.isfinite(array))[0][0])
        column = int(np.argwhere(~np.isfinite(array))[0][1]) if array.ndim > 1 else 0
        name = columns[column] if column < len(columns) else f"column {column + 1}"
        raise InvalidArgumentError(
            f"row {row + 1}: {name} is {array.reshape(len(array), -1)[row, column]}, and must be "
            "a finite number; leave such rows away"
        )
    found = finite_array(argument, value, shape)
    found.setflags(write=False)
    return found


def _trial_numbers(trial: ArrayLike, count: int) -> NDArray[np.int64]:
    if not np.size(trial):
        return np.ones(count, dtype=np.int64)
    given = finite_array("trial", trial, (count,))
    numbers = given.astype(np.int64)
    broken = np.flatnonzero(given != numbers)
    if len(broken):
        raise InvalidArgumentError(
            f"row {broken[0] + 1}: trial must be a whole number; got {given[broken[0]]:g}"
        )
    begins = np.flatnonzero(np.diff(numbers, prepend=numbers[:1] - 1))
    seen: set[int] = set()
    for row in begins.tolist():
        if int(numbers[row]) in seen:
            raise InvalidArgumentError(
                f"row {row + 1}: trial {numbers[row]} begins again after it had ended; "
                "the rows of a trial must follow one another"
            )
        seen.add(int(numbers[row]))
    return numbers


def _check_time(time: Floats, blocks: Sequence[slice], trial: NDArray[np.int64]) -> None:
    for rows in blocks:
        name, steps = f"trial {trial[rows.start]}", np.diff(time[rows])
        if len(steps) < FEWEST:
            raise InvalidArgumentError(
                f"{name} must have at least {FEWEST + 1} rows; it has {len(steps) + 1}"
            )
        back = np.flatnonzero(steps <= 0.0)
        if len(back):
            row = rows.start + int(back[0]) + 1
            what = "stands still at" if time[row] == time[row - 1] else "goes back to"
            raise InvalidArgumentError(
                f"row {row + 1}: time {what} {time[row]:g} s within {name}; "
                "if another trial begins there, number the trials in a column trial"
            )
        typical = float(np.median(steps))
        if typical > 1.0 / SLOWEST:
            hint = "; is time in milliseconds? It must be in s" if typical >= 1.0 else ""
            raise InvalidArgumentError(
                f"{name} must have at least {SLOWEST:g} rows a second; it has one in "
                f"{typical:g} s{hint}"
            )
        gaps = np.flatnonzero(steps > MOST_GAP)
        if len(gaps):
            row = rows.start + int(gaps[0]) + 1
            raise InvalidArgumentError(
                f"row {row + 1}: there is a gap of {time[row] - time[row - 1]:.2g} s before it, "
                f"and at most {MOST_GAP:g} s are allowed within a trial; give what follows a "
                "trial's number of its own"
            )


def _check_rates(gyro: Floats) -> None:
    fast = np.argwhere(np.abs(gyro) > FASTEST)
    if len(fast):
        row, axis = fast[0].tolist()
        raise InvalidArgumentError(
            f"row {row + 1}: {GYRO[axis]} is {gyro[row, axis]:g} rad/s, and no such fish turns "
            f"faster than {FASTEST:g}; is this in degrees/s? Then multiply by pi / 180"
        )


def _check_servos(commands: Floats) -> None:
    outside = np.argwhere((commands < COMMAND_LOW) | (commands > COMMAND_HIGH))
    if len(outside):
        row, servo = outside[0].tolist()
        raise InvalidArgumentError(
            f"row {row + 1}: {SERVOS[servo]} must lie in [{COMMAND_LOW[servo]:g}, "
            f"{COMMAND_HIGH[servo]:g}] {UNITS[servo]}; got {commands[row, servo]:g}"
        )
