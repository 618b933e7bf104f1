"""The Estimation-Exploration Algorithm: rounds of asking the target and modelling it (Sec. 3.2)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from eea.core.angles import Floats, circular_distance
from eea.core.behavior import summarize
from eea.core.bits import BitLayout, pose_layout
from eea.core.checks import ConfigurationError, TargetError, at_most, finite, instance, whole
from eea.core.config import EEAConfig
from eea.core.estimation import Estimation
from eea.core.experiment import Context, Experiment, Performed, Simulator, Target, reveals
from eea.core.exploration import Exploration
from eea.core.fitness import dimension_errors, objective_fitness
from eea.core.inference import Ideal, InBand, Inference, NoInference, OutOfBand
from eea.core.laboratory import Laboratory
from eea.core.problem import Problem
from eea.core.result import Result, RoundRecord

STREAMS: tuple[str, ...] = ("target", "exploration", "estimation", "inference")
MAXIMUM_SEED = 2**64 - 1


def streams(seed: int) -> dict[str, np.random.Generator]:
    """Return one replicate's random generators by name; the seed is below 2^64.

    The target has its own, so that the angles it hides are the same under every condition and
    comparisons are paired.
    """
    whole("seed", seed, 0, MAXIMUM_SEED)
    rngs = np.random.default_rng(seed).spawn(len(STREAMS))
    return dict(zip(STREAMS, rngs, strict=True))


def make_inference(
    config: EEAConfig, poses: BitLayout, laboratory: Laboratory, rng: np.random.Generator
) -> Inference:
    """Return the strategy for ``config.condition``; ``poses`` is the hidden angles' genome."""
    if config.condition == "ideal":
        return Ideal()
    if config.condition == "none":
        return NoInference()
    if config.condition == "in-band":
        return InBand(config.in_band)
    return OutOfBand(config.out_of_band, poses, laboratory, config.genetic, rng)


class EEA:
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
        instance("config", config, EEAConfig)
        instance("problem", problem, Problem)
        poses = pose_layout(problem.hidden, config.genetic.coding)
        searched = [problem.models, problem.actions]
        if config.condition == "out-of-band":
            searched.append(poses)
        bits = min(layout.bits for layout in searched)
        at_most("genetic.mutations", config.genetic.mutations, "the shortest genome's bits", bits)
        if truth is not None:
            truth = finite("truth", truth, (len(problem.models),))
        if config.condition == "ideal" and not reveals(target):
            raise TargetError(
                "the ideal condition needs a target with start_angles, the hidden angles when "
                f"its last command began; {type(target).__name__} has none"
            )
        self.result = Result(config, seed, problem.models, truth)
        self._target = target
        self._problem = problem
        self._laboratory = Laboratory(simulator, config.behavior, config.steps, problem.axes)
        rngs = self._rngs = streams(seed)
        laboratory, genetic, hidden = self._laboratory, config.genetic, len(problem.hidden)
        self._exploration = Exploration(
            problem.actions, hidden, laboratory, config.exploration, genetic, rngs["exploration"]
        )
        self._estimation = Estimation(
            problem.models, laboratory, config.estimation, genetic, rngs["estimation"]
        )
        self._inference = make_inference(config, poses, laboratory, rngs["inference"])
        self._experiments: list[Experiment] = []

    def run(self, progress: Callable[[RoundRecord], None] | None = None) -> Result:
        """Run to a stop rule; call ``progress`` after each round.

        Ctrl-C loses only its round: ``result`` has the others, and to run again is to go on.
        """
        for record in self:
            if progress is not None:
                progress(record)
        return self.result

    def __iter__(self) -> Iterator[RoundRecord]:
        """Yield a record a round until a stop rule holds; ``result`` grows with them."""
        config, result = self.result.config, self.result
        began = time.monotonic() - (result.rounds[-1].seconds if result.rounds else 0.0)
        while True:
            fitness = result.rounds[-1].model_fitness if result.rounds else float("-inf")
            if config.accurate is not None and fitness >= config.accurate:
                result.stopped = "accurate"
                return
            if len(result.rounds) >= config.rounds:
                result.stopped = "rounds"
                return
            if config.time_limit is not None and time.monotonic() - began >= config.time_limit:
                result.stopped = "time"
                return
            with self._whole_or_not_at_all():
                record = self._round(began)
                result.rounds.append(record)
            yield record

    @contextmanager
    def _whole_or_not_at_all(self) -> Iterator[None]:
        """Undo a round that is broken off: its experiment, what it inferred, what it drew."""
        contexts = [experiment.context for experiment in self._experiments]
        population = self._estimation.population
        drawn = {name: rng.bit_generator.state for name, rng in self._rngs.items()}
        try:
            yield
        except BaseException:
            del self._experiments[len(contexts) :]
            del self.result.rounds[len(contexts) :]
            for experiment, context in zip(self._experiments, contexts, strict=True):
                experiment.context = context
            self._estimation.go_back(population)
            for name, rng in self._rngs.items():
                rng.bit_generator.state = drawn[name]
            raise

    def _round(self, began: float) -> RoundRecord:
        trials = self._laboratory.trials
        action_fitness: float | None = None
        if self._experiments:
            before = self._estimation.population
            command, action_fitness = self._exploration.run(before.models, before.fitness)
        else:
            command = self._exploration.first()
        newest = self._perform(command)
        if not np.array_equal(newest.command, command):
            action_fitness = None  # nobody has worked it out for what was executed instead
        self._experiments.append(newest)
        rng = self._rngs["inference"]
        morphology, fitness = self._estimation.run(self._experiments, self._inference, rng)
        truth, true, layout = self.result.truth, newest.true_angles, self.result.layout
        objective = None if truth is None else float(objective_fitness(morphology, truth, layout))
        errors = None if truth is None else dimension_errors(morphology, truth, layout)
        off = None if true is None else circular_distance(newest.context.middle, true)
        return RoundRecord(
            round=len(self._experiments),
            command=tuple(newest.command.tolist()),
            action_fitness=action_fitness,
            model_fitness=fitness,
            morphology=tuple(morphology.tolist()),
            min_angle=tuple(newest.context.min_angle.tolist()),
            max_angle=tuple(newest.context.max_angle.tolist()),
            true_angles=None if true is None else tuple(true.tolist()),
            angle_error=None if off is None else tuple(off.tolist()),
            objective_fitness=objective,
            dimension_error=None if errors is None else tuple(errors.tolist()),
            spread=tuple((self._estimation.population.models.std(axis=0) / layout.span).tolist()),
            trials=self._laboratory.trials - trials,
            seconds=time.monotonic() - began,
        )

    def _perform(self, command: Floats) -> Experiment:
        """Let the target perform; what it executed and where it began is noted if it tells."""
        config, problem, hidden = self.result.config, self._problem, len(self._problem.hidden)
        log = self._target.perform(command.copy())
        if isinstance(log, Performed):
            command = _told("executed command", log.command, len(problem.actions))
            log = log.log
        behavior = summarize(log, config.behavior, config.steps, problem.axes, "the target")
        if len(behavior) != 1:
            raise TargetError(
                f"the target must return the log of one trial; it returned {len(behavior)}"
            )
        if not np.isfinite(behavior).all():
            raise TargetError("the target's log must be finite; it holds NaN or infinity")
        true: Floats | None = None
        if reveals(self._target):
            true = _told("start_angles", self._target.start_angles, hidden)
        return Experiment(command, behavior[0], Context.unknown(hidden, 0.0), true)


def _told(what: str, value: object, width: int) -> Floats:
    """Return numbers (width,) that the target told, if they are any."""
    try:
        return finite(what, value, (width,))  # type: ignore[arg-type]
    except ConfigurationError as error:
        raise TargetError(f"the target's {error}") from None
