"""Four ways to deal with joints whose angles are unknown (Secs. 3.3, 3.4, 4.1 and 4.2).

Each is a small strategy over the same rounds: ``begin`` with a new experiment, act
``before_generation`` and ``after_generation``, ``end`` the round. What a strategy has to say it
says by replacing the newest experiment's context.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from eea.core.angles import Floats, Inclusion, smallest_inclusive, widen
from eea.core.bits import BitLayout
from eea.core.checks import choice, flag, real, whole
from eea.core.experiment import Context, Experiment, Trials
from eea.core.genetic import MAXIMUM_GENERATIONS, MAXIMUM_POPULATION, GeneticConfig, evolve
from eea.core.model_evaluator import ModelEvaluator


class Inference(ABC):
    """What the estimation phase asks of a strategy."""

    experiments: Sequence[Experiment]
    generations: int

    @property
    def newest(self) -> Experiment:
        """The round's own experiment."""
        return self.experiments[-1]

    def begin(self, experiments: Sequence[Experiment], generations: int) -> None:
        """Begin a round of so many generations; the newest experiment is the last."""
        self.experiments, self.generations = experiments, generations
        self.newest.context = self._first_context(self.newest)

    @abstractmethod
    def _first_context(self, newest: Experiment) -> Context:
        """Return what is believed of a new experiment's start."""

    def before_generation(self, generation: int, models: Floats) -> None:  # noqa: B027
        """Infer, before a generation (from 0) of models (N, n) is evaluated."""

    def after_generation(  # noqa: B027
        self, generation: int, angles: Floats, similarities: Floats
    ) -> None:
        """Learn from starts (N, E, h) and similarities (N, E) of an evaluated generation."""

    def end(self) -> None:  # noqa: B027 - most have nothing left to say
        """End the round: lock in what was inferred."""


class NoInference(Inference):
    """Every model begins at the zero state (Sec. 4.2): the floor."""

    def _first_context(self, newest: Experiment) -> Context:
        return Context.known(np.zeros(len(newest.context)))


class Ideal(Inference):
    """The target's angles are given to the models (Sec. 4.1): the ceiling."""

    def _first_context(self, newest: Experiment) -> Context:
        assert newest.true_angles is not None  # EEA refuses targets that do not reveal them
        return Context.known(newest.true_angles)


@dataclass(frozen=True)
class InBandConfig:
    """Settings of In-Band Inference."""

    k: int = 3  #: How many of the best models' angles make the inferred range.
    #: Which models are the best: those that fit the "newest" experiment, whose angles are sought,
    #: or those that fit all, "overall", by MOD_FIT.
    rank_by: Literal["newest", "overall"] = "newest"
    #: Of the newest experiment: the share of models that begin in the inferred range.
    confidence: float = 0.5
    dynamic_split: bool = False  #: Raise that share evenly to 1 by the middle of the round.
    #: Share of its width by which the range is widened at each end; the paper tried 0.2.
    extension: float = 0.0
    #: What range includes the best: "circular" is the shortest arc, "linear" reaches from their
    #: least to their greatest angle in [-pi, pi).
    inclusion: Inclusion = "circular"

    def __post_init__(self) -> None:
        whole("in_band.k", self.k, 1, MAXIMUM_POPULATION)
        choice("in_band.rank_by", self.rank_by, ("newest", "overall"))
        real("in_band.confidence", self.confidence, 0.0, 1.0)
        flag("in_band.dynamic_split", self.dynamic_split)
        real("in_band.extension", self.extension, 0.0)
        choice("in_band.inclusion", self.inclusion, ("circular", "linear"))


@dataclass
class InBand(Inference):
    """Infer the angles from how the evolving models do (Sec. 3.3).

    Half the models begin somewhere in the range of the K best's angles, the others anywhere, so
    that the range can move. When the round ends the range is locked in: models begin inside it,
    and are still spread over it.
    """

    config: InBandConfig

    def _first_context(self, newest: Experiment) -> Context:
        return Context.unknown(len(newest.context), self._confidence(0))

    def after_generation(self, generation: int, angles: Floats, similarities: Floats) -> None:
        """Set the newest experiment's range to that of the K best models of this generation."""
        newest_only = self.config.rank_by == "newest"
        scores = similarities[:, -1] if newest_only else similarities.mean(axis=1)
        k_best = np.argsort(-scores, kind="stable")[: self.config.k]
        low, high = smallest_inclusive(angles[k_best, -1], self.config.inclusion)
        if self.config.extension:
            low, high = widen(low, high, self.config.extension)
        self.newest.context = Context(low, high, self._confidence(generation + 1))

    def end(self) -> None:
        """Lock the range in: confidence 1."""
        context = self.newest.context
        self.newest.context = Context(context.min_angle, context.max_angle, 1.0)

    def _confidence(self, generation: int) -> float:
        start = self.config.confidence
        if not self.config.dynamic_split:
            return start
        return start + (1.0 - start) * min(1.0, 2.0 * generation / self.generations)


@dataclass(frozen=True)
class OutOfBandConfig:
    """Settings of Out-of-Band Inference."""

    #: Generations of models between inferences: at 0, 35 and 70 of the paper's 100.
    period: int = 35
    inner_population: int = 25  #: How many poses evolve.
    inner_generations: int = 25  #: For how many generations they evolve in an inference.
    #: How many models, drawn at random for each inference, judge the poses; None for all.
    sampled_models: int | None = None
    #: What a pose scores: the "mean" of the judging models' similarities to the newest experiment,
    #: or that of the "best" of them.
    pose_fitness: Literal["mean", "best"] = "mean"
    #: Begin a round's later inferences with the pose inferred before among the candidates.
    warm_start: bool = False
    #: At each inference, infer the angles of so many earlier experiments anew too, drawn at random
    #: and begun with the pose they had. The paper locks them in: 0.
    revisit: int = 0

    def __post_init__(self) -> None:
        whole("out_of_band.period", self.period, 1, MAXIMUM_GENERATIONS)
        whole("out_of_band.inner_population", self.inner_population, 2, MAXIMUM_POPULATION)
        whole("out_of_band.inner_generations", self.inner_generations, 1, MAXIMUM_GENERATIONS)
        if self.sampled_models is not None:
            whole("out_of_band.sampled_models", self.sampled_models, 1, MAXIMUM_POPULATION)
        choice("out_of_band.pose_fitness", self.pose_fitness, ("mean", "best"))
        flag("out_of_band.warm_start", self.warm_start)
        whole("out_of_band.revisit", self.revisit, 0, MAXIMUM_POPULATION)


@dataclass
class OutOfBand(Inference):
    """Interrupt the search for models by one for the angles (Sec. 3.4)."""

    config: OutOfBandConfig
    layout: BitLayout  #: The poses' genome.
    evaluator: ModelEvaluator
    genetic: GeneticConfig
    rng: np.random.Generator

    def _first_context(self, newest: Experiment) -> Context:
        # Never simulated: generation 0 begins with an inference.
        return Context.unknown(len(newest.context), 1.0)

    def before_generation(self, generation: int, models: Floats) -> None:
        """Every ``period`` generations, replace the newest experiment's angles."""
        if generation % self.config.period:
            return
        start = self.newest.context.min_angle if generation and self.config.warm_start else None
        self.newest.context = Context.known(self.opt_ang(models, self.newest, start))
        earlier = len(self.experiments) - 1
        count = min(self.config.revisit, earlier)
        for e in self.rng.choice(earlier, count, replace=False) if count else ():
            experiment = self.experiments[e]
            pose = self.opt_ang(models, experiment, experiment.context.min_angle)
            experiment.context = Context.known(pose)

    def opt_ang(
        self, models: Floats, experiment: Experiment, start: Floats | None = None
    ) -> Floats:
        """Evolve the pose (h,) with which models (N, n) best reproduce an experiment.

        A pose to ``start`` with is put among the first candidates.
        """
        config = self.config
        if config.sampled_models is not None and config.sampled_models < len(models):
            models = models[self.rng.choice(len(models), config.sampled_models, replace=False)]
        genomes = self.layout.random(config.inner_population, self.rng)
        if start is not None:
            genomes[0] = self.layout.encode(start[None])[0]
        genome, _ = evolve(
            genomes,
            config.inner_generations,
            lambda poses: self._pose_fitness(self.layout.decode(poses), models, experiment),
            self.genetic,
            self.rng,
        )
        pose: Floats = self.layout.decode(genome[None])[0]
        return pose

    def _pose_fitness(self, poses: Floats, models: Floats, experiment: Experiment) -> Floats:
        """Return the fitness (P,) of poses (P, h) judged by models (N, n)."""
        shape = (len(poses), len(models))
        count = shape[0] * shape[1]
        trials = Trials(
            np.tile(models, (shape[0], 1)),
            np.broadcast_to(experiment.command, (count, len(experiment.command))),
            np.repeat(poses, shape[1], axis=0),
        )
        similarities = self.evaluator.similarities(
            trials, experiment.behavior[None], np.zeros(count, dtype=np.intp)
        ).reshape(shape)
        best = self.config.pose_fitness == "best"
        fitness: Floats = similarities.max(axis=1) if best else similarities.mean(axis=1)
        return fitness
