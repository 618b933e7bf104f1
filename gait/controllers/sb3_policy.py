"""Policies of stable-baselines3: dense layers from an observation to an action, in float32."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.arithmetic import clip, where_less
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers import dense
from gait.controllers.network import tanh

Floats = NDArray[np.float32]

CLIPPED = "clipped to the bounds"
SQUASHED = "tanh, scaled to the bounds"
CHOSEN = "the largest output's number"


def _relu(z: Any) -> Any:
    return where_less(z, 0.0, 0.0, z)


def _leaky_relu(z: Any) -> Any:
    return where_less(z, 0.0, 0.01 * z, z)


def _elu(z: Any) -> Any:
    """Return e^z - 1 = 2 t / (1 - t) with t = tanh(z / 2) where z < 0, else z."""
    t = tanh(0.5 * where_less(z, 0.0, z, 0.0))
    return where_less(z, 0.0, 2.0 * t / (1.0 - t), z)


def _silu(z: Any) -> Any:
    return z * (0.5 + 0.5 * tanh(0.5 * z))


#: What PyTorch calls an activation -> the function, which ``policy.c`` restates.
ACTIVATIONS = {
    "Tanh": tanh, "ReLU": _relu, "LeakyReLU": _leaky_relu, "ELU": _elu, "SiLU": _silu
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Layer:
    """A dense layer: weights (out, in), biases (out,), and its name in ``policy.pth``."""

    name: str
    weights: Floats
    biases: Floats

    def sums(self, values: Floats) -> Floats:
        """Return the outputs (T, out), before an activation, for inputs (T, in)."""
        inputs = np.vstack([np.ones(len(values), np.float32), values.T])
        found = np.empty((len(self.biases), len(values)), np.float32)
        dense.layer(self._columns, inputs, found, dense.LINEAR)
        return found.T

    @cached_property
    def _columns(self) -> Floats:
        return dense.columns(np.hstack([self.biases[:, None], self.weights]))


@dataclass(frozen=True, eq=False)
class Normalization:
    """How VecNormalize scales observations (n,): clip((x - mean) / scale, limit)."""

    mean: Floats
    scale: Floats
    limit: float


@dataclass(frozen=True, eq=False)
class SB3Policy:
    """A policy of dense layers, without exploration, in float32.

    Attributes
    ----------
    kind
        The algorithm that learned it.
    layers
        From the observation (n,), flattened, to the outputs (m,).
    activation
        After each layer except the last; a key of ``ACTIVATIONS``.
    output
        What becomes of the outputs: ``CLIPPED``, ``SQUASHED`` or ``CHOSEN``.
    low, high
        Bounds (m,) of the actions; empty for ``CHOSEN``.
    normalization
        None where the observations are not scaled.
    """

    kind: str
    layers: tuple[Layer, ...]
    activation: str
    output: str
    low: Floats
    high: Floats
    normalization: Normalization | None

    @property
    def widths(self) -> tuple[int, ...]:
        """Number of the observation's entries, then of each layer's outputs."""
        return (self.layers[0].weights.shape[1], *(len(layer.biases) for layer in self.layers))

    def act(self, observations: Floats) -> NDArray[Any]:
        """Return the actions (T, m), or the choices (T, 1), that follow observations (T, n).

        This is the reference for ``policy.c``: every operation is rounded to float32, and a sum
        begins with the bias and adds the products in the order of the inputs.

        Raises
        ------
        InvalidArgumentError
            If a layer exceeds float32.
        """
        values: NDArray[Any] = observations
        with np.errstate(over="ignore", invalid="ignore"):
            if self.normalization is not None:
                values = (values - self.normalization.mean) / self.normalization.scale
                if np.isfinite(self.normalization.limit):
                    values = clip(values, self.normalization.limit)
            for layer in self.layers:
                total = layer.sums(values)
                if not np.isfinite(total).all():
                    raise InvalidArgumentError(
                        f"{layer.name} must have outputs in the range of float32; they exceed it"
                    )
                last = layer is self.layers[-1]
                values = total if last else ACTIVATIONS[self.activation](total)
        if self.output == CHOSEN:
            values = values.argmax(axis=1, keepdims=True)
        elif self.output == SQUASHED:
            values = self.low + np.float32(0.5) * (tanh(values) + 1) * (self.high - self.low)
        else:
            most = where_less(self.high, values, self.high, values)
            values = where_less(values, self.low, self.low, most)
        return values
