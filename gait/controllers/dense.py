"""Dense layers on arrays in single precision: of P networks of the same weights at once.

Each sum is taken in the order of its terms, and no function of a mathematical library is called. So
the numbers are the same on every processor.
"""

from __future__ import annotations

import functools
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.compiling import compiled
from gait.controllers.controller import Controller
from gait.controllers.network import OUTPUT_GAIN

Singles = NDArray[np.float32]

#: What a layer makes of its sums.
LINEAR = 0
HYPERBOLIC_TANGENT = 1
EXPONENTIAL_LINEAR = 2
# Singles, so that compiled code computes with nothing else.
_ZERO, _HALF, ONE, _EIGHTH = (np.float32(x) for x in (0.0, 0.5, 1.0, 0.125))
_TANH_LIMIT = np.float32(9.0)  # 1 - tanh(9) = 3e-8
_N1, _N2, _N3 = (np.float32(x / 135135) for x in (17325, 378, 1))
_D1, _D2, _D3 = (np.float32(x / 135135) for x in (62370, 3150, 28))


@functools.partial(compiled, error_model="numpy")
def _tanh(z: Any) -> Any:
    """Return tanh z in single precision: the Pade approximant [7/6] of tanh(z / 8), doubled thrice.

    See :func:`gait.controllers.network.tanh`.
    """
    y = min(max(z, -_TANH_LIMIT), _TANH_LIMIT) * _EIGHTH
    q = y * y
    n = y * (ONE + q * (_N1 + q * (_N2 + q * _N3)))
    d = ONE + q * (_D1 + q * (_D2 + q * _D3))
    for _ in range(3):
        n, d = n * d + n * d, d * d + n * n
    return n / d


@functools.partial(compiled, error_model="numpy")
def layer(weights: Singles, values: Singles, nodes: Singles, kind: int) -> None:
    """Put into ``nodes`` (N, P) what a layer of weights (M, N) makes of ``values`` (M, P).

    A bias is the weight of a value that is 1. ``kind`` is one of the three above.
    """
    sums = np.empty(weights.shape[1], np.float32)
    for p in range(values.shape[1]):
        sums[:] = _ZERO
        for i in range(values.shape[0]):
            value = values[i, p]
            row = weights[i]
            for j in range(sums.size):
                sums[j] += row[j] * value
        if kind == HYPERBOLIC_TANGENT:
            for j in range(sums.size):
                sums[j] = _tanh(sums[j])
        elif kind == EXPONENTIAL_LINEAR:  # exp(z) - 1 = 2 t / (1 - t), where t = tanh(z / 2)
            for j in range(sums.size):
                t = _tanh(_HALF * min(sums[j], _ZERO))
                sums[j] = max(sums[j], _ZERO) + (t + t) / (ONE - t)
        nodes[:, p] = sums


def columns(matrix: Singles) -> Singles:
    """Return a matrix (N, M) as the weights (M, N) of :func:`layer`."""
    return np.ascontiguousarray(matrix.T)


def layers_of(controller: Controller) -> list[Singles]:
    """Return the weights (1 + inputs + earlier nodes, nodes) of each layer of a controller.

    The first row is the bias; the gain before the hyperbolic tangent is a factor of them. The
    controller must have layers and no memory.
    """
    inputs = len(controller.inputs)
    ends = np.cumsum((0, *(controller.layers or ()))).tolist()
    found = []
    for begin, end in pairwise(ends):
        gain = OUTPUT_GAIN * controller.response[begin:end, None]
        bias = OUTPUT_GAIN * controller.bias[begin:end, None]
        matrix = np.hstack([bias, gain * controller.weights[begin:end, : inputs + begin]])
        found.append(columns(matrix.astype(np.float32)))
    return found
