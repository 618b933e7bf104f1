"""Observed trials, which may differ in length, rate and noise.

Trials are rows of one array. Trials that are shorter than the longest are padded, and the padding
has no weight.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from eea.core.angles import Floats

# of the mean distance of two samples: readings within it of even times count as even
EVEN_TIME_SHARE = 0.5


class SlowBasis(NamedTuple):
    """A basis in which slow errors of one trial are independent."""

    #: (T,), variances of the coefficients, for errors correlated by exp(-|t - t'| / d).
    variances: Floats
    vectors: Floats | None  #: (T, T), its columns are the basis; None for the cosine transform.

    def transform(self, signals: Floats, axes: int) -> Floats:
        """Return the coefficients (n, axes, T) of signals (n, axes times at least T)."""
        own = signals.reshape(len(signals), axes, -1)[:, :, : len(self.variances)]
        if self.vectors is not None:
            return np.asarray(own @ self.vectors)
        return np.asarray(dct(own, axis=-1, norm="ortho"))


@dataclass(frozen=True, eq=False)
class Observed:
    """E trials of the robot."""

    commands: NDArray[Any]  #: Commands (E, c), or another array of E rows that ``Simulate`` takes.
    signal: Floats  #: (E, T, axes), rad/s.
    #: (E, T), factors that give all samples the noise of one reading; 0 after a trial's end. None
    #: for 1.
    weight: Floats | None = None
    #: (E, T), times of the samples in the unit of a discrepancy's duration; None for 1, 2, ...
    time: Floats | None = None
    _bases: dict[tuple[int, float], SlowBasis] = field(default_factory=dict, init=False, repr=False)

    def __len__(self) -> int:
        return len(self.commands)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """The number of samples of each trial."""
        if self.weight is None:
            return (self.signal.shape[1],) * len(self.signal)
        return tuple((self.weight > 0.0).sum(axis=1).tolist())

    @property
    def size(self) -> int:
        """The number of samples of all trials and axes."""
        return int(sum(self.counts) * self.signal.shape[2])

    def sampled(self, trials: Iterable[int], stride: int) -> int:
        """Return the number of samples in some trials and all axes if every n-th is taken."""
        return int(sum(-(-self.counts[e] // stride) for e in trials) * self.signal.shape[2])

    @cached_property
    def weighted(self) -> Floats:
        """The signal (E, T, axes) times the weights."""
        return self.signal if self.weight is None else self.signal * self.weight[:, :, None]

    def simulated(self, residuals: Iterable[Floats]) -> list[Floats]:
        """Return the simulated signals (T, axes) of trials, given weighted residuals (T, axes)."""
        found = []
        for e, left in enumerate(residuals):
            own = slice(self.counts[e])
            apart = left if self.weight is None else left / self.weight[e, own, None]
            found.append(self.signal[e, own] + apart)
        return found

    def slow_basis(self, trial: int, duration: float) -> SlowBasis:
        """Return the basis for errors of a trial that are correlated by exp(-|t - t'| / duration).

        For evenly sampled errors it is nearly the cosine transform.
        """
        key = trial, duration
        if key not in self._bases:
            self._bases[key] = self._slow_basis(trial, duration)
        return self._bases[key]

    def _slow_basis(self, trial: int, duration: float) -> SlowBasis:
        count = self.counts[trial]
        weight = np.ones(count) if self.weight is None else self.weight[trial, :count]
        time = np.arange(count, dtype=float) if self.time is None else self.time[trial, :count]
        pace = float(np.diff(time).mean())
        uneven = np.abs(time - time[0] - pace * np.arange(count)).max() > EVEN_TIME_SHARE * pace
        if not uneven and np.ptp(weight) == 0.0:
            return SlowBasis(weight[0] ** 2 * spectrum(count, duration / pace), None)
        covariance = np.exp(-np.abs(time[:, None] - time) / duration) * np.outer(weight, weight)
        variances, vectors = np.linalg.eigh(covariance)
        return SlowBasis(np.maximum(variances, 0.0), vectors)


def spectrum(samples: int, duration: float) -> Floats:
    """Return the variances (T,) of the cosine transform of noise with exp(-t / duration).

    Examples
    --------
    >>> spectrum(4, 1e-3).round(6)
    array([1., 1., 1., 1.])
    """
    kept = np.exp(-1.0 / duration)
    angle = np.pi * np.arange(samples) / samples
    variances: Floats = (1.0 - kept**2) / (1.0 - 2.0 * kept * np.cos(angle) + kept**2)
    return variances
