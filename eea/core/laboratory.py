"""Where models are tried: the simulator and the behaviour summary together."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eea.core.behavior import BehaviorConfig, Coefficients, likeness, similarity, summarize
from eea.core.checks import TargetError
from eea.core.experiment import Floats, Simulator, Trials
from eea.core.fitness import action_fitness, disagreement

DIVERGED = -1e6  # far below any real similarity, and still a number that means can hold


class Comparer(Protocol):
    """Simulates and compares in one go, where a simulator can do that faster than numpy.

    What it answers is what ``behavior.py`` and ``fitness.py`` would, but for rounding. A robot
    that left the finite numbers gives an answer that is not finite.
    """

    def to_observed(
        self, trials: Trials, observed: Coefficients, which: NDArray[np.intp]
    ) -> Floats:
        """Return the mean difference (B,) of coefficients from ``observed[which]``.

        ``observed`` has shape (E, F), ``which`` (B,).
        """

    def between_models(self, trials: Trials, models: int) -> Floats:
        """Return, for each run of ``models`` trials, the sum over its pairs of that mean, (A,)."""


class Laboratory:
    """Runs batches of models through the simulator and counts them.

    Parameters
    ----------
    simulator
        Runs the trials. If it has a method ``comparer``, that is asked for a :class:`Comparer`
        for the behaviour and the length of trials, or None.
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
        find = getattr(simulator, "comparer", None)
        self._comparer: Comparer | None = None if find is None else find(behavior, steps)

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
        self,
        morphologies: Floats,
        commands: Floats,
        fin_angles: Floats,
        observed: Coefficients,
        which: NDArray[np.intp],
    ) -> Floats:
        """Return sim (B,) between those behaviours and the observed ones, ``observed[which]``.

        A robot that left the finite numbers is like nothing: its sim is ``DIVERGED``.

        Parameters
        ----------
        morphologies, commands, fin_angles
            Shape (B, n), (B, 3) and (B, 3).
        observed
            Behaviours of the target, shape (E, F).
        which
            The one that each is compared with, shape (B,).
        """
        if self._comparer is not None:
            trials = Trials(morphologies, commands, fin_angles)
            sim = likeness(self._comparer.to_observed(trials, observed, which), self.behavior)
            self.trials += len(trials)
            return np.where(np.isfinite(sim), sim, DIVERGED)
        simulated = self.behaviors(morphologies, commands, fin_angles)
        with np.errstate(invalid="ignore", over="ignore"):
            sim = similarity(simulated, observed[which], self.behavior)
        finite = np.isfinite(sim)
        if self.behavior.clamp:  # which makes infinity a difference like any other
            finite &= np.isfinite(simulated).all(axis=-1)
        return np.where(finite, sim, DIVERGED)

    def disagreements(
        self, morphologies: Floats, commands: Floats, fin_angles: Floats, models: int
    ) -> Floats:
        """Return ACT_FIT (A,) of A commands, each tried on ``models`` bodies in a row (Eq. 1).

        That of a command under which a robot left the finite numbers is not finite.

        Parameters
        ----------
        morphologies, commands, fin_angles
            Shape (A * models, n), (A * models, 3) and (A * models, 3).
        models
            How many, at least two.
        """
        if self._comparer is not None:
            trials = Trials(morphologies, commands, fin_angles)
            apart = self._comparer.between_models(trials, models)
            self.trials += len(trials)
            return disagreement(apart, models, self.behavior)
        behaviors = self.behaviors(morphologies, commands, fin_angles)
        actions = len(behaviors) // models
        with np.errstate(invalid="ignore", over="ignore"):
            return action_fitness(behaviors.reshape(actions, models, -1), self.behavior)
