"""Hidden angles under the four conditions during estimation (Secs. 3.3, 3.4, 4.1 and 4.2).

None and Ideal differ only in the first context of an experiment. In-Band Inference narrows the
newest context after each generation of models (:func:`models_range`), and Out-of-Band Inference
interrupts the generations by an evolution of the angles (:func:`infer_angles`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eea.core.angles import Floats, extended, smallest_inclusive
from eea.core.config import GeneticConfig, InBandConfig, OutOfBandConfig, PaperConfig
from eea.core.experiment import Context, Experiment, Trials
from eea.core.fitness import model_fitness
from eea.core.genetic import evolve
from eea.core.genome import pose_layout
from eea.core.model_evaluator import ModelEvaluator

Experiments = tuple[Experiment, ...]  # the newest last


def first_context(config: PaperConfig, hidden: int, true_angles: Floats | None) -> Context:
    """Return the context of a new experiment with ``hidden`` hidden angles."""
    if config.condition == "none":
        return Context.known(np.zeros(hidden))  # Sec. 4.2
    if config.condition == "ideal":
        assert true_angles is not None  # EEA refuses targets that do not reveal their angles
        return Context.known(true_angles)  # Sec. 4.1
    return Context.unknown(hidden, config.in_band.confidence)


def with_context(experiments: Experiments, index: int, context: Context) -> Experiments:
    """Return the experiments with the context of one replaced."""
    changed = list(experiments)
    changed[index] = replace(changed[index], context=context)
    return tuple(changed)


def models_range(
    angles: Floats, similarities: Floats, config: InBandConfig, progress: float = 0.0
) -> Context:
    """Return In-Band's context of the newest experiment: the range of the best models' angles.

    ``config.confidence`` of the models begin in that range, the others anywhere, so that the range
    can move. ``angles`` (N, h) and ``similarities`` (N,) are those of the models in that
    experiment, ``progress`` is the share of the round's generations that are done.
    """
    best = np.argsort(-similarities, kind="stable")[: config.best]
    confidence = config.confidence
    if config.dynamic_split:
        confidence += (1.0 - confidence) * min(1.0, 2.0 * progress)
    low, high = smallest_inclusive(angles[best])
    if config.extension:
        low, high = extended(low, high, config.extension)
    return Context(low, high, confidence)


def infer_angles(
    experiments: Experiments,
    models: Floats,
    evaluator: ModelEvaluator,
    config: OutOfBandConfig,
    genetic: GeneticConfig,
    rng: np.random.Generator,
) -> Experiments:
    """Infer the angles of the newest and of ``config.revisit`` other experiments, out of band."""
    pose = opt_ang(models, experiments[-1], evaluator, config, genetic, rng)
    experiments = with_context(experiments, -1, Context.known(pose))
    earlier = len(experiments) - 1
    count = min(config.revisit, earlier)
    for e in rng.choice(earlier, count, replace=False) if count else ():
        start = experiments[e].context.min_angle
        pose = opt_ang(models, experiments[e], evaluator, config, genetic, rng, start)
        experiments = with_context(experiments, e, Context.known(pose))
    return experiments


def opt_ang(
    models: Floats,
    experiment: Experiment,
    evaluator: ModelEvaluator,
    config: OutOfBandConfig,
    genetic: GeneticConfig,
    rng: np.random.Generator,
    start: Floats | None = None,
) -> Floats:
    """Evolve the pose (h,) with which models (N, n) best reproduce an experiment: optAng.

    A ``start`` (h,) is one of the first candidates.
    """
    if config.sampled_models is not None and config.sampled_models < len(models):
        models = models[rng.choice(len(models), config.sampled_models, replace=False)]
    layout = pose_layout(len(experiment.context.min_angle)).with_coding(genetic.coding)
    genomes = layout.random(config.inner_population, rng)
    if start is not None:
        genomes[0] = layout.encode(start[None])[0]

    def pose_fitness(candidates: Floats) -> Floats:
        """Return the models' mean sim (P,) from each of poses (P, h)."""
        count = len(candidates) * len(models)
        trials = Trials(
            np.tile(models, (len(candidates), 1)),
            np.broadcast_to(experiment.command, (count, len(experiment.command))),
            np.repeat(candidates, len(models), axis=0),
        )
        newest = np.zeros(count, dtype=np.intp)
        sim = evaluator.similarities(trials, experiment.behavior[None], newest)
        return model_fitness(sim.reshape(len(candidates), len(models)))

    genome, _ = evolve(
        genomes,
        config.inner_generations,
        lambda some: pose_fitness(layout.decode(some)),
        genetic,
        rng,
    )
    best: Floats = layout.decode(genome[None])[0]
    return best
