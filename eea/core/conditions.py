"""Four ways to treat hidden angles during estimation (Secs. 3.3, 3.4, 4.1 and 4.2).

Each is a strategy of the estimation phase that returns experiments with new contexts.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from eea.core.angles import Floats, smallest_inclusive
from eea.core.checks import real, whole
from eea.core.experiment import Context, Experiment, Trials
from eea.core.genetic import MAXIMUM_GENERATIONS, MAXIMUM_POPULATION, GeneticConfig, evolve
from eea.core.genome import BitLayout
from eea.core.model_evaluator import ModelEvaluator

Experiments = tuple[Experiment, ...]  # the newest last


def with_context(experiments: Experiments, index: int, context: Context) -> Experiments:
    """Return the experiments with another context for one of them."""
    changed = list(experiments)
    changed[index] = replace(changed[index], context=context)
    return tuple(changed)


class Inference(ABC):
    """A strategy of the estimation phase."""

    @abstractmethod
    def first_context(self, hidden: int, true_angles: Floats | None) -> Context:
        """Return the context of a new experiment with ``hidden`` hidden angles."""

    def before_generation(
        self,
        generation: int,  # noqa: ARG002
        models: Floats,  # noqa: ARG002
        experiments: Experiments,
        rng: np.random.Generator,  # noqa: ARG002
    ) -> Experiments:
        """Infer angles before a generation (from 0) of models (N, n) is evaluated."""
        return experiments

    def after_generation(
        self,
        angles: Floats,  # noqa: ARG002
        similarities: Floats,  # noqa: ARG002
        experiments: Experiments,
    ) -> Experiments:
        """Infer angles from those (N, E, h) and the similarities (N, E) of a generation."""
        return experiments

    def after_round(self, experiments: Experiments) -> Experiments:
        """Lock in what was inferred in the round."""
        return experiments


class NoInference(Inference):
    """Every model begins at the zero state (Sec. 4.2): the floor."""

    def first_context(self, hidden: int, true_angles: Floats | None) -> Context:  # noqa: ARG002
        """Return the zero state."""
        return Context.known(np.zeros(hidden))


class Ideal(Inference):
    """The models are given the target's angles (Sec. 4.1): the ceiling."""

    def first_context(self, hidden: int, true_angles: Floats | None) -> Context:  # noqa: ARG002
        """Return the true angles."""
        assert true_angles is not None  # EEA refuses targets that do not reveal them
        return Context.known(true_angles)


@dataclass(frozen=True)
class InBandConfig:
    """Settings of In-Band Inference."""

    k: int = 3  #: The inferred range includes the angles of the k best models.
    #: Share of the models that begin the newest experiment within the inferred range.
    confidence: float = 0.5

    def __post_init__(self) -> None:
        whole("in_band.k", self.k, 1, MAXIMUM_POPULATION)
        real("in_band.confidence", self.confidence, 0.0, 1.0)


@dataclass(frozen=True)
class InBand(Inference):
    """Infer the angles from the fitness of the evolving models (Sec. 3.3).

    Half of the models begin in the range of the k best models' angles, the others anywhere, so
    that the range can move. After the round all models begin inside the range.
    """

    config: InBandConfig

    def first_context(self, hidden: int, true_angles: Floats | None) -> Context:  # noqa: ARG002
        """Return the whole turn."""
        return Context.unknown(hidden, self.config.confidence)

    def after_generation(
        self, angles: Floats, similarities: Floats, experiments: Experiments
    ) -> Experiments:
        """Set the newest experiment's range to that of the k models that fit it best."""
        k_best = np.argsort(-similarities[:, -1], kind="stable")[: self.config.k]
        low, high = smallest_inclusive(angles[k_best, -1])
        return with_context(experiments, -1, Context(low, high, self.config.confidence))

    def after_round(self, experiments: Experiments) -> Experiments:
        """Lock the range in: confidence 1."""
        return with_context(experiments, -1, replace(experiments[-1].context, confidence=1.0))


@dataclass(frozen=True)
class OutOfBandConfig:
    """Settings of Out-of-Band Inference."""

    period: int = 35  #: Generations between inferences: at 0, 35 and 70 of the paper's 100.
    inner_population: int = 25  #: Number of poses that evolve.
    inner_generations: int = 25  #: Generations of an inference.
    #: Number of models, drawn at random for each inference, that judge the poses; None for all.
    sampled_models: int | None = None
    #: Number of earlier experiments, drawn at random, whose angles each inference updates too,
    #: starting from their present pose. The paper locks them in: 0.
    revisit: int = 0

    def __post_init__(self) -> None:
        whole("out_of_band.period", self.period, 1, MAXIMUM_GENERATIONS)
        whole("out_of_band.inner_population", self.inner_population, 2, MAXIMUM_POPULATION)
        whole("out_of_band.inner_generations", self.inner_generations, 1, MAXIMUM_GENERATIONS)
        if self.sampled_models is not None:
            whole("out_of_band.sampled_models", self.sampled_models, 1, MAXIMUM_POPULATION)
        whole("out_of_band.revisit", self.revisit, 0, MAXIMUM_POPULATION)


@dataclass(frozen=True)
class OutOfBand(Inference):
    """Interrupt the evolution of models by one of the angles (Sec. 3.4)."""

    config: OutOfBandConfig
    layout: BitLayout  #: The poses' genome.
    evaluator: ModelEvaluator
    genetic: GeneticConfig

    def first_context(self, hidden: int, true_angles: Floats | None) -> Context:  # noqa: ARG002
        """Return the whole turn; it is never simulated, as generation 0 infers first."""
        return Context.unknown(hidden, 1.0)

    def before_generation(
        self, generation: int, models: Floats, experiments: Experiments, rng: np.random.Generator
    ) -> Experiments:
        """Every ``period`` generations, infer the newest experiment's angles and earlier ones."""
        if generation % self.config.period:
            return experiments
        pose = self.opt_ang(models, experiments[-1], rng)
        experiments = with_context(experiments, -1, Context.known(pose))
        earlier = len(experiments) - 1
        count = min(self.config.revisit, earlier)
        for e in rng.choice(earlier, count, replace=False) if count else ():
            pose = self.opt_ang(models, experiments[e], rng, experiments[e].context.min_angle)
            experiments = with_context(experiments, e, Context.known(pose))
        return experiments

    def opt_ang(
        self,
        models: Floats,
        experiment: Experiment,
        rng: np.random.Generator,
        start: Floats | None = None,
    ) -> Floats:
        """Evolve the pose (h,) with which models (N, n) best reproduce an experiment: optAng.

        A ``start`` (h,) is one of the first candidates.
        """
        config = self.config
        if config.sampled_models is not None and config.sampled_models < len(models):
            models = models[rng.choice(len(models), config.sampled_models, replace=False)]
        genomes = self.layout.random(config.inner_population, rng)
        if start is not None:
            genomes[0] = self.layout.encode(start[None])[0]
        genome, _ = evolve(
            genomes,
            config.inner_generations,
            lambda poses: self._pose_fitness(self.layout.decode(poses), models, experiment),
            self.genetic,
            rng,
        )
        pose: Floats = self.layout.decode(genome[None])[0]
        return pose

    def _pose_fitness(self, poses: Floats, models: Floats, experiment: Experiment) -> Floats:
        """Return the fitness (P,) of poses (P, h): models' (N, n) mean sim to an experiment."""
        shape = (len(poses), len(models))
        count = shape[0] * shape[1]
        trials = Trials(
            np.tile(models, (shape[0], 1)),
            np.broadcast_to(experiment.command, (count, len(experiment.command))),
            np.repeat(poses, shape[1], axis=0),
        )
        similarities = self.evaluator.similarities(
            trials, experiment.behavior[None], np.zeros(count, dtype=np.intp)
        )
        fitness: Floats = similarities.reshape(shape).mean(axis=1)
        return fitness
