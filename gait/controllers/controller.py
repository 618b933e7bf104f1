"""A controller: a small network as arrays, with its senses and its clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.bodies import plan_key
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, BodyPlan, check_plan
from aquafish_gym.rollout import Program
from aquafish_gym.rollout.plan import Act
from aquafish_gym.utils.storage import read_document, write_document
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    file_path,
    finite_array,
    instance,
    integer,
    one_of,
)
from gait.controllers import network
from gait.controllers.checks import check_fields, check_order, check_senses, check_sums
from gait.controllers.network import Senses
from gait.controllers.network_agent import NetworkAgent

SCHEMA = "gait.controller/2"
MAXIMUM_NODES = 1000
MAXIMUM_BYTES = 64 * 2**20  # of the largest network's file
MAXIMUM_SEED = 2**64 - 1
MAXIMUM_HELD_STEPS = 1000  # physics steps that an action may be held for
INTERVAL = 5  # physics steps that an action is held for, as in AquaFish-v0
IMU_AND_CLOCK = Senses()
OPTIONAL = ("senses", "layers", "output", "interval", "sample")  # a file omits them at default


@dataclass(frozen=True, eq=False)
class Controller:
    """A network from senses to the speeds of a robot's servos.

    Node n computes tanh(2.5 (bias_n + response_n sum_k weights_nk v_k)). The vector v holds the
    inputs (``inputs``) and then the nodes' values: present ones of earlier layers, previous
    ones (0 at first) of all others. The last nodes, one for each servo in the order of the plan's
    fins, are the outputs in [-1, 1]. One table holds every class of controller; NEAT's have one
    layer for each node.

    Parameters
    ----------
    weights
        (N, I + N).
    bias, response
        (N,).
    clock
        Frequency of the clock, in Hz.
    morphology, seed
        The body it was evolved on, whose plan is the controller's, and the seed of that run.
    sample
        Size and hash of the sample of bodies it was evolved on, whose median is ``morphology``;
        None for one body.
    senses
        Its inputs.
    layers
        Number of nodes in each layer, N in all; None for one layer for each node, without memory.
    output
        Squashing function of the outputs: "tanh", or "clip" of 2.5 (...) to [-1, 1].
    interval
        Steps of 0.01 s that an action is held.

    Raises
    ------
    InvalidArgumentError
        If a shape does not fit, a number is not finite, a node's sum could exceed 1e30 and so leave
        float32, or a node without ``layers`` has an input from itself or a later node.

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
        check_senses(self.senses)
        instance("controller.morphology", self.morphology, Morphology)
        inputs = len(self.inputs)
        outputs = len(self.plan.fins)
        bias = finite_array("controller.bias", self.bias, (None,))
        nodes = len(bias)
        if not outputs <= nodes <= MAXIMUM_NODES:
            raise InvalidArgumentError(
                f"controller.bias must have {outputs} to {MAXIMUM_NODES} entries; got {nodes}"
            )
        response = finite_array("controller.response", self.response, (nodes,))
        weights = finite_array("controller.weights", self.weights, (nodes, inputs + nodes))
        check_sums(weights, bias, response)
        check_order(weights[:, inputs:], self.layers)
        layers = self.layers
        if layers is not None:
            if not isinstance(layers, list | tuple):
                raise InvalidArgumentError(
                    f"controller.layers must be a list of node counts; got {brief(layers)}"
                )
            layers = tuple(integer("controller.layers", n, 1, nodes) for n in layers)
            if sum(layers) != nodes or layers[-1] < outputs:
                raise InvalidArgumentError(
                    f"controller.layers must sum to {nodes} nodes, {outputs} or more in the last; "
                    f"got {layers}"
                )
        for array in (bias, response, weights):
            array.setflags(write=False)
        clock = float(finite_array("controller.clock", self.clock, (), 0.0, 50.0, "Hz"))
        seed = integer("controller.seed", self.seed, 0, MAXIMUM_SEED)
        interval = integer("controller.interval", self.interval, 1, MAXIMUM_HELD_STEPS)
        vars(self).update(
            weights=weights, bias=bias, response=response, layers=layers, clock=clock, seed=seed,
            interval=interval,
        )  # fmt: skip
        if self.sample is not None:
            instance("controller.sample", self.sample, str)
        one_of("controller.output", self.output, ("tanh", "clip"))

    def variants(self, weights: ArrayLike, bias: ArrayLike, clock: ArrayLike) -> list[Controller]:
        """Return P controllers with other numbers, which are checked together.

        A search makes tens of thousands: one by one, their checks take a third as long as their
        swims.

        Parameters
        ----------
        weights
            (P, N, I + N).
        bias
            (P, N).
        clock
            (P,) in Hz.

        Raises
        ------
        InvalidArgumentError
            As of :class:`Controller`.
        """
        numbers = finite_array("controller.weights", weights, (None, *self.weights.shape))
        count = len(numbers)
        biases = finite_array("controller.bias", bias, (count, self.nodes))
        clocks = finite_array("controller.clock", clock, (count,), 0.0, 50.0, "Hz")
        check_sums(numbers, biases, self.response)
        check_order(numbers[:, :, len(self.inputs) :], self.layers)
        for array in (numbers, biases):
            array.setflags(write=False)
        shared = vars(self)
        found = []
        for own_weights, own_bias, own_clock in zip(numbers, biases, clocks.tolist(), strict=True):
            one = object.__new__(type(self))
            vars(one).update(shared, weights=own_weights, bias=own_bias, clock=own_clock)
            found.append(one)
        return found

    @property
    def plan(self) -> BodyPlan:
        """The body plan of the robots that it steers."""
        return self.morphology.plan

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of its inputs, in the order of the weights."""
        return self.senses.names(self.plan)

    @property
    def nodes(self) -> int:
        """Number of nodes, including the outputs."""
        return len(self.bias)

    @property
    def connections(self) -> int:
        """Number of weights that are not zero."""
        return int(np.count_nonzero(self.weights))

    @property
    def memory(self) -> bool:
        """Whether a node has an input from its own layer or a later one."""
        inputs = len(self.inputs)
        return any(
            self.weights[begin:end, inputs + begin :].any()
            for begin, end in pairwise((0, *self._ends))
        )

    @property
    def kind(self) -> tuple[Any, ...]:
        """The properties that controllers of one batch must share."""
        return self.plan, self.senses, self.layers, self.output, self.interval

    @property
    def _ends(self) -> tuple[int, ...]:
        return tuple(accumulate(self.layers or (1,) * self.nodes))

    def layout(self, nodes: int | None = None, memory: bool | None = None) -> NDArray[np.int64]:
        """Return the integers that ``network.responder`` reads, padded as :meth:`genes`."""
        padded = self._padded(nodes)
        remembers = self.memory if memory is None else memory
        sizes = len(self.inputs), padded.nodes, remembers, self.output == "clip"
        ends = padded._ends
        return np.array([*self.senses.layout, *sizes, len(ends), *ends], np.int64)

    def genes(self, nodes: int | None = None, memory: bool | None = None) -> NDArray[np.float64]:
        """Return the rows that ``network.responder`` reads, for one robot.

        For a batch of controllers of one :attr:`kind`, silent hidden nodes pad each to ``nodes``,
        and ``memory`` adds room for memory.
        """
        return _genes([self._padded(nodes)], self.memory if memory is None else memory)[:, 0]

    def _padded(self, nodes: int | None) -> Controller:
        """Return a controller with silent nodes between the hidden ones and the outputs."""
        if nodes is None or nodes == self.nodes:
            return self
        more = nodes - self.nodes
        hidden = self.nodes - len(self.plan.fins)
        inputs = len(self.inputs)
        place = np.concatenate([np.arange(hidden), np.arange(hidden, self.nodes) + more])
        weights = np.zeros((nodes, inputs + nodes))
        weights[np.ix_(place, [*range(inputs), *(inputs + place)])] = self.weights
        bias = np.zeros(nodes)
        response = np.zeros(nodes)
        bias[place] = self.bias
        response[place] = self.response
        return replace(self, weights=weights, bias=bias, response=response)

    def __repr__(self) -> str:
        return (
            f"Controller({self.nodes} nodes, {self.connections} connections, "
            f"clock {self.clock:g} Hz, seed {self.seed})"
        )

    def policy(
        self, fin_angles: ArrayLike | None = None, servo_gain: ArrayLike | None = None
    ) -> Act:
        """Return a policy that steers one robot through one swim.

        It is a function of an observation and the time, s. It reads the first nine entries of an
        observation, and the last three if it senses a goal. A reading that is not finite, or beyond
        its sensor's range, is not observed: the last one of that channel stands.

        If it senses its fins, it assumes these initial angles (F,) in rad, by default 0, and servo
        gains (F,), by default 1. It acts when first called, and whenever ``interval`` is over
        since; in between it returns the action that it holds. Called late, it takes the intervals
        that were missed for ones of the action in force: its clock and fins go on by whole
        intervals.
        """
        agent = NetworkAgent(program_of([self]), servo_gain, "servo_gain")
        return agent.policy(np.zeros(len(self.plan.fins)) if fin_angles is None else fin_angles)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as lists and numbers, ready for JSON."""
        defaults = {name: field.default for name, field in self.__dataclass_fields__.items()}
        optional = {
            name: asdict(value) if isinstance(value, Senses) else value
            for name in OPTIONAL
            if (value := getattr(self, name)) != defaults[name]
        }
        return {
            "inputs": list(self.inputs),
            "outputs": list(self.plan.names),
            "clock": self.clock,
            "seed": self.seed,
            **plan_key(self.plan),
            "morphology": self.morphology.to_dict(),
            **{name: list(v) if isinstance(v, tuple) else v for name, v in optional.items()},
            "bias": self.bias.tolist(),
            "response": self.response.tolist(),
            "weights": self.weights.tolist(),
        }

    @classmethod
    def from_dict(cls, data: object) -> Controller:
        """Return the controller of a :meth:`to_dict`; InvalidArgumentError names a wrong field."""
        names = {"inputs", "outputs", "plan", *cls.__dataclass_fields__}
        fields = dict(check_fields("controller", data, names, (*OPTIONAL, "plan")))
        plan = check_plan(fields.pop("plan", AQUAFISH))
        senses = IMU_AND_CLOCK
        if "senses" in fields:
            known = Senses.__dataclass_fields__
            given = check_fields("controller.senses", fields["senses"], known, ("goal",))
            fields["senses"] = senses = Senses(**given)
            check_senses(senses)
        for name, expected in (("inputs", senses.names(plan)), ("outputs", plan.names)):
            if fields.pop(name) != list(expected):
                raise InvalidArgumentError(f"controller.{name} must be {', '.join(expected)}")
        body = check_fields("controller.morphology", fields["morphology"], plan.names)
        return cls(**{**fields, "morphology": Morphology.coerce(body, plan)})

    def save(self, path: Path | str) -> None:
        """Write a ``controller.json``, whole or not at all."""
        write_document(file_path("path", path), self.to_dict(), SCHEMA)

    @classmethod
    def load(cls, path: Path | str) -> Controller:
        """Read a ``controller.json``; InvalidArgumentError if it is damaged or not a controller."""
        path = file_path("controller", path)
        data = read_document(path, SCHEMA, "controller", MAXIMUM_BYTES)
        try:
            return cls.from_dict(data)
        except InvalidArgumentError as error:
            raise InvalidArgumentError(f"controller: {path}: {error}") from None


def check_controllers(controllers: Sequence[Controller]) -> list[Controller]:
    """Return controllers as a list; the error says which one is none."""
    if not isinstance(controllers, list | tuple):
        raise InvalidArgumentError(
            f"controllers must be a list of Controllers; got {brief(controllers)}"
        )
    return [instance(f"controllers[{i}]", one, Controller) for i, one in enumerate(controllers)]


def program_of(controllers: Sequence[Controller], swims: int = 1) -> Program:
    """Return a program of P Q robots for P controllers of one kind, each in Q swims in a row."""
    if not controllers or any(c.kind != controllers[0].kind for c in controllers):
        raise InvalidArgumentError("controllers must be one or more of one kind")
    first = controllers[0]
    nodes = max(c.nodes for c in controllers)
    memory = any(c.memory for c in controllers)
    rows = _genes([c._padded(nodes) for c in controllers], memory)
    return Program(
        network.responder(first.plan),
        np.repeat(rows, swims, axis=1),
        first.layout(nodes, memory),
        len(first.inputs) + 2 * nodes,
        first.interval,
        first.senses.goal,
        first.plan,
    )


def _genes(controllers: Sequence[Controller], memory: bool) -> NDArray[np.float64]:
    """Return the genes of P controllers of one kind, equally large, as columns."""
    first = controllers[0]
    inputs = len(first.inputs)
    nodes = first.nodes
    table = np.empty((nodes, 2 + inputs + nodes, len(controllers)))
    table[:, 0] = np.transpose([c.bias for c in controllers])
    table[:, 1] = np.transpose([c.response for c in controllers])
    table[:, 2:] = np.moveaxis(np.array([c.weights for c in controllers]), 0, -1)
    rows = [np.array([[c.clock for c in controllers]])]
    for begin, end in pairwise((0, *first._ends)):
        sources = inputs + (nodes if memory else begin)
        rows.append(table[begin:end, : 2 + sources].reshape(-1, len(controllers)))
    return np.concatenate(rows, dtype=np.float64)
