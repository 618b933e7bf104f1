"""The estimation phase: evolve bodies that explain every experiment so far (Sec. 3.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.bits import BitLayout, Genomes
from eea.core.checks import choice, flag, whole
from eea.core.conditions import Inference
from eea.core.experiment import Experiment, Trials, perform_angles
from eea.core.fitness import model_fitness
from eea.core.genetic import MAXIMUM_GENERATIONS, MAXIMUM_POPULATION, GeneticConfig, next_generation
from eea.core.model_evaluator import ModelEvaluator


@dataclass(frozen=True)
class EstimationConfig:
    """The estimation phase's settings (the paper's are the defaults)."""

    population: int = 25  #: How many models evolve.
    generations: int = 100  #: For how many generations they evolve in a round.
    #: Whether the population lives on in the next round, "continue", or each round begins with a
    #: random one, "reseed".
    carry_over: Literal["continue", "reseed"] = "continue"
    #: Keep the similarities of bodies seen before to experiments whose angles stand still. The
    #: results are the same to the bit without; it only takes longer.
    remember: bool = True

    def __post_init__(self) -> None:
        whole("estimation.population", self.population, 2, MAXIMUM_POPULATION)
        whole("estimation.generations", self.generations, 1, MAXIMUM_GENERATIONS)
        choice("estimation.carry_over", self.carry_over, ("continue", "reseed"))
        flag("estimation.remember", self.remember)


class SimilarityTable:
    """Similarities already known: a row a genome, a column an experiment, NaN where unknown.

    A column belongs to one experiment from one pose, and is forgotten when either changes.
    """

    def __init__(self) -> None:
        self._rows: dict[bytes, int] = {}
        self._known: list[tuple[Experiment | None, bytes]] = []
        self._table: Floats = np.empty((0, 0))

    def rows(self, genomes: Genomes) -> NDArray[np.intp]:
        """Return the genomes' rows (N,), new ones for new genomes."""
        keys = [genome.tobytes() for genome in np.packbits(genomes, axis=1)]
        rows = np.array([self._rows.setdefault(key, len(self._rows)) for key in keys])
        missing = len(self._rows) - len(self._table)
        if missing > 0:
            # Room to grow: the table doubles, rather than being copied each generation.
            extra = np.full((max(missing, len(self._table)), self._table.shape[1]), np.nan)
            self._table = np.concatenate([self._table, extra])
        return rows

    def columns(self, experiments: Sequence[Experiment]) -> Floats:
        """Return the table with a valid column for each experiment whose angles stand still."""
        added = len(experiments) - self._table.shape[1]
        if added > 0:
            empty = np.full((len(self._table), added), np.nan)
            self._table = np.concatenate([self._table, empty], axis=1)
            self._known += [(None, b"")] * added
        for e, experiment in enumerate(experiments):
            known, pose = self._known[e], experiment.context.min_angle.tobytes()
            if experiment.context.fixed and (known[0] is not experiment or known[1] != pose):
                self._table[:, e] = np.nan
                self._known[e] = (experiment, pose)
        return self._table

    def keep_only(self, genomes: Genomes) -> None:
        """Forget every genome but these, so that memory does not grow with the rounds."""
        rows = self.rows(genomes)  # which makes room for them
        kept = self._table[rows]
        self._rows = {}
        self._table = np.empty((0, kept.shape[1]))
        rows = self.rows(genomes)
        self._table[rows] = kept


@dataclass(frozen=True)
class Population:
    """N hypotheses."""

    genomes: Genomes  #: Shape (N, bits).
    models: Floats  #: What they mean, shape (N, n).
    fitness: Floats  #: Their MOD_FIT, shape (N,); NaN before the first round.


@dataclass
class Estimation:
    """Keeps a population of models and fits it to the experiments."""

    layout: BitLayout
    evaluator: ModelEvaluator
    config: EstimationConfig
    genetic: GeneticConfig
    rng: np.random.Generator

    def __post_init__(self) -> None:
        genomes = self.layout.random(self.config.population, self.rng)
        unknown = np.full(self.config.population, np.nan)
        self.go_back(Population(genomes, self.layout.decode(genomes), unknown))

    def go_back(self, population: Population) -> None:
        """Take up an earlier population, after a round that was broken off."""
        self.population = population
        self._table = SimilarityTable()

    def run(
        self, experiments: Sequence[Experiment], inference: Inference, rng: np.random.Generator
    ) -> tuple[Floats, float]:
        """Evolve the models for a round; return the last generation's fittest and its MOD_FIT.

        The newest experiment is the last; ``inference`` sets its context, and ``rng`` draws the
        angles of contexts that leave a choice.
        """
        config = self.config
        genomes, fitness = self.population.genomes, self.population.fitness
        if config.carry_over == "reseed" and len(experiments) > 1:
            genomes = self.layout.random(config.population, self.rng)
        self._table.keep_only(genomes)
        inference.begin(experiments, config.generations)
        for generation in range(config.generations):
            if generation:
                genomes = next_generation(genomes, fitness, self.genetic, self.rng)
            models = self.layout.decode(genomes)
            inference.before_generation(generation, models)
            angles = perform_angles(experiments, config.population, rng)
            similarities = self._similarities(genomes, models, experiments, angles)
            fitness = model_fitness(similarities)
            inference.after_generation(generation, angles, similarities)
        inference.end()
        self._table.keep_only(genomes)
        self.population = Population(genomes, models, fitness)
        best = int(np.argmax(fitness))
        return models[best], float(fitness[best])

    def _similarities(
        self, genomes: Genomes, models: Floats, experiments: Sequence[Experiment], angles: Floats
    ) -> Floats:
        """Return sim (N, E) of every model in every experiment; what is unknown is one batch."""
        fixed = np.array([experiment.context.fixed for experiment in experiments])
        shape = (len(genomes), len(experiments))
        needed = np.ones(shape, dtype=bool)
        result = np.empty(shape)
        if self.config.remember:
            rows = self._table.rows(genomes)
            table = self._table.columns(experiments)
            first = np.zeros(len(genomes), dtype=bool)
            first[np.unique(rows, return_index=True)[1]] = True
            needed = ~fixed | (np.isnan(table[rows]) & first[:, None])
        model, experiment = np.nonzero(needed)
        if len(model):
            commands = np.stack([e.command for e in experiments])
            observed = np.stack([e.behavior for e in experiments])
            trials = Trials(models[model], commands[experiment], angles[model, experiment])
            result[model, experiment] = self.evaluator.similarities(trials, observed, experiment)
        if self.config.remember:
            model, experiment = np.nonzero(needed & fixed)
            table[rows[model], experiment] = result[model, experiment]
            result[:, fixed] = table[rows][:, fixed]
        return result
