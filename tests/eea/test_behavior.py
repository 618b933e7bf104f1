from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eea.core.behavior import BehaviorConfig, modulus, similarity, summarize
from eea.core.checks import ConfigurationError, TargetError
from fake_fish import FakeLog

DFT = BehaviorConfig()
ATTITUDE = BehaviorConfig(signal="attitude")
both_signals = pytest.mark.parametrize("config", [DFT, ATTITUDE], ids=["body_rates", "attitude"])
RNG = np.random.default_rng(0)
LOG = FakeLog(RNG.normal(size=(4, 16, 3)).cumsum(axis=1), RNG.normal(size=(4, 16, 3)))


def naive_dft(signal: np.ndarray) -> list[complex]:
    n = len(signal)
    return [
        sum(signal[t] * np.exp(-2j * np.pi * k * t / n) for t in range(n))
        for k in range(n // 2 + 1)
    ]


def naive_transform(samples: np.ndarray) -> list[list[complex]]:
    return [
        [c for axis in range(3) for c in naive_dft(np.degrees(trial[:, axis]))] for trial in samples
    ]


def test_the_default_is_the_unnormalised_transform_of_each_rate_in_degrees_a_second():
    assert np.allclose(summarize(LOG, DFT), naive_transform(LOG.gyro))


def test_the_attitudes_is_that_of_roll_pitch_and_yaw_in_degrees():
    assert np.allclose(summarize(LOG, ATTITUDE), naive_transform(LOG.rpy))


@both_signals
def test_radians_are_the_degrees_scaled(config):
    radians = summarize(LOG, replace(config, unit="radians"))
    assert np.allclose(np.degrees(radians.real), summarize(LOG, config).real)


@both_signals
def test_normalised_divides_by_the_number_of_samples(config):
    normalised = summarize(LOG, replace(config, normalised=True))
    assert np.allclose(normalised * 16, summarize(LOG, config))


@both_signals
def test_magnitude_drops_the_phase(config):
    magnitude = summarize(LOG, replace(config, difference="magnitude"))
    assert np.isrealobj(magnitude)
    assert np.allclose(magnitude, np.abs(summarize(LOG, config)))


def test_body_rates_are_the_gyroscope():
    rates = summarize(LOG, DFT)
    assert np.allclose(rates, summarize(FakeLog(LOG.gyro, LOG.rpy), ATTITUDE))


def test_the_rates_of_the_attitude_are_its_mean_and_rms_change_a_second():
    rate = np.degrees(np.diff(LOG.rpy, axis=1)) / 0.01
    assert np.allclose(summarize(LOG, replace(ATTITUDE, summary="mean_rate")), rate.mean(axis=1))
    rms = np.sqrt((rate**2).mean(axis=1))
    assert np.allclose(summarize(LOG, replace(ATTITUDE, summary="rms_rate")), rms)
    halved = summarize(LOG, replace(ATTITUDE, summary="rms_rate", timestep=0.02))
    assert np.allclose(halved, rms / 2)


@pytest.mark.parametrize("summary", ["mean_rate", "rms_rate"])
def test_the_rates_of_the_body_are_those_of_the_gyroscope(summary):
    found = summarize(LOG, BehaviorConfig(summary=summary, signal="body_rates", unit="radians"))
    square = np.sqrt((LOG.gyro**2).mean(axis=1))
    assert np.allclose(found, LOG.gyro.mean(axis=1) if summary == "mean_rate" else square)


@both_signals
def test_one_trial_needs_no_batch_axis(config):
    single = FakeLog(LOG.rpy[1], LOG.gyro[1])
    assert np.array_equal(summarize(single, config), summarize(LOG, config)[1:2])


@both_signals
def test_a_trial_does_not_depend_on_the_batch_it_is_in(config):
    single = FakeLog(LOG.rpy.astype("f4"), LOG.gyro.astype("f4"))
    whole = summarize(single, config)
    for i in range(4):
        alone = summarize(FakeLog(single.rpy[i : i + 1], single.gyro[i : i + 1]), config)
        assert np.array_equal(alone[0], whole[i])
        assert similarity(alone[0], whole[0], config) == similarity(whole, whole[0], config)[i]


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


@both_signals
@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (np.zeros((2, 1, 3)), "at least 2 steps"),
        (np.zeros((2, 8, 2)), r"\(B, T, 3\)"),
        (np.zeros(8), r"\(B, T, 3\)"),
        (None, "must hold {name} for behavior.signal = {signal}; that of a robot holds none"),
        ([["left"] * 3] * 8, "must hold real numbers; {name} of a robot is"),
        ([[0.0], [0.0, 0.0]], "{name} of a robot is ragged"),
    ],
)
def test_a_log_of_the_wrong_form_is_refused(samples, message, config):
    # The other signal is as it should be, and is not taken instead.
    name = "rpy" if config.signal == "attitude" else "gyro"
    log = replace(LOG, **{name: samples})
    with pytest.raises(TargetError, match=message.format(name=name, signal=config.signal)):
        summarize(log, config, axes=3)


@both_signals
@pytest.mark.parametrize(("log", "got"), [(None, "None"), (np.zeros((8, 3)), "a ndarray")])
def test_what_is_no_log_is_refused(log, got, config):
    name = "rpy" if config.signal == "attitude" else "gyro"
    with pytest.raises(TargetError, match=f"a robot must return a log with {name}; .* {got}"):
        summarize(log, config)


@both_signals
def test_the_other_signal_need_not_be_logged(config):
    other = "gyro" if config.signal == "attitude" else "rpy"
    alone = replace(LOG, **{other: None})
    assert np.array_equal(summarize(alone, config), summarize(LOG, config))


@pytest.mark.parametrize("signal", ["attitude", "body_rates"])
@pytest.mark.parametrize("summary", ["dft", "mean_rate", "rms_rate"])
def test_a_log_of_another_length_is_refused(summary, signal):
    config = BehaviorConfig(summary=summary, signal=signal)
    assert np.array_equal(summarize(LOG, config, 16), summarize(LOG, config))
    for steps in (15, 17, 32):
        message = f"the fish must log trials of {steps} steps, .*; it logged 16"
        with pytest.raises(TargetError, match=message):
            summarize(LOG, config, steps, source="the fish")


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
