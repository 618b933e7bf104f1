"""Changes of a log that undo possible mistakes of a logger."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations, product
from typing import Any

import numpy as np

from aquafish_gym.plans import BodyPlan, FinPlan
from eea.core.angles import Floats
from eea.fish.swim_log import SwimLog

PACES = tuple(1.1**power for power in range(-7, 8) if power)  # 0.51 to 1.95
DELAYS = (-0.4, -0.2, 0.05, 0.1, 0.2)  # s; the inferred lag covers 0.2 s before each delay
DEGREE = np.pi / 180.0
AXES = ("x", "y", "z")
MIRRORED = ("x", "-y", "-z")  # signs of the rates of a fish mirrored across x
UPSIDE_DOWN = ("-x", "-y", "z")  # and across z
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
    #: The words of two fins for each pair whose commands are exchanged.
    exchanged: tuple[tuple[str, str], ...] = ()
    pace: float = 1.0  #: Divisor of the times.
    rows: int = 0  #: Rows by which the gyroscope's readings are moved to later times.
    delay: float = 0.0  #: The same delay in s.
    factor: float = 1.0  #: Factor on the rates.
    #: Constant that is subtracted from the rates, rad/s.
    constant: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moving: bool = False  #: Whether trials begin in mid-swim although the caller says at rest.
    same: str = ""  #: Another change that does the same to a symmetric fish, in words.

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
        if self.exchanged:
            pairs = " and ".join(map(_both, self.exchanged))
            said.append(f"the commands of the {pairs} exchanged")
        if self.same:
            said[-1] += f" (or {self.same}: the fish is symmetric)"
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
        words = list(log.plan.words.values())
        places = list(range(len(words)))
        for one, other in self.exchanged:
            places[words.index(one)] = words.index(other)
            places[words.index(other)] = words.index(one)
        commands = log.commands[:, places]
        if not self.rows:
            return SwimLog(log.time / self.pace, gyro, commands, log.trial, plan=log.plan)
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
        time = log.time[at] / self.pace
        return SwimLog(time, gyro[taken], commands[at], log.trial[at], plan=log.plan)


def possible_changes(log: SwimLog, moving: bool) -> Iterator[LogChange]:
    """Yield all changes that are tried."""
    plan = log.plan
    mirrored = is_mirror_image(plan, 0)
    turns = any(fin.turns for fin in plan.fins)
    flat = is_mirror_image(plan, 2)
    for order, signs in product(permutations(AXES), product(("", "-"), repeat=3)):
        x, y, z = (f"{sign}{axis}" for sign, axis in zip(signs, order, strict=True))
        axes = (x, y, z)
        if axes == AXES or (axes == MIRRORED and mirrored):
            continue
        if axes == UPSIDE_DOWN and flat:
            if turns:
                yield LogChange(axes, same="those of the commands of all fins that turn")
            continue
        yield LogChange(axes)
    words = [fin.word for fin in plan.fins]
    pairs = [(words[both[0]], words[both[1]]) for both in plan.groups if len(both) > 1]
    if len(pairs) > 1:
        yield from (LogChange(exchanged=(pair,)) for pair in pairs)
    if pairs:
        same = "the signs of the gyroscope's y and z changed" if mirrored else ""
        yield LogChange(exchanged=tuple(pairs), same=same)
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


def is_mirror_image(plan: BodyPlan, axis: int) -> bool:
    """Return whether a plan is its own mirror image across the body's axis 0 (x) or 2 (z).

    Across x fins turn the same way as their images, across z those that turn do the other way.
    Sweeps are symmetric.
    """
    sign = np.ones(3)
    sign[axis] = -1.0
    turned = sign if axis == 2 else -sign
    own = {_placed(fin, np.ones(3), np.ones(3)) for fin in plan.fins}
    return own == {_placed(fin, sign, turned) for fin in plan.fins}


def _placed(fin: FinPlan, sign: Floats, turned: Floats) -> tuple[Any, ...]:
    """Return what a mirrored fin is, with its place and axis; + 0.0 leaves no -0.0."""
    axis = tuple((turned * fin.axis + 0.0).tolist())
    if not fin.turns:
        axis = max(axis, tuple((0.0 - turned * fin.axis).tolist()))
    ends = ((sign * end + 0.0).tolist() for end in (fin.hinge, fin.direction))
    return (fin.drive, fin.speed, fin.sweep, fin.largest, axis, *map(tuple, ends))


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
        return f"{noun} of {_listed(turned)} of the gyroscope changed"
    if not turned and len(moved) == 2:
        return f"{_listed(moved)} of the gyroscope exchanged"
    words = f"x, y and z of the gyroscope taken from the log's {_listed(axes)}"
    return f"{words}, as in ROS" if axes == ("-y", "x", "z") else words


def _both(words: tuple[str, str]) -> str:
    """Return two fins in words, with what both have at the end once.

    Examples
    --------
    >>> _both(("left flipper", "right flipper")), _both(("keel", "tail"))
    ('left and right flipper', 'keel and tail')
    """
    first, other = words
    begin, _, last = first.rpartition(" ")
    return f"{begin if begin and other.endswith(f' {last}') else first} and {other}"


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
