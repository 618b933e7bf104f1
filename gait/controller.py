"""A controller: a feed-forward network as arrays, and the clock it listens to."""

from __future__ import annotations

import json
import math
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, brief, finite_array, integer
from gait.network import INPUTS, OUTPUTS, forward, listen
from gait.policy import Policy

SCHEMA = "gait.controller/2"  # 1 had no checksum
# Nobody's network is this large; a file that says so is broken or meant to hurt.
MAXIMUM_NODES = 1000
MOST_BYTES = 64 * 2**20  # of such a network's file
MAXIMUM_SEED = 2**64 - 1
_HEARD = 9  # entries of an observation


@dataclass(frozen=True, eq=False)
class Controller:
    """A feed-forward network from IMU and clock to three servo speeds.

    Node n computes tanh(2.5 (bias_n + response_n sum_k weights_nk v_k)), where v holds the
    inputs (``network.INPUTS``) and then the nodes' own values, so a node hears only the nodes
    before it. The last three nodes are the outputs, in [-1, 1], in the order of the servos.

    Parameters
    ----------
    weights
        (N, I + N), zero where a node would hear itself or a later one.
    bias, response
        (N,).
    clock
        Frequency of the clock, in Hz.
    morphology, seed
        The body it was evolved on, and the seed of that run.
    sample
        Of a sample of bodies, of which ``morphology`` is then the median, how many they were and a
        hash of them, as ``aquafish_gym.bodies.sample_stamp`` says it; None of one body.

    Raises
    ------
    InvalidArgumentError
        If a shape does not fit, a number is not finite, or a node hears a later one.

    Examples
    --------
    >>> body = Morphology.nominal()
    >>> silent = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, body, seed=0)
    >>> silent
    Controller(3 nodes, 0 connections, clock 0.7 Hz, seed 0)
    >>> silent.policy()(np.zeros(9), 0.0).tolist()
    [0.0, 0.0, 0.0]
    """

    weights: NDArray[np.float64]
    bias: NDArray[np.float64]
    response: NDArray[np.float64]
    clock: float
    morphology: Morphology
    seed: int
    sample: str | None = None

    def __post_init__(self) -> None:
        bias = finite_array("controller.bias", self.bias, (None,))
        nodes = len(bias)
        if not len(OUTPUTS) <= nodes <= MAXIMUM_NODES:
            raise InvalidArgumentError(
                f"controller.bias must have {len(OUTPUTS)} to {MAXIMUM_NODES} entries; got {nodes}"
            )
        response = finite_array("controller.response", self.response, (nodes,))
        weights = finite_array("controller.weights", self.weights, (nodes, len(INPUTS) + nodes))
        if np.triu(weights[:, len(INPUTS) :]).any():
            raise InvalidArgumentError(
                "controller.weights must be zero where a node would hear itself or a later node"
            )
        for name, array in (("bias", bias), ("response", response), ("weights", weights)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        clock = float(finite_array("controller.clock", self.clock, (), 0.0, 50.0, "Hz"))
        object.__setattr__(self, "clock", clock)
        object.__setattr__(self, "seed", integer("controller.seed", self.seed, 0, MAXIMUM_SEED))
        if not isinstance(self.sample, str | None):
            raise InvalidArgumentError(
                f"controller.sample must be text or None; got {brief(self.sample)}"
            )

    @property
    def nodes(self) -> int:
        """How many nodes there are, the three outputs among them."""
        return len(self.bias)

    @property
    def connections(self) -> int:
        """How many weights are not zero."""
        return int(np.count_nonzero(self.weights))

    def genes(self, nodes: int | None = None) -> NDArray[np.float64]:
        """Return clock and network as the rows that ``network.steer`` reads, for one robot.

        They are padded with silent hidden nodes up to ``nodes``, if that is given, so that
        networks of different sizes can run side by side.
        """
        total = self.nodes if nodes is None else nodes
        pad, hidden, inputs = total - self.nodes, self.nodes - len(OUTPUTS), len(INPUTS)
        # Silent nodes stand between the hidden nodes and the outputs.
        place = np.concatenate([np.arange(hidden), np.arange(hidden, self.nodes) + pad])
        table = np.zeros((total, 2 + inputs + total))
        table[place, 0] = self.bias
        table[place, 1] = self.response
        table[place, 2 : 2 + inputs] = self.weights[:, :inputs]
        table[np.ix_(place, 2 + inputs + place)] = self.weights[:, inputs:]
        rows = [row[: 2 + inputs + n] for n, row in enumerate(table)]
        return np.concatenate([[self.clock], *rows])

    def __repr__(self) -> str:
        return (
            f"Controller({self.nodes} nodes, {self.connections} connections, "
            f"clock {self.clock:g} Hz, seed {self.seed})"
        )

    def policy(self) -> Policy:
        """Return this controller ready to steer one robot.

        It hears the first nine entries of an observation, and raises InvalidArgumentError if
        there are fewer, or one of them or the time is not finite.
        """
        genes: list[float] = self.genes().tolist()
        values = [0.0] * (len(INPUTS) + self.nodes)  # scratch space

        def act(observation: ArrayLike, time: float) -> NDArray[np.float64]:
            senses = np.asarray(observation)
            if senses.ndim != 1 or len(senses) < _HEARD:
                raise InvalidArgumentError(
                    f"observation must be {_HEARD} numbers or more in a row; "
                    f"got shape {senses.shape}"
                )
            o = finite_array("observation", senses[:_HEARD], (_HEARD,)).tolist()
            if not math.isfinite(time):
                raise InvalidArgumentError(f"time must be finite; got {time}")
            listen(values, genes[0], time, o[0:3], o[3:6], o[6:9])
            return np.array(forward(genes, self.nodes, values, 0, 1, 0.0))

        return act

    def to_dict(self) -> dict[str, Any]:
        """Return everything as lists and numbers, ready for JSON."""
        return {
            "inputs": list(INPUTS),
            "outputs": list(OUTPUTS),
            "clock": self.clock,
            "seed": self.seed,
            "morphology": self.morphology.to_dict(),
            **({} if self.sample is None else {"sample": self.sample}),
            "bias": self.bias.tolist(),
            "response": self.response.tolist(),
            "weights": self.weights.tolist(),
        }

    @classmethod
    def from_dict(cls, data: object) -> Controller:
        """Read what :meth:`to_dict` returned; InvalidArgumentError if a field is not that."""
        if isinstance(data, dict):
            data = {"sample": None, **data}  # which one body has not
        fields = dict(
            check_fields("controller", data, ("inputs", "outputs", *cls.__dataclass_fields__))
        )
        for name, names in (("inputs", INPUTS), ("outputs", OUTPUTS)):
            if fields.pop(name) != list(names):
                raise InvalidArgumentError(f"controller.{name} must be {', '.join(names)}")
        fields["morphology"] = Morphology.from_json(json.dumps(fields["morphology"]))
        return cls(**fields)

    def save(self, path: Path | str) -> None:
        """Write a ``controller.json``, whole or not at all."""
        write_document(path, self.to_dict(), SCHEMA)

    @classmethod
    def load(cls, path: Path | str) -> Controller:
        """Read a ``controller.json``; InvalidArgumentError if it is none, or damaged."""
        data = read_document(path, SCHEMA, "controller", MOST_BYTES)
        try:
            return cls.from_dict(data)
        except InvalidArgumentError as error:
            raise InvalidArgumentError(f"controller: {path}: {error}") from None


def check_fields(argument: str, data: object, names: Collection[str]) -> dict[str, Any]:
    """Return ``data`` if it is an object of just these fields; the error names the odd ones."""
    if not isinstance(data, dict):
        raise InvalidArgumentError(f"{argument} must be a JSON object; got {brief(data)}")
    odd = ", ".join(sorted(map(str, data.keys() ^ set(names))))
    if odd:
        raise InvalidArgumentError(f"{argument} has missing or unknown fields: {odd}")
    return data
