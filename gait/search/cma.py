"""CMA-ES (pycma) over the free numbers of a class of controllers, with several starts.

A run has some 20,000 controllers for one or two hundred numbers, too few to learn a full
covariance matrix: it stays diagonal (Ros and Hansen, A simple modification in CMA-ES achieving
linear time and space complexity, 2008).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gait.controllers.controller import Controller
from gait.search.ask_tell import Proposal, Stages, Turns, halve, halving_stages
from gait.search.templates import Template

# CMA-ES starts from the best of many random controllers. From a random one, it sticks one time in
# three where no step improves anything. All are tried from a few poses. There the best are those
# that happen to begin in step with their clock, so a shortlist of them swims from more poses.
CANDIDATE_POSES = 2
SHORTLIST = 100
SHORTLIST_POSES = 15
SIGMA = 0.15  # initial step size
REFINING = 0.05  # that of a gait which already swims
# The controller at the mean swims the run's fixed swims once in this many generations: they take
# as long as a generation, and the mean moves little in between.
FINALS_EVERY = 4
STAGES: Stages = ((6, 50), (3, 100))

Build = Callable[[NDArray[np.float64]], list[Controller]]  # of vectors (P, D)


def evolution_strategy(
    first: NDArray[np.float64],
    population: int,
    rng: np.random.Generator,
    sigma: float,
    diagonal: bool = False,
) -> Any:
    """Return pycma's CMA-ES from a vector (D,), which draws from ``rng`` and never stops itself."""
    import cma  # slow to import

    unlimited = ("maxiter", "tolstagnation", "tolflatfitness", "tolconditioncov", "tolfacupx")
    options = {
        "popsize": population,
        "CMA_diagonal": diagonal,
        "seed": np.nan,  # leaves numpy's global generator alone
        "randn": lambda *shape: rng.standard_normal(shape),
        "verbose": -9,
        **dict.fromkeys((*unlimited, "tolupsigma"), np.inf),
        **dict.fromkeys(("tolx", "tolfun", "tolfunhist", "tolfunrel"), 0.0),
    }
    return cma.CMAEvolutionStrategy(first, sigma, options)


class Strategy:
    """One CMA-ES with a diagonal covariance matrix, as a :class:`~gait.search.ask_tell.Search`.

    The winner of a generation is the controller at the mean of the distribution.
    """

    def __init__(
        self,
        first: NDArray[np.float64],
        build: Build,
        population: int,
        rng: np.random.Generator,
        sigma: float = SIGMA,
    ) -> None:
        self._strategy = evolution_strategy(first, population, rng, sigma, diagonal=True)
        self._build = build
        self._generation = 0
        self.final = -np.inf

    def ask(self) -> Proposal:
        """Return a generation drawn from the distribution, and at times its mean."""
        self._vectors: list[NDArray[np.float64]] = self._strategy.ask()
        count = len(self._vectors)
        final = [self._strategy.mean] if self._generation % FINALS_EVERY == 0 else []
        built = self._build(np.array([*self._vectors, *final]))
        return Proposal(built[:count], built[count:])

    def tell(self, fitness: Sequence[float], winner: Controller, final: float) -> None:  # noqa: ARG002
        """Update the distribution."""
        self._strategy.tell(self._vectors, [-value for value in fitness])
        if self._generation % FINALS_EVERY == 0:
            self.final = max(self.final, final)
        self._generation += 1


def tuner(
    first: Controller, population: int, rng: np.random.Generator, sigma: float = SIGMA
) -> Strategy:
    """Return CMA-ES over the weights, the biases and the clock of a controller."""
    template = Template.like(first)
    return Strategy(
        template.vector(first),
        lambda vectors: template.controllers(vectors, first),
        population,
        rng,
        sigma,
    )


class Screening:
    """One generation of random controllers (S, D), of which the best ``kept`` stay."""

    def __init__(
        self, vectors: NDArray[np.float64], build: Build, kept: int, poses: int, restarts: int
    ) -> None:
        self.vectors, self._build = vectors, build
        self._kept = kept
        self._poses = poses
        self._restarts = restarts

    def ask(self) -> Proposal:
        """Return all of them."""
        return Proposal(self._build(self.vectors), None, self._restarts, self._poses)

    def tell(self, fitness: Sequence[float], winner: Controller, final: float) -> None:  # noqa: ARG002
        """Keep the best."""
        best = np.argsort(fitness, kind="stable")[::-1][: self._kept]
        self.vectors = self.vectors[best]


def screenings(candidates: int, restarts: int, poses: int) -> list[tuple[int, int]]:
    """Return how many controllers each screening keeps, and from how many poses besides one.

    ``poses`` are those of a generation, 0 for the zero pose alone.

    Examples
    --------
    >>> screenings(1200, 6, 6)
    [(100, 2), (6, 15)]
    """
    few = min(CANDIDATE_POSES, poses)
    if poses and restarts < SHORTLIST < candidates:
        return [(SHORTLIST, few), (restarts, SHORTLIST_POSES)]
    return [(restarts, few)]


def multistart(
    candidates: NDArray[np.float64],
    build: Build,
    population: int,
    restarts: int,
    poses: int,
    rng: np.random.Generator,
) -> Turns:
    """Yield the turns of a search from the best of random candidates (S, D).

    They are screened as :func:`screenings` says for ``poses``. Then ``restarts`` searches start,
    each with ``population`` controllers in a generation, and the best go on by successive halving.
    All random numbers come from ``rng``.
    """
    for kept, count in screenings(len(candidates), restarts, poses):
        screening = Screening(candidates, build, kept, count, restarts)
        yield screening, restarts
        candidates = screening.vectors
    starts = zip(candidates, rng.spawn(restarts), strict=True)
    strategies = [Strategy(x, build, population, child) for x, child in starts]
    yield from halve(strategies, halving_stages(restarts, sys.maxsize, STAGES))
