"""Comparison of behaviours within the engine: only the distances leave it.

A trial's Fourier transform costs numpy about as much as the compiled engine needs for the whole
trial, and the comparison half as much again. In the engine's lanes both are nearly free, with the
same result up to single precision (tests/eea/test_target.py).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import check_commands
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.engines.compiled.spectrum import (
    coefficients,
    disagreements,
    pack_spectra,
    spectral_distances,
)
from aquafish_gym.plans import BodyPlan
from aquafish_gym.scenario import Scenario
from eea.core.angles import Floats
from eea.core.behavior import DEGREES, Coefficients
from eea.core.experiment import Trials

SHORTEST_SPECTRUM_STEPS = 4  # steps of a trial that the engine transforms


class SpectralComparer(NamedTuple):
    """An ``eea.core.experiment.Comparer`` in the compiled engine; see ``EngineSimulator``."""

    steps: int
    dtype: str
    current: ArrayLike
    substeps: int
    threads: int | None
    reactive: bool
    plan: BodyPlan

    def to_observed(
        self, trials: Trials, observed: Coefficients, which: NDArray[np.intp]
    ) -> Floats:
        """See ``Comparer``."""
        spectra = self._spectra(trials)
        packed = pack_spectra(observed, spectra.dtype.type)
        return spectral_distances(spectra, packed, which) / coefficients(self.steps)

    def between_models(self, trials: Trials, models: int) -> Floats:
        """See ``Comparer``."""
        return disagreements(self._spectra(trials), models) / coefficients(self.steps)

    def _spectra(self, trials: Trials) -> NDArray[np.floating]:
        scenario = Scenario.create(
            trials.models,
            fin_angles=trials.angles,
            current=self.current,
            reactive=self.reactive,
            plan=self.plan,
        )
        lanes = LaneBatch(scenario, getattr(np, self.dtype), self.substeps, self.threads)
        return lanes.spectra(check_commands(self.plan, trials.commands), self.steps, DEGREES)
