"""NEAT: a run depends on its seed alone."""

from __future__ import annotations

import configparser
import random
from importlib.resources import files
from typing import Any

import neat
import numpy as np

from aquafish_gym.morphology import Morphology
from gait.controllers.network import OUTPUTS, Senses
from gait.search.neat import Evolution, genome_to_controller


def worth(genome: Any) -> float:
    """Stand in for a swim: structure and weights both count."""
    weights = [c.weight for c in genome.connections.values() if c.enabled]
    return float(np.sin(sum(weights)) + 0.1 * len(genome.nodes) - 0.01 * len(weights))


def start(size: int, seed: int) -> Evolution:
    build = lambda genome: genome_to_controller(genome, 0.7, Morphology.nominal(), seed)  # noqa: E731
    return Evolution(build, size, seed)


def advance(evolution: Evolution, generations: int) -> Evolution:
    for _ in range(generations):
        evolution.breed([worth(g) for g in evolution.genomes])
    return evolution


def snapshot(evolution: Evolution) -> list[tuple[Any, ...]]:
    """Return all genes of the present generation, in neat-python's order."""
    return [
        (
            genome.key,
            [(key, node.bias) for key, node in genome.nodes.items()],
            [(key, c.weight, c.enabled) for key, c in genome.connections.items()],
        )
        for genome in evolution.genomes
    ]


def test_global_draws_do_not_change_a_run() -> None:
    random.seed(1)
    quiet = advance(start(30, 5), 6)
    disturbed = start(30, 5)
    for i in range(6):
        random.seed(i)
        random.random()
        advance(disturbed, 1)
    assert snapshot(quiet) == snapshot(disturbed)
    assert snapshot(quiet) != snapshot(advance(start(30, 6), 6))


def test_global_generator_is_restored() -> None:
    random.seed(42)
    expected = random.random()
    random.seed(42)
    advance(start(20, 5), 3)
    assert random.random() == expected


def test_configuration_keys_are_known_to_neat_python() -> None:
    parser = configparser.ConfigParser()
    parser.read_string(files("gait.search").joinpath("neat.ini").read_text(encoding="utf-8"))
    params = {
        "node_gene_type": neat.DefaultNodeGene,
        "connection_gene_type": neat.DefaultConnectionGene,
        **dict(parser["DefaultGenome"]),
    }
    known = {p.name for p in neat.genome.DefaultGenomeConfig(params)._params}
    # neat-python itself refuses unknown keys of the other sections, but not of this one.
    assert set(parser["DefaultGenome"]) == known
    assert parser.getint("DefaultGenome", "num_inputs") == len(Senses().names)
    assert parser.getint("DefaultGenome", "num_outputs") == len(OUTPUTS)
