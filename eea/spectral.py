"""The fish's behaviours compared where they are simulated: only the answers leave the engine.

A trial's Fourier transform costs numpy about as much as the compiled engine needs for the whole
trial, and comparing it half as much again. Here both happen in the engine's lanes, to the same
result but for single precision's rounding (tests/eea/test_spectral.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.lanes import LaneBatch
from aquafish_gym.engines.spectrum import coefficients, disagreements, distances, pack_spectra
from eea.behavior import BehaviorConfig, Coefficients
from eea.experiment import Floats, Trials

SHORTEST = 4  # steps of a trial that the engine transforms


def can_compare(behavior: BehaviorConfig, steps: int) -> bool:
    """Return whether the engine knows this behaviour: the plain transform of the attitude."""
    plain = behavior.summary == "dft" and behavior.signal == "attitude"
    return plain and behavior.difference == "complex" and not behavior.clamp and steps >= SHORTEST


@dataclass(frozen=True)
class SpectralComparer:
    """An ``eea.laboratory.Comparer`` in the compiled engine.

    Attributes
    ----------
    behavior
        One for which :func:`can_compare`.
    steps
        Length of a trial, a power of two.
    current, dtype, substeps, threads
        As ``aquafish_gym.simulate``.
    """

    behavior: BehaviorConfig
    steps: int
    current: tuple[float, float, float]
    dtype: str
    substeps: int
    threads: int | None

    def to_observed(
        self, trials: Trials, observed: Coefficients, which: NDArray[np.intp]
    ) -> Floats:
        """Return the mean difference (B,) of coefficients from ``observed[which]``."""
        spectra = self._spectra(trials)
        packed = pack_spectra(observed, spectra.dtype.type)
        return distances(spectra, packed, which) / coefficients(self.steps)

    def between_models(self, trials: Trials, models: int) -> Floats:
        """Return, for each run of ``models`` trials, the sum over its pairs of that mean, (A,)."""
        return disagreements(self._spectra(trials), models) / coefficients(self.steps)

    def _spectra(self, trials: Trials) -> NDArray[np.floating]:
        lanes = LaneBatch(
            trials.morphologies, trials.fin_angles, self.current, getattr(np, self.dtype),
            self.substeps, self.threads,
        )  # fmt: skip
        scale = 180.0 / np.pi if self.behavior.unit == "degrees" else 1.0
        if self.behavior.normalised:
            scale /= self.steps
        return lanes.spectra(trials.commands, self.steps, scale)
