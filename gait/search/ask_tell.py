"""A search proposes controllers with ``ask`` and receives their fitness with ``tell``.

A search knows neither bodies nor files, and draws from a seed alone. So telling a new search the
fitness values that were recorded restores its state.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

from gait.controllers.controller import Controller

# Stages of successive halving: the number of searches, and the generations that each then has.
Stages = Sequence[tuple[int, int]]


class Proposal(NamedTuple):
    """A generation of controllers."""

    controllers: Sequence[Controller]
    #: Candidates for the generation's winner; None for the best of ``controllers``. An empty list
    #: keeps the last winner.
    finalists: Sequence[Controller] | None = None
    species: int | None = None  #: Number of species; None for the number of searches still alive.
    poses: int | None = None  #: Number of poses besides one; None for that of the configuration.


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


# The search of each generation, and the number of searches still alive. The next turn may depend on
# what the searches were told before.
Turns = Iterator[tuple[Search, int]]


class Relay:
    """A search whose generations are those of several searches in turn."""

    def __init__(self, turns: Turns) -> None:
        self._turns = turns

    def ask(self) -> Proposal:
        """See :class:`Search`."""
        self._search, alive = next(self._turns)
        proposal = self._search.ask()
        return proposal if proposal.species else proposal._replace(species=alive)

    def tell(self, fitness: Sequence[float], winner: Controller, final: float) -> None:
        """See :class:`Search`."""
        self._search.tell(fitness, winner, final)


def halve(searches: Sequence[Rated], stages: Stages) -> Turns:
    """Yield the turns of successive halving: at each stage only the best searches go on."""
    alive = list(searches)
    for count, generations in stages:
        alive = sorted(alive, key=lambda search: -search.final)[:count]
        for search in alive:
            for _ in range(generations):
                yield search, len(alive)


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
