"""Where models are tried: the simulator and the behaviour summary together."""

from __future__ import annotations

import numpy as np

from eea.behavior import BehaviorConfig, Coefficients, similarity, summarize
from eea.checks import TargetError
from eea.experiment import Floats, Simulator, Trials

DIVERGED = -1e6  # far below any real similarity, and still a number that means can hold


class Laboratory:
    """Runs batches of models through the simulator and counts them.

    Parameters
    ----------
    simulator
        Runs the trials.
    behavior
        How logs are summarised and compared.
    steps
        How long every log must be.
    """

    def __init__(self, simulator: Simulator, behavior: BehaviorConfig, steps: int) -> None:
        self._simulator = simulator
        self.behavior: BehaviorConfig = behavior
        self.steps: int = steps
        self.trials: int = 0

    def behaviors(self, morphologies: Floats, commands: Floats, fin_angles: Floats) -> Coefficients:
        """Return the behaviours (B, F) of bodies (B, n) under commands (B, 3) from angles (B, 3).

        A robot that left the finite numbers has coefficients that are not finite.

        Raises
        ------
        TargetError
            If the simulator returns another number of logs, or logs another number of steps.
        """
        trials = Trials(morphologies, commands, fin_angles)
        with np.errstate(invalid="ignore", over="ignore"):
            log = self._simulator.simulate(trials)
            coefficients = summarize(log, self.behavior, self.steps, "the simulator")
        if len(coefficients) != len(trials):
            raise TargetError(
                f"the simulator must return a log for each of {len(trials)} trials; "
                f"it returned {len(coefficients)}"
            )
        self.trials += len(trials)
        return coefficients

    def similarities(
        self, morphologies: Floats, commands: Floats, fin_angles: Floats, observed: Coefficients
    ) -> Floats:
        """Return sim (B,) between those behaviours and observed ones, (F,) or (B, F).

        A robot that left the finite numbers is like nothing: its sim is ``DIVERGED``.
        """
        simulated = self.behaviors(morphologies, commands, fin_angles)
        with np.errstate(invalid="ignore", over="ignore"):
            sim = similarity(simulated, observed, self.behavior)
        finite = np.isfinite(sim)
        if self.behavior.clamp:  # which makes infinity a difference like any other
            finite &= np.isfinite(simulated).all(axis=-1)
        return np.where(finite, sim, DIVERGED)
