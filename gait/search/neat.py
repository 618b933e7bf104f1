"""NEAT (neat-python) with several starts, whose best networks CMA-ES then tunes.

neat-python 2.0 draws from Python's global ``random``. That generator is set before each of its
steps and restored afterwards, so that a run follows from its seed.
"""

from __future__ import annotations

import random
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.resources import as_file, files
from typing import Any

import neat
import numpy as np

from aquafish_gym.plans import AQUAFISH, BodyPlan
from gait.controllers.controller import Controller
from gait.controllers.network import Senses
from gait.search import cma
from gait.search.ask_tell import Proposal, Stages, Turns, halve, halving_stages
from gait.search.genome import genome_to_controller as genome_to_controller

NEAT_STAGES: Stages = ((6, 50), (2, 60))  # of CMA-ES on the networks that the starts have found

GenomeBuilder = Callable[[Any], Controller]  # from a genome


class Evolution:
    """One run of neat-python as a :class:`~gait.search.ask_tell.Search`, with its best network."""

    def __init__(
        self,
        build: GenomeBuilder,
        size: int,
        seed: int,
        senses: Senses | None = None,
        growing: bool = False,
        plan: BodyPlan = AQUAFISH,
    ) -> None:
        self._build = build
        self._config = load_config(size, senses, growing, plan)
        self._random = random.Random(seed).getstate()
        with self._global_random():
            self._run = neat.Population(self._config)
        self.best: Controller | None = None
        self.final = -np.inf

    @property
    def genomes(self) -> list[Any]:
        """The present generation's genomes."""
        return list(self._run.population.values())

    def ask(self) -> Proposal:
        """Return the networks of the present generation."""
        networks = [self._build(genome) for genome in self.genomes]
        return Proposal(networks, species=len(self._run.species.species))

    def tell(self, fitness: Sequence[float], winner: Controller, final: float) -> None:
        """Keep the winner if it is the best, and breed the next generation."""
        if final > self.final:
            self.best, self.final = winner, final
        self.breed(fitness)

    def breed(self, fitness: Sequence[float]) -> None:
        """Breed the next generation from the fitness of the present one."""

        def assign(genomes: list[tuple[int, Any]], _config: Any) -> None:
            for (_, genome), value in zip(genomes, fitness, strict=True):
                genome.fitness = float(value)

        with self._global_random():
            self._run.run(assign, 1)

    @contextmanager
    def _global_random(self) -> Iterator[None]:
        others = random.getstate()
        random.setstate(self._random)
        try:
            yield
        finally:
            self._random = random.getstate()
            random.setstate(others)


def multistart(
    starts: Sequence[Evolution],
    generations: int,
    tuning: tuple[int, np.random.Generator] | None,
) -> Turns:
    """Yield the turns of several NEAT runs, each for some generations; then the best goes on.

    A single run is plain NEAT. ``tuning`` is the population and the random numbers of CMA-ES, which
    then tunes the best network of each run by successive halving; None continues the best run.
    """
    first = (len(starts), generations)
    if tuning is None:
        yield from halve(starts, [first, (1, sys.maxsize)])
        return
    yield from halve(starts, [first])
    population, rng = tuning
    best = [start.best for start in starts if start.best]
    children = zip(best, rng.spawn(len(best)), strict=True)
    tuners = [cma.tuner(each, population, child) for each, child in children]
    yield from halve(tuners, halving_stages(len(tuners), sys.maxsize, NEAT_STAGES))


def load_config(
    size: int, senses: Senses | None = None, growing: bool = False, plan: BodyPlan = AQUAFISH
) -> Any:
    """Return neat-python's configuration for ``size`` genomes of controllers of a plan.

    ``senses`` are by default ``Senses()``. ``growing`` genomes add a node, and a connection, in
    every other child, and tolerate larger differences within a species. On some bodies good gaits
    need hidden nodes; on others they are found sooner without.
    """
    with as_file(files("gait.search") / "neat.ini") as path:
        config = neat.Config(
            neat.DefaultGenome,
            neat.DefaultReproduction,
            neat.DefaultSpeciesSet,
            neat.DefaultStagnation,
            path,
        )
    config.pop_size = size
    genome = config.genome_config
    inputs = len((senses or Senses()).names(plan))
    genome.num_inputs = inputs
    genome.input_keys = [-i - 1 for i in range(inputs)]
    genome.num_outputs = len(plan.fins)
    genome.output_keys = list(range(genome.num_outputs))
    if growing:
        genome.node_add_prob = genome.conn_add_prob = 0.5
        config.species_set_config.compatibility_threshold *= 2.0
    return config
