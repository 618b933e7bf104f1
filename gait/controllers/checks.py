"""What a controller refuses: numbers, senses and documents that are none of a network."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import InvalidArgumentError, flag, instance, integer
from gait.controllers import network
from gait.controllers.network import Senses

MAXIMUM_HARMONICS = 32
MAXIMUM_SUM = 1e30  # of a node whose inputs are 1: larger inputs do not overflow float32 either


def check_sums(
    weights: NDArray[np.float64], bias: NDArray[np.float64], response: NDArray[np.float64]
) -> None:
    """Refuse a node whose sum may overflow in float32, where infinities make NaN commands.

    ``weights`` are those of one controller (N, I + N) or of P of them (P, N, I + N).
    """
    with np.errstate(over="ignore", invalid="ignore"):
        reach = np.abs(weights).sum(axis=-1)
        sums = np.maximum(reach, network.OUTPUT_GAIN * (np.abs(bias) + np.abs(response) * reach))
    beyond = np.flatnonzero(~(sums <= MAXIMUM_SUM))
    if len(beyond):
        place = int(beyond[0])
        raise InvalidArgumentError(
            f"controller.weights, bias and response must keep every node's sum within "
            f"{MAXIMUM_SUM:g}, as float32 must hold it; node {place % len(response)} reaches "
            f"{sums.flat[place]:.3g}"
        )


def check_order(between: NDArray[np.float64], layers: object) -> None:
    """Refuse weights between nodes (..., N, N) that need memory where no layers are given."""
    if layers is None and np.triu(between).any():
        raise InvalidArgumentError(
            "controller.weights must be zero from a node to itself or an earlier one, unless "
            "controller.layers gives the layers of a network with memory"
        )


def check_senses(senses: object) -> None:
    """Refuse what is no ``Senses``, or has fields of other types and ranges."""
    checked = instance("controller.senses", senses, Senses)
    for sense in ("imu", "fins", "goal"):
        flag(f"controller.senses.{sense}", getattr(checked, sense))
    integer("controller.senses.clock", checked.clock, 0, MAXIMUM_HARMONICS)


def check_fields(
    argument: str, data: object, names: Collection[str], optional: Collection[str] = ()
) -> dict[str, Any]:
    """Return ``data`` if it is an object with these fields; the error names the wrong ones."""
    checked = instance(argument, data, dict)
    wrong = {
        name for name in checked.keys() ^ set(names) if name in checked or name not in optional
    }
    if wrong:
        odd = ", ".join(sorted(map(str, wrong)))
        raise InvalidArgumentError(f"{argument} has missing or unknown fields: {odd}")
    return checked
