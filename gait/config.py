"""How a gait is evolved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer, one_of
from gait.controller import MAXIMUM_SEED
from gait.rollout import MAXIMUM_THREADS, SECONDS, step_count

DEFAULT_QUANTILE = 0.2


@dataclass(frozen=True, kw_only=True)
class EvolveConfig:
    """How to evolve a gait.

    Examples
    --------
    >>> EvolveConfig(generations=200, seed=3).population
    150
    """

    seed: int = 0
    """The run follows from it alone."""
    generations: int = 60
    """How many in all, those that the directory already holds included."""
    population: int = 150
    """Controllers in a generation."""
    poses: int = 8
    """Random fin poses to swim from besides the zero pose, others in every generation. In a sample
    of bodies, each pose is another body's, and each generation draws others."""
    clock: float = 0.7
    """Frequency of the controllers' clock, in Hz."""
    seconds: float = SECONDS
    """How long a swim lasts, in s."""
    aggregate: Literal["mean", "quantile"] = "mean"
    """What a controller's swims come to: their mean distance, or a low quantile of it, for a gait
    that holds for nearly all bodies and poses rather than for most."""
    quantile: float = DEFAULT_QUANTILE
    """The share of swims that may fall short of the fitness, if aggregate is quantile."""
    threads: int | None = None
    """How many threads swim; every core if not given. No result depends on it."""

    def __post_init__(self) -> None:
        integer("seed", self.seed, 0, MAXIMUM_SEED)
        integer("generations", self.generations, 1, 100_000)
        integer("population", self.population, 10, 10_000)
        integer("poses", self.poses, 0, 1000)
        finite_array("clock", self.clock, (), 0.0, 50.0, "Hz")
        step_count(self.seconds)
        one_of("aggregate", self.aggregate, ("mean", "quantile"))
        finite_array("quantile", self.quantile, (), 0.0, 1.0)
        if self.aggregate == "mean" and self.quantile != DEFAULT_QUANTILE:
            raise InvalidArgumentError(
                f'quantile has a say only with aggregate="quantile"; got {self.quantile:g} with '
                'aggregate="mean"'
            )
        if self.aggregate == "quantile" and not self.poses:
            raise InvalidArgumentError(
                'poses must be at least 1 with aggregate="quantile": one swim has no quantiles'
            )
        if self.threads is not None:
            integer("threads", self.threads, 1, MAXIMUM_THREADS)
