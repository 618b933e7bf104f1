"""Export a learned multilayer perceptron as a ``Controller``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gait.network import GAIN, OUTPUTS

# A memory node holds this fraction of an input: tanh is linear there, to one part in a million.
MEMORY_SCALE = 1e-3


class Network(NamedTuple):
    """Weights (N, I + N) and biases (N,) of a ``Controller``'s nodes; all responses are 1."""

    weights: NDArray[np.float64]
    bias: NDArray[np.float64]


def dense_network(
    layers: Sequence[tuple[NDArray[np.floating], NDArray[np.floating]]],
    mean: NDArray[np.float64],
    scale: NDArray[np.float64],
) -> Network:
    """Return a stack of dense layers as the nodes of a controller.

    A node computes tanh(2.5 z), so weights and biases are divided by 2.5.

    Parameters
    ----------
    layers
        Weights (out, in) and biases (out,) of each layer, in order; the last has three outputs.
    mean, scale
        (I,) each: the first layer receives (x - mean) / scale of the inputs x.

    Examples
    --------
    >>> layers = [(np.ones((4, 2)), np.zeros(4)), (np.ones((3, 4)), np.zeros(3))]
    >>> dense_network(layers, np.zeros(2), np.ones(2)).weights.shape
    (7, 9)
    """
    inputs, nodes = len(mean), sum(len(bias) for _, bias in layers)
    weights, biases = np.zeros((nodes, inputs + nodes)), np.zeros(nodes)
    begin, sources = 0, slice(0, inputs)
    for matrix, bias in layers:
        end = begin + len(bias)
        weights[begin:end, sources] = matrix / GAIN
        biases[begin:end] = bias / GAIN
        begin, sources = end, slice(inputs + begin, inputs + end)
    weights[:, :inputs] /= scale
    return Network(weights, biases - weights[:, :inputs] @ mean)


def with_memory(network: Network, frames: int) -> Network:
    """Return a network of I inputs equal to one of ``frames`` stacked inputs (F I, latest last).

    Before the three outputs come (F - 1) I memory nodes, which hold the inputs of the F - 1
    previous times.

    Examples
    --------
    >>> with_memory(Network(np.ones((4, 6 + 4)), np.zeros(4)), 3).weights.shape
    (8, 10)
    """
    nodes = len(network.bias)
    inputs = (network.weights.shape[1] - nodes) // frames
    hidden, held = nodes - len(OUTPUTS), (frames - 1) * inputs
    place = np.r_[:hidden, hidden + held : nodes + held]
    weights, bias = np.zeros((nodes + held, inputs + nodes + held)), np.zeros(nodes + held)
    bias[place] = network.bias
    weights[np.ix_(place, inputs + place)] = network.weights[:, frames * inputs :]
    stacked = network.weights[:, : frames * inputs].reshape(nodes, frames, inputs)
    weights[place, :inputs] = stacked[:, -1]
    memory = hidden + np.arange(held)
    earlier = stacked[:, -2::-1].reshape(nodes, held)
    weights[np.ix_(place, inputs + memory)] = earlier / MEMORY_SCALE
    # The first memory nodes copy the inputs; each later group copies the group before it.
    weights[memory[:inputs], np.arange(inputs)] = MEMORY_SCALE / GAIN
    weights[memory[inputs:], inputs + memory[:-inputs]] = 1.0 / GAIN
    return Network(weights, bias)
