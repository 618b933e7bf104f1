from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from eea.core.checks import ConfigurationError
from eea.infer.goodness import autocorrelation, effective_count, goodness_of_fit

SIGMA = 0.01
SHAPE = (4, 256, 3)


def smooth_effects(rng, count, shape=SHAPE):
    """Return what parameters do to trials of a shape: orthonormal (N, count), and slow."""
    time = np.arange(shape[1])[:, None] / 100
    rate, phase = (
        2 * np.pi * rng.uniform(least, most, size=(count, shape[0], 1, shape[2]))
        for least, most in ((0.1, 3.0), (0.0, 1.0))
    )
    return np.linalg.qr(np.sin(rate * time + phase).reshape(count, -1).T)[0]


@pytest.mark.parametrize("sigma", [None, SIGMA])
def test_white_noise_raises_the_alarm_as_often_as_stated(sigma):
    rng = np.random.default_rng(0)
    alarms = [goodness_of_fit(rng.normal(0, SIGMA, SHAPE), 0, sigma).p < 0.05 for _ in range(600)]
    assert 0.025 < np.mean(alarms) < 0.08


def test_what_a_fit_leaves_of_one_trial_raises_it_no_more_often():
    """Of 768 samples and 21 parameters of slow effects: one in five if they were ignored."""
    rng, shape, fits = np.random.default_rng(1), (1, 256, 3), []
    for _ in range(20):
        effects = smooth_effects(rng, 21, shape)
        for noise in rng.normal(0, SIGMA, (20, np.prod(shape))):
            left = noise - effects @ (effects.T @ noise)
            fits.append(goodness_of_fit(left.reshape(shape), 21, SIGMA))
    assert np.mean([fit.whiteness_p < 0.05 for fit in fits]) < 0.05
    counts, _ = np.histogram([fit.size_p for fit in fits], 5, range=(0, 1))
    assert counts == pytest.approx(np.full(5, 80), abs=32)


@pytest.mark.parametrize("sigma", [None, SIGMA])
def test_a_wrong_model_that_adds_four_hundredths_to_the_rms_is_found_out(sigma):
    rng = np.random.default_rng(2)
    found = 0
    for _ in range(50):
        error = smooth_effects(rng, 1).reshape(SHAPE) * np.sqrt(0.08 * np.prod(SHAPE)) * SIGMA
        fit = goodness_of_fit(rng.normal(0, SIGMA, SHAPE) + error, 27, sigma)
        found += not fit.good
    assert found >= 48


def test_noise_larger_than_known_is_found_out_by_its_size_alone():
    noise = np.random.default_rng(0).normal(0, 1.1 * SIGMA, SHAPE)
    fit = goodness_of_fit(noise, 27, SIGMA)
    assert not fit.good
    assert fit.whiteness_p > 0.01
    assert fit.verdict.startswith("no robot explains the log")
    assert "1.1 times the noise" in fit.verdict
    assert goodness_of_fit(noise, 27, None).good


def test_rounding_is_a_perfect_fit_whatever_its_shape():
    drift = np.linspace(-1e-7, 1e-7, 256)[None, :, None] * np.ones(SHAPE)
    fit = goodness_of_fit(drift, 27, None, floor=1e-6)
    assert fit.good
    assert fit.p == 1.0
    assert "to rounding" in fit.verdict
    assert not goodness_of_fit(100 * drift, 27, None).good
    assert goodness_of_fit(np.zeros(SHAPE), 27, SIGMA).good


def test_autocorrelations_are_those_of_an_autoregressive_process():
    noise = np.random.default_rng(0).normal(size=(6, 4000, 3))
    series = lfilter([1.0], [1.0, -0.7], noise, axis=1)
    shares, spread = autocorrelation(series, 5)
    assert shares == pytest.approx(0.7 ** np.arange(1, 6), abs=0.02)
    assert spread == pytest.approx(np.full(5, noise.size**-0.5), rel=0.01)


def test_noise_with_most_samples_missing_is_noise():
    rng = np.random.default_rng(0)
    fits = []
    for _ in range(300):
        noise = rng.normal(size=(1, 200, 1))
        noise[:, 15:-15] = 0.0
        fits.append(goodness_of_fit(noise, 2, missing=170))
    assert sum(fit.whiteness_p < 0.05 for fit in fits) <= 27  # of 15
    assert sum(not fit.good for fit in fits) <= 2


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_correlated_samples_are_worth_fewer(share):
    noise = np.random.default_rng(0).normal(size=(6, 4000, 3))
    series = lfilter([1.0], [1.0, -share], noise, axis=1)
    expected = noise.size * (1 - share) / (1 + share)
    assert effective_count(series) == pytest.approx(expected, rel=0.12)
    assert effective_count(-np.sign(share) * series) <= noise.size


@pytest.mark.parametrize(
    ("residuals", "settings", "said"),
    [
        (np.zeros((1, 20, 1)), {"parameters": 20}, "outnumber parameters, 20"),
        (np.full((1, 20, 1), np.nan), {}, "residuals must be finite"),
    ],
)
def test_what_cannot_be_tested_is_refused(residuals, settings, said):
    with pytest.raises(ConfigurationError, match=said):
        goodness_of_fit(residuals, **{"parameters": 2, **settings})


def test_white_residuals_louder_than_a_gyroscope_are_no_noise():
    loud = np.random.default_rng(0).uniform(-10.0, 10.0, (2, 256, 3))
    fit = goodness_of_fit(loud, parameters=12, unit="rad/s", loudest=0.3)
    assert not fit.good
    assert "as noise would" not in fit.verdict
    assert "more than a sensor's noise" in fit.verdict
    assert goodness_of_fit(loud / 5.8, parameters=12, sigma=1.0).good


@pytest.mark.parametrize("share", [0.0, 1e-6, 1e-3])
def test_a_log_without_noise_is_explained_whatever_noise_is_stated(share):
    smooth = 0.01 * np.sin(np.arange(256) / 20)[None, :, None]
    fit = goodness_of_fit(share * smooth, parameters=4, sigma=0.01, unit="rad/s")
    assert fit.good
    assert "up to rounding" in fit.verdict
    assert not goodness_of_fit(smooth, parameters=4, sigma=0.01).good


def test_missing_samples_do_not_make_the_others_look_large() -> None:
    noise = np.random.default_rng(0).normal(0.0, 0.01, (2, 400, 2))
    whole = goodness_of_fit(noise[:1], parameters=4, sigma=0.01)
    noise[1] = 0.0  # a trial that is missing
    half = goodness_of_fit(noise, parameters=4, sigma=0.01, missing=800)
    assert half.peak_p == pytest.approx(whole.peak_p)
