"""NEAT: a run depends on its seed alone."""

from __future__ import annotations

import configparser
import random
import subprocess
import sys
from importlib.resources import files
from typing import Any

import neat
import numpy as np

from aquafish_gym.morphology import Morphology
from gait.network import OUTPUTS, Senses
from gait.search.neat import Evolution, genome_to_controller


def worth(genome: Any) -> float:
    """Stand in for a swim: structure and weights both count."""
    weights = [c.weight for c in genome.connections.values() if c.enabled]
    return float(np.sin(sum(weights)) + 0.1 * len(genome.nodes) - 0.01 * len(weights))


def advance(evolution: Evolution, generations: int) -> Evolution:
    for _ in range(generations):
        evolution.tell([worth(g) for g in evolution.ask()])
    return evolution


def snapshot(evolution: Evolution) -> list[tuple[Any, ...]]:
    """Return all genes of the present generation, in neat-python's order."""
    return [
        (
            genome.key,
            [(key, node.bias) for key, node in genome.nodes.items()],
            [(key, c.weight, c.enabled) for key, c in genome.connections.items()],
        )
        for genome in evolution.ask()
    ]


def test_global_draws_do_not_change_a_run() -> None:
    random.seed(1)
    quiet = advance(Evolution(30, 5), 6)
    disturbed = Evolution(30, 5)
    for i in range(6):
        random.seed(i)
        random.random()
        advance(disturbed, 1)
    assert snapshot(quiet) == snapshot(disturbed)
    assert snapshot(quiet) != snapshot(advance(Evolution(30, 6), 6))


def test_global_generator_is_restored() -> None:
    random.seed(42)
    expected = random.random()
    random.seed(42)
    advance(Evolution(20, 5), 3)
    assert random.random() == expected


def test_hash_seed_does_not_change_a_run() -> None:
    code = (
        "import hashlib; from gait.search.neat import Evolution\n"
        "e = Evolution(20, 3)\n"
        "for _ in range(4): e.tell([float(len(g.nodes) - 0.1 * len(g.connections)"
        " + next(iter(g.nodes.values())).bias) for g in e.ask()])\n"
        "genes = [(g.key, list(g.nodes), list(g.connections)) for g in e.ask()]\n"
        "print(hashlib.sha256(repr(genes).encode()).hexdigest())"
    )
    digests = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={"PYTHONHASHSEED": seed, "PATH": ""},
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        ).stdout
        for seed in ("0", "1")
    }
    assert len(digests) == 1


def test_networks_grow() -> None:
    evolution = advance(Evolution(40, 2), 15)
    controllers = [genome_to_controller(g, 1.0, Morphology.nominal(), 2) for g in evolution.ask()]
    assert len({c.nodes for c in controllers}) > 1
    assert evolution.species >= 1


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
