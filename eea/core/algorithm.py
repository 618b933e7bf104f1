"""The Estimation-Exploration Algorithm: evolve commands and models in turn (Sec. 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

from eea.core.angles import Floats
from eea.core.behavior import summarize
from eea.core.checks import TargetError, at_most, instance
from eea.core.conditions import Experiments, Ideal, InBand, Inference, NoInference, OutOfBand
from eea.core.config import PaperConfig
from eea.core.estimation import Estimation, Population
from eea.core.experiment import Experiment, RecordedLog, Simulator, Target, reveals
from eea.core.exploration import Exploration
from eea.core.genome import BitLayout, pose_layout
from eea.core.model_evaluator import ModelEvaluator
from eea.core.problem import Problem
from eea.core.result import RoundFit, RoundRecord
from eea.core.session import Session, Streams, Trial, streams


@dataclass(frozen=True)
class EEAState:
    """What the algorithm knows after some rounds."""

    experiments: Experiments
    population: Population


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
        poses, genetic = pose_layout(problem.hidden), config.genetic
        searched = [problem.models, problem.actions]
        if config.condition == "out-of-band":
            searched.append(poses)
        bits = min(layout.bits for layout in searched)
        at_most("genetic.mutations", genetic.mutations, "the shortest genome's bits", bits)
        if config.condition == "ideal" and not reveals(target):
            raise TargetError(
                "the ideal condition needs a target with start_angles, the hidden angles when "
                f"its last command began; {type(target).__name__} has none"
            )
        evaluator = ModelEvaluator(simulator, config.steps, problem.axes)
        self._evaluator = evaluator
        self._inference = make_inference(config, poses, evaluator)
        self._exploration = Exploration(
            problem.actions, len(problem.hidden), evaluator, config.exploration, genetic
        )
        self._estimation = Estimation(problem.models, evaluator, config.estimation, genetic)
        rngs = streams(seed)
        state = EEAState((), self._estimation.random(rngs["estimation"]))
        super().__init__(target, problem, config, seed, truth, state, rngs)

    def _choose(self, state: EEAState, rngs: Streams) -> tuple[Floats, float | None]:
        """Explore: evolve a command about which the models disagree."""
        self._simulated = self._evaluator.trials
        if not state.experiments:
            return self._exploration.random(rngs["exploration"]), None
        return self._exploration.disputed(state.population.models, rngs["exploration"])

    def _fit(self, state: EEAState, trial: Trial, rngs: Streams) -> tuple[EEAState, RoundFit]:
        """Estimate: evolve models that explain all experiments."""
        behavior = summarize(RecordedLog(trial.gyro))[0]
        context = self._inference.first_context(len(self._problem.hidden), trial.true_angles)
        newest = Experiment(trial.command, behavior, context, trial.true_angles)
        population, experiments = self._estimation.evolve(
            state.population,
            (*state.experiments, newest),
            self._inference,
            rngs["estimation"],
            rngs["inference"],
        )
        model, fitness = population.best
        spread = population.models.std(axis=0) / self._problem.models.span
        simulated = self._evaluator.trials - self._simulated
        fit = RoundFit(model, fitness, experiments[-1].context, spread, simulated)
        return EEAState(experiments, population), fit

    def _why_stop(self, state: EEAState, rounds: tuple[RoundRecord, ...]) -> str | None:  # noqa: ARG002
        """Stop once a model is accurate enough."""
        accurate = self.config.accurate
        enough = accurate is not None and rounds and rounds[-1].model_fitness >= accurate
        return "accurate" if enough else None


def make_inference(config: PaperConfig, poses: BitLayout, evaluator: ModelEvaluator) -> Inference:
    """Return the strategy for ``config.condition``; ``poses`` is the hidden angles' genome."""
    if config.condition == "ideal":
        return Ideal()
    if config.condition == "none":
        return NoInference()
    if config.condition == "in-band":
        return InBand(config.in_band)
    return OutOfBand(config.out_of_band, poses, evaluator, config.genetic)
