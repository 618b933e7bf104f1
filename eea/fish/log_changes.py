"""Changes of a log that undo possible mistakes of a logger."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from eea.core.angles import Floats
from eea.fish.swim_log import SwimLog

PACES = tuple(1.1**power for power in range(-7, 8) if power)  # 0.51 to 1.95
DELAYS = (-0.4, -0.2, 0.05, 0.1, 0.2)  # s; the inferred lag covers 0.2 s before each delay
DEGREE = np.pi / 180.0
AXES = ("x", "y", "z")
MIRRORED = ("x", "-y", "-z")  # signs of the rates of a mirrored fish
LEAST_CONSTANT = 0.1  # rad/s; infer_log finds smaller constants as a bias


@dataclass(frozen=True, eq=False)
class LogChange:
    """One change of a log; the default changes nothing.

    Examples
    --------
    >>> LogChange(axes=("y", "x", "z")).words
    'x and y of the gyroscope exchanged'
    >>> LogChange(pace=1.2).words
    'time running 1.2 times as fast'
    """

    #: Axes of the log, such as "-y", that hold the rates about x, y and z.
    axes: tuple[str, str, str] = AXES
    flippers: bool = False  #: Whether the commands of the left and right flipper are exchanged.
    pace: float = 1.0  #: Divisor of the times.
    rows: int = 0  #: Rows by which the gyroscope's readings are moved to later times.
    delay: float = 0.0  #: The same delay in s.
    factor: float = 1.0  #: Factor on the rates.
    #: Constant that is subtracted from the rates, rad/s.
    constant: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moving: bool = False  #: Whether trials begin in mid-swim although the caller says at rest.

    @property
    def kind(self) -> str:
        """The kind of change, a key of ``DESCENDED``, for a fair share of the effort."""
        if self.axes != AXES:
            return "axes"
        if self.pace != 1.0:
            return "clock"
        return "delay" if self.rows else "other"

    @property
    def words(self) -> str:
        """The change in words, to follow "with"."""
        said = [_axes_in_words(self.axes)] if self.axes != AXES else []
        if self.flippers:
            said.append(
                "the commands of the left and right flipper exchanged (or the signs of the "
                "gyroscope's y and z changed: the fish is symmetric)"
            )
        if self.pace != 1.0:
            said.append(f"time running {round(self.pace, 2):g} times as fast")
        if self.rows:
            way = "later" if self.rows > 0 else "earlier"
            said.append(f"the gyroscope {1000.0 * abs(self.delay):.3g} ms {way}")
        if self.factor == DEGREE:
            said.append("the gyroscope read in degrees/s")
        elif self.factor != 1.0:
            said.append(f"the gyroscope's rates times {self.factor:.3g}")
        if any(self.constant):
            parts = [
                f"{value:.2g} rad/s from {axis}"
                for value, axis in zip(self.constant, AXES, strict=True)
                if abs(value) >= LEAST_CONSTANT / 2.0
            ]
            said.append(f"a constant taken from the gyroscope ({', '.join(parts)})")
        if self.moving:
            said.append("the swim begun in motion, not at rest (--start moving)")
        return " and ".join(said) or "no change"

    def apply(self, log: SwimLog, moving: bool = False) -> SwimLog:
        """Return the changed log.

        Parameters
        ----------
        log
            The log.
        moving
            Whether the caller says that its trials begin in mid-swim.

        Raises
        ------
        InvalidArgumentError
            If the change is impossible: trials are too short, or rates get too large.
        """
        order = [AXES.index(axis[-1]) for axis in self.axes]
        signs = [-1.0 if axis[0] == "-" else 1.0 for axis in self.axes]
        gyro = self.factor * np.array(signs) * log.gyro[:, order] - np.array(self.constant)
        commands = log.commands[:, [1, 0, 2]] if self.flippers else log.commands
        if not self.rows:
            return SwimLog(log.time / self.pace, gyro, commands, log.trial)
        read = []  # rows of the readings
        seen = []  # rows of the times at which they were taken
        for block in log.blocks:
            rows = np.arange(block.start, block.stop)
            late = max(self.rows, 0)
            if self.rows > 0 and not (moving or self.moving):  # the first row is the start at rest
                read.append(np.append(rows[0], rows[1 : len(rows) - late]))
                seen.append(np.append(rows[0], rows[1 + late :]))
            else:
                early = max(-self.rows, 0)
                read.append(rows[early : len(rows) - late])
                seen.append(rows[late : len(rows) - early])
        at = np.concatenate(seen)
        taken = np.concatenate(read)
        return SwimLog(log.time[at] / self.pace, gyro[taken], commands[at], log.trial[at])


def possible_changes(log: SwimLog, moving: bool) -> Iterator[LogChange]:
    """Yield all changes that are tried."""
    for order, signs in product(permutations(AXES), product(("", "-"), repeat=3)):
        x, y, z = (f"{sign}{axis}" for sign, axis in zip(signs, order, strict=True))
        if (x, y, z) not in (AXES, MIRRORED):
            yield LogChange(axes=(x, y, z))
    yield LogChange(flippers=True)
    yield from (LogChange(pace=pace) for pace in PACES)
    step = typical_step(log)
    counts = dict.fromkeys(round(delay / step) for delay in DELAYS)
    yield from (LogChange(rows=count, delay=count * step) for count in counts if count)
    yield from (LogChange(factor=factor) for factor in (DEGREE, 1.0 / DEGREE))
    for level in (log.gyro.mean(axis=0), log.gyro[0]):
        if np.abs(level).max() >= LEAST_CONSTANT:
            yield LogChange(constant=three(level))
    if not moving:
        yield LogChange(moving=True)


def typical_step(log: SwimLog) -> float:
    """Return the typical time between two rows, s."""
    return float(np.median([np.median(np.diff(log.time[rows])) for rows in log.blocks]))


def three(numbers: Floats) -> tuple[float, float, float]:
    """Return an array (3,) as a tuple."""
    x, y, z = numbers.tolist()
    return x, y, z


def _axes_in_words(axes: tuple[str, str, str]) -> str:
    """Return a signed permutation in words."""
    moved = [right for right, axis in zip(AXES, axes, strict=True) if axis[-1] != right]
    turned = [axis[-1] for axis in axes if axis[0] == "-"]
    if not moved:
        noun = "the sign" if len(turned) == 1 else "the signs"
        words = f"{noun} of {_listed(turned)} of the gyroscope changed"
        if turned == ["x", "y"]:  # the fish is symmetric
            words += " (or those of both flippers' commands: the fish is symmetric)"
        return words
    if not turned and len(moved) == 2:
        return f"{_listed(moved)} of the gyroscope exchanged"
    words = f"x, y and z of the gyroscope taken from the log's {_listed(axes)}"
    return f"{words}, as in ROS" if axes == ("-y", "x", "z") else words


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
