"""The exploration phase: evolve the command about which the models disagree most (Sec. 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eea.core.angles import Floats
from eea.core.checks import whole
from eea.core.experiment import Trials
from eea.core.genetic import MAXIMUM_GENERATIONS, MAXIMUM_POPULATION, GeneticConfig, evolve
from eea.core.genome import BitLayout
from eea.core.model_evaluator import ModelEvaluator


@dataclass(frozen=True)
class ExplorationConfig:
    """Settings of the exploration phase; the paper's are the defaults."""

    population: int = 25  #: Number of commands that evolve.
    generations: int = 25  #: Generations a round.

    def __post_init__(self) -> None:
        whole("exploration.population", self.population, 2, MAXIMUM_POPULATION)
        whole("exploration.generations", self.generations, 1, MAXIMUM_GENERATIONS)


@dataclass(frozen=True)
class Exploration:
    """Chooses the commands to perform on the target."""

    layout: BitLayout  #: The commands' genome.
    hidden: int  #: Number of hidden angles.
    evaluator: ModelEvaluator
    config: ExplorationConfig
    genetic: GeneticConfig

    def random(self, rng: np.random.Generator) -> Floats:
        """Return a random command (c,), for the first round: random models teach Eq. 1 nothing."""
        command: Floats = self.layout.decode(self.layout.random(1, rng))[0]
        return command

    def disputed(self, models: Floats, rng: np.random.Generator) -> tuple[Floats, float]:
        """Evolve a command (c,) about which models (M, n) disagree; return it and its ACT_FIT."""
        genome, act_fit = evolve(
            self.layout.random(self.config.population, rng),
            self.config.generations,
            lambda genomes: self._disagreement(models, self.layout.decode(genomes)),
            self.genetic,
            rng,
        )
        return self.layout.decode(genome[None])[0], act_fit

    def _disagreement(self, models: Floats, commands: Floats) -> Floats:
        """Return ACT_FIT (A,) of commands (A, c) over models (M, n), all angles initially zero.

        A command under which a model diverges scores below all others.
        """
        actions, count = len(commands), len(models)
        trials = Trials(
            np.tile(models, (actions, 1)),
            np.repeat(commands, count, axis=0),
            np.zeros((actions * count, self.hidden)),
        )
        fitness = self.evaluator.disagreements(trials, count)
        return np.where(np.isfinite(fitness), fitness, -1.0)
