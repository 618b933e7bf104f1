from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eea.core.checks import ConfigurationError
from eea.core.genome import BitLayout, Variable, pose_layout
from fake_fish import MODELS

VARIABLES = st.lists(
    st.builds(
        Variable,
        st.just("v"),
        st.integers(1, 9),
        st.floats(-10, 0),
        st.floats(0.01, 10),
        st.booleans(),
    ),
    min_size=1,
    max_size=5,
)


@given(VARIABLES, st.sampled_from(["gray", "binary"]), st.integers(0, 2**32 - 1))
def test_encoding_undoes_decoding(variables, coding, seed):
    layout = BitLayout(variables).with_coding(coding)
    genomes = layout.random(20, np.random.default_rng(seed))
    assert np.array_equal(layout.encode(layout.decode(genomes)), genomes)


def test_binary_code_is_place_values_and_gray_code_changes_one_bit_a_step():
    layout = BitLayout([Variable("v", 3, 0.0, 7.0)])
    values = np.arange(8.0)[:, None]
    binary = layout.with_coding("binary").encode(values)
    assert np.array_equal(binary @ [4, 2, 1], values[:, 0])
    assert (np.abs(np.diff(layout.encode(values).astype(int), axis=0)).sum(axis=1) == 1).all()
    with pytest.raises(ConfigurationError, match=r"coding .* did you mean 'gray'"):
        layout.with_coding("grey")


@given(VARIABLES, st.integers(0, 2**32 - 1))
def test_values_stay_in_range_and_both_ends_are_reached(variables, seed):
    layout = BitLayout(variables)
    values = layout.decode(layout.random(50, np.random.default_rng(seed)))
    assert (values >= layout.low).all()
    assert (values <= layout.high).all()
    ends = layout.decode(layout.encode([layout.low, layout.high]))
    assert np.array_equal(ends[0], layout.low)
    for value, variable in zip(ends[1], variables, strict=True):
        # The end of a periodic variable is its beginning.
        assert value == pytest.approx(variable.low if variable.periodic else variable.high)
        assert value <= variable.high


@given(st.integers(2, 10), st.data())
def test_gray_neighbours_differ_in_one_bit(bits, data):
    layout = BitLayout([Variable("v", bits, 0.0, 2.0**bits - 1)])
    k = data.draw(st.integers(0, 2**bits - 2))
    a, b = layout.encode([[k], [k + 1]])
    assert (a != b).sum() == 1


def test_a_value_is_the_range_times_k_over_two_to_the_n_less_one():
    layout = BitLayout([Variable("a", 3, 0.0, 7.0), Variable("length", 6, 0.0, 2.0)])
    # 6 and 5 in Gray code, the most significant bit first.
    found = layout.decode([[1, 0, 1, 0, 0, 0, 1, 1, 1]])[0]
    assert found == pytest.approx([6.0, 2.0 * 5 / 63])


def test_a_pose_has_24_bits_and_wraps():
    layout = pose_layout(3)
    assert layout.bits == 24
    genomes = layout.encode([[np.pi, -np.pi, 3 * np.pi]])
    assert np.allclose(layout.decode(genomes), -np.pi)


@given(hnp.arrays(np.float64, (4, 9), elements=st.floats(0, 1)))
def test_encoding_takes_the_nearest_value(fractions):
    values = fractions * MODELS.high
    quanta = np.array([v.quantum for v in MODELS.variables])
    error = np.abs(MODELS.decode(MODELS.encode(values)) - values)
    assert (error <= quanta / 2 + 1e-12).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Variable("v", 0, 0.0, 1.0), "bits of v must be a whole number of at least 1"),
        (lambda: Variable("v", 3, 1.0, 1.0), "high of v"),
        (lambda: BitLayout([]), "number of variables"),
        (lambda: MODELS.encode([[0.0] * 8]), r"values must have shape \(any, 9\)"),
        (lambda: MODELS.encode([[np.nan] * 9]), "values must be finite"),
    ],
)
def test_bad_layouts_and_values_are_refused(make, message):
    with pytest.raises(ConfigurationError, match=message):
        make()
