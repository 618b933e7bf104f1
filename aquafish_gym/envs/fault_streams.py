"""The random numbers of faults on NumPy: each robot's own, as if it were alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aquafish_gym.utils.array_types import Flags, Floats

# Children of a robot's seed: no stream of its environment, which the seed itself begins, and which
# may spawn its first children.
DAMAGE_STREAM = (7_051, 0)
NOISE_STREAM = (7_051, 1)
OBSERVATIONS = 64  # whose noise is drawn at once
LARGEST_BLOCK = 4096  # numbers


class FaultStreams:
    """The generators of B robots with C sensors.

    Two robots of the same seed draw the same, in whatever batch they are.
    """

    def __init__(self, count: int, sensors: int) -> None:
        self._damage: list[np.random.Generator | None] = [None] * count
        self._noise: list[np.random.Generator | None] = [None] * count
        self._seeds: list[int | None] = [None] * count
        self._sensors = sensors
        self._length = max(1, min(OBSERVATIONS, LARGEST_BLOCK // max(1, sensors)))
        self._used = np.full(count, self._length)  # of the block of each
        self._blocks: Floats | None = None  # (B, length, C)
        self._everyone = np.arange(count)

    def seed(self, seeds: Sequence[int | None]) -> None:
        """Begin the streams of the robots that have a seed."""
        for robot, seed in enumerate(seeds):
            if seed is not None:
                self._seeds[robot] = seed
                self._damage[robot] = self._noise[robot] = None
                self._used[robot] = self._length

    def damage(self, robot: int) -> np.random.Generator:
        """Return the generator of a robot's random damage."""
        return self._generator(self._damage, robot, DAMAGE_STREAM)

    def white(self, deviation: Floats, mask: Flags | None = None) -> Floats:
        """Return standard normal numbers (B, C) for an observation of the robots of a mask (B,).

        Those that have noise, of some ``deviation`` (B, C), take the next numbers of their own
        blocks, so that what a robot draws does not depend on those beside it.
        """
        observing = (deviation != 0.0).any(axis=1)
        if mask is not None:
            observing &= mask
        if self._blocks is None:
            self._blocks = np.zeros((len(self._everyone), self._length, self._sensors))
        empty = observing & (self._used == self._length)
        for robot in np.flatnonzero(empty).tolist():
            rng = self._generator(self._noise, robot, NOISE_STREAM)
            self._blocks[robot] = rng.standard_normal((self._length, self._sensors))
            self._used[robot] = 0
        found: Floats = self._blocks[self._everyone, self._used % self._length]
        self._used[observing] += 1
        return found

    def _generator(
        self, generators: list[np.random.Generator | None], robot: int, stream: tuple[int, int]
    ) -> np.random.Generator:
        rng = generators[robot]
        if rng is None:
            sequence = np.random.SeedSequence(self._seeds[robot], spawn_key=stream)
            rng = generators[robot] = np.random.default_rng(sequence)
        return rng
