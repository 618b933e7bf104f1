from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eea.behavior import BehaviorConfig, modulus, similarity, summarize
from eea.checks import ConfigurationError, TargetError
from fake_fish import FakeLog

DFT = BehaviorConfig()
RNG = np.random.default_rng(0)
LOG = FakeLog(RNG.normal(size=(4, 16, 3)).cumsum(axis=1), RNG.normal(size=(4, 16, 3)))


def naive_dft(signal: np.ndarray) -> list[complex]:
    n = len(signal)
    return [
        sum(signal[t] * np.exp(-2j * np.pi * k * t / n) for t in range(n))
        for k in range(n // 2 + 1)
    ]


def test_the_default_is_the_unnormalised_transform_of_each_axis_in_degrees():
    expected = [
        [c for axis in range(3) for c in naive_dft(np.degrees(trial[:, axis]))] for trial in LOG.rpy
    ]
    assert np.allclose(summarize(LOG, DFT), expected)


def test_radians_are_the_degrees_scaled():
    radians = summarize(LOG, replace(DFT, unit="radians"))
    assert np.allclose(np.degrees(radians.real), summarize(LOG, DFT).real)


def test_normalised_divides_by_the_number_of_samples():
    assert np.allclose(summarize(LOG, replace(DFT, normalised=True)) * 16, summarize(LOG, DFT))


def test_magnitude_drops_the_phase():
    magnitude = summarize(LOG, replace(DFT, difference="magnitude"))
    assert np.isrealobj(magnitude)
    assert np.allclose(magnitude, np.abs(summarize(LOG, DFT)))


def test_body_rates_are_the_gyroscope():
    rates = summarize(LOG, replace(DFT, signal="body_rates"))
    assert np.allclose(rates, summarize(FakeLog(LOG.gyro, LOG.rpy), DFT))


def test_the_rates_of_the_attitude_are_its_mean_and_rms_change_a_second():
    rate = np.degrees(np.diff(LOG.rpy, axis=1)) / 0.01
    assert np.allclose(summarize(LOG, replace(DFT, summary="mean_rate")), rate.mean(axis=1))
    rms = np.sqrt((rate**2).mean(axis=1))
    assert np.allclose(summarize(LOG, replace(DFT, summary="rms_rate")), rms)
    halved = summarize(LOG, replace(DFT, summary="rms_rate", timestep=0.02))
    assert np.allclose(halved, rms / 2)


@pytest.mark.parametrize("summary", ["mean_rate", "rms_rate"])
def test_the_rates_of_the_body_are_those_of_the_gyroscope(summary):
    found = summarize(LOG, BehaviorConfig(summary=summary, signal="body_rates", unit="radians"))
    square = np.sqrt((LOG.gyro**2).mean(axis=1))
    assert np.allclose(found, LOG.gyro.mean(axis=1) if summary == "mean_rate" else square)


def test_one_trial_needs_no_batch_axis():
    single = FakeLog(LOG.rpy[1], LOG.gyro[1])
    assert np.array_equal(summarize(single, DFT), summarize(LOG, DFT)[1:2])


def test_a_trial_does_not_depend_on_the_batch_it_is_in():
    single = FakeLog(LOG.rpy.astype("f4"), LOG.gyro)
    whole = summarize(single, DFT)
    for i in range(4):
        alone = summarize(FakeLog(single.rpy[i : i + 1], single.gyro), DFT)
        assert np.array_equal(alone[0], whole[i])
        assert similarity(alone[0], whole[0], DFT) == similarity(whole, whole[0], DFT)[i]


def test_similarity_is_one_less_the_mean_difference_over_max():
    a, b = np.array([3 + 4j, 0j]), np.array([0j, 10 + 0j])
    assert similarity(a, b, DFT) == pytest.approx(1 - (5 + 10) / 2 / 100)
    assert similarity(a, b, replace(DFT, maximum=10.0)) == pytest.approx(1 - 0.75)


def test_the_clamp_bounds_each_coefficient():
    a, b = np.array([1000.0 + 0j, 0j]), np.array([0j, 50j])
    assert similarity(a, b, DFT) == pytest.approx(1 - 10.5 / 2)
    assert similarity(a, b, replace(DFT, clamp=True)) == pytest.approx(1 - 1.5 / 2)


COEFFICIENTS = hnp.arrays(
    np.complex128, (2, 7), elements=st.complex_numbers(max_magnitude=1e4, allow_nan=False)
)


@given(COEFFICIENTS, st.booleans())
def test_similarity_is_symmetric_and_at_most_one(pair, clamp):
    config = BehaviorConfig(clamp=clamp)
    sim = similarity(pair[0], pair[1], config)
    assert sim == similarity(pair[1], pair[0], config)
    assert sim <= 1
    assert similarity(pair[0], pair[0], config) == 1
    assert sim >= 0 or not clamp


@given(COEFFICIENTS)
def test_the_modulus_is_the_absolute_value(values):
    assert np.allclose(modulus(values), np.abs(values), rtol=1e-12)
    assert np.array_equal(modulus(values.real), np.abs(values.real))


@pytest.mark.parametrize(
    ("log", "config", "message"),
    [
        (FakeLog(np.zeros((2, 1, 3)), None), DFT, "at least 2 steps"),
        (FakeLog(np.zeros((2, 8, 2)), None), DFT, r"\(B, T, 3\)"),
        (FakeLog(np.zeros(8), None), DFT, r"\(B, T, 3\)"),
        (FakeLog(np.zeros((1, 8, 3)), None), BehaviorConfig(signal="body_rates"), "holds none"),
        (FakeLog(None, np.zeros((1, 8, 3))), DFT, "must hold rpy .* holds none"),
        (None, DFT, "a robot must return a log with rpy; it returned None"),
        (np.zeros((8, 3)), DFT, "a log with rpy; it returned a ndarray"),
        (FakeLog([["left"] * 3] * 8, None), DFT, "must hold real numbers"),
        (FakeLog([[0.0], [0.0, 0.0]], None), DFT, "rpy of a robot is ragged"),
    ],
)
def test_a_log_of_the_wrong_form_is_refused(log, config, message):
    with pytest.raises(TargetError, match=message):
        summarize(log, config)


@pytest.mark.parametrize("summary", ["dft", "mean_rate", "rms_rate"])
def test_a_log_of_another_length_is_refused(summary):
    config = BehaviorConfig(summary=summary)
    assert np.array_equal(summarize(LOG, config, 16), summarize(LOG, config))
    for steps in (15, 17, 32):
        message = f"the fish must log trials of {steps} steps, .*; it logged 16"
        with pytest.raises(TargetError, match=message):
            summarize(LOG, config, steps, "the fish")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"summary": "fft"}, "did you mean 'dft'"),
        ({"signal": "body_rate"}, "did you mean 'body_rates'"),
        ({"unit": "degree"}, "did you mean 'degrees'"),
        ({"difference": "magnitudes"}, "did you mean 'magnitude'"),
        ({"maximum": 0.0}, "behavior.maximum"),
        ({"timestep": -0.01}, "behavior.timestep"),
        ({"clamp": "no"}, "behavior.clamp must be True or False; got 'no'"),
        ({"normalised": 0}, "behavior.normalised must be True or False; got 0"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(ConfigurationError, match=message):
        BehaviorConfig(**settings)
