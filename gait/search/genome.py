"""A genome of neat-python as a controller, whose commands are those of neat-python's network."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import neat
import numpy as np

from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, brief, instance
from gait.controllers.controller import INTERVAL, Controller
from gait.controllers.network import Senses

ACTIVATION, AGGREGATION = "tanh", "sum"  # neat-python's names of what a controller computes


def genome_to_controller(
    genome: Any,
    clock: float,
    morphology: Morphology,
    seed: int,
    senses: Senses | None = None,
    interval: int = INTERVAL,
    config: Any = None,
) -> Controller:
    """Return a neat-python genome as a controller, without nodes that reach no output.

    Parameters
    ----------
    genome
        Its inputs are ``senses.names``, and its outputs the servos of the body's plan. Every node
        that reaches an output has the activation tanh and the aggregation sum.
    clock, morphology, seed, senses, interval
        As of :class:`~gait.controllers.controller.Controller`.
    config
        neat-python's configuration of the run that evolved it. With ``feed_forward = False`` the
        controller's commands are those of ``neat.nn.RecurrentNetwork``, where a node has the other
        nodes' values of the step before. Without a configuration, or with ``feed_forward = True``,
        they are those of ``neat.nn.FeedForwardNetwork``.

    Raises
    ------
    InvalidArgumentError
        If a node has another activation or aggregation, the inputs or outputs are others, or a
        feed-forward network has a cycle; the message names the node.
    """
    for name in ("nodes", "connections"):
        if not isinstance(getattr(genome, name, None), dict):
            raise InvalidArgumentError(
                f"genome must be a genome of neat-python, with nodes and connections; "
                f"got {brief(genome)}"
            )
    senses = Senses() if senses is None else instance("senses", senses, Senses)
    plan = instance("morphology", morphology, Morphology).plan
    inputs = [-i - 1 for i in range(len(senses.names(plan)))]
    outputs = list(range(len(plan.fins)))
    recurrent = config is not None and _is_recurrent(config, len(inputs), len(outputs))
    enabled = [key for key, c in genome.connections.items() if c.enabled]
    _check_ends(genome, enabled, inputs, outputs)
    if recurrent:
        kept = neat.graphs.required_for_output(inputs, outputs, enabled)
        hidden = sorted(kept - set(outputs))
    else:
        layers, kept = neat.graphs.feed_forward_layers(inputs, outputs, enabled)
        hidden = [key for layer in layers for key in sorted(layer) if key not in outputs]
        _check_acyclic(kept - set(hidden) - set(outputs), kept, enabled, outputs)
    order = hidden + outputs
    _check_functions(genome, order)
    column = {key: i for i, key in enumerate(inputs + order)}
    weights = np.zeros((len(order), len(inputs) + len(order)))
    for source, sink in enabled:
        if sink in column and source in column:
            weight = genome.connections[source, sink].weight
            weights[column[sink] - len(inputs), column[source]] = weight
    fed = {sink for _, sink in enabled}
    return Controller(
        weights=weights,
        # A node without inputs has its bias in a feed-forward network, and 0 in a recurrent one.
        bias=np.array([genome.nodes[k].bias if k in fed or not recurrent else 0.0 for k in order]),
        response=np.array([genome.nodes[key].response for key in order]),
        clock=clock,
        morphology=morphology,
        seed=seed,
        senses=senses,
        layers=(len(order),) if recurrent else None,  # one layer reads its own previous values
        interval=interval,
    )


def _is_recurrent(config: Any, inputs: int, outputs: int) -> bool:
    """Return whether a configuration's networks are recurrent; refuse other inputs or outputs."""
    settings = instance("config", config, neat.Config).genome_config
    for what, keys, expected in (
        ("inputs", settings.input_keys, inputs),
        ("outputs", settings.output_keys, outputs),
    ):
        if len(keys) != expected:
            raise InvalidArgumentError(
                f"config must have {expected} {what}, as the controller has; got {len(keys)}"
            )
    return not settings.feed_forward


def _check_ends(
    genome: Any, enabled: Iterable[tuple[int, int]], inputs: list[int], outputs: list[int]
) -> None:
    """Refuse connections from or to what is neither an input nor a node, and missing outputs."""
    missing = [key for key in outputs if key not in genome.nodes]
    if missing:
        raise InvalidArgumentError(
            f"genome must have the output nodes {_listed(outputs)}, one for each servo; it has no "
            f"{_listed(missing)}"
        )
    for source, sink in enabled:
        if sink not in genome.nodes or (source not in genome.nodes and source not in inputs):
            raise InvalidArgumentError(
                f"genome must have inputs -1 to {-len(inputs)}, those of the senses; it has a "
                f"connection from {source} to {sink}"
            )


def _check_acyclic(
    left: Collection[int],
    kept: Collection[int],
    enabled: Iterable[tuple[int, int]],
    outputs: list[int],
) -> None:
    """Refuse nodes that no order can evaluate, and connections that leave an output."""
    leaving = [source for source, sink in enabled if source in outputs and sink in kept]
    if left or leaving:
        raise InvalidArgumentError(
            f"genome must be feed-forward, without config; got a cycle or an output that is an "
            f"input, at node {_listed(sorted(left) or leaving[:1])}. Give the config of its run, "
            "with feed_forward = False"
        )


def _check_functions(genome: Any, order: Iterable[int]) -> None:
    """Refuse nodes that compute something else than a controller's."""
    for key in order:
        node = genome.nodes[key]
        if (node.activation, node.aggregation) != (ACTIVATION, AGGREGATION):
            raise InvalidArgumentError(
                f'genome must have nodes with the activation "{ACTIVATION}" and the aggregation '
                f'"{AGGREGATION}"; node {key} has "{node.activation}" and "{node.aggregation}". '
                "gait.swim takes any network as a function"
            )


def _listed(keys: Iterable[int]) -> str:
    return ", ".join(map(str, keys))
