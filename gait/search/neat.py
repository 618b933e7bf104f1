"""NEAT (neat-python) with several starts, whose best networks CMA-ES then tunes.

neat-python 2.0 draws from Python's global ``random``. That generator is set before each of its
steps and restored afterwards, so that a run follows from its seed.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.resources import as_file, files
from typing import Any

import neat
import numpy as np

from aquafish_gym.morphology import Morphology
from gait.controller import INTERVAL, Controller
from gait.network import OUTPUTS, Senses
from gait.search import cma
from gait.search.ask_tell import Phases, Proposal, Search, Stages, SuccessiveHalving
from gait.search.templates import Template

DEFAULT_INPUTS = len(Senses().names)
STAGES: Stages = ((6, 50), (2, 60))  # of CMA-ES on the networks that the starts have found

Build = Callable[[Any], Controller]


class Evolution:
    """One run of neat-python: :meth:`ask` returns ``size`` genomes, :meth:`tell` takes fitness."""

    def __init__(
        self,
        size: int,
        seed: int,
        inputs: int = DEFAULT_INPUTS,
        recurrent: bool = False,
        growing: bool = False,
    ) -> None:
        self._config = load_config(size, inputs, recurrent, growing)
        self._random = random.Random(seed).getstate()
        with self._global_random():
            self._run = neat.Population(self._config)

    @property
    def species(self) -> int:
        """Number of species in the present generation."""
        return len(self._run.species.species)

    def ask(self) -> list[Any]:
        """Return the present generation's genomes."""
        return list(self._run.population.values())

    def tell(self, fitness: Sequence[float]) -> None:
        """Receive the fitness of the last genomes, and breed the next generation."""

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


class Start:
    """One NEAT run as a :class:`~gait.search.ask_tell.Search`; it keeps its best network."""

    def __init__(self, evolution: Evolution, build: Build) -> None:
        self._evolution, self._build = evolution, build
        self.best: Controller | None = None
        self.final = -np.inf

    def ask(self) -> Proposal:
        """Return the networks of a generation."""
        networks = [self._build(genome) for genome in self._evolution.ask()]
        return Proposal(networks, species=self._evolution.species)

    def tell(self, fitness: Sequence[float], winner: Controller, final: float) -> None:
        """Breed the next generation."""
        self._evolution.tell(fitness)
        if final > self.final:
            self.best, self.final = winner, final

    def tuner(self, population: int, rng: np.random.Generator) -> cma.Strategy:
        """Return CMA-ES over the weights, the biases and the clock of the best network."""
        best = self.best
        assert best is not None
        template = Template.like(best)
        return cma.Strategy(
            template.vector(best),
            lambda x: template.controller(x, best.clock, best.morphology, best.seed),
            population,
            rng,
        )


def multistart(
    evolutions: Sequence[Evolution],
    build: Build,
    generations: int,
    tuning: tuple[int, np.random.Generator] | None,
) -> Search:
    """Return a search by several NEAT runs, each for some generations; then the best goes on.

    A single run is plain NEAT. ``tuning`` is the population and the random numbers of CMA-ES, which
    then tunes the best network of each run by successive halving; None continues the best run.
    """
    starts = [Start(evolution, build) for evolution in evolutions]
    search = SuccessiveHalving(starts, [(len(starts), generations)])
    if tuning is None:
        return search
    population, rng = tuning

    def tune() -> Search:
        children = zip(starts, rng.spawn(len(starts)), strict=True)
        return cma.halving([start.tuner(population, child) for start, child in children], STAGES)

    return Phases(search, len(starts) * generations, tune)


def genome_to_controller(
    genome: Any,
    clock: float,
    morphology: Morphology,
    seed: int,
    senses: Senses | None = None,
    recurrent: bool = False,
    interval: int = INTERVAL,
) -> Controller:
    """Return a neat-python genome as a controller, without hidden nodes that reach no output."""
    senses = senses or Senses()
    inputs, outputs = [-i - 1 for i in range(len(senses.names))], list(range(len(OUTPUTS)))
    enabled = [key for key, c in genome.connections.items() if c.enabled]
    connected = {sink for _, sink in enabled}
    if recurrent:
        # In neat-python's recurrent networks a node without inputs is 0, not its bias.
        needed = neat.graphs.required_for_output(inputs, outputs, enabled)
        hidden = sorted((needed & connected) - set(outputs))
    else:
        layers, _ = neat.graphs.feed_forward_layers(inputs, outputs, enabled)
        hidden = [key for layer in layers for key in sorted(layer) if key not in outputs]
    # Outputs may stand last: neat-python never connects from one in a feed-forward network.
    order = hidden + outputs
    column = {key: i for i, key in enumerate(inputs + order)}
    weights = np.zeros((len(order), len(inputs) + len(order)))
    for source, sink in enabled:
        if sink in column and source in column:
            weight = genome.connections[source, sink].weight
            weights[column[sink] - len(inputs), column[source]] = weight
    return Controller(
        weights=weights,
        bias=np.array(
            [genome.nodes[key].bias if key in connected or not recurrent else 0.0 for key in order]
        ),
        response=np.array([genome.nodes[key].response for key in order]),
        clock=clock,
        morphology=morphology,
        seed=seed,
        senses=senses,
        layers=(len(order),) if recurrent else None,
        interval=interval,
    )


def load_config(
    size: int, inputs: int = DEFAULT_INPUTS, recurrent: bool = False, growing: bool = False
) -> Any:
    """Return neat-python's configuration for ``size`` genomes.

    ``growing`` ones add a node, and a connection, in every other child, and tolerate larger
    differences within a species. On some bodies good gaits need hidden nodes; on others they are
    found sooner without.
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
    genome.num_inputs, genome.input_keys = inputs, [-i - 1 for i in range(inputs)]
    genome.feed_forward = not recurrent
    if growing:
        genome.node_add_prob = genome.conn_add_prob = 0.5
        config.species_set_config.compatibility_threshold *= 2.0
    return config
