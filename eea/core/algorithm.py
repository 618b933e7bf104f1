"""The Estimation-Exploration Algorithm: rounds of asking the target and modelling it (Sec. 3.2)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from eea.core.angles import Floats
from eea.core.behavior import summarize
from eea.core.bits import BitLayout, pose_layout
from eea.core.checks import ConfigurationError, TargetError, at_most
from eea.core.conditions import Ideal, InBand, Inference, NoInference, OutOfBand
from eea.core.config import EEAConfig
from eea.core.estimation import Estimation
from eea.core.experiment import Context, Experiment, Simulator, Target, reveals
from eea.core.exploration import Exploration
from eea.core.model_evaluator import ModelEvaluator
from eea.core.problem import Problem
from eea.core.session import Answer, Conclusion, Session


def make_inference(
    config: EEAConfig, poses: BitLayout, evaluator: ModelEvaluator, rng: np.random.Generator
) -> Inference:
    """Return the strategy for ``config.condition``; ``poses`` is the hidden angles' genome."""
    if config.condition == "ideal":
        return Ideal()
    if config.condition == "none":
        return NoInference()
    if config.condition == "in-band":
        return InBand(config.in_band)
    return OutOfBand(config.out_of_band, poses, evaluator, config.genetic, rng)


class EEA(Session):
    """One run of the algorithm against one target.

    Parameters
    ----------
    target
        What is to be modelled; it is asked once a round.
    simulator
        Runs the models.
    problem
        What there is to find, to command and to feel: all widths.
    config, seed
        Settings, and the replicate's seed.
    truth
        The target's dimensions (n,) if known: only for OBJ_FIT in the records.

    Raises
    ------
    ConfigurationError
        If a setting is wrong, or the truth has another shape.
    TargetError
        If the simulator is none, or the target of the Ideal condition hides where it began.

    Examples
    --------
    ``for record in EEA(...)`` yields a record as each round ends, and ``run`` is that loop;
    ``examples/toy_robot.py`` has a whole robot. A round that is broken off, by Ctrl-C or by an
    error of the target's, leaves no trace here, and a new loop goes on after the last complete
    one. (The target has moved, of course: it performs that round's command again.)

    >>> from eea.core.bits import action_layout, model_layout
    >>> from eea.core.estimation import EstimationConfig
    >>> from eea.core.exploration import ExplorationConfig
    >>> from eea.core.experiment import Trials
    >>> from eea.core.replay import RecordedLog
    >>> class Wheel(Simulator):
    ...     def simulate(self, trials):
    ...         turned = trials.commands * 0.1 * np.arange(16) + trials.angles
    ...         return RecordedLog(gyro=(trials.models * np.sin(turned))[:, :, None])
    >>> class Robot:
    ...     def perform(self, command):
    ...         trial = Trials(np.array([[0.6]]), command[None], np.array([[0.5]]))
    ...         return Wheel().simulate(trial)
    >>> problem = Problem(
    ...     model_layout([("radius", 1.0, 6)]), action_layout([("speed", 0.0, 2.0)]), ("angle",), 1
    ... )
    >>> small = EEAConfig(steps=16, rounds=2, estimation=EstimationConfig(generations=8),
    ...     exploration=ExplorationConfig(4, 2))
    >>> result = EEA(Robot(), Wheel(), problem, small, truth=[0.6]).run()
    >>> len(result.rounds), result.objective_fitness > result.chance
    (2, True)
    """

    def __init__(
        self,
        target: Target,
        simulator: Simulator,
        problem: Problem,
        config: EEAConfig,
        seed: int = 0,
        truth: Floats | None = None,
    ) -> None:
        super().__init__(target, problem, config, seed, truth)
        if config.condition == "joint":
            raise ConfigurationError(
                "the joint condition is no EEA: it needs eea.joint.JointInference, or, for the "
                "fish, eea.fish_eea"
            )
        poses = pose_layout(problem.hidden, config.genetic.coding)
        searched = [problem.models, problem.actions]
        if config.condition == "out-of-band":
            searched.append(poses)
        bits = min(layout.bits for layout in searched)
        at_most("genetic.mutations", config.genetic.mutations, "the shortest genome's bits", bits)
        if config.condition == "ideal" and not reveals(target):
            raise TargetError(
                "the ideal condition needs a target with start_angles, the hidden angles when "
                f"its last command began; {type(target).__name__} has none"
            )
        self._evaluator = ModelEvaluator(simulator, config.behavior, config.steps, problem.axes)
        rngs = self._rngs
        evaluator, genetic, hidden = self._evaluator, config.genetic, len(problem.hidden)
        self._exploration = Exploration(
            problem.actions, hidden, evaluator, config.exploration, genetic, rngs["exploration"]
        )
        self._estimation = Estimation(
            problem.models, evaluator, config.estimation, genetic, rngs["estimation"]
        )
        self._inference = make_inference(config, poses, evaluator, rngs["inference"])
        self._experiments: list[Experiment] = []

    @contextmanager
    def _undone_if_broken_off(self) -> Iterator[None]:
        """Undo a round's experiment and what it inferred."""
        contexts = [experiment.context for experiment in self._experiments]
        population = self._estimation.population
        try:
            yield
        except BaseException:
            del self._experiments[len(contexts) :]
            for experiment, context in zip(self._experiments, contexts, strict=True):
                experiment.context = context
            self._estimation.go_back(population)
            raise

    def _round(self) -> tuple[Answer, Conclusion]:
        evaluator, trials = self._evaluator, self._evaluator.trials
        before, config = self._estimation.population, self.result.config
        command, action_fitness = self._exploration.choose(
            len(self._experiments), before.models, before.fitness
        )
        answer = self._perform(command)
        if not np.array_equal(answer.command, command):
            action_fitness = None  # nobody has worked it out for what was executed instead
        behavior = summarize(answer.log, config.behavior)[0]
        unknown = Context.unknown(len(self._problem.hidden), 0.0)
        newest = Experiment(answer.command, behavior, unknown, answer.true_angles)
        self._experiments.append(newest)
        rng = self._rngs["inference"]
        model, fitness = self._estimation.run(self._experiments, self._inference, rng)
        spread = self._estimation.population.models.std(axis=0) / self.result.layout.span
        simulated = evaluator.trials - trials
        return answer, Conclusion(action_fitness, model, fitness, newest.context, spread, simulated)
