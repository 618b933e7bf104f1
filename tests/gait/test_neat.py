"""NEAT: a run depends on its seed alone; a genome acts as neat-python's network."""

from __future__ import annotations

import configparser
import random
from importlib.resources import files
from typing import Any

import neat
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers import network
from gait.controllers.controller import Controller
from gait.controllers.network import Senses
from gait.search.neat import Evolution, genome_to_controller
from gait_fakes import INPUT_COUNT, random_genome

BODY = Morphology.nominal()


def convert(genome: Any, **options: Any) -> Controller:
    return genome_to_controller(genome, 0.7, BODY, 0, **options)


def answers(controller: Controller, rows: list[list[float]]) -> list[list[float]]:
    """Return the controller's actions for inputs (T, I), one step after the other."""
    scratch = [0.0] * (INPUT_COUNT + 2 * controller.nodes)
    found = []
    for inputs in rows:
        scratch[:INPUT_COUNT] = inputs
        layout = controller.layout().tolist()
        network.forward(controller.genes(), layout, scratch, 0, 1, 0.0)
        last = INPUT_COUNT + controller.nodes
        found.append(scratch[last - 3 : last])
    return found


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.integers(0, 60), st.integers(0, 2**32))
def test_recurrent_genome_acts_as_neat_pythons_network(
    seed: int, mutations: int, observed: int
) -> None:
    config, genome = random_genome(seed, mutations, feed_forward=False)
    expected = neat.nn.RecurrentNetwork.create(genome, config)
    rows = np.random.default_rng(observed).uniform(-1.0, 1.0, (6, INPUT_COUNT)).tolist()
    found = answers(convert(genome, config=config), rows)
    assert np.allclose(found, [expected.activate(row) for row in rows], atol=1e-12)


def test_recurrent_genome_has_memory() -> None:
    """A hidden node's value arrives a step later, also where there is no cycle."""
    config, genome = random_genome(0, 0, feed_forward=False)
    genome.connections.clear()
    genome.nodes[7] = genome.create_node(config.genome_config, 7)
    for node in genome.nodes.values():
        node.bias, node.response = 0.0, 1.0
    for number, ends in enumerate(((-1, 7), (7, 0))):
        gene = genome.create_connection(config.genome_config, *ends, number)
        gene.weight, gene.enabled = 1.0, True
        genome.connections[ends] = gene
    rows = [[1.0] + [0.0] * (INPUT_COUNT - 1)] * 2
    late, at_once = answers(convert(genome, config=config), rows), answers(convert(genome), rows)
    assert late[0][0] == 0.0
    assert late[1][0] == at_once[0][0] == pytest.approx(np.tanh(2.5 * np.tanh(2.5)))


def test_disabled_connections_and_nodes_without_effect_are_left_out() -> None:
    config, genome = random_genome(4, 40)
    orphan = genome.create_node(config.genome_config, 9999)
    orphan.activation = "relu"  # reaches no output
    genome.nodes[9999] = orphan
    controller = convert(genome)
    used = [c for c in genome.connections.values() if c.enabled]
    assert controller.connections <= len(used) < len(genome.connections)
    assert controller.nodes < len(genome.nodes)


def test_genome_of_another_robot_is_refused() -> None:
    config, genome = random_genome(1, 0)
    with pytest.raises(InvalidArgumentError, match=r"inputs -1 to -9.*from -1[01] to"):
        convert(genome, senses=Senses(clock=0))
    with pytest.raises(InvalidArgumentError, match=r"config must have 17 inputs.*got 11"):
        convert(genome, senses=Senses(fins=True), config=config)
    config.genome_config.output_keys = [0, 1, 2, 3]
    with pytest.raises(InvalidArgumentError, match=r"config must have 3 outputs.*got 4"):
        convert(genome, config=config)
    del genome.nodes[2]
    with pytest.raises(InvalidArgumentError, match=r"output nodes 0, 1, 2.*has no 2"):
        convert(genome)


def test_cycle_is_refused_without_a_recurrent_configuration() -> None:
    for seed in range(20):
        config, genome = random_genome(seed, 60, feed_forward=False)
        recurrent = convert(genome, config=config)
        if not np.triu(recurrent.weights[:, INPUT_COUNT:]).any():
            continue
        with pytest.raises(InvalidArgumentError, match="genome must be feed-forward"):
            convert(genome)
        config.genome_config.feed_forward = True
        with pytest.raises(InvalidArgumentError, match="genome must be feed-forward"):
            convert(genome, config=config)
        return
    pytest.fail("no genome with a cycle was drawn")


@pytest.mark.parametrize("recurrent", [False, True])
@pytest.mark.parametrize(("name", "value"), [("activation", "relu"), ("aggregation", "product")])
def test_other_functions_are_refused_by_node(name: str, value: str, recurrent: bool) -> None:
    config, genome = random_genome(1, 40)
    config.genome_config.feed_forward = not recurrent
    layers, _ = neat.graphs.feed_forward_layers(
        config.genome_config.input_keys, [0, 1, 2],
        [key for key, gene in genome.connections.items() if gene.enabled],
    )  # fmt: skip
    hidden = max(key for layer in layers for key in layer)
    assert hidden > 2
    for node in (1, hidden):
        usual = getattr(genome.nodes[node], name)
        setattr(genome.nodes[node], name, value)
        with pytest.raises(InvalidArgumentError, match=f'"sum"; node {node} has .*"{value}"'):
            convert(genome, config=config)
        setattr(genome.nodes[node], name, usual)


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


def test_a_run_neither_uses_nor_changes_the_global_generator() -> None:
    random.seed(42)
    expected = random.random()
    random.seed(42)
    quiet = advance(start(30, 5), 6)
    assert random.random() == expected
    disturbed = start(30, 5)
    for i in range(6):
        random.seed(i)
        advance(disturbed, 1)
    assert snapshot(quiet) == snapshot(disturbed)
    assert snapshot(quiet) != snapshot(advance(start(30, 6), 6))


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
    assert parser.getint("DefaultGenome", "num_inputs") == len(Senses().names())
    assert parser.getint("DefaultGenome", "num_outputs") == 3
