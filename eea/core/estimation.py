"""The estimation phase: evolve bodies that explain every experiment so far (Sec. 3.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.checks import whole
from eea.core.conditions import Experiments, Inference
from eea.core.experiment import Experiment, Trials, perform_angles
from eea.core.fitness import model_fitness
from eea.core.genetic import MAXIMUM_GENERATIONS, MAXIMUM_POPULATION, GeneticConfig, next_generation
from eea.core.genome import BitLayout, Genomes
from eea.core.model_evaluator import ModelEvaluator


@dataclass(frozen=True)
class EstimationConfig:
    """Settings of the estimation phase; the paper's are the defaults."""

    population: int = 25  #: Number of models that evolve; they survive from round to round.
    generations: int = 100  #: Generations a round.

    def __post_init__(self) -> None:
        whole("estimation.population", self.population, 2, MAXIMUM_POPULATION)
        whole("estimation.generations", self.generations, 1, MAXIMUM_GENERATIONS)


class SimilarityTable:
    """A cache of similarities: a row a genome, a column an experiment, NaN where unknown.

    A column holds for one pose of its experiment and is cleared when the pose changes. Results are
    the same to the bit without it.
    """

    def __init__(self) -> None:
        self._rows: dict[bytes, int] = {}
        self._poses: list[bytes] = []
        self._table: Floats = np.empty((0, 0))

    def rows(self, genomes: Genomes) -> NDArray[np.intp]:
        """Return the genomes' rows (N,); new genomes get new rows."""
        keys = [genome.tobytes() for genome in np.packbits(genomes, axis=1)]
        rows = np.array([self._rows.setdefault(key, len(self._rows)) for key in keys])
        missing = len(self._rows) - len(self._table)
        if missing > 0:
            # The table doubles rather than being copied in each generation.
            extra = np.full((max(missing, len(self._table)), self._table.shape[1]), np.nan)
            self._table = np.concatenate([self._table, extra])
        return rows

    def columns(self, experiments: Sequence[Experiment]) -> Floats:
        """Return the table with a valid column for each experiment of a fixed context."""
        added = len(experiments) - len(self._poses)
        if added > 0:
            empty = np.full((len(self._table), added), np.nan)
            self._table = np.concatenate([self._table, empty], axis=1)
            self._poses += [b""] * added
        for e, experiment in enumerate(experiments):
            pose = experiment.context.min_angle.tobytes()
            if experiment.context.fixed and self._poses[e] != pose:
                self._table[:, e] = np.nan
                self._poses[e] = pose
        return self._table

    def only(self, genomes: Genomes) -> SimilarityTable:
        """Return a new table with these genomes alone, so that memory does not grow with rounds."""
        table = SimilarityTable()
        table._poses = list(self._poses)
        table._table = np.empty((0, self._table.shape[1]))
        mine, theirs = self.rows(genomes), table.rows(genomes)
        table._table[theirs] = self._table[mine]
        return table


@dataclass(frozen=True)
class Population:
    """N models."""

    genomes: Genomes  #: Shape (N, bits).
    models: Floats  #: Their values, shape (N, n).
    fitness: Floats  #: Their MOD_FIT, shape (N,); NaN before the first round.
    known: SimilarityTable = field(default_factory=SimilarityTable, repr=False)

    @property
    def best(self) -> tuple[Floats, float]:
        """The fittest model (n,) and its MOD_FIT."""
        best = int(np.argmax(self.fitness))
        return self.models[best], float(self.fitness[best])


@dataclass(frozen=True)
class Estimation:
    """Fits a population of models to the experiments."""

    layout: BitLayout  #: The models' genome.
    evaluator: ModelEvaluator
    config: EstimationConfig
    genetic: GeneticConfig

    def random(self, rng: np.random.Generator) -> Population:
        """Return a random population, for the first round."""
        genomes = self.layout.random(self.config.population, rng)
        unknown = np.full(self.config.population, np.nan)
        return Population(genomes, self.layout.decode(genomes), unknown)

    def evolve(
        self,
        population: Population,
        experiments: Experiments,
        inference: Inference,
        breeding: np.random.Generator,
        inferring: np.random.Generator,
    ) -> tuple[Population, Experiments]:
        """Evolve a population for one round; return it, and the experiments' inferred contexts.

        ``breeding`` draws the next generations; ``inferring`` draws angles and inferences.
        """
        genomes, fitness = population.genomes, population.fitness
        known = population.known.only(genomes)
        for generation in range(self.config.generations):
            if generation:
                genomes = next_generation(genomes, fitness, self.genetic, breeding)
            models = self.layout.decode(genomes)
            experiments = inference.before_generation(generation, models, experiments, inferring)
            angles = perform_angles(experiments, len(models), inferring)  # PERFORM, Sec. 3.3
            similarities = self._similarities(genomes, models, experiments, angles, known)
            fitness = model_fitness(similarities)  # Eq. 3
            experiments = inference.after_generation(angles, similarities, experiments)
        survivors = Population(genomes, models, fitness, known.only(genomes))
        return survivors, inference.after_round(experiments)

    def _similarities(
        self,
        genomes: Genomes,
        models: Floats,
        experiments: Experiments,
        angles: Floats,
        known: SimilarityTable,
    ) -> Floats:
        """Return sim (N, E) of every model in every experiment; unknown ones form one batch."""
        fixed = np.array([experiment.context.fixed for experiment in experiments])
        result = np.empty((len(genomes), len(experiments)))
        rows = known.rows(genomes)
        table = known.columns(experiments)
        first = np.zeros(len(genomes), dtype=bool)
        first[np.unique(rows, return_index=True)[1]] = True
        needed = ~fixed | (np.isnan(table[rows]) & first[:, None])
        model, experiment = np.nonzero(needed)
        if len(model):
            commands = np.stack([e.command for e in experiments])
            observed = np.stack([e.behavior for e in experiments])
            trials = Trials(models[model], commands[experiment], angles[model, experiment])
            result[model, experiment] = self.evaluator.similarities(trials, observed, experiment)
        model, experiment = np.nonzero(needed & fixed)
        table[rows[model], experiment] = result[model, experiment]
        result[:, fixed] = table[rows][:, fixed]
        return result
