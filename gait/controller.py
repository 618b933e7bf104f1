"""A controller: a feed-forward network as arrays, and the clock it listens to."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer, parse_json
from gait.network import INPUTS, OUTPUTS, forward, listen

SCHEMA = 1
KIND = "aquafish-controller"
# Nobody's network is this large; a file that says so is broken or meant to hurt.
MAXIMUM_NODES = 1000
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
    morphology
        The body it was evolved on.
    seed
        The seed of the run that evolved it.

    Raises
    ------
    InvalidArgumentError
        If a shape does not fit, a number is not finite, a node hears a later one, or the seed
        is not a whole number of at least 0.
    """

    weights: NDArray[np.float64]
    bias: NDArray[np.float64]
    response: NDArray[np.float64]
    clock: float
    morphology: Morphology
    seed: int

    def __post_init__(self) -> None:
        bias = finite_array("controller.bias", self.bias, (None,))
        nodes = len(bias)
        if not len(OUTPUTS) <= nodes <= MAXIMUM_NODES:
            raise InvalidArgumentError(
                f"controller.bias must have {len(OUTPUTS)} to {MAXIMUM_NODES} entries; got {nodes}"
            )
        arrays = {
            "bias": bias,
            "response": finite_array("controller.response", self.response, (nodes,)),
            "weights": finite_array(
                "controller.weights", self.weights, (nodes, len(INPUTS) + nodes)
            ),
        }
        if np.triu(arrays["weights"][:, len(INPUTS) :]).any():
            raise InvalidArgumentError(
                "controller.weights must be zero where a node would hear itself or a later node"
            )
        for name, array in arrays.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        clock = float(finite_array("controller.clock", self.clock, (), 0.0, 50.0, "Hz"))
        object.__setattr__(self, "clock", clock)
        object.__setattr__(self, "seed", integer("controller.seed", self.seed, 0))

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

        Parameters
        ----------
        nodes
            Pad with silent hidden nodes up to this many, so that networks of different sizes
            can run side by side. By default there is no padding.
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

    def policy(self) -> Policy:
        """Return this controller ready to steer one robot."""
        return Policy(self)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as lists and numbers, ready for JSON."""
        return {
            "kind": KIND,
            "schema": SCHEMA,
            "inputs": list(INPUTS),
            "outputs": list(OUTPUTS),
            "clock": self.clock,
            "seed": self.seed,
            "morphology": self.morphology.to_dict(),
            "bias": self.bias.tolist(),
            "response": self.response.tolist(),
            "weights": self.weights.tolist(),
        }

    @classmethod
    def from_dict(cls, data: object) -> Controller:
        """Read what :meth:`to_dict` returned.

        Raises
        ------
        InvalidArgumentError
            If a field is missing or unknown, or its value does not fit.
        """
        wanted = {"kind", "schema", "inputs", "outputs", "clock", "seed", "morphology"}
        wanted |= {"bias", "response", "weights"}
        if not isinstance(data, dict) or data.get("kind") != KIND:
            raise InvalidArgumentError(
                f'a controller must be a JSON object with "kind": "{KIND}", '
                "as `python -m gait evolve` writes it"
            )
        if data.get("schema") != SCHEMA:
            raise InvalidArgumentError(
                f"controller.schema must be {SCHEMA}; got {data.get('schema')!r}"
            )
        if data.keys() != wanted:
            odd = ", ".join(sorted(map(str, data.keys() ^ wanted)))
            raise InvalidArgumentError(f"controller has missing or unknown fields: {odd}")
        for name, names in (("inputs", INPUTS), ("outputs", OUTPUTS)):
            if data[name] != list(names):
                raise InvalidArgumentError(f"controller.{name} must be {', '.join(names)}")
        return cls(
            weights=data["weights"],
            bias=data["bias"],
            response=data["response"],
            clock=data["clock"],
            morphology=Morphology.from_json(json.dumps(data["morphology"])),
            seed=data["seed"],
        )

    @classmethod
    def load(cls, path: Path | str) -> Controller:
        """Read a ``controller.json``.

        Raises
        ------
        InvalidArgumentError
            If the file cannot be read, is not JSON or is not a controller.
        """
        return cls.from_dict(read_json(Path(path), "controller"))


class Policy:
    """A controller with its scratch space: what one robot carries on board."""

    def __init__(self, controller: Controller) -> None:
        self._genes: list[float] = controller.genes().tolist()
        self._nodes = controller.nodes
        self._values = [0.0] * (len(INPUTS) + controller.nodes)

    def __call__(self, observation: ArrayLike, time: float) -> NDArray[np.float64]:
        """Return the three actions in [-1, 1].

        Parameters
        ----------
        observation
            (9,) the world's up and north in body axes and the gyro in rad/s, as AquaFish-v0
            observes them; entries that follow are not heard.
        time
            Seconds since the controller was switched on.

        Raises
        ------
        InvalidArgumentError
            If there are fewer entries, or one of the nine or the time is not finite.
        """
        senses = np.asarray(observation)
        if senses.ndim != 1 or len(senses) < _HEARD:
            raise InvalidArgumentError(
                f"observation must be {_HEARD} numbers or more in a row; got shape {senses.shape}"
            )
        o = finite_array("observation", senses[:_HEARD], (_HEARD,)).tolist()
        if not math.isfinite(time):
            raise InvalidArgumentError(f"time must be finite; got {time}")
        listen(self._values, self._genes[0], time, o[0:3], o[3:6], o[6:9])
        return np.array(forward(self._genes, self._nodes, self._values, 0, 1, 0.0))


def read_json(path: Path, argument: str) -> object:
    """Return what a JSON file holds.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read or is not JSON; the message names ``argument``.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InvalidArgumentError(
            f"{argument}: cannot read {path}: {error.strerror or error}"
        ) from None
    except ValueError as error:
        raise InvalidArgumentError(f"{argument}: {path} is not JSON: {error}") from None
    data: object = parse_json(f"{argument}: {path}", text)
    return data
