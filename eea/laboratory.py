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
    """

    def __init__(self, simulator: Simulator, behavior: BehaviorConfig) -> None:
        self._simulator = simulator
        self.behavior: BehaviorConfig = behavior
        self.trials: int = 0

    def behaviors(self, morphologies: Floats, commands: Floats, fin_angles: Floats) -> Coefficients:
        """Return the behaviours (B, F) of bodies (B, n) under commands (B, 3) from angles (B, 3).

        A robot that left the finite numbers has coefficients that are not finite.

        Raises
        ------
        TargetError
            If the simulator returns another number of logs.
        """
        trials = Trials(morphologies, commands, fin_angles)
        with np.errstate(invalid="ignore", over="ignore"):
            coefficients = summarize(self._simulator.simulate(trials), self.behavior)
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

        Raises
        ------
        TargetError
            If target and simulator log different numbers of steps.
        """
        simulated = self.behaviors(morphologies, commands, fin_angles)
        if simulated.shape[-1] != observed.shape[-1]:
            raise TargetError(
                "the target and the simulator must log the same number of steps; their behaviours "
                f"have {observed.shape[-1]} and {simulated.shape[-1]} coefficients"
            )
        with np.errstate(invalid="ignore", over="ignore"):
            sim = similarity(simulated, observed, self.behavior)
        return np.where(np.isfinite(sim), sim, DIVERGED)
