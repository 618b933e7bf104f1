"""CMA-ES over the numbers of a class of controllers, by pycma; of many starts the best go on.

With some 20,000 controllers to spend on a hundred or two of free numbers there is no time to learn
how these depend on each other: the covariance matrix stays diagonal (Ros and Hansen, A simple
modification in CMA-ES achieving linear time and space complexity, 2008).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gait.controller import Controller
from gait.search.asking import Ask, Search
from gait.search.schedules import legs

# Random controllers that are looked at, from few poses; of the best of them CMA-ES starts. Starting
# anywhere it sticks, one time in three, where no step is worth anything.
SCREEN_POSES = 2
SIGMA = 0.15  # of the first step

Build = Callable[[NDArray[np.float64]], Controller]


class Strategy:
    """One CMA-ES, with a diagonal covariance matrix, that maximises."""

    def __init__(
        self, first: NDArray[np.float64], population: int, rng: np.random.Generator
    ) -> None:
        import cma  # slowly, and only where it is needed

        never: dict[str, Any] = dict.fromkeys(("tolx", "tolfun", "tolfunhist", "tolfunrel"), 0.0)
        options = {
            "popsize": population,
            "CMA_diagonal": True,
            "seed": np.nan,  # numpy's global generator is not touched
            "randn": lambda *shape: rng.standard_normal(shape),
            "verbose": -9,
            "maxiter": np.inf,
            "tolstagnation": np.inf,
            "tolflatfitness": np.inf,
            "tolconditioncov": np.inf,
            "tolfacupx": np.inf,
            "tolupsigma": np.inf,
            **never,
        }
        self._strategy = cma.CMAEvolutionStrategy(first, SIGMA, options)
        self._asked: list[NDArray[np.float64]] = []
        self.final = -np.inf  #: The best that a generation's mean has come to.

    @property
    def mean(self) -> NDArray[np.float64]:
        """Where the next generation is drawn about."""
        return np.array(self._strategy.mean)

    def turn(self, build: Build, species: int) -> Search:
        """Ask for one generation, whose winner is the controller at its mean."""
        self._asked = self._strategy.ask()
        answer = yield Ask([build(x) for x in self._asked], [build(self.mean)], species)
        self._strategy.tell(self._asked, [-value for value in answer.fitness])
        self.final = max(self.final, answer.final)


def race(
    screened: NDArray[np.float64],
    build: Build,
    population: int,
    starts: int,
    rng: np.random.Generator,
) -> Search:
    """Search among random vectors (S, D) first, then from the best of them.

    Parameters
    ----------
    screened
        Vectors to choose the starts from.
    build
        Makes a controller of a vector.
    population
        Controllers a generation.
    starts
        How many CMA-ES begin.
    rng
        Everything random.
    """
    answer = yield Ask([build(x) for x in screened], None, starts, SCREEN_POSES)
    best = np.argsort(answer.fitness, kind="stable")[::-1][:starts]
    going = [
        Strategy(screened[i], population, child)
        for i, child in zip(best, rng.spawn(starts), strict=True)
    ]
    for many, generations in legs(starts, sys.maxsize)[:-1]:
        going = sorted(going, key=lambda one: -one.final)[:many]
        for one in going:
            for _ in range(generations):
                yield from one.turn(build, len(going))
    last = max(going, key=lambda one: one.final)
    while True:
        yield from last.turn(build, 1)


def polish(
    first: NDArray[np.float64], build: Build, population: int, rng: np.random.Generator
) -> Search:
    """Search about one vector (D,)."""
    strategy = Strategy(first, population, rng)
    while True:
        yield from strategy.turn(build, 1)
