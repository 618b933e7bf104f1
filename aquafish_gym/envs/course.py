"""How damage goes on through an episode, and what a broken sensor says."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage import CHANNELS, Damage, Effect, Fault
from aquafish_gym.morphology import Morphology

Floats = NDArray[np.float64]
Said = NDArray[np.floating]
Rows = NDArray[np.intp]
NEVER = 2**62
GYRO = slice(CHANNELS.index("gyro_x"), len(CHANNELS))


@dataclass(frozen=True)
class Course:
    """What a robot is in each of an episode's steps.

    Attributes
    ----------
    effects
        What it is in turn, from the step of that index in ``begins`` on.
    begins
        The first is 0.

    Examples
    --------
    >>> damage = Damage.parse("caudal:missing@4+2")
    >>> course_of(damage, Morphology.nominal(), 0.05).begins
    (0, 80, 120)
    """

    effects: tuple[Effect, ...]
    begins: tuple[int, ...]

    def at(self, step: int) -> Effect:
        """Return what the robot is in a step."""
        return self.effects[bisect_right(self.begins, step) - 1]

    def next(self, step: int) -> int:
        """Return the first step after this one in which it is something else."""
        after = bisect_right(self.begins, step)
        return self.begins[after] if after < len(self.begins) else NEVER


@lru_cache(maxsize=128)
def course_of(damage: Damage, morphology: Morphology, dt: float) -> Course:
    """Return the course of a damage that leaves nothing to chance, in steps of ``dt`` seconds.

    A step is broken if it begins at a fault's onset or later, and each fault breaks one at least.
    Raises as ``Damage.effect``.
    """
    spans = [_steps(fault, dt) for fault in damage]
    always = [replace(fault, onset=0.0, duration=None) for fault in damage]
    begins = sorted({0, *(step for span in spans for step in span if step < NEVER)})
    found = [
        Damage(tuple(f for f, (a, b) in zip(always, spans, strict=True) if a <= step < b))
        for step in begins
    ]
    return Course(tuple(broken.effect(morphology) for broken in found), tuple(begins))


def _steps(fault: Fault, dt: float) -> tuple[int, int]:
    """Return the first step that a fault breaks, and the first one after it."""
    onset, end = fault.span
    first = math.ceil(onset / dt - 1e-9)  # rounding makes no step of its own
    return first, NEVER if math.isinf(end) else max(first + 1, math.ceil(end / dt - 1e-9))


class Sensors:
    """The sensors of B robots, that may say something else than what is.

    ``broken`` is whether any of them ever did; where none did, nothing is computed. They say
    numbers of type ``dtype``.
    """

    def __init__(self, count: int, dtype: type[np.floating] = np.float32) -> None:
        channels = (count, len(CHANNELS))
        self.broken = False
        self._noise: Floats = np.zeros(count)
        self._biases = np.zeros(channels, dtype)
        self._stuck, self._dropped = np.zeros(channels, np.bool_), np.zeros(channels, np.bool_)
        self._fresh = np.zeros(channels, np.bool_)  # stuck from the next observation on
        self._held = np.zeros(channels, dtype)

    def become(self, robots: list[int], effect: Effect) -> None:
        """Have robots' sensors be as an effect says, from their next observations on."""
        sensor = (effect.noise, effect.biases, effect.stuck, effect.dropped)
        if not self.broken and not any(np.any(part) for part in sensor):
            return
        self.broken = True
        self._fresh[robots] = np.array(effect.stuck) & ~self._stuck[robots]
        rows: tuple[NDArray[Any], ...] = (self._noise, self._biases, self._stuck, self._dropped)
        for row, value in zip(rows, sensor, strict=True):
            row[robots] = value

    def reset(self, robots: list[int]) -> None:
        """Forget what these robots' sensors said: an episode begins."""
        self._stuck[robots] = False

    def say(
        self, truth: Said, limits: Floats, rngs: Sequence[np.random.Generator], rows: Rows
    ) -> Said:
        """Return what the sensors of the robots ``rows`` say, observations (n, k).

        They begin with ``CHANNELS``, and are ``truth`` where nothing is broken; ``rngs`` are of all
        B robots.
        """
        said = truth.copy()
        felt = said[:, : len(CHANNELS)]  # a view
        felt += self._biases[rows]
        for i, robot in enumerate(rows.tolist()):
            if self._noise[robot]:
                felt[i, GYRO] += rngs[robot].normal(0.0, self._noise[robot], 3)
        np.clip(said, -limits, limits, out=said)
        self._held[rows] = np.where(self._fresh[rows], felt, self._held[rows])
        self._fresh[rows] = False
        np.copyto(felt, self._held[rows], where=self._stuck[rows])
        felt[self._dropped[rows]] = 0.0
        return said
