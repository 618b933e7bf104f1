"""A pytest plugin with which neat-python's tests run on AquaFish's networks; see ``test_peers.py``.

``FeedForwardNetwork.create`` and ``RecurrentNetwork.create`` then return networks whose answers are
those of ``genome_to_controller`` and the compiled ``forward``, and are compared with neat-python's.
A fish has eleven inputs and three outputs: a genome with fewer is given silent ones. A sigmoid is
half a tanh plus a half, so the weights and biases of what reads it are changed to match. Genomes
with other functions stay neat-python's.
"""

from __future__ import annotations

import copy
import os
from collections import Counter
from typing import Any

import neat
import pytest
from neat.nn.feed_forward import FeedForwardNetwork
from neat.nn.recurrent import RecurrentNetwork

from aquafish_gym import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers import network
from gait.search.genome import genome_to_controller

INPUTS = 11
OUTPUTS = 3
KINDS = ("tanh", "sigmoid")
TOLERANCE = 1e-9
calls: Counter[str] = Counter()
took_part: set[str] = set()
largest = 0.0


class Translation:
    """A genome of tanh with a fish's inputs and outputs, and how its answers are scaled."""

    def __init__(self, genome: Any, config: Any) -> None:
        ends = len(config.output_keys)
        links = {key: link for key, link in genome.connections.items() if link.enabled}
        needed = neat.graphs.required_for_output(config.input_keys, config.output_keys, list(links))
        self.used = [key for key in {*needed, *config.output_keys} if key in genome.nodes]
        self.possible = len(config.input_keys) <= INPUTS and ends <= OUTPUTS
        for key in self.used:
            node = genome.nodes[key]
            self.possible &= node.activation in KINDS and node.aggregation == "sum"
        if not self.possible:
            return
        recurrent = not config.feed_forward
        fed = {sink for _, sink in links}
        self.genome = copy.deepcopy(genome)
        self._translate(genome, links, ends, recurrent, fed)
        outputs = [genome.nodes.get(key) for key in range(ends)]
        self.halves = [node is not None and node.activation == "sigmoid" for node in outputs]
        self.silent = [recurrent and key not in fed for key in range(ends)]

    def _translate(
        self, genome: Any, links: Any, ends: int, recurrent: bool, fed: set[int]
    ) -> None:
        """Write the nodes and links of the new genome."""
        # A hidden node of neat-python may have the number of a fish's further outputs.
        names = {key: key if key < ends else key + OUTPUTS for key in self.used}
        nodes: dict[int, Any] = {}
        connections: dict[tuple[int, int], Any] = {}
        for key in self.used:
            node = copy.deepcopy(genome.nodes[key])
            node.activation = "tanh"
            node.key = names[key]
            nodes[node.key] = node
        for (source, sink), link in links.items():
            if sink not in names or (source > -1 and source not in names):
                continue
            new = copy.deepcopy(link)
            if recurrent and source > -1 and source not in fed:
                new.weight = 0.0  # neat-python leaves the node's value at 0
            elif source > -1 and genome.nodes[source].activation == "sigmoid":
                new.weight = link.weight / 2
                node = nodes[names[sink]]
                node.bias += node.response * new.weight
            connections[names.get(source, source), names[sink]] = new
        for key in range(OUTPUTS):
            if key not in nodes:
                node = neat.genes.DefaultNodeGene(key)
                node.bias = 0.0
                node.response = 1.0
                node.activation = "tanh"
                node.aggregation = "sum"
                nodes[key] = node
        self.genome.nodes = nodes
        self.genome.connections = connections


class Answers:
    """A network of either kind that answers by AquaFish's code."""

    fish: Any = None

    def activate(self, inputs: Any) -> list[float]:
        """Return the outputs, compared with neat-python's."""
        global largest
        expected: list[float] = super().activate(inputs)  # type: ignore[misc]
        if self.fish is None:
            calls["by neat-python"] += 1
            return expected
        controller, translation, scratch = self.fish
        scratch[:INPUTS] = [*map(float, inputs), *[0.0] * (INPUTS - len(inputs))]
        raw = network.forward(controller.genes(), controller.layout().tolist(), scratch, 0, 1, 0.0)
        found = [
            0.0 if silent else 0.5 + 0.5 * value if half else value
            for value, half, silent in zip(
                raw, translation.halves, translation.silent, strict=False
            )
        ]
        apart = max(abs(one - other) for one, other in zip(found, expected, strict=True))
        largest = max(largest, apart)
        calls["by the fish"] += 1
        assert apart < TOLERANCE, (found, expected)
        return found

    def reset(self) -> None:
        """Forget, as neat-python does."""
        super().reset()  # type: ignore[misc]
        if self.fish is not None:
            controller, translation, scratch = self.fish
            scratch[INPUTS:] = start_of(translation, controller.nodes)


def start_of(translation: Translation, nodes: int) -> list[float]:
    """Return the first values of all nodes: 0 in neat-python, which for a sigmoid is -1 of tanh."""
    return [-1.0 if any(translation.halves) else 0.0] * (2 * nodes)


def patch(kind: Any) -> None:
    """Let a kind of network answer by AquaFish's code."""
    original = kind.create

    def create(genome: Any, config: Any, *arguments: Any, **options: Any) -> Any:
        net = original(genome, config, *arguments, **options)  # which may draw weights again
        settings = copy.copy(config.genome_config)
        settings.feed_forward = kind is FeedForwardNetwork
        translation = Translation(genome, settings)
        net.__class__ = type("Fish" + kind.__name__, (Answers, kind), {})
        activations = {node.activation for node in genome.nodes.values()}
        # Where a network remembers, the first values of both kinds of nodes would differ.
        mixed = kind is RecurrentNetwork and len(activations) > 1
        if not translation.possible or mixed:
            return net
        own = None
        if kind is RecurrentNetwork:
            own = copy.deepcopy(config)
            own.genome_config.feed_forward = False
            own.genome_config.input_keys = [-i - 1 for i in range(INPUTS)]
            own.genome_config.output_keys = list(range(OUTPUTS))
        try:
            body = Morphology.nominal()
            controller = genome_to_controller(translation.genome, 0.7, body, 0, config=own)
        except InvalidArgumentError as error:
            calls[f"refused: {error}"[:60]] += 1
            return net
        scratch = [0.0] * INPUTS + start_of(translation, controller.nodes)
        net.fish = controller, translation, scratch
        return net

    kind.create = staticmethod(create)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Any:
    """Note whether AquaFish's code answers in a test."""
    before = calls["by the fish"]
    try:
        return (yield)
    finally:
        if calls["by the fish"] > before:
            took_part.add(item.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail if AquaFish's code answered in too few tests."""
    if len(took_part) < int(os.environ["PEER_AT_LEAST"]):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how many tests took part, and how far both were apart."""
    terminalreporter.write_line(f"took part: {len(took_part)}")
    terminalreporter.write_line(f"largest difference: {largest:.1e} in {dict(calls)}")


for _kind in (FeedForwardNetwork, RecurrentNetwork):
    patch(_kind)
