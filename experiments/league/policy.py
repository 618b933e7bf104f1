"""Policies with and without memory, learned by PPO, as plain numbers that numpy evaluates.

They are residual: each adds to the action of the gait ``PPO, fins``, of the whole robot.
``experiments.league.policies`` trains them and writes their files.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish.online.gaits import load_library
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.utils.storage import read_document, write_document
from gait.controllers.agent import ControllerAgent
from gait.controllers.controller import Controller
from gait.controllers.inputs import NetworkInputs
from gait.controllers.network import OUTPUT_GAIN, Senses

Floats = NDArray[np.float64]

SCHEMA = "aquafish.policy/1"
DIGITS = 5
SENSES = Senses(fins=True)  # of ``PPO, fins``
CLOCK = 0.7  # Hz, of ``PPO, fins``
INTERVAL = 20  # steps of 0.01 s of an action
DT = INTERVAL * TIMESTEP  # s of an action
LARGEST = 2.0  # addition to an action


class Offline(NamedTuple):
    """What was spent on an entrant before its first episode."""

    steps: int = 0  #: Simulated robot steps of 0.01 s.
    seconds: float = 0.0  #: CPU time.


def begin_inputs(fin_angles: Floats) -> NetworkInputs:
    """Return the inputs of networks with ``SENSES`` of B robots, at fin angles (B, 3), rad."""
    return NetworkInputs(SENSES, CLOCK, INTERVAL, fin_angles)


def drive(gait: Controller, seen: Floats) -> Floats:
    """Return the outputs (B, 3), before they are clipped, of a feed-forward controller.

    ``seen`` (B, 17) are the inputs.
    """
    values = seen
    begin = 0
    for count in gait.layers or ():
        rows = slice(begin, begin + count)
        z = OUTPUT_GAIN * (gait.bias[rows] + values @ gait.weights[rows, : values.shape[1]].T)
        values = np.hstack([values, np.tanh(z)])
        begin = rows.stop
    return z


def known_or_zero(fin_angles: ArrayLike | None) -> Floats:
    """Return fin angles (1, 3); 0 if they are None."""
    return np.zeros((1, 3)) if fin_angles is None else np.reshape(fin_angles, (1, 3))


class FixedGait(ControllerAgent):
    """One controller in one episode, which takes unknown fin angles for 0."""

    def begin(self, fin_angles: ArrayLike | None) -> None:
        """Begin an episode."""
        self.reset({"fin_angles": known_or_zero(fin_angles)})


@dataclass(frozen=True, eq=False)
class Policy:
    """A policy from a frame, inputs and the previous action, to an addition to an action.

    Attributes
    ----------
    weights
        ``mean`` and ``scale`` (20,) of a frame; of the layers ``w0``, ``b0``, ``w1``, ...: (out,
        in) and (out,). All but the last have tanh. Of an LSTM before them ``w_in`` (4M, 20),
        ``w_back`` (4M, M) and ``b_in`` (4M,), its gates in torch's order i, f, g, o.
    frames
        The last frames, the latest last, that the first layer has as inputs.
    offline
        What its training took.
    curve
        [actions of all robots, mean return of their last episodes] in training.
    """

    weights: dict[str, Floats]
    frames: int
    offline: Offline
    curve: tuple[tuple[int, float], ...] = ()

    def save(self, path: Path) -> None:
        """Write a file of weights with five digits."""
        numbers = {
            name: np.vectorize(lambda x: float(f"{x:.{DIGITS}g}"))(value).tolist()
            for name, value in self.weights.items()
        }
        document = {
            "frames": self.frames,
            "offline": self.offline._asdict(),
            "curve": self.curve,
            "weights": numbers,
        }
        write_document(path, document, SCHEMA, indent=None)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file of weights."""
        data: dict[str, Any] = read_document(path, SCHEMA, "policy")
        weights = {name: np.array(value) for name, value in data["weights"].items()}
        curve = tuple((steps, earned) for steps, earned in data["curve"])
        return cls(weights, data["frames"], Offline(**data["offline"]), curve)


class PolicyAgent:
    """A learned policy in one episode, which knows the initial fin angles."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._gait = load_library()[0]

    def begin(self, fin_angles: ArrayLike | None) -> None:
        """Begin an episode."""
        w = self._policy.weights
        self._inputs = begin_inputs(known_or_zero(fin_angles))
        self._action = np.zeros((1, 3))
        self._frames = np.zeros((self._policy.frames, len(w["mean"])))
        cells = w["w_back"].shape[1] if "w_back" in w else 0
        self._hidden = np.zeros(cells)
        self._cell = np.zeros(cells)

    def act(self, observation: ArrayLike) -> Floats:
        """Return the gait's action and what the policy adds on average."""
        w = self._policy.weights
        seen = self._inputs.observe(np.asarray(observation, float)[None])
        frame = (np.hstack([seen, self._action])[0] - w["mean"]) / w["scale"]
        self._frames = np.vstack([self._frames[1:], frame])
        values = self._frames.ravel()
        if "w_back" in w:
            gates = w["w_in"] @ values + w["w_back"] @ self._hidden + w["b_in"]
            enter, keep, new, show = np.split(gates, 4)
            self._cell = _sigmoid(keep) * self._cell + _sigmoid(enter) * np.tanh(new)
            self._hidden = _sigmoid(show) * np.tanh(self._cell)
            values = self._hidden
        last = sum(name[0] == "w" and name[1:].isdigit() for name in w) - 1
        for i in range(last + 1):
            values = w[f"w{i}"] @ values + w[f"b{i}"]
            values = np.tanh(values) if i < last else values
        values = np.clip(values, -LARGEST, LARGEST)
        self._action = np.clip(np.clip(drive(self._gait, seen), -1.0, 1.0) + values, -1.0, 1.0)
        self._inputs.follow(self._action)
        return np.asarray(self._action[0])


def _sigmoid(x: Floats) -> Floats:
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * x))
