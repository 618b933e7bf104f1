"""Session of asking a target: what every method of modelling it has in common (Sec. 3.2)."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import NamedTuple

import numpy as np

from eea.core.angles import Floats, circular_distance
from eea.core.behavior import Log, signal_samples
from eea.core.checks import ConfigurationError, TargetError, finite, instance, whole
from eea.core.config import EEAConfig
from eea.core.experiment import Context, Performed, Target, reveals
from eea.core.fitness import dimension_errors, objective_fitness
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


class Answer(NamedTuple):
    """What a target did when it was asked for a command."""

    command: Floats  #: Shape (c,): what it executed.
    log: Log  #: Of one trial, of the wanted length, finite.
    samples: Floats  #: Shape (T, axes): the log's signal.
    true_angles: Floats | None  #: Where the hidden angles (h,) began, if it tells.


class Conclusion(NamedTuple):
    """What a round has come to."""

    action_fitness: float | None  #: Of the command, as the exploration worked it out.
    model: Floats  #: The best model (n,).
    model_fitness: float  #: Its MOD_FIT.
    context: Context  #: Where the newest trial's hidden angles began, as far as is known.
    spread: Floats  #: In each dimension, as a share (n,) of its range.
    trials: int  #: Simulated in this round.


class Session(ABC):
    """A method that asks a target round by round and comes to a model of it.

    A method has a ``_round``, which asks and concludes, and ``_undone_if_broken_off``. It takes
    what ``EEA`` does; see there for the parameters and the errors.
    """

    def __init__(
        self,
        target: Target,
        problem: Problem,
        config: EEAConfig,
        seed: int,
        truth: Floats | None,
    ) -> None:
        instance("config", config, EEAConfig)
        instance("problem", problem, Problem)
        if truth is not None:
            truth = finite("truth", truth, (len(problem.models),))
        self.result: Result = Result(config, seed, problem.models, truth)
        self._target = target
        self._problem = problem
        self._rngs = streams(seed)

    @abstractmethod
    def _round(self) -> tuple[Answer, Conclusion]:
        """Ask the target once, and return what it did and what is now believed."""

    @abstractmethod
    def _undone_if_broken_off(self) -> AbstractContextManager[None]:
        """Forget whatever a round that raises has changed."""

    def _stopped(self) -> str | None:
        """Return why this method has enough, if it has, besides the rules that all share."""
        return None

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
            why = self._stopped()
            if why is not None:
                result.stopped = why
                return
            done = len(result.rounds)
            drawn = {name: rng.bit_generator.state for name, rng in self._rngs.items()}
            try:
                with self._undone_if_broken_off():
                    record = self._record(*self._round(), began)
                    result.rounds.append(record)
            except BaseException:
                del result.rounds[done:]
                for name, rng in self._rngs.items():
                    rng.bit_generator.state = drawn[name]
                raise
            yield record

    def _record(self, answer: Answer, concluded: Conclusion, began: float) -> RoundRecord:
        truth, true, layout = self.result.truth, answer.true_angles, self.result.layout
        model, context = concluded.model, concluded.context
        objective = None if truth is None else float(objective_fitness(model, truth, layout))
        errors = None if truth is None else dimension_errors(model, truth, layout)
        off = None if true is None else circular_distance(context.middle, true)
        return RoundRecord(
            round=len(self.result.rounds) + 1,
            command=tuple(answer.command.tolist()),
            action_fitness=concluded.action_fitness,
            model_fitness=concluded.model_fitness,
            morphology=tuple(model.tolist()),
            min_angle=tuple(context.min_angle.tolist()),
            max_angle=tuple(context.max_angle.tolist()),
            true_angles=None if true is None else tuple(true.tolist()),
            angle_error=None if off is None else tuple(off.tolist()),
            objective_fitness=objective,
            dimension_error=None if errors is None else tuple(errors.tolist()),
            spread=tuple(concluded.spread.tolist()),
            trials=concluded.trials,
            seconds=time.monotonic() - began,
        )

    def _perform(self, command: Floats) -> Answer:
        """Let the target perform; what it executed and where it began is noted if it tells."""
        config, problem = self.result.config, self._problem
        log = self._target.perform(command.copy())
        if isinstance(log, Performed):
            command = _told("executed command", log.command, len(problem.actions))
            log = log.log
        samples = signal_samples(log, config.behavior, problem.axes, "the target", config.steps)
        if len(samples) != 1:
            raise TargetError(
                f"the target must return the log of one trial; it returned {len(samples)}"
            )
        if not np.isfinite(samples).all():
            raise TargetError("the target's log must be finite; it holds NaN or infinity")
        true: Floats | None = None
        if reveals(self._target):
            true = _told("start_angles", self._target.start_angles, len(problem.hidden))
        return Answer(command, log, samples[0].astype(np.float64), true)


def _told(what: str, value: object, width: int) -> Floats:
    """Return numbers (width,) that the target told, if they are any."""
    try:
        return finite(what, value, (width,))  # type: ignore[arg-type]
    except ConfigurationError as error:
        raise TargetError(f"the target's {error}") from None
