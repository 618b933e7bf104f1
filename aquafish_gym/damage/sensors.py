"""The observations of broken sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.scenario import CHANNELS, Scenario

Floats = NDArray[np.float64]
Observations = NDArray[np.floating]
Rows = NDArray[np.intp]
GYRO = slice(CHANNELS.index("gyro_x"), len(CHANNELS))


class Sensors:
    """The sensors of B robots, which may observe something else than the truth.

    ``broken`` is whether any of them ever did; where none did, nothing is computed. They observe
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

    def update(self, rows: Rows, scenario: Scenario) -> None:
        """Set the sensors of robots ``rows`` (n,) from a scenario of n, for later observations."""
        noise, bias = scenario.gyro_noise, scenario.sensor_bias
        stuck, dropped = scenario.sensor_stuck, scenario.sensor_dropped
        if not self.broken and not (noise.any() or bias.any() or stuck.any() or dropped.any()):
            return
        self.broken = True
        self._fresh[rows] = stuck & ~self._stuck[rows]
        self._noise[rows] = noise
        self._biases[rows] = bias
        self._stuck[rows] = stuck
        self._dropped[rows] = dropped

    def reset(self, rows: Rows) -> None:
        """Forget the observations of these robots: an episode begins."""
        self._stuck[rows] = False

    def observe(
        self, truth: Observations, limits: Floats, rngs: Sequence[np.random.Generator], rows: Rows
    ) -> Observations:
        """Return the observations (n, k) of the robots ``rows``, which begin with ``CHANNELS``.

        ``truth`` is what whole sensors would observe; ``rngs`` are of all B robots.
        """
        observed = truth.copy()
        felt = observed[:, : len(CHANNELS)]  # a view
        felt += self._biases[rows]
        for i, robot in enumerate(rows.tolist()):
            if self._noise[robot]:
                felt[i, GYRO] += rngs[robot].normal(0.0, self._noise[robot], 3)
        np.clip(observed, -limits, limits, out=observed)
        self._held[rows] = np.where(self._fresh[rows], felt, self._held[rows])
        self._fresh[rows] = False
        np.copyto(felt, self._held[rows], where=self._stuck[rows])
        felt[self._dropped[rows]] = 0.0
        return observed
