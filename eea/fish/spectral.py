"""The fish's behaviours compared where they are simulated: only the answers leave the engine.

A trial's Fourier transform costs numpy about as much as the compiled engine needs for the whole
trial, and comparing it half as much again. Here both happen in the engine's lanes, to the same
result but for single precision's rounding (tests/eea/test_spectral.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.command import check_commands
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.engines.compiled.spectrum import (
    coefficients,
    disagreements,
    distances,
    pack_spectra,
)
from aquafish_gym.scenario import Scenario
from eea.core.angles import Floats
from eea.core.behavior import DEGREES, Coefficients
from eea.core.experiment import Trials

if TYPE_CHECKING:
    from eea.fish.simulator import EngineSimulator

SHORTEST = 4  # steps of a trial that the engine transforms


@dataclass(frozen=True)
class SpectralComparer:
    """An ``eea.core.experiment.Comparer`` in the compiled engine."""

    simulator: EngineSimulator  #: Whose trials these are.

    def to_observed(
        self, trials: Trials, observed: Coefficients, which: NDArray[np.intp]
    ) -> Floats:
        """See ``Comparer``."""
        spectra = self._spectra(trials)
        packed = pack_spectra(observed, spectra.dtype.type)
        return distances(spectra, packed, which) / coefficients(self.simulator.steps)

    def between_models(self, trials: Trials, models: int) -> Floats:
        """See ``Comparer``."""
        return disagreements(self._spectra(trials), models) / coefficients(self.simulator.steps)

    def _spectra(self, trials: Trials) -> NDArray[np.floating]:
        s = self.simulator
        scenario = Scenario.create(trials.models, fin_angles=trials.angles, current=s.current)
        lanes = LaneBatch(scenario, getattr(np, s.dtype), s.substeps, s.threads)
        return lanes.spectra(check_commands(trials.commands), s.steps, DEGREES, rates=True)
