"""The Estimation-Exploration Algorithm: evolve commands and models in turn (Sec. 3.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from eea.core.angles import Floats
from eea.core.behavior import summarize
from eea.core.checks import TargetError, at_most, instance
from eea.core.conditions import (
    Experiments,
    first_context,
    infer_angles,
    models_range,
    with_context,
)
from eea.core.config import OUT_OF_BAND, PaperConfig
from eea.core.experiment import (
    Experiment,
    RecordedLog,
    Simulator,
    Target,
    Trials,
    perform_angles,
    reveals,
)
from eea.core.fitness import model_fitness
from eea.core.genetic import evolve, next_generation
from eea.core.genome import Genomes
from eea.core.model_evaluator import ModelEvaluator
from eea.core.problem import Problem
from eea.core.result import RoundFit
from eea.core.session import Session, Streams, Trial, streams

# The initial angles of an experiment, and cached similarities of models by genome.
Known = tuple[bytes, dict[bytes, float]]


@dataclass(frozen=True)
class EEAState:
    """State of the algorithm after some rounds."""

    experiments: Experiments
    genomes: Genomes  #: Population of models, shape (N, bits).
    #: Cached similarities of each experiment: surviving models are not simulated again.
    known: tuple[Known, ...] = ()


class EEA(Session[EEAState]):
    """One run of the algorithm against one target; ``for record in EEA(...)`` yields each round.

    Parameters
    ----------
    simulator
        Runs the models.
    target, problem, config, seed, truth
        See :class:`eea.core.session.Session`.

    Raises
    ------
    ConfigurationError
        If a setting is wrong, or the truth has another shape.
    TargetError
        If the simulator lacks a method, or the target of the Ideal condition is not revealing.

    Examples
    --------
    ``examples/toy_robot.py`` defines a whole robot.

    >>> for record in EEA(robot, simulator, problem, PaperConfig()):  # doctest: +SKIP
    ...     print(record.round, record.model_fitness)
    """

    config: PaperConfig

    def __init__(
        self,
        target: Target,
        simulator: Simulator,
        problem: Problem,
        config: PaperConfig,
        seed: int = 0,
        truth: Floats | None = None,
    ) -> None:
        instance("config", config, PaperConfig)
        instance("problem", problem, Problem)
        if config.condition == "ideal" and not reveals(target):
            raise TargetError(
                "the ideal condition needs a target with start_angles, the hidden angles when "
                f"its last command began; {type(target).__name__} has none"
            )
        self._evaluator = ModelEvaluator(simulator, config.steps, problem.axes)
        self._models = problem.models.with_coding(config.genetic.coding)
        self._actions = problem.actions.with_coding(config.genetic.coding)
        bits = min(self._models.bits, self._actions.bits)
        at_most("genetic.mutations", config.genetic.mutations, "the shortest genome's bits", bits)
        rngs = streams(seed)
        models = self._models.random(config.estimation.population, rngs["estimation"])
        super().__init__(target, problem, config, seed, truth, EEAState((), models), rngs)

    def _choose(self, state: EEAState, rngs: Streams) -> tuple[Floats, float | None]:
        """Explore: evolve the command on which the models disagree most."""
        self._simulated = self._evaluator.trials
        layout = self._actions
        config = self.config.exploration
        rng = rngs["exploration"]
        if not state.experiments:  # the models are still random bodies, so Eq. 1 has no information
            return layout.decode(layout.random(1, rng))[0], None
        models = self._models.decode(state.genomes)
        angles = np.zeros(len(self._problem.hidden))
        if config.initial_angles == "random":
            angles = rng.uniform(-np.pi, np.pi, len(angles))
        genome, action_fitness = evolve(
            layout.random(config.population, rng),
            config.generations,
            lambda genomes: self._disagreement(models, layout.decode(genomes), angles),  # Eq. 1
            self.config.genetic,
            rng,
        )
        return layout.decode(genome[None])[0], action_fitness

    def _fit(self, state: EEAState, trial: Trial, rngs: Streams) -> tuple[EEAState, RoundFit]:
        """Estimate: evolve models that explain all experiments."""
        config = self.config
        layout = self._models
        inferring = rngs["inference"]
        context = first_context(config, len(self._problem.hidden), trial.true_angles)
        behavior = summarize(RecordedLog(trial.gyro))[0]
        experiments = (*state.experiments, Experiment(trial.command, behavior, context))
        genomes = state.genomes
        fitness = np.empty(0)
        keys = _keys(genomes)
        known = [(pose, {k: sims[k] for k in keys if k in sims}) for pose, sims in state.known]
        for generation in range(config.estimation.generations):
            if generation:
                genomes = next_generation(genomes, fitness, config.genetic, rngs["estimation"])
            models = layout.decode(genomes)
            if config.condition in OUT_OF_BAND and generation % config.out_of_band.period == 0:
                experiments = infer_angles(  # optAng, Sec. 3.4
                    experiments,
                    models,
                    self._evaluator,
                    config.out_of_band,
                    config.genetic,
                    inferring,
                )
            angles = perform_angles(experiments, len(models), inferring)  # PERFORM, Sec. 3.3
            similarities = self._similarities(genomes, experiments, angles, known)  # Eq. 2
            fitness = model_fitness(similarities)  # Eq. 3
            if config.condition == "in-band":
                done = (generation + 1) / config.estimation.generations
                newest = models_range(  # Sec. 3.3
                    angles[:, -1], similarities[:, -1], config.in_band, done
                )
                experiments = with_context(experiments, -1, newest)
        locked = replace(experiments[-1].context, confidence=1.0)
        experiments = with_context(experiments, -1, locked)
        best = int(np.argmax(fitness))
        spread = models.std(axis=0) / layout.span
        simulated = self._evaluator.trials - self._simulated
        fit = RoundFit(models[best], float(fitness[best]), locked, spread, simulated)
        return EEAState(experiments, genomes, tuple(known)), fit

    def _disagreement(self, models: Floats, commands: Floats, angles: Floats) -> Floats:
        """Return ACT_FIT (A,) of commands (A, c) over models (M, n), all from angles (h,).

        A command under which a model diverges scores below all others.
        """
        trials = Trials(
            np.tile(models, (len(commands), 1)),
            np.repeat(commands, len(models), axis=0),
            np.tile(angles, (len(commands) * len(models), 1)),
        )
        fitness = self._evaluator.disagreements(trials, len(models))
        return np.where(np.isfinite(fitness), fitness, -1.0)

    def _similarities(
        self, genomes: Genomes, experiments: Experiments, angles: Floats, known: list[Known]
    ) -> Floats:
        """Return sim (N, E) of models from angles (N, E, h) in every experiment.

        Models that ``known`` lacks are simulated in one batch and added to it, unless their angles
        are drawn in each generation.
        """
        keys = _keys(genomes)
        models = self._models.decode(genomes)
        new: list[tuple[int, int]] = []
        for e, experiment in enumerate(experiments):
            if not experiment.context.fixed:
                new += [(n, e) for n in range(len(keys))]
                pose = b""
            else:
                pose = experiment.context.min_angle.tobytes()
            if e == len(known) or known[e][0] != pose:
                known[e : e + 1] = [(pose, {})]
            if pose:
                first = {key: n for n, key in reversed(list(enumerate(keys)))}
                new += [(n, e) for key, n in first.items() if key not in known[e][1]]
        result = np.empty(angles.shape[:2])
        if new:
            model, experiment_of = np.array(new).T
            commands = np.stack([each.command for each in experiments])
            observed = np.stack([each.behavior for each in experiments])
            trials = Trials(models[model], commands[experiment_of], angles[model, experiment_of])
            result[model, experiment_of] = self._evaluator.similarities(
                trials, observed, experiment_of
            )
        for n, e in new:
            if known[e][0]:
                known[e][1][keys[n]] = float(result[n, e])
        for e, (pose, sims) in enumerate(known):
            if pose:
                result[:, e] = [sims[key] for key in keys]
        return result


def _keys(genomes: Genomes) -> list[bytes]:
    """Return genomes (N, bits) as keys of a dictionary."""
    return [genome.tobytes() for genome in genomes]
