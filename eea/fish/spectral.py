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
)
from aquafish_gym.engines.worlds import batch_class
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
    engine: str

    def to_observed(
        self, trials: Trials, observed: Coefficients, which: NDArray[np.intp]
    ) -> Floats:
        """See ``Comparer``."""
        packed = pack_spectra(observed, getattr(np, self.dtype))
        lanes, commands = self._lanes(trials)
        found = lanes.distances(commands, self.steps, DEGREES, packed, which)
        return found / coefficients(self.steps)

    def between_models(self, trials: Trials, models: int) -> Floats:
        """See ``Comparer``."""
        lanes, commands = self._lanes(trials)
        spectra = lanes.spectra(commands, self.steps, DEGREES)
        return disagreements(spectra, models) / coefficients(self.steps)

    def _lanes(self, trials: Trials) -> tuple[LaneBatch, Floats]:
        """Return the robots of trials, at rest, and their commands."""
        scenario = Scenario.create(
            trials.models,
            fin_angles=trials.angles,
            current=self.current,
            reactive=self.reactive,
            plan=self.plan,
        )
        kind = getattr(np, self.dtype)
        lanes = batch_class(self.engine)(scenario, kind, self.substeps, self.threads)
        return lanes, check_commands(self.plan, trials.commands)
