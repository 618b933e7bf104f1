"""Where models are tried: the simulator and the behaviour summary together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.behavior import (
    BehaviorConfig,
    Coefficients,
    likeness,
    signal_samples,
    similarity,
    summarize,
)
from eea.core.checks import TargetError
from eea.core.experiment import Simulator, Trials
from eea.core.fitness import action_fitness, disagreement

DIVERGED = -1e6  # far below any real similarity, and still a number that means can hold


class ModelEvaluator:
    """Runs batches of models through the simulator and counts them.

    Every log must be of so many ``steps``, and its signal of so many ``axes``.
    """

    def __init__(
        self, simulator: Simulator, behavior: BehaviorConfig, steps: int, axes: int
    ) -> None:
        for method in ("simulate", "comparer"):
            if not callable(getattr(simulator, method, None)):
                raise TargetError(
                    f"the simulator must have {method}, as whatever inherits from eea.Simulator "
                    f"and simulates has; {type(simulator).__name__} has none"
                )
        self._simulator = simulator
        self._comparer = simulator.comparer(behavior, steps)
        self.behavior: BehaviorConfig = behavior
        self.steps: int = steps
        self.axes: int = axes
        self.trials: int = 0

    def behaviors(self, trials: Trials) -> Coefficients:
        """Return the behaviours (B, F) of B trials.

        A robot that left the finite numbers has coefficients that are not finite.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            log = self._simulator.simulate(trials)
            coefficients = summarize(log, self.behavior, self.steps, self.axes, "the simulator")
        if len(coefficients) != len(trials):
            raise TargetError(
                f"the simulator must return a log for each of {len(trials)} trials; "
                f"it returned {len(coefficients)}"
            )
        self.trials += len(trials)
        return coefficients

    def signals(self, trials: Trials) -> Floats:
        """Return what the IMUs of B trials' robots feel, (B, T, axes), as a behaviour's signal."""
        log = self._simulator.simulate(trials)
        samples: Floats = signal_samples(
            log, self.behavior, self.axes, "the simulator", self.steps
        ).astype(np.float64)
        self.trials += len(trials)
        return samples

    def similarities(
        self, trials: Trials, observed: Coefficients, which: NDArray[np.intp]
    ) -> Floats:
        """Return sim (B,) between B trials' behaviours and those observed, ``observed[which]``.

        A robot that left the finite numbers is like nothing: its sim is ``DIVERGED``. Shapes are
        (E, F) of ``observed`` and (B,) of ``which``.
        """
        if self._comparer is not None:
            sim = likeness(self._comparer.to_observed(trials, observed, which), self.behavior)
            self.trials += len(trials)
            return np.where(np.isfinite(sim), sim, DIVERGED)
        simulated = self.behaviors(trials)
        with np.errstate(invalid="ignore", over="ignore"):
            sim = similarity(simulated, observed[which], self.behavior)
        finite = np.isfinite(sim)
        if self.behavior.clamp:  # which makes infinity a difference like any other
            finite &= np.isfinite(simulated).all(axis=-1)
        return np.where(finite, sim, DIVERGED)

    def disagreements(self, trials: Trials, models: int) -> Floats:
        """Return ACT_FIT (A,) of A commands, each tried on ``models`` bodies in a row (Eq. 1).

        That of a command under which a robot left the finite numbers is not finite.
        """
        if self._comparer is not None:
            apart = self._comparer.between_models(trials, models)
            self.trials += len(trials)
            return disagreement(apart, models, self.behavior)
        behaviors = self.behaviors(trials).reshape(len(trials) // models, models, -1)
        with np.errstate(invalid="ignore", over="ignore"):
            return action_fitness(behaviors, self.behavior)
