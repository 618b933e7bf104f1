"""The results of a run: a record of each round, and all rounds with reference scores."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from eea.core.angles import Floats, circular_distance
from eea.core.checks import TargetError, whole
from eea.core.config import Config
from eea.core.experiment import Context
from eea.core.fitness import (
    chance_level,
    dimension_errors,
    mid_range_level,
    objective_fitness,
    quantisation_limit,
)
from eea.core.genome import BitLayout

RUN_SCHEMA = "eea.result/1"
# decimals, in shares of a range, of sizes that other searches take
SHARE_DECIMALS = 4


def handed_on(bodies: Floats, low: Floats, span: Floats) -> Floats:
    """Return inferred bodies (..., n) to 1e-4 of each range, as other searches take them.

    The last digits of least squares depend on the processor, by the kernels of its linear algebra.
    They mean nothing, but a search for a gait would magnify them. ``low`` (n,) and ``span`` (n,)
    are of the ranges.

    Examples
    --------
    >>> handed_on(np.array([0.800000221]), np.zeros(1), np.array([1.6]))
    array([0.8])
    """
    shares = np.round((bodies - low) / span, SHARE_DECIMALS)
    return np.asarray(low + shares * span)


class RoundFit(NamedTuple):
    """Result of the fit of one round."""

    model: Floats  #: The best model (n,).
    fitness: float  #: Its MOD_FIT (Eq. 3).
    context: Context  #: Context of the newest trial.
    spread: Floats  #: Standard deviation in each dimension, as a share (n,) of its range.
    trials: int  #: Simulated in this round.


@dataclass(frozen=True)
class RoundRecord:
    """Record of one round; every field is ready for JSON."""

    round: int  #: From 1; also the number of experiments so far.
    command: tuple[float, ...]  #: The executed command.
    #: ACT_FIT of the command (Eq. 1). None if the command was not chosen by disagreement, or if
    #: the target executed another one.
    action_fitness: float | None
    model_fitness: float  #: The best MOD_FIT (Eq. 3).
    morphology: tuple[float, ...]  #: The model with the best MOD_FIT, n numbers.
    #: The range inferred for the hidden angles in this round's experiment, rad.
    min_angle: tuple[float, ...]
    max_angle: tuple[float, ...]
    #: The true angles, and their distance from the range's middle, rad; None if not revealed.
    true_angles: tuple[float, ...] | None
    angle_error: tuple[float, ...] | None
    objective_fitness: float | None  #: OBJ_FIT (Eq. 4); None if the truth is not known.
    #: The model's error in each dimension, as a share of its range; None if the truth is unknown.
    dimension_error: tuple[float, ...] | None
    spread: tuple[float, ...]  #: See :class:`RoundFit`.
    trials: int  #: Simulated in this round.
    seconds: float  #: Time since the run began, s.

    @classmethod
    def of(
        cls,
        number: int,
        command: Floats,
        action_fitness: float | None,
        fit: RoundFit,
        layout: BitLayout,
        truth: Floats | None,
        true_angles: Floats | None,
        seconds: float,
    ) -> RoundRecord:
        """Return the record of a round's fit, with errors where the truth is known."""
        errors = off = objective = None
        if truth is not None:
            objective = float(objective_fitness(fit.model, truth, layout))
            errors = tuple(dimension_errors(fit.model, truth, layout).tolist())
        if true_angles is not None:
            off = tuple(circular_distance(fit.context.middle, true_angles).tolist())
        return cls(
            round=number,
            command=tuple(command.tolist()),
            action_fitness=action_fitness,
            model_fitness=fit.fitness,
            morphology=tuple(fit.model.tolist()),
            min_angle=tuple(fit.context.min_angle.tolist()),
            max_angle=tuple(fit.context.max_angle.tolist()),
            true_angles=None if true_angles is None else tuple(true_angles.tolist()),
            angle_error=off,
            objective_fitness=objective,
            dimension_error=errors,
            spread=tuple(fit.spread.tolist()),
            trials=fit.trials,
            seconds=seconds,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the record for JSON."""
        return asdict(self)


@dataclass
class Result:
    """A run's settings, rounds and conclusion; readable after every round.

    A body inferred from logs alone has a posterior, but no rounds and no ``config``.

    Examples
    --------
    >>> from eea.core.config import PaperConfig
    >>> from eea.core.genome import model_layout
    >>> result = Result(PaperConfig(), 0, model_layout([("length", 2.0, 6)]), np.array([1.0]))
    >>> result.stopped, round(result.mid_range, 3)
    ('interrupted', 1.0)
    """

    config: Config | None
    seed: int
    layout: BitLayout  #: The models' genome, with the ranges of the dimensions.
    truth: Floats | None = None  #: The target's true dimensions (n,), if known.
    rounds: list[RoundRecord] = field(default_factory=list)
    #: Why the run ended: ``"rounds"`` or ``"narrow"``; ``"interrupted"`` until then.
    stopped: str = "interrupted"
    #: The posterior of joint inference, an ``eea.infer.answer.Answer``.
    belief: Any = None

    @property
    def method(self) -> str:
        """The condition of a run; "joint" of a body from logs, which has no other."""
        return "joint" if self.config is None else self.config.condition

    @property
    def complete(self) -> bool:
        """Whether there is a model: of a posterior, or of a round."""
        return self.belief is not None or bool(self.rounds)

    @property
    def model(self) -> Floats:
        """The best model (n,), of the posterior or the last round; ``TargetError`` without both."""
        if not self.complete:
            raise TargetError("there is no model yet: no round was completed")
        return np.array(self.rounds[-1].morphology if self.rounds else self.belief.model)

    @property
    def body(self) -> Floats:
        """The best model (n,) for other searches; of joint inference to 1e-4 of each range."""
        return (
            self.model
            if self.belief is None
            else handed_on(self.model, self.layout.low, self.layout.span)
        )

    @property
    def objective_fitness(self) -> float | None:
        """OBJ_FIT (Eq. 4) of ``model``; None if the truth or a model is missing."""
        if self.truth is None or not self.complete:
            return None
        return float(objective_fitness(self.model, self.truth, self.layout))

    def interval(self, mass: float = 0.9) -> tuple[Floats, Floats]:
        """Return the ends (n,) of each dimension's interval of probability ``mass``.

        The interval holds the dimension of ``model``. Where no body explains the trials, the
        interval is the whole range.

        Raises
        ------
        TargetError
            If the condition is not "joint", or no round was completed.
        """
        belief = self._known_belief()
        if not belief.good:
            return np.array(self.layout.low), np.array(self.layout.high)
        low, high = belief.interval(mass)
        return np.minimum(low, self.model), np.maximum(high, self.model)

    def width(self, mass: float = 0.9) -> float:
        """Return the intervals' mean width, as a share of the ranges; see :meth:`interval`."""
        low, high = self.interval(mass)
        return float(((high - low) / self.layout.span).mean())

    def sample(self, count: int, seed: int = 0) -> Floats:
        """Return bodies (count, n) drawn from the posterior, each size to 1e-4 of its range.

        Raises as :meth:`interval`.
        """
        whole("seed", seed, 0)
        bodies: Floats = self._known_belief().sample(count, np.random.default_rng(seed))
        return bodies

    def _known_belief(self) -> Any:
        if self.belief is None:
            raise TargetError(
                'only the condition "joint" has a posterior, after the first round; '
                f"this is {self.method!r} after {len(self.rounds)} rounds"
            )
        return self.belief

    @property
    def chance(self) -> float | None:
        """The mean OBJ_FIT of uniform random genomes, if the truth is known."""
        return None if self.truth is None else chance_level(self.truth, self.layout)

    @property
    def mid_range(self) -> float | None:
        """The OBJ_FIT of the body in the middle of all ranges, if the truth is known."""
        return None if self.truth is None else mid_range_level(self.truth, self.layout)

    @property
    def nearest(self) -> float | None:
        """The OBJ_FIT of the genome nearest to the truth, the quantisation limit, if known."""
        return None if self.truth is None else quantisation_limit(self.truth, self.layout)

    def to_dict(self) -> dict[str, Any]:
        """Return everything, ready for JSON; of a body from logs without what a run has."""
        settings: dict[str, Any] = {}
        rounds: dict[str, Any] = {}
        if self.config is not None:
            settings = {"config": self.config.to_dict(), "seed": self.seed, "stopped": self.stopped}
            rounds = {"rounds": [record.to_dict() for record in self.rounds]}
        return {
            "schema": RUN_SCHEMA,
            **settings,
            "dimensions": list(self.layout.names),
            "morphology": self.model.tolist() if self.complete else None,
            "truth": None if self.truth is None else self.truth.tolist(),
            "objective_fitness": self.objective_fitness,
            "chance": self.chance,
            "mid_range": self.mid_range,
            "nearest": self.nearest,
            "belief": None if self.belief is None else self.belief.to_dict(),
            **rounds,
        }
