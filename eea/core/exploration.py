"""The exploration phase: which command the target performs next (Sec. 3.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from eea.core.angles import Floats
from eea.core.bits import BitLayout
from eea.core.checks import choice, whole
from eea.core.experiment import Trials
from eea.core.genetic import MAXIMUM_GENERATIONS, MAXIMUM_POPULATION, GeneticConfig, evolve
from eea.core.model_evaluator import ModelEvaluator


@dataclass(frozen=True)
class ExplorationConfig:
    """The exploration phase's settings (the paper's are the defaults)."""

    population: int = 25  #: How many commands evolve, for disagreement.
    generations: int = 25  #: For how many generations they evolve in a round.
    #: Where all the models begin: "zero", every hidden angle at zero, or "common_random", one
    #: random pose a round. It is common to all, so that disagreement is the bodies'.
    pose: Literal["zero", "common_random"] = "zero"
    #: How many models, the fittest, enter Eq. 1; None for the whole population.
    best_models: int | None = None

    def __post_init__(self) -> None:
        whole("exploration.population", self.population, 2, MAXIMUM_POPULATION)
        whole("exploration.generations", self.generations, 1, MAXIMUM_GENERATIONS)
        choice("exploration.pose", self.pose, ("zero", "common_random"))
        if self.best_models is not None:
            whole("exploration.best_models", self.best_models, 2, MAXIMUM_POPULATION)


@dataclass
class Exploration:
    """Chooses the commands to perform on the target."""

    layout: BitLayout
    hidden: int  #: How many hidden angles a pose has.
    evaluator: ModelEvaluator
    config: ExplorationConfig
    genetic: GeneticConfig
    rng: np.random.Generator

    def choose(
        self, performed: int, models: Floats, fitness: Floats
    ) -> tuple[Floats, float | None]:
        """Return the next command (c,) and its ACT_FIT; a random one, without, for the first trial.

        Parameters
        ----------
        performed
            How many commands were performed so far.
        models, fitness
            As of ``run``.
        """
        return self.run(models, fitness) if performed else (self.first(), None)

    def first(self) -> Floats:
        """Return a random command (c,): before any experiment the models know nothing."""
        command: Floats = self.layout.decode(self.layout.random(1, self.rng))[0]
        return command

    def run(self, models: Floats, fitness: Floats) -> tuple[Floats, float]:
        """Evolve a command about which models (M, n) disagree; return the best and its ACT_FIT.

        ``best_models`` chooses by the models' MOD_FIT, shape (M,).
        """
        config = self.config
        if config.best_models is not None:
            models = models[np.argsort(-fitness, kind="stable")[: config.best_models]]
        pose = np.zeros(self.hidden)
        if config.pose == "common_random":
            pose = self.rng.uniform(-np.pi, np.pi, size=self.hidden)
        genome, act_fit = evolve(
            self.layout.random(config.population, self.rng),
            config.generations,
            lambda genomes: self._disagreement(models, self.layout.decode(genomes), pose),
            self.genetic,
            self.rng,
        )
        return self.layout.decode(genome[None])[0], act_fit

    def _disagreement(self, models: Floats, commands: Floats, pose: Floats) -> Floats:
        """Return ACT_FIT (A,) of commands (A, c) over models (M, n).

        A command that some model cannot be simulated under scores below all others.
        """
        actions, count = len(commands), len(models)
        trials = Trials(
            np.tile(models, (actions, 1)),
            np.repeat(commands, count, axis=0),
            np.broadcast_to(pose, (actions * count, len(pose))),
        )
        fitness = self.evaluator.disagreements(trials, count)
        return np.where(np.isfinite(fitness), fitness, -1.0)
