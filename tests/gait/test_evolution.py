"""NEAT under our reins: same seed, same run, whoever else draws and wherever it stopped."""

from __future__ import annotations

import configparser
import json
import random
import subprocess
import sys
from importlib.resources import files
from typing import Any

import neat
import numpy as np
import pytest

from aquafish_gym.morphology import Morphology
from gait.evolution import Evolution, genome_to_controller
from gait.network import INPUT_COUNT, OUTPUTS


def worth(genome: Any) -> float:
    """Stand in for a swim: structure and weights both count."""
    weights = [c.weight for c in genome.connections.values() if c.enabled]
    return float(np.sin(sum(weights)) + 0.1 * len(genome.nodes) - 0.01 * len(weights))


def advance(evolution: Evolution, generations: int) -> Evolution:
    for _ in range(generations):
        evolution.tell([worth(g) for g in evolution.ask()])
    return evolution


def snapshot(evolution: Evolution) -> str:
    return json.dumps(evolution.state(), allow_nan=False)


def test_same_seed_same_run_whatever_others_draw() -> None:
    random.seed(1)
    quiet = advance(Evolution(30, 5), 6)
    disturbed = Evolution(30, 5)
    for i in range(6):
        random.seed(i)
        random.random()
        advance(disturbed, 1)
    assert snapshot(quiet) == snapshot(disturbed)
    assert snapshot(quiet) != snapshot(advance(Evolution(30, 6), 6))


def test_the_global_generator_is_left_as_it_was_found() -> None:
    random.seed(42)
    expected = random.random()
    random.seed(42)
    advance(Evolution(20, 5), 3)
    assert random.random() == expected


@pytest.mark.parametrize("stop", [0, 1, 7])
def test_a_run_taken_up_again_is_the_run_that_never_stopped(stop: int) -> None:
    straight = advance(Evolution(40, 11), 14)
    stopped = advance(Evolution(40, 11), stop)
    resumed = Evolution.from_state(json.loads(snapshot(stopped)))
    assert snapshot(resumed) == snapshot(stopped)
    assert resumed.state()["generation"] == stop
    assert snapshot(advance(resumed, 14 - stop)) == snapshot(straight)


def test_looking_at_the_state_changes_nothing() -> None:
    plain, watched = Evolution(20, 3), Evolution(20, 3)
    for _ in range(5):
        advance(plain, 1)
        snapshot(watched)
        advance(watched, 1)
        snapshot(watched)
    assert snapshot(plain) == snapshot(watched)


def test_a_run_does_not_depend_on_the_hash_seed() -> None:
    code = (
        "import hashlib, json; from gait.evolution import Evolution\n"
        "e = Evolution(20, 3)\n"
        "for _ in range(4): e.tell([float(len(g.nodes) - 0.1 * len(g.connections)"
        " + next(iter(g.nodes.values())).bias) for g in e.ask()])\n"
        "print(hashlib.sha256(json.dumps(e.state()).encode()).hexdigest())"
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


def test_networks_grow_and_stay_evaluable() -> None:
    evolution = advance(Evolution(40, 2), 15)
    controllers = [genome_to_controller(g, 1.0, Morphology.nominal(), 2) for g in evolution.ask()]
    assert len({c.nodes for c in controllers}) > 1
    assert evolution.species >= 1


def test_tell_wants_a_fitness_for_every_genome() -> None:
    with pytest.raises(ValueError, match="shorter"):
        Evolution(20, 1).tell([0.0])


def test_every_key_of_the_configuration_is_one_that_neat_python_knows() -> None:
    parser = configparser.ConfigParser()
    parser.read_string(files("gait").joinpath("neat.ini").read_text(encoding="utf-8"))
    params = {
        "node_gene_type": neat.DefaultNodeGene,
        "connection_gene_type": neat.DefaultConnectionGene,
        **dict(parser["DefaultGenome"]),
    }
    known = {p.name for p in neat.genome.DefaultGenomeConfig(params)._params}
    # neat-python itself refuses unknown keys of the other sections, but not of this one.
    assert set(parser["DefaultGenome"]) == known
    assert parser.getint("DefaultGenome", "num_inputs") == INPUT_COUNT
    assert parser.getint("DefaultGenome", "num_outputs") == len(OUTPUTS)
