"""NEAT, by neat-python: several starts, of which the best goes on and has its weights polished.

neat-python 2.0 draws from Python's global ``random``. Here that generator is set before each of its
steps and put back after, so that a run follows from its seed.
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
from gait.search.asking import Ask, Search
from gait.search.schedules import POLISHING_LEGS
from gait.search.templates import Template

USUAL = len(Senses().names)  # inputs

Build = Callable[[Any], Controller]


class Evolution:
    """One NEAT run: :meth:`ask` for ``size`` genomes, :meth:`tell` their fitness, and again."""

    def __init__(
        self,
        size: int,
        seed: int,
        inputs: int = USUAL,
        recurrent: bool = False,
        lively: bool = False,
    ) -> None:
        self._config = load_config(size, inputs, recurrent, lively)
        self._random = random.Random(seed).getstate()
        with self._global_random():
            self._run = neat.Population(self._config)

    @property
    def species(self) -> int:
        """How many species the present generation falls into."""
        return len(self._run.species.species)

    def ask(self) -> list[Any]:
        """Return the present generation's genomes."""
        return list(self._run.population.values())

    def tell(self, fitness: Sequence[float]) -> None:
        """Say how good the genomes of the last :meth:`ask` are, and breed the next generation."""

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


class _Start:
    """An evolution, and its best network."""

    def __init__(self, evolution: Evolution, build: Build) -> None:
        self.evolution, self.build = evolution, build
        self.best: Controller | None = None
        self.final = -np.inf

    def turn(self) -> Search:
        """Ask for one generation."""
        networks = [self.build(genome) for genome in self.evolution.ask()]
        answer = yield Ask(networks, None, self.evolution.species)
        self.evolution.tell(answer.fitness)
        if answer.final > self.final:
            self.best, self.final = answer.winner, answer.final

    def polisher(self, population: int, rng: np.random.Generator) -> cma.Strategy:
        """Return a search about the best network."""
        best = self.best
        assert best is not None
        template = Template.like(best)
        return cma.Strategy(
            template.vector(best),
            lambda x: template.controller(x, best.clock, best.morphology, best.seed),
            population,
            rng,
        )


def race(
    evolutions: Sequence[Evolution],
    build: Build,
    generations: int,
    polishing: tuple[int, np.random.Generator] | None,
) -> Search:
    """Evolve each for some generations, and polish what they come to; the best goes on.

    Parameters
    ----------
    evolutions
        The starts. One alone is NEAT as it is.
    build
        Makes a controller of a genome.
    generations
        Of each.
    polishing
        How many controllers a generation CMA-ES then has, on the weights, the biases and the clock
        of each one's best network, and its random numbers; None to evolve the best for ever.
    """
    starts = [_Start(evolution, build) for evolution in evolutions]
    for start in starts:
        for _ in range(generations):
            yield from start.turn()
    if polishing is None:
        best = max(starts, key=lambda one: one.final)
        while True:
            yield from best.turn()
    population, rng = polishing
    yield from cma.knockout(
        [
            start.polisher(population, child)
            for start, child in zip(starts, rng.spawn(len(starts)), strict=True)
        ],
        POLISHING_LEGS,
    )


def genome_to_controller(
    genome: Any,
    clock: float,
    morphology: Morphology,
    seed: int,
    senses: Senses | None = None,
    recurrent: bool = False,
    interval: int = INTERVAL,
) -> Controller:
    """Return a neat-python genome's network, without hidden nodes that no output hears."""
    senses = senses or Senses()
    inputs, outputs = [-i - 1 for i in range(len(senses.names))], list(range(len(OUTPUTS)))
    enabled = [key for key, c in genome.connections.items() if c.enabled]
    told = {sink for _, sink in enabled}
    if recurrent:
        # A node that hears nothing says 0 in neat-python's recurrent networks, not its bias.
        needed = neat.graphs.required_for_output(inputs, outputs, enabled)
        hidden = sorted((needed & told) - set(outputs))
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
            [genome.nodes[key].bias if key in told or not recurrent else 0.0 for key in order]
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
    size: int, inputs: int = USUAL, recurrent: bool = False, lively: bool = False
) -> Any:
    """Return neat-python's configuration for so many genomes of so many inputs.

    Lively ones add a node, and a connection, in every other child, and are one species although
    they differ in more. On some bodies the good gaits need hidden nodes, and are not found without;
    on others they do not, and are found sooner without.
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
    if lively:
        genome.node_add_prob = genome.conn_add_prob = 0.5
        config.species_set_config.compatibility_threshold *= 2.0
    return config
