"""What a run leaves behind: a record a round, and the whole of them with its levels."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

import numpy as np

from eea.core.angles import Floats
from eea.core.bits import BitLayout
from eea.core.checks import TargetError
from eea.core.config import EEAConfig
from eea.core.fitness import chance_level, mid_range_level, quantisation_limit

SCHEMA = "eea.result/1"


@dataclass(frozen=True)
class RoundRecord:
    """What one round did and found; every field is ready for JSON."""

    round: int  #: From 1; also the number of experiments so far.
    command: tuple[float, ...]  #: What the target performed.
    #: ACT_FIT of that command (Eq. 1), or what another strategy that compares commands promised of
    #: it; None for the first, for random and fast ones, and for one that the target performed in
    #: place of another.
    action_fitness: float | None
    model_fitness: float  #: The best MOD_FIT (Eq. 3).
    morphology: tuple[float, ...]  #: The model that has it, n numbers.
    #: The range inferred for the hidden angles in this round's experiment, rad.
    min_angle: tuple[float, ...]
    max_angle: tuple[float, ...]
    #: The truth, and its distance from the range's middle, rad; None if not revealed.
    true_angles: tuple[float, ...] | None
    angle_error: tuple[float, ...] | None
    objective_fitness: float | None  #: OBJ_FIT (Eq. 4); None if the truth is not known.
    #: The model's distance from the truth in each dimension, as a share of its range; None if the
    #: truth is not known.
    dimension_error: tuple[float, ...] | None
    #: The standard deviation over the final population in each dimension, as such a share: what the
    #: models still disagree about.
    spread: tuple[float, ...]
    trials: int  #: Simulated in this round.
    seconds: float  #: Since the run began.

    def to_dict(self) -> dict[str, Any]:
        """Return the record for JSON."""
        return asdict(self)


class Belief(Protocol):
    """What a method believes of the body beyond one best model."""

    @property
    def findings(self) -> list[str]:
        """What a person should know, in sentences, the most important first."""

    @property
    def good(self) -> bool:
        """Whether the best model explains what was felt, so that the intervals can be trusted."""

    @property
    def verdict(self) -> str:
        """The same in a sentence, with the reason."""

    def table(self, mass: float = 0.9) -> dict[str, tuple[float, float, float]]:
        """Return the median and the interval's ends of everything inferred, by name."""

    def interval(self, mass: float = 0.9) -> tuple[Floats, Floats]:
        """Return the ends (n,) of each dimension's equal-tailed interval."""

    def sample(self, count: int, rng: np.random.Generator) -> Floats:
        """Return bodies (count, n) that the trials allow."""

    def to_dict(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""


@dataclass
class Result:
    """A run's settings, rounds and conclusion; readable after every round.

    Examples
    --------
    >>> from eea.core.bits import model_layout
    >>> result = Result(EEAConfig(), 0, model_layout([("length", 2.0, 6)]), np.array([1.0]))
    >>> result.stopped, round(result.mid_range, 3)
    ('interrupted', 1.0)
    """

    config: EEAConfig
    seed: int
    layout: BitLayout  #: The models' genome, for the ranges of the dimensions.
    truth: Floats | None = None  #: The target's dimensions (n,), if known: an oracle.
    rounds: list[RoundRecord] = field(default_factory=list)  #: One record a round.
    #: Why it ended: ``"rounds"``, ``"accurate"``, ``"time"``, under the joint condition also
    #: ``"narrow"`` or ``"robust"``, or ``"interrupted"`` until then.
    stopped: str = "interrupted"
    belief: Belief | None = None  #: How sure it is; only the joint condition knows.

    @property
    def model(self) -> Floats:
        """The last round's best model, shape (n,); ``TargetError`` if there is no round."""
        if not self.rounds:
            raise TargetError("there is no model yet: no round was completed")
        return np.array(self.rounds[-1].morphology)

    @property
    def objective_fitness(self) -> float | None:
        """OBJ_FIT (Eq. 4) of the last round's model; None if the truth or a round is lacking."""
        return self.rounds[-1].objective_fitness if self.rounds else None

    def interval(self, mass: float = 0.9) -> tuple[Floats, Floats]:
        """Return the ends (n,) of each dimension's interval of so much probability.

        Equal-tailed: as much probability lies below it as above. Raises ``TargetError`` where
        the condition is not "joint", or no round was completed.
        """
        return self._sure().interval(mass)

    def width(self, mass: float = 0.9) -> float:
        """Return the dimensions' intervals' mean width, as a share of the ranges; see those."""
        low, high = self.interval(mass)
        return float(((high - low) / self.layout.span).mean())

    def sample(self, count: int, seed: int = 0) -> Floats:
        """Return ``count`` bodies (count, n) drawn from what the trials allow.

        Raises as ``interval``.
        """
        return self._sure().sample(count, np.random.default_rng(seed))

    def _sure(self) -> Belief:
        if self.belief is None:
            raise TargetError(
                'only the condition "joint" knows how sure it is, once a round is completed; '
                f"this is {self.config.condition!r} after {len(self.rounds)} rounds"
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
        """Return everything, ready for JSON."""
        return {
            "schema": SCHEMA,
            "config": self.config.to_dict(),
            "seed": self.seed,
            "stopped": self.stopped,
            "dimensions": list(self.layout.names),
            "morphology": list(self.rounds[-1].morphology) if self.rounds else None,
            "truth": None if self.truth is None else self.truth.tolist(),
            "chance": self.chance,
            "mid_range": self.mid_range,
            "nearest": self.nearest,
            "belief": None if self.belief is None else self.belief.to_dict(),
            "rounds": [record.to_dict() for record in self.rounds],
        }

    def to_json(self) -> str:
        """Return everything as one line of JSON."""
        return json.dumps(self.to_dict(), allow_nan=False)
