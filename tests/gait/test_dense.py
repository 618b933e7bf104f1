"""Dense layers: sums in the order of their terms, of arrays and of views."""

from __future__ import annotations

import numpy as np
import pytest

from gait.controllers.dense import EXPONENTIAL_LINEAR, HYPERBOLIC_TANGENT, LINEAR, Singles, layer


def arrays(terms: int, count: int, networks: int) -> tuple[Singles, Singles]:
    rng = np.random.default_rng(networks)
    weights = rng.normal(size=(terms, count)).astype(np.float32)
    return weights, rng.normal(size=(terms, networks)).astype(np.float32)


def in_order(weights: Singles, values: Singles) -> Singles:
    """Return the sums (N, P), one term after the other."""
    sums = np.zeros((weights.shape[1], values.shape[1]), np.float32)
    for row, value in zip(weights, values, strict=True):
        sums += row[:, None] * value
    return sums


@pytest.mark.parametrize("networks", [1, 5, 16, 32, 33])
@pytest.mark.parametrize("count", [1, 3, 8, 10])
def test_sums_are_in_order_to_the_bit(networks: int, count: int) -> None:
    weights, values = arrays(7, count, networks)
    nodes = np.empty((count, networks), np.float32)
    layer(weights, values, nodes, LINEAR)
    np.testing.assert_array_equal(nodes, in_order(weights, values))


def test_functions_are_those_of_the_sums() -> None:
    weights, values = arrays(7, 10, 33)
    z = in_order(weights, values).astype(np.float64)
    nodes = np.empty(z.shape, np.float32)
    layer(weights, values, nodes, HYPERBOLIC_TANGENT)
    np.testing.assert_allclose(nodes, np.tanh(z), atol=3e-7)
    layer(weights, values, nodes, EXPONENTIAL_LINEAR)
    np.testing.assert_allclose(nodes, np.where(z > 0.0, z, np.expm1(z)), atol=1e-6)


def test_views_are_layers_too() -> None:
    weights, values = arrays(7, 10, 33)
    room = np.zeros((20, 66), np.float32)
    layer(weights, np.asfortranarray(values), room[::2, ::2], LINEAR)
    np.testing.assert_array_equal(room[::2, ::2], in_order(weights, values))
    assert not room[1::2].any()
    assert not room[:, 1::2].any()
    layer(np.asfortranarray(weights), values[:, ::-1], room[:10, :33], LINEAR)
    np.testing.assert_array_equal(room[:10, :33], in_order(weights, values)[:, ::-1])
