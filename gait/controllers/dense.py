"""Dense layers on arrays in single precision: of P networks of the same weights at once.

Each sum is taken in the order of its terms, and no function of a mathematical library is called. So
the numbers are the same on every processor.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.compiled.lanes import lane_width
from aquafish_gym.physics.arithmetic import clip, fetch, put, where_less
from aquafish_gym.physics.compiling import compiled, register
from aquafish_gym.physics.simd import inlined, zero_lanes
from gait.controllers.controller import Controller
from gait.controllers.network import OUTPUT_GAIN

Singles = NDArray[np.float32]

#: What a layer makes of its sums.
LINEAR = 0
HYPERBOLIC_TANGENT = 1
EXPONENTIAL_LINEAR = 2
# Singles, so that compiled code computes with nothing else.
_HALF, ONE, _EIGHTH = (np.float32(x) for x in (0.5, 1.0, 0.125))
_WIDTH = lane_width(np.float32)
_TANH_LIMIT = np.float32(9.0)  # 1 - tanh(9) = 3e-8
_N1, _N2, _N3 = (np.float32(x / 135135) for x in (17325, 378, 1))
_D1, _D2, _D3 = (np.float32(x / 135135) for x in (62370, 3150, 28))


def _tanh(z: Any) -> Any:
    """Return tanh z in single precision: the Pade approximant [7/6] of tanh(z / 8), doubled thrice.

    See :func:`gait.controllers.network.tanh`.
    """
    y = clip(z, _TANH_LIMIT) * _EIGHTH
    q = y * y
    n = y * (ONE + q * (_N1 + q * (_N2 + q * _N3)))
    d = ONE + q * (_D1 + q * (_D2 + q * _D3))
    for _ in range(3):
        n, d = n * d + n * d, d * d + n * n
    return n / d


register()
inlined(_tanh)


@compiled
def layer(weights: Singles, values: Singles, nodes: Singles, kind: int) -> None:
    """Put into ``nodes`` (N, P) what a layer of weights (M, N) makes of ``values`` (M, P).

    A bias is the weight of a value that is 1. ``kind`` is one of the three above.
    """
    zero = zero_lanes(values, _WIDTH)
    terms, count = weights.shape
    networks = values.shape[1]
    groups = -(-networks // _WIDTH)
    # Copied, because the arrays may be views, and their rows end within a register.
    wide = np.zeros((terms, groups * _WIDTH), np.float32)
    sums = np.empty((count, groups * _WIDTH), np.float32)
    for i in range(terms):
        for p in range(networks):
            wide[i, p] = values[i, p]
    inputs, outputs = wide.reshape(-1), sums.reshape(-1)
    for group in range(groups):
        # Four sums at a time, so that none waits for its own last addition.
        fours = count - count % 4
        for j in range(0, fours, 4):
            a = b = c = d = zero
            for i in range(terms):
                value = fetch(inputs, i * groups + group, zero)
                a = a + weights[i, j] * value
                b = b + weights[i, j + 1] * value
                c = c + weights[i, j + 2] * value
                d = d + weights[i, j + 3] * value
            put(outputs, j * groups + group, a)
            put(outputs, (j + 1) * groups + group, b)
            put(outputs, (j + 2) * groups + group, c)
            put(outputs, (j + 3) * groups + group, d)
        for j in range(fours, count):
            a = zero
            for i in range(terms):
                a = a + weights[i, j] * fetch(inputs, i * groups + group, zero)
            put(outputs, j * groups + group, a)
    if kind == HYPERBOLIC_TANGENT:
        for k in range(count * groups):
            put(outputs, k, _tanh(fetch(outputs, k, zero)))
    elif kind == EXPONENTIAL_LINEAR:  # exp(z) - 1 = 2 t / (1 - t), where t = tanh(z / 2)
        for k in range(count * groups):
            z = fetch(outputs, k, zero)
            t = _tanh(_HALF * where_less(z, zero, z, zero))
            put(outputs, k, where_less(z, zero, zero, z) + (t + t) / (ONE - t))
    for j in range(count):
        for p in range(networks):
            nodes[j, p] = sums[j, p]


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
