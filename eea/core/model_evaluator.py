"""Evaluation of models: simulate them and compare their behaviours (Eqs. 1 and 2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.behavior import Coefficients, likeness, similarity, summarize
from eea.core.checks import TargetError
from eea.core.experiment import Simulator, Trials
from eea.core.fitness import action_fitness, disagreement

DIVERGED_SIMILARITY = -1e6  # far below any other similarity, but finite, so that means stay finite


class ModelEvaluator:
    """Runs models through a simulator, whose logs have ``steps`` samples of ``axes`` axes."""

    def __init__(self, simulator: Simulator, steps: int, axes: int) -> None:
        for method in ("simulate", "comparer"):
            if not callable(getattr(simulator, method, None)):
                raise TargetError(
                    f"the simulator must have {method}; inherit from eea.Simulator and define "
                    f"simulate; {type(simulator).__name__} has none"
                )
        self._simulator = simulator
        self._comparer = simulator.comparer(steps)
        self.steps: int = steps
        self.axes: int = axes
        self.trials: int = 0  #: Number of trials simulated so far.

    def behaviors(self, trials: Trials) -> Coefficients:
        """Return the behaviours (B, F) of B trials; rows of diverged robots are not finite."""
        with np.errstate(invalid="ignore", over="ignore"):
            log = self._simulator.simulate(trials)
            coefficients = summarize(log, self.steps, self.axes, "the simulator")
        if len(coefficients) != len(trials):
            raise TargetError(
                f"the simulator must return a log for each of {len(trials)} trials; "
                f"it returned {len(coefficients)}"
            )
        self.trials += len(trials)
        return coefficients

    def similarities(
        self, trials: Trials, observed: Coefficients, which: NDArray[np.intp]
    ) -> Floats:
        """Return sim (B,) between B trials' behaviours and ``observed[which]``.

        A diverged robot has ``DIVERGED_SIMILARITY``. ``observed`` has shape (E, F), ``which`` (B,).
        """
        if self._comparer is not None:
            sim = likeness(self._comparer.to_observed(trials, observed, which))
            self.trials += len(trials)
        else:
            simulated = self.behaviors(trials)
            with np.errstate(invalid="ignore", over="ignore"):
                sim = similarity(simulated, observed[which])
        return np.where(np.isfinite(sim), sim, DIVERGED_SIMILARITY)

    def disagreements(self, trials: Trials, models: int) -> Floats:
        """Return ACT_FIT (A,) of A commands, each simulated on ``models`` bodies in a row (Eq. 1).

        It is not finite for a command under which a robot diverged.
        """
        if self._comparer is not None:
            apart = self._comparer.between_models(trials, models)
            self.trials += len(trials)
            return disagreement(apart, models)
        behaviors = self.behaviors(trials).reshape(len(trials) // models, models, -1)
        with np.errstate(invalid="ignore", over="ignore"):
            return action_fitness(behaviors)
