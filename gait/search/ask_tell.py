"""A search proposes controllers with ``ask`` and receives their fitness with ``tell``.

A search knows neither bodies nor files, and draws from a seed alone. So telling a new search the
fitness values that were recorded restores its state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import repeat
from typing import NamedTuple, Protocol

from gait.controller import Controller

# Stages of successive halving: the number of searches, and the generations that each then has.
Stages = Sequence[tuple[int, int]]


class Proposal(NamedTuple):
    """A generation of controllers."""

    controllers: Sequence[Controller]
    #: Candidates for the generation's winner; None for the best of ``controllers``. An empty list
    #: keeps the last winner.
    finalists: Sequence[Controller] | None = None
    species: int | None = None  #: Number of species; None for the number of searches still alive.
    poses: int | None = None  #: Number of random poses that suffice; None for all.


class Search(Protocol):
    """A search for the controller with the highest fitness."""

    def ask(self) -> Proposal:
        """Return the next generation."""

    def tell(self, fitness: Sequence[float], winner: Controller, final: float) -> None:
        """Receive the fitness of each controller of the last generation, and of its winner.

        ``final`` is the winner's fitness over the run's fixed swims.
        """


class Rated(Search, Protocol):
    """A search that knows how good its best controller is."""

    @property
    def final(self) -> float:
        """The highest ``final`` so far."""


class SuccessiveHalving:
    """Several searches in turn: after each stage the best go on, after the last one only the best.

    ``stages`` say how many go on at each stage, and the generations that each then has.
    """

    def __init__(self, searches: Sequence[Rated], stages: Stages) -> None:
        self.alive = list(searches)
        self._turns = self._schedule(stages)

    def _schedule(self, stages: Stages) -> Iterator[Rated]:
        for count, generations in stages:
            self._keep(count)
            for search in self.alive:
                yield from repeat(search, generations)
        self._keep(1)
        yield from repeat(self.alive[0])

    def _keep(self, count: int) -> None:
        self.alive = sorted(self.alive, key=lambda search: -search.final)[:count]

    def ask(self) -> Proposal:
        """See :class:`Search`."""
        self._asked = next(self._turns)
        proposal = self._asked.ask()
        if proposal.species is None:
            proposal = proposal._replace(species=len(self.alive))
        return proposal

    def tell(self, fitness: Sequence[float], winner: Controller, final: float) -> None:
        """See :class:`Search`."""
        self._asked.tell(fitness, winner, final)


class Phases:
    """A first search for some generations, then the search that ``then`` returns."""

    def __init__(self, first: Search, generations: int, then: Callable[[], Search]) -> None:
        self._search, self._left, self._then = first, generations, then

    def ask(self) -> Proposal:
        """See :class:`Search`."""
        if not self._left:
            self._search = self._then()
        self._left -= 1
        return self._search.ask()

    def tell(self, fitness: Sequence[float], winner: Controller, final: float) -> None:
        """See :class:`Search`."""
        self._search.tell(fitness, winner, final)


def halving_stages(searches: int, generations: int, table: Stages) -> list[tuple[int, int]]:
    """Return the stages of several searches, where the last survivor has the remaining generations.

    ``generations`` are those of the last survivor over all stages, and ``table`` has the stages of
    six searches. A single search has one stage.

    Examples
    --------
    >>> halving_stages(6, 750, ((6, 50), (3, 100)))
    [(6, 50), (3, 100), (1, 600)]
    """
    stages, left = list[tuple[int, int]](), generations
    for i, (count, most) in enumerate(table if searches > 1 else ()):
        stages.append((min(count, searches) if i else searches, min(most, left)))
        left -= stages[-1][1]
    return [*stages, (1, left)]


def generation_count(stages: Stages) -> int:
    """Return the generations of all searches together."""
    return sum(count * generations for count, generations in stages)
