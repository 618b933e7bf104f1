"""The estimation phase: evolve bodies that explain every experiment so far (Sec. 3.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from eea.core.bits import BitLayout, Genomes
from eea.core.checks import choice, flag, whole
from eea.core.experiment import Context, Experiment, Floats, perform_angles
from eea.core.fitness import model_fitness
from eea.core.genetic import GeneticConfig, next_generation
from eea.core.inference import Inference
from eea.core.laboratory import Laboratory

CarryOver = Literal["continue", "reseed"]


@dataclass(frozen=True)
class EstimationConfig:
    """The estimation phase's settings (the paper's are the defaults).

    Attributes
    ----------
    population
        How many models evolve.
    generations
        For how many generations they evolve in a round.
    carry_over
        Whether the population lives on in the next round, "continue", or each round begins with
        a random one, "reseed".
    remember
        Keep the similarities of bodies seen before to experiments whose angles stand still.
        The results are the same to the bit without; it only takes longer.
    """

    population: int = 25
    generations: int = 100
    carry_over: CarryOver = "continue"
    remember: bool = True

    def __post_init__(self) -> None:
        whole("estimation.population", self.population, 2)
        whole("estimation.generations", self.generations, 1)
        choice("estimation.carry_over", self.carry_over, ("continue", "reseed"))
        flag("estimation.remember", self.remember)


class SimilarityTable:
    """Similarities already known: a row a genome, a column an experiment, NaN where unknown.

    A column belongs to the pose it was made with, and is forgotten when that changes.
    """

    def __init__(self) -> None:
        self._rows: dict[bytes, int] = {}
        self._poses: list[bytes] = []
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

    def columns(self, contexts: Sequence[Context]) -> Floats:
        """Return the table with a valid column for each context."""
        added = len(contexts) - self._table.shape[1]
        if added > 0:
            empty = np.full((len(self._table), added), np.nan)
            self._table = np.concatenate([self._table, empty], axis=1)
            self._poses += [b""] * added
        for e, context in enumerate(contexts):
            pose = context.min_angle.tobytes()
            if context.fixed and pose != self._poses[e]:
                self._table[:, e] = np.nan
                self._poses[e] = pose
        return self._table

    def keep_only(self, genomes: Genomes) -> None:
        """Forget every genome but these, so that memory does not grow with the rounds."""
        rows = self.rows(genomes)
        kept = self._table[rows]
        self._rows = {}
        self._table = np.empty((0, kept.shape[1]))
        rows = self.rows(genomes)
        self._table[rows] = kept

    def save(self, genomes: Genomes) -> dict[str, Any]:
        """Return what is known of genomes (N, bits), for ``restore``."""
        rows = self.rows(genomes)
        return {"similarities": self._table[rows], "poses": [pose.hex() for pose in self._poses]}

    def restore(self, genomes: Genomes, similarities: Floats, poses: Sequence[str]) -> None:
        """Know what ``save`` returned of these genomes, and nothing else."""
        self._rows = {}
        self._poses = [bytes.fromhex(pose) for pose in poses]
        self._table = np.empty((0, len(poses)))
        rows = self.rows(genomes)  # which makes room for them
        self._table[rows] = similarities


class Estimation:
    """Keeps a population of models and fits it to the experiments.

    Parameters
    ----------
    layout
        The models' genome.
    laboratory
        Where models are tried.
    config, genetic
        Settings.
    rng
        Its own stream of chance.

    Attributes
    ----------
    models
        The hypotheses, shape (N, n), as the last round left them; random at first.
    fitness
        Their MOD_FIT, shape (N,); NaN before the first round.
    """

    def __init__(
        self,
        layout: BitLayout,
        laboratory: Laboratory,
        config: EstimationConfig,
        genetic: GeneticConfig,
        rng: np.random.Generator,
    ) -> None:
        self._layout = layout
        self._laboratory = laboratory
        self._config = config
        self._genetic = genetic
        self._rng = rng
        self._genomes = layout.random(config.population, rng)
        self._table = SimilarityTable()
        self.models: Floats = layout.decode(self._genomes)
        self.fitness: Floats = np.full(config.population, np.nan)

    def save(self) -> dict[str, Any]:
        """Return everything that the next round depends on, as arrays, for ``restore``."""
        known = self._table.save(self._genomes)
        return {"genomes": self._genomes, "fitness": self.fitness, **known}

    def restore(self, saved: dict[str, Any]) -> None:
        """Go back to what ``save`` returned between two rounds."""
        self._genomes, self.fitness = saved["genomes"], saved["fitness"]
        self.models = self._layout.decode(self._genomes)
        self._table = SimilarityTable()
        self._table.restore(self._genomes, saved["similarities"], saved["poses"])

    def run(
        self, experiments: Sequence[Experiment], inference: Inference, chance: np.random.Generator
    ) -> tuple[Floats, float]:
        """Evolve the models for one round.

        Parameters
        ----------
        experiments
            All so far, the newest last.
        inference
            Sets the newest experiment's context, before and between generations.
        chance
            Draws the angles of contexts that leave a choice.

        Returns
        -------
        morphology
            The fittest of the final generation, shape (n,).
        mod_fit
            Its MOD_FIT (Eq. 3).
        """
        config = self._config
        genomes = self._genomes
        if config.carry_over == "reseed" and len(experiments) > 1:
            genomes = self._layout.random(config.population, self._rng)
        self._table.keep_only(genomes)
        inference.begin(experiments, config.generations)
        for generation in range(config.generations):
            if generation:
                genomes = next_generation(genomes, self.fitness, self._genetic, self._rng)
            self.models = self._layout.decode(genomes)
            inference.pause(generation, self.models)
            angles = perform_angles(experiments, config.population, chance)
            similarities = self._similarities(genomes, experiments, angles)
            self.fitness = model_fitness(similarities)
            inference.observe(generation, angles, similarities)
        inference.end()
        self._genomes = genomes
        self._table.keep_only(genomes)
        best = int(np.argmax(self.fitness))
        return self.models[best], float(self.fitness[best])

    def _similarities(
        self, genomes: Genomes, experiments: Sequence[Experiment], angles: Floats
    ) -> Floats:
        """Return sim (N, E) of every model to the target in every experiment.

        All that is not yet known runs as one batch.
        """
        fixed = np.array([experiment.context.fixed for experiment in experiments])
        shape = (len(genomes), len(experiments))
        needed = np.ones(shape, dtype=bool)
        result = np.empty(shape)
        if self._config.remember:
            rows = self._table.rows(genomes)
            table = self._table.columns([experiment.context for experiment in experiments])
            first = np.zeros(len(genomes), dtype=bool)
            first[np.unique(rows, return_index=True)[1]] = True
            needed = ~fixed | (np.isnan(table[rows]) & first[:, None])
        model, experiment = np.nonzero(needed)
        if len(model):
            commands = np.stack([e.command for e in experiments])
            observed = np.stack([e.behavior for e in experiments])
            result[model, experiment] = self._laboratory.similarities(
                self.models[model],
                commands[experiment],
                angles[model, experiment],
                observed,
                experiment,
            )
        if self._config.remember:
            model, experiment = np.nonzero(needed & fixed)
            table[rows[model], experiment] = result[model, experiment]
            result[:, fixed] = table[rows][:, fixed]
        return result
