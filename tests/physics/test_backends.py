"""The polynomials in place of libm, against libm, over their whole range."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from numpy.testing import assert_allclose

from aquafish_gym.engines.compiled.lanes import lane_width, pack_rows
from aquafish_gym.physics import compiling, simd
from aquafish_gym.physics.arithmetic import (
    arctangent2,
    fetch,
    floor,
    put,
    small_sine_cosine,
    where_less,
)

compiling.register()


def in_lanes(function, dtype, *columns):  # type: ignore[no-untyped-def]
    """Return what ``function`` of lanes gives for columns of numbers."""
    width = lane_width(dtype)
    rows = pack_rows(np.array(columns, dtype=np.float64), dtype, width)
    groups = rows.size // (len(columns) * width)

    @njit
    def run(rows, out, groups):  # type: ignore[no-untyped-def]
        for g in range(groups):
            zero = simd.zero_lanes(rows, width)
            put(out, g, function(fetch(rows, g, zero), fetch(rows, groups + g, zero)))

    out = np.empty(groups * width, dtype)
    run(rows, out, groups)
    return out[: len(columns[0])]


ANGLES = np.linspace(-math.pi, math.pi, 20001)


@pytest.mark.parametrize("radius", [1e-8, 1.0, 1e8])
def test_arctangent2_is_libms(radius: float) -> None:
    y, x = radius * np.sin(ANGLES), radius * np.cos(ANGLES)
    ours = [arctangent2(float(b), float(a)) for b, a in zip(y, x, strict=True)]
    assert_allclose(ours, np.arctan2(y, x), atol=9e-16)


@pytest.mark.parametrize(("dtype", "error"), [(np.float64, 9e-16), (np.float32, 5e-7)])
def test_arctangent2_in_lanes(dtype: type, error: float) -> None:
    from numba.extending import register_jitable

    y, x = np.sin(ANGLES), np.cos(ANGLES)
    ours = in_lanes(register_jitable(lambda b, a: arctangent2(b, a)), dtype, y, x)
    turns = (ours - np.arctan2(y, x) + math.pi) % (2 * math.pi) - math.pi
    assert_allclose(turns, 0, atol=error)


def test_arctangent2_on_the_axes() -> None:
    assert arctangent2(0.0, 0.0) == 0.0
    assert arctangent2(0.0, 1.0) == 0.0
    assert arctangent2(1.0, 0.0) == math.pi / 2
    assert arctangent2(-1.0, 0.0) == -math.pi / 2
    assert arctangent2(0.0, -1.0) == math.pi


@given(st.floats(-0.6, 0.6))
def test_small_sine_cosine(x: float) -> None:
    s, c = small_sine_cosine(x)
    assert abs(s - math.sin(x)) < 5e-16
    assert abs(c - math.cos(x)) < 5e-16


def test_primitives_are_the_same_in_lanes() -> None:
    from numba.extending import register_jitable

    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 1000)) * 3
    b[:100] = a[:100]
    chosen = in_lanes(register_jitable(lambda a, b: where_less(a, b, a, -b)), np.float64, a, b)
    assert_allclose(chosen, np.where(a < b, a, -b), rtol=0)
    whole = in_lanes(register_jitable(lambda a, b: floor(a) + 0.0 * b), np.float64, a, b)
    assert_allclose(whole, np.floor(a), rtol=0)
    assert [floor(v) for v in a] == list(np.floor(a))


@pytest.mark.parametrize(
    ("features", "width"), [("+avx512f,+avx,-sse", 64), ("+avx,-avx512f", 32), ("+sse4.2", 16)]
)
def test_lanes_fill_the_widest_register(
    monkeypatch: pytest.MonkeyPatch, features: str, width: int
) -> None:
    monkeypatch.setattr(simd.config, "CPU_FEATURES", features)
    assert simd.register_bytes.__wrapped__() == width
