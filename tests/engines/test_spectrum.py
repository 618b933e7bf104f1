"""The transforms in the lanes are numpy's, and so are the distances between them."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym.engines.compiled.spectrum import (
    coefficients,
    disagreements,
    pack_spectra,
    padded,
    spectral_distances,
)
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.utils.validation import InvalidArgumentError
from instruments.verification.trials import lane_batch, random_trials, rotations

COUNT = 35  # no multiple of any width
ROUNDING = {np.float32: 3e-7, np.float64: 1e-15}
dtypes = pytest.mark.parametrize("dtype", ROUNDING)


def spectra(steps: int, dtype: type[np.floating], **kwargs: object) -> np.ndarray:
    t = random_trials(COUNT, 0)
    batch = lane_batch(t.morphologies, t.fin_angles, dtype=dtype, **kwargs)  # type: ignore[arg-type]
    return batch.spectra(t.commands, steps, scale=2.0)


def by_numpy(steps: int, dtype: type[np.floating]) -> np.ndarray:
    t = random_trials(COUNT, 0)
    batch = lane_batch(t.morphologies, t.fin_angles, dtype=dtype)
    log = batch.log(t.commands, steps, "gyro")
    samples = 2.0 * np.asarray(log.gyro, dtype=np.float64)
    return np.fft.rfft(samples.transpose(0, 2, 1), axis=-1).reshape(COUNT, -1)


@dtypes
@pytest.mark.parametrize("steps", [4, 8, 16, 64, 512, 1024])
def test_the_transform_is_numpys(steps: int, dtype: type[np.floating]) -> None:
    found, expected = spectra(steps, dtype), by_numpy(steps, dtype)
    count = coefficients(steps)
    assert found.shape == (COUNT, 2, padded(steps))
    assert expected.shape[1] == count
    assert (found[:, :, count:] == 0).all()
    complexes = found[:, 0, :count] + 1j * found[:, 1, :count]
    error = abs(complexes - expected).max(axis=1) / abs(expected).max(axis=1)
    assert error.max() < ROUNDING[dtype]


@dtypes
def test_distances_are_those_of_the_coefficients(dtype: type[np.floating]) -> None:
    found, expected = spectra(64, dtype), by_numpy(64, dtype)
    observed, which = expected[5:9], np.arange(COUNT) % 4
    apart = spectral_distances(found, pack_spectra(observed, dtype), which)
    np.testing.assert_allclose(
        apart, abs(expected - observed[which]).sum(axis=1), rtol=1e-5, atol=ROUNDING[dtype] * 1e4
    )
    pairs = disagreements(found, 7)
    groups = expected.reshape(5, 7, -1)
    naive = [sum(abs(a - b).sum() for i, a in enumerate(g) for b in g[:i]) for g in groups]
    np.testing.assert_allclose(pairs, naive, rtol=10 * ROUNDING[dtype])


@dtypes
def test_no_spectrum_depends_on_threads_or_batch(dtype: type[np.floating]) -> None:
    whole = spectra(32, dtype)
    np.testing.assert_array_equal(spectra(32, dtype, threads=3), whole)
    # Only work that is worth it is split.
    one, three = (spectra(1024, dtype, threads=threads) for threads in (1, 3))
    np.testing.assert_array_equal(three, one)
    t = random_trials(COUNT, 0)
    some = lane_batch(t.morphologies[9:12], t.fin_angles[9:12], dtype=dtype)
    np.testing.assert_array_equal(some.spectra(t.commands[9:12], 32, 2.0), whole[9:12])


@pytest.mark.slow  # each width is compiled by itself, which takes ten seconds
@dtypes
@pytest.mark.parametrize("width", [1, 4, 8, 16])
def test_no_spectrum_depends_on_the_width(dtype: type[np.floating], width: int) -> None:
    np.testing.assert_array_equal(spectra(32, dtype, width=width), spectra(32, dtype))


@dtypes
def test_what_needs_no_attitude_leaves_one_in_the_state(dtype: type[np.floating]) -> None:
    """Spectra, and a log of the gyroscope."""
    t = random_trials(COUNT, 0)
    whole, *others = [lane_batch(t.morphologies, t.fin_angles, dtype=dtype) for _ in range(3)]
    for batch in (whole, *others):
        batch.advance(t.commands, 20)
    whole.log(t.commands, 32, "attitude")
    others[0].spectra(t.commands, 32)
    others[1].log(t.commands, 32, "gyro")
    angles = layout(AQUAFISH).rpy
    for batch in others:
        turned = [rotations(each.states[angles].T) for each in (whole, batch)]
        np.testing.assert_allclose(*turned, atol=1e-5)
        np.testing.assert_array_equal(batch.states[: angles.start], whole.states[: angles.start])


def test_a_robot_that_diverges_has_no_finite_spectrum_and_spoils_no_other() -> None:
    t = random_trials(COUNT, 0)
    batch = lane_batch(t.morphologies, t.fin_angles)
    batch.states[10, 3] = 1e30  # spins
    found = batch.spectra(t.commands, 32, 2.0)
    assert not np.isfinite(spectral_distances(found, found[:1].copy(), np.zeros(COUNT, int))[3])
    others = np.arange(COUNT) != 3
    np.testing.assert_array_equal(found[others], spectra(32, np.float32)[others])


@pytest.mark.parametrize("steps", [2, 12, 100])
def test_only_powers_of_two_are_transformed(steps: int) -> None:
    with pytest.raises(InvalidArgumentError, match=f"steps must be a power of two.*got {steps}"):
        spectra(steps, np.float32)
