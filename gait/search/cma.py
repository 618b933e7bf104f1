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
from gait.search.schedules import CMA_LEGS, Table, legs

# Random controllers that are looked at, from few poses; of the best of them CMA-ES starts. Starting
# anywhere it sticks, one time in three, where no step is worth anything.
SCREEN_POSES = 2
SIGMA = 0.15  # of the first step
# A mean swims over the run's fixed swims once in so many generations: they are as many as a
# generation's own, and in between it moves little.
FINALS_EVERY = 4

Build = Callable[[NDArray[np.float64]], Controller]


class Strategy:
    """One CMA-ES, with a diagonal covariance matrix, that maximises."""

    def __init__(
        self,
        first: NDArray[np.float64],
        build: Build,
        population: int,
        rng: np.random.Generator,
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
        self._build = build
        self._asked: list[NDArray[np.float64]] = []
        self._turns = 0
        self.final = -np.inf  #: The best that a generation's mean has come to.

    @property
    def mean(self) -> NDArray[np.float64]:
        """Where the next generation is drawn about."""
        return np.array(self._strategy.mean)

    def turn(self, species: int) -> Search:
        """Ask for one generation, whose winner, if it has one, is the controller at its mean."""
        self._asked = self._strategy.ask()
        finalists = [] if self._turns % FINALS_EVERY else [self._build(self.mean)]
        self._turns += 1
        answer = yield Ask([self._build(x) for x in self._asked], finalists, species)
        self._strategy.tell(self._asked, [-value for value in answer.fitness])
        if finalists:
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
        Strategy(screened[i], build, population, child)
        for i, child in zip(best, rng.spawn(starts), strict=True)
    ]
    yield from knockout(going, CMA_LEGS)


def knockout(going: list[Strategy], table: Table) -> Search:
    """Let all go on for a while, the best of them for another, and the best of all for ever."""
    for many, generations in legs(len(going), sys.maxsize, table)[:-1]:
        going = sorted(going, key=lambda one: -one.final)[:many]
        for one in going:
            for _ in range(generations):
                yield from one.turn(len(going))
    last = max(going, key=lambda one: one.final)
    while True:
        yield from last.turn(1)
