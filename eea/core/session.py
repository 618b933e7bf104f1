"""The loop of every method: choose a command, perform it on the target, fit (Sec. 3.2)."""

from __future__ import annotations

import copy
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from eea.core.angles import Floats
from eea.core.behavior import gyro_samples
from eea.core.checks import ConfigurationError, TargetError, brief, callback, finite, whole
from eea.core.config import Config
from eea.core.experiment import Performed, Target, reveals
from eea.core.floating import callers_errors, own_errors
from eea.core.problem import Problem
from eea.core.result import Result, RoundFit, RoundRecord

STREAMS: tuple[str, ...] = ("target", "exploration", "estimation", "inference")
MAXIMUM_SEED = 2**64 - 1

SessionState = TypeVar("SessionState")
Streams = dict[str, np.random.Generator]


def streams(seed: int) -> Streams:
    """Return a replicate's random generators by name; the seed is below 2^64.

    The target has its own stream, so that its hidden angles are the same under every condition and
    comparisons are paired.
    """
    whole("seed", seed, 0, MAXIMUM_SEED)
    rngs = np.random.default_rng(seed).spawn(len(STREAMS))
    return dict(zip(STREAMS, rngs, strict=True))


class Trial(NamedTuple):
    """One trial of the target."""

    command: Floats  #: Executed command, shape (c,).
    gyro: Floats  #: Shape (T, axes), rad/s, finite.
    true_angles: Floats | None  #: The hidden angles (h,) at its start, if the target reveals them.


class Session(ABC, Generic[SessionState]):
    """A run of a method against a target, round by round.

    Subclasses implement ``_choose`` and ``_fit``, which take an immutable state of type
    ``SessionState`` and return a new one. Random generators are copied for each round, so a round
    that raises, or is interrupted by Ctrl-C, changes nothing, and a new loop continues after the
    last complete round. (The target has moved, of course: it performs that round's command again.)

    Parameters
    ----------
    target
        The robot to be modelled; it performs one command a round.
    problem
        The robot's dimensions, commands, hidden angles and signal.
    config, seed
        Settings, and the replicate's seed.
    truth
        The target's dimensions (n,) if known; only OBJ_FIT in the records uses them.
    state, rngs
        State and random generators before the first round.
    """

    def __init__(
        self,
        target: Target,
        problem: Problem,
        config: Config,
        seed: int,
        truth: Floats | None,
        state: SessionState,
        rngs: Streams,
    ) -> None:
        if not callable(getattr(target, "perform", None)):
            raise TargetError(f"target must have a method perform; {brief(target)} has none")
        self.config = config
        self.seed = seed
        self._target = target
        self._problem = problem
        self._truth = None if truth is None else finite("truth", truth, (len(problem.models),))
        self._stopped = "interrupted"
        # Everything that a round changes; it is replaced in one assignment.
        self._kept: tuple[SessionState, Streams, tuple[RoundRecord, ...]] = state, rngs, ()

    @property
    def result(self) -> Result:
        """All complete rounds."""
        state, _, rounds = self._kept
        return Result(
            self.config,
            self.seed,
            self._problem.models,
            self._truth,
            list(rounds),
            self._stopped,
            self._posterior(state),
        )

    @abstractmethod
    def _choose(self, state: SessionState, rngs: Streams) -> tuple[Floats, float | None]:
        """Return the next command (c,) and its ACT_FIT, if it has one."""

    @abstractmethod
    def _fit(
        self, state: SessionState, trial: Trial, rngs: Streams
    ) -> tuple[SessionState, RoundFit]:
        """Return the state and the fit after another trial."""

    def _posterior(self, state: SessionState) -> Any:  # noqa: ARG002
        """Return the posterior, if the method has one."""
        return None

    def _accurate(self, state: SessionState) -> bool:  # noqa: ARG002
        """Return whether the method needs no other round."""
        return False

    def run(self, progress: Callable[[RoundRecord], None] | None = None) -> Result:
        """Run until a stop rule holds, call ``progress`` after each round, return the result."""
        callback("progress", progress)
        for record in self:
            if progress is not None:
                progress(record)
        return self.result

    def __iter__(self) -> Iterator[RoundRecord]:
        """Yield a record for each round until a stop rule holds."""
        rounds = self._kept[2]
        began = time.monotonic() - (rounds[-1].seconds if rounds else 0.0)
        while True:
            state, _, rounds = self._kept
            if self._accurate(state):
                self._stopped = "narrow"
                return
            if len(rounds) >= self.config.rounds:
                self._stopped = "rounds"
                return
            yield self._next(began)

    @own_errors
    def _next(self, began: float) -> RoundRecord:
        """Perform a round, keep it, and return its record."""
        state, kept_rngs, rounds = self._kept
        rngs = copy.deepcopy(kept_rngs)
        command, action_fitness = self._choose(state, rngs)
        trial = self._perform(command)
        if not np.array_equal(trial.command, command):
            action_fitness = None  # this ACT_FIT belongs to another command
        state, fit = self._fit(state, trial, rngs)
        seconds = time.monotonic() - began
        record = RoundRecord.of(
            len(rounds) + 1,
            trial.command,
            action_fitness,
            fit,
            self._problem.models,
            self._truth,
            trial.true_angles,
            seconds,
        )
        self._kept = state, rngs, (*rounds, record)
        return record

    def _perform(self, command: Floats) -> Trial:
        """Perform a command on the target; check its log and read revealed angles."""
        problem = self._problem
        with callers_errors():
            log = self._target.perform(command.copy())
        if isinstance(log, Performed):
            command = _reported("executed command", log.command, len(problem.actions))
            log = log.log
        samples = gyro_samples(log, self.config.steps, problem.axes, "the target")
        if len(samples) != 1:
            raise TargetError(
                f"the target must return the log of one trial; it returned {len(samples)}"
            )
        if not np.isfinite(samples).all():
            raise TargetError("the target's log must be finite; it holds NaN or infinity")
        most = float(np.abs(samples).max())
        if most > problem.fastest:
            raise TargetError(
                f"the target must log at most {problem.fastest:g} rad/s, which no such robot "
                f"exceeds (not degrees/s); it logged {most:.4g}"
            )
        true: Floats | None = None
        if reveals(self._target):
            true = _reported("start_angles", self._target.start_angles, len(problem.hidden))
        return Trial(command, samples[0], true)


def _reported(what: str, value: object, width: int) -> Floats:
    """Return numbers (width,) that the target reported; raise a TargetError for anything else."""
    try:
        return finite(what, value, (width,))  # type: ignore[arg-type]
    except ConfigurationError as error:
        raise TargetError(f"the target's {error}") from None
