"""A controller: a small network as arrays, what it senses, and the clock it listens to."""

from __future__ import annotations

import json
import math
from collections.abc import Collection
from dataclasses import asdict, dataclass, replace
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.base import TIMESTEP
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.runs.storage import read_document, write_document
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    flag,
    integer,
    one_of,
)
from gait.network import OUTPUTS, Senses, respond
from gait.policy import Policy

SCHEMA = "gait.controller/2"  # 1 had no checksum
# Nobody's network is this large; a file that says so is broken or meant to hurt.
MAXIMUM_NODES = 1000
MAXIMUM_HARMONICS = 32
MOST_BYTES = 64 * 2**20  # of such a network's file
MAXIMUM_SEED = 2**64 - 1
INTERVAL = 5  # physics steps that an action is held for, as in AquaFish-v0
IMU_AND_CLOCK = Senses()
# What a file leaves out: as most controllers have it.
USUAL: dict[str, Any] = {
    "senses": asdict(IMU_AND_CLOCK),
    "layers": None,
    "output": "tanh",
    "interval": INTERVAL,
    "sample": None,
}
FELT = tuple(Senses.__dataclass_fields__)
_HEARD = 9  # entries of an observation
_NO_GAIN = (1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Controller:
    """A network from senses to three servo speeds.

    Node n computes tanh(2.5 (bias_n + response_n sum_k weights_nk v_k)), where v holds the inputs
    (``senses.names``) and then the nodes' values: of nodes in layers before its own those of now,
    of all others those of the time before, 0 at first. The last three nodes are the outputs, in
    [-1, 1], in the order of the servos. So one kind of table holds every class of controller:
    NEAT's feed-forward networks have a layer a node, its recurrent ones a single layer.

    Parameters
    ----------
    weights
        (N, I + N).
    bias, response
        (N,).
    clock
        Frequency of the clock, in Hz.
    morphology, seed
        The body it was evolved on, and the seed of that run.
    sample
        Of a sample of bodies, of which ``morphology`` is then the median, how many they were and a
        hash of them, as ``aquafish_gym.bodies.sample_stamp`` says it; None of one body.
    senses
        What it feels.
    layers
        How many nodes are in each layer, N in all; None for a layer a node and no memory.
    output
        What squashes the outputs: "tanh", or "clip", which cuts 2.5 (...) off at 1.
    interval
        For how many steps of 0.01 s an action is held.

    Raises
    ------
    InvalidArgumentError
        If a shape does not fit, a number is not finite, or a node hears a later one without layers.

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
    senses: Senses = IMU_AND_CLOCK
    layers: tuple[int, ...] | None = None
    output: Literal["tanh", "clip"] = "tanh"
    interval: int = INTERVAL

    def __post_init__(self) -> None:
        if not isinstance(self.senses, Senses):
            raise InvalidArgumentError(
                f"controller.senses must be Senses; got {brief(self.senses)}"
            )
        flag("controller.senses.imu", self.senses.imu)
        flag("controller.senses.fins", self.senses.fins)
        flag("controller.senses.goal", self.senses.goal)
        integer("controller.senses.clock", self.senses.clock, 0, MAXIMUM_HARMONICS)
        inputs = len(self.senses.names)
        bias = finite_array("controller.bias", self.bias, (None,))
        nodes = len(bias)
        if not len(OUTPUTS) <= nodes <= MAXIMUM_NODES:
            raise InvalidArgumentError(
                f"controller.bias must have {len(OUTPUTS)} to {MAXIMUM_NODES} entries; got {nodes}"
            )
        response = finite_array("controller.response", self.response, (nodes,))
        weights = finite_array("controller.weights", self.weights, (nodes, inputs + nodes))
        if self.layers is None:
            if np.triu(weights[:, inputs:]).any():
                raise InvalidArgumentError(
                    "controller.weights must be zero where a node would hear itself or a later "
                    "node, unless controller.layers says what it remembers"
                )
        else:
            if not isinstance(self.layers, list | tuple) or not self.layers:
                raise InvalidArgumentError(
                    f"controller.layers must be numbers of nodes; got {brief(self.layers)}"
                )
            layers = tuple(integer("controller.layers", n, 1, nodes) for n in self.layers)
            if sum(layers) != nodes or layers[-1] < len(OUTPUTS):
                raise InvalidArgumentError(
                    f"controller.layers must come to {nodes} nodes, {len(OUTPUTS)} or more in the "
                    f"last; got {layers}"
                )
            object.__setattr__(self, "layers", layers)
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
        one_of("controller.output", self.output, ("tanh", "clip"))
        integer("controller.interval", self.interval, 1, 1000)

    @property
    def nodes(self) -> int:
        """How many nodes there are, the three outputs among them."""
        return len(self.bias)

    @property
    def connections(self) -> int:
        """How many weights are not zero."""
        return int(np.count_nonzero(self.weights))

    @property
    def memory(self) -> bool:
        """Whether a node hears one of its own layer or of a later one, as it was before."""
        inputs = len(self.senses.names)
        return any(
            self.weights[begin:end, inputs + begin :].any()
            for begin, end in pairwise((0, *self._ends))
        )

    @property
    def kind(self) -> tuple[Any, ...]:
        """What controllers must share to swim side by side."""
        shape = None if self.layers is None else self.layers if len(self.layers) > 1 else ()
        return self.senses, shape, self.output, self.interval

    @property
    def _ends(self) -> tuple[int, ...]:
        layers = (1,) * self.nodes if self.layers is None else self.layers
        return tuple(accumulate(layers))

    def layout(self, nodes: int | None = None, memory: bool | None = None) -> NDArray[np.int64]:
        """Return the whole numbers that ``network.respond`` reads, padded as :meth:`genes` is."""
        padded = self._padded(self.nodes if nodes is None else nodes)
        remembers = self.memory if memory is None else memory
        senses, ends = self.senses, padded._ends
        return np.array(
            [
                senses.imu, senses.clock, senses.fins, senses.goal, len(senses.names),
                padded.nodes, remembers, self.output == "clip", self.interval, len(ends), *ends,
            ],
            np.int64,
        )  # fmt: skip

    def genes(
        self,
        nodes: int | None = None,
        memory: bool | None = None,
        fin_angles: ArrayLike = (0.0, 0.0, 0.0),
        servo_gain: ArrayLike = _NO_GAIN,
    ) -> NDArray[np.float64]:
        """Return the rows that ``network.respond`` reads, for one robot.

        Controllers of one :attr:`kind` swim side by side: with silent hidden nodes up to ``nodes``,
        and room for memories if one of them has any. ``fin_angles``, rad, and ``servo_gain`` are
        what they are told of the fins.
        """
        padded = self._padded(self.nodes if nodes is None else nodes)
        remembers = self.memory if memory is None else memory
        inputs = len(self.senses.names)
        rows = [np.array([self.clock]), np.asarray(fin_angles) / TAU, np.asarray(servo_gain)]
        for begin, end in pairwise((0, *padded._ends)):
            heard = inputs + (padded.nodes if remembers else begin)
            for n in range(begin, end):
                rows += [padded.bias[n : n + 1], padded.response[n : n + 1]]
                rows.append(padded.weights[n, :heard])
        return np.concatenate(rows, dtype=np.float64)

    def _padded(self, nodes: int) -> Controller:
        """Return a controller with silent nodes between the hidden ones and the outputs."""
        more = nodes - self.nodes
        if not more:
            return self
        hidden, inputs = self.nodes - len(OUTPUTS), len(self.senses.names)
        place = np.concatenate([np.arange(hidden), np.arange(hidden, self.nodes) + more])
        weights = np.zeros((nodes, inputs + nodes))
        weights[np.ix_(place, [*range(inputs), *(inputs + place)])] = self.weights
        bias, response = np.zeros(nodes), np.zeros(nodes)
        bias[place], response[place] = self.bias, self.response
        layers = None if self.layers is None else (nodes,)
        return replace(self, weights=weights, bias=bias, response=response, layers=layers)

    def __repr__(self) -> str:
        return (
            f"Controller({self.nodes} nodes, {self.connections} connections, "
            f"clock {self.clock:g} Hz, seed {self.seed})"
        )

    def policy(
        self, fin_angles: ArrayLike = (0.0, 0.0, 0.0), servo_gain: ArrayLike = _NO_GAIN
    ) -> Policy:
        """Return this controller ready to steer one robot through one swim.

        It hears the first nine entries of an observation, and the last three of one with a goal if
        it feels that. It raises InvalidArgumentError if there are fewer, or one of them or the time
        is not finite.

        Parameters
        ----------
        fin_angles, servo_gain
            Where the fins stand at first, (3,) in rad, and how much faster each servo (3,) is than
            told, as far as is known: all that a controller with this sense ever learns of its fins.
        """
        angles = finite_array("fin_angles", fin_angles, (3,), unit="rad")
        gains = finite_array("servo_gain", servo_gain, (3,))
        genes: list[float] = self.genes(fin_angles=angles, servo_gain=gains).tolist()
        layout: list[int] = self.layout().tolist()
        scratch = [0.0] * scratch_size(self)
        held, heard = self.interval * TIMESTEP, _HEARD + 3 * self.senses.goal
        action, due = np.zeros(3), 0.0

        def act(observation: ArrayLike, time: float) -> NDArray[np.float64]:
            nonlocal action, due
            senses = np.asarray(observation)
            if senses.ndim != 1 or len(senses) < heard:
                raise InvalidArgumentError(
                    f"observation must be {heard} numbers or more in a row; "
                    f"got shape {senses.shape}"
                )
            felt = np.concatenate([senses[:_HEARD], senses[-3:]])
            o = finite_array("observation", felt, (_HEARD + 3,)).tolist()
            if not math.isfinite(time):
                raise InvalidArgumentError(f"time must be finite; got {time}")
            if due and time < due - TIMESTEP / 2:
                return action
            due = time + held
            way = o[9:]
            action = np.array(
                respond(genes, layout, scratch, 0, 1, time, o[0:3], o[3:6], o[6:9], way)
            )
            return action

        return act

    def to_dict(self) -> dict[str, Any]:
        """Return everything as lists and numbers, ready for JSON."""
        usual = {
            "senses": asdict(self.senses),
            "layers": None if self.layers is None else list(self.layers),
            "output": self.output,
            "interval": self.interval,
            "sample": self.sample,
        }
        return {
            "inputs": list(self.senses.names),
            "outputs": list(OUTPUTS),
            "clock": self.clock,
            "seed": self.seed,
            "morphology": self.morphology.to_dict(),
            **{name: value for name, value in usual.items() if value != USUAL[name]},
            "bias": self.bias.tolist(),
            "response": self.response.tolist(),
            "weights": self.weights.tolist(),
        }

    @classmethod
    def from_dict(cls, data: object) -> Controller:
        """Read what :meth:`to_dict` returned; InvalidArgumentError if a field is not that."""
        if isinstance(data, dict):
            data = {**USUAL, **data}
        fields = dict(
            check_fields("controller", data, ("inputs", "outputs", *cls.__dataclass_fields__))
        )
        felt = fields["senses"]
        if isinstance(felt, dict):
            felt = {"goal": False, **felt}  # which older files do not say
        senses = Senses(**check_fields("controller.senses", felt, FELT))
        fields["senses"] = senses
        for name, names in (("inputs", senses.names), ("outputs", OUTPUTS)):
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


def scratch_size(controller: Controller, nodes: int | None = None) -> int:
    """Return how many numbers ``network.respond`` keeps in a swim."""
    return len(controller.senses.names) + 2 * (nodes or controller.nodes) + 3


def check_fields(argument: str, data: object, names: Collection[str]) -> dict[str, Any]:
    """Return ``data`` if it is an object of just these fields; the error names the odd ones."""
    if not isinstance(data, dict):
        raise InvalidArgumentError(f"{argument} must be a JSON object; got {brief(data)}")
    odd = ", ".join(sorted(map(str, data.keys() ^ set(names))))
    if odd:
        raise InvalidArgumentError(f"{argument} has missing or unknown fields: {odd}")
    return data
