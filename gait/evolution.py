"""neat-python, tamed: ask for networks, tell how they did, stop and go on anywhere.

neat-python 2.0 draws from Python's global ``random`` and hands out ids from counters that
advance when they are pickled, so its own checkpoints and worker pools change the run they
save. Here the global generator is set before each of its steps and put back after, nothing is
pickled, and the whole state is plain numbers for JSON: a run that was taken up again is the
run that never stopped, bit for bit.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.resources import as_file, files
from typing import Any, Self

import neat
import numpy as np

from aquafish_gym.morphology import Morphology
from gait.controller import Controller
from gait.network import INPUTS, OUTPUTS


class _Counter:
    """A counter whose next value can be read without using it up."""

    def __init__(self, value: int) -> None:
        self.value = value

    def __next__(self) -> int:
        self.value += 1
        return self.value - 1


class Evolution:
    """One NEAT run: :meth:`ask` for ``size`` genomes, :meth:`tell` their fitness, and again."""

    def __init__(self, size: int, seed: int) -> None:
        self._config = load_config(size)
        self._random = random.Random(seed).getstate()
        with self._global_random():
            self._run = neat.Population(self._config)
        species = max(self._run.species.species) + 1
        self._install_counters(max(self._run.population) + 1, len(OUTPUTS), species)

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

    def state(self) -> dict[str, Any]:
        """Return everything the rest of the run depends on, ready for JSON."""
        run, genome_config = self._run, self._config.genome_config
        return {
            "size": self._config.pop_size,
            "generation": run.generation,
            "random": self._random,
            "next_genome": run.reproduction.genome_indexer.value,
            "next_node": genome_config.node_indexer.value,
            "next_species": run.species.indexer.value,
            "innovations": run.reproduction.innovation_tracker.global_counter,
            "genomes": [_genome_to_list(g) for g in run.population.values()],
            "species": [
                {
                    "key": s.key,
                    "created": s.created,
                    "last_improved": s.last_improved,
                    "representative": s.representative.key,
                    "members": list(s.members),
                    "fitness_history": s.fitness_history,
                }
                for s in run.species.species.values()
            ],
        }

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> Self:
        """Go on from what :meth:`state` returned, also after a trip through JSON."""
        self = cls.__new__(cls)
        self._config = load_config(state["size"])
        version, words, gauss = state["random"]
        self._random = (version, tuple(words), gauss)
        population = {g[0]: _genome_from_list(g) for g in state["genomes"]}
        species = neat.DefaultSpeciesSet(self._config.species_set_config, None)
        for entry in state["species"]:
            one = neat.species.Species(entry["key"], entry["created"])
            one.last_improved = entry["last_improved"]
            one.fitness_history = list(entry["fitness_history"])
            members = {key: population[key] for key in entry["members"]}
            one.update(population[entry["representative"]], members)
            species.species[one.key] = one
            species.genome_to_species.update(dict.fromkeys(members, one.key))
        self._run = neat.Population(self._config, (population, species, state["generation"]))
        self._run.reproduction.innovation_tracker.global_counter = state["innovations"]
        self._install_counters(state["next_genome"], state["next_node"], state["next_species"])
        return self

    def _install_counters(self, genome: int, node: int, species: int) -> None:
        self._run.reproduction.genome_indexer = _Counter(genome)
        self._config.genome_config.node_indexer = _Counter(node)
        self._run.species.indexer = _Counter(species)

    @contextmanager
    def _global_random(self) -> Iterator[None]:
        others = random.getstate()
        random.setstate(self._random)
        try:
            yield
        finally:
            self._random = random.getstate()
            random.setstate(others)


def genome_to_controller(
    genome: Any, clock: float, morphology: Morphology, seed: int
) -> Controller:
    """Return a neat-python genome's network, without hidden nodes that no output hears."""
    inputs, outputs = [-i - 1 for i in range(len(INPUTS))], list(range(len(OUTPUTS)))
    enabled = [key for key, c in genome.connections.items() if c.enabled]
    layers, _ = neat.graphs.feed_forward_layers(inputs, outputs, enabled)
    hidden = [key for layer in layers for key in sorted(layer) if key not in outputs]
    # Outputs may stand last: neat-python never connects from one.
    order = hidden + outputs
    column = {key: i for i, key in enumerate(inputs + order)}
    weights = np.zeros((len(order), len(inputs) + len(order)))
    for source, sink in enabled:
        if sink in column and source in column:
            weight = genome.connections[source, sink].weight
            weights[column[sink] - len(inputs), column[source]] = weight
    return Controller(
        weights=weights,
        bias=np.array([genome.nodes[key].bias for key in order]),
        response=np.array([genome.nodes[key].response for key in order]),
        clock=clock,
        morphology=morphology,
        seed=seed,
    )


def load_config(size: int) -> Any:
    with as_file(files("gait") / "neat.ini") as path:
        config = neat.Config(
            neat.DefaultGenome,
            neat.DefaultReproduction,
            neat.DefaultSpeciesSet,
            neat.DefaultStagnation,
            path,
        )
    config.pop_size = size
    return config


def _genome_to_list(genome: Any) -> list[Any]:
    # In the dictionaries' order, which neat-python's random choices go by.
    return [
        genome.key,
        genome.fitness,
        [[key, n.bias, n.response, n.time_constant] for key, n in genome.nodes.items()],
        [[*key, c.innovation, c.weight, c.enabled] for key, c in genome.connections.items()],
    ]


def _genome_from_list(data: Sequence[Any]) -> Any:
    key, fitness, nodes, connections = data
    genome = neat.DefaultGenome(key)
    genome.fitness = fitness
    for node_key, bias, response, time_constant in nodes:
        node = neat.DefaultNodeGene(node_key)
        node.activation, node.aggregation = "tanh", "sum"
        node.bias, node.response, node.time_constant = bias, response, time_constant
        genome.nodes[node_key] = node
    for source, sink, innovation, weight, enabled in connections:
        gene = neat.DefaultConnectionGene((source, sink), innovation=innovation)
        gene.weight, gene.enabled = weight, enabled
        genome.connections[source, sink] = gene
    return genome
