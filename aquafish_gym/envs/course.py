"""How damage goes on through an episode, and what a broken sensor says."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage import Damage
from aquafish_gym.faults import CHANNELS, Effect
from aquafish_gym.morphology import Morphology

Floats = NDArray[np.float64]
Observations = NDArray[np.float32]
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

    def at(self, step: int) -> Effect | None:
        """Return what the robot is from this step on, if that is not what it was before."""
        return dict(zip(self.begins, self.effects, strict=True)).get(step)


@lru_cache(maxsize=1024)
def course_of(damage: Damage, morphology: Morphology, dt: float) -> Course:
    """Return the course of a damage that leaves nothing to chance, in steps of ``dt`` seconds.

    A step is broken if it begins at a fault's onset or later. Raises as ``Damage.effect``.
    """
    # The last moment of those that come to the same step: rounding makes no step of its own.
    moments = {math.ceil(moment / dt - 1e-9): moment for moment in (0.0, *damage.moments)}
    found = [damage.at(moment).effect(morphology) for moment in moments.values()]
    return Course(tuple(found), tuple(moments))


class Sensors:
    """The sensors of B robots, that may say something else than what is.

    ``broken`` is whether any of them ever did; where none did, nothing is computed.
    """

    def __init__(self, count: int) -> None:
        channels = (count, len(CHANNELS))
        self.broken = False
        self._noise: Floats = np.zeros(count)
        self._biases = np.zeros(channels, np.float32)
        self._stuck, self._dropped = np.zeros(channels, np.bool_), np.zeros(channels, np.bool_)
        self._fresh = np.zeros(channels, np.bool_)  # stuck from the next observation on
        self._held = np.zeros(channels, np.float32)

    def become(self, robot: int, effect: Effect) -> None:
        """Have a robot's sensor be as an effect says, from its next observation on."""
        sensor = (effect.noise, effect.biases, effect.stuck, effect.dropped)
        if not self.broken and not any(np.any(part) for part in sensor):
            return
        self.broken = True
        stuck = np.array(effect.stuck)
        self._fresh[robot] = stuck & ~self._stuck[robot]
        self._noise[robot], self._biases[robot], self._stuck[robot], self._dropped[robot] = sensor

    def reset(self, robot: int) -> None:
        """Forget what a robot's sensor said: an episode begins."""
        self._stuck[robot] = False

    def say(
        self, truth: Observations, limits: Floats, rngs: list[np.random.Generator]
    ) -> Observations:
        """Return what B sensors say, observations (B, n) that begin with ``CHANNELS``."""
        said = truth.copy()
        felt = said[:, : len(CHANNELS)]  # a view
        felt += self._biases
        for robot in np.flatnonzero(self._noise).tolist():
            felt[robot, GYRO] += rngs[robot].normal(0.0, self._noise[robot], 3)
        np.clip(said, -limits, limits, out=said)
        np.copyto(self._held, felt, where=self._fresh)
        self._fresh[:] = False
        np.copyto(felt, self._held, where=self._stuck)
        felt[self._dropped] = 0.0
        return said
