"""Intervals count what the simulator may get wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import dct
from scipy.signal import lfilter

from eea import FitConfig
from eea.fish.simulator_error import Calibration, Discrepancy, slow_errors
from eea.infer.descent import descend
from eea.infer.fit import fit
from eea.infer.goodness import goodness_of_fit
from eea.infer.misfit import FINE, Regression
from eea.infer.robot import Robot
from eea.infer.statement import Hypothesis, Number, Part
from eea.infer.trials import Observed, spectrum
from eea.infer.unknowns import Unknowns
from eea.infer.words import Fit, faults

TIME = 0.01 * np.arange(1, 129)
WAVE = np.sin(7.0 * TIME)
QUICK = FitConfig(bodies=8, poses=4, descents=4, polished=2, restarts=0)


def wheel(values, _commands):
    return (values["size"][:, None] * np.sin(7.0 * TIME))[:, :, None]


def wave(values, commands):
    return 0.05 * wheel(values, commands)[:, None]


NUMBERS = {"size": Number(0.0, 1.0), "a": Number.angle()}
RIGHT = Robot(wheel, NUMBERS, {"gyro": "rad/s"})


def inferred(discrepancy, noise):
    joint = replace(RIGHT, discrepancy=discrepancy)
    rng = np.random.default_rng(0)
    signal = (0.5 * WAVE + noise * rng.normal(size=(2, 128)))[:, :, None]
    return fit(Observed(np.full((2, 1), 0.5), signal), joint, QUICK, rng)


def test_an_unknown_scale_widens_the_interval_to_what_the_simulator_is_worth():
    for noise in (0.0, 0.01):
        belief = inferred(Discrepancy(1e-4, 5.0, wave), noise)
        low, high = belief.interval(0.9)
        # The wave is proportional to the size: its sd of 5% is that of the size.
        assert high[0] - low[0] == pytest.approx(2 * 1.645 * 0.05 * 0.5, rel=0.15)
        assert belief.model[0] == pytest.approx(0.5, abs=0.01)


def test_the_median_body_is_that_inside_the_model():
    inside, doubted = inferred(None, 0.0), inferred(Discrepancy(0.02, 20.0), 0.0)
    assert doubted.model.tolist() == inside.model.tolist()
    (low,), (high,) = doubted.interval(0.9)
    assert low < 0.5 < high
    assert high - low > 1e-3
    assert np.ptp(inside.interval(0.9)) < 1e-5


def test_a_longer_discrepancy_costs_more():
    widths = [np.ptp(inferred(Discrepancy(0.02, t), 0.001).interval(0.9)) for t in (1.0, 5.0)]
    assert widths[1] > 1.3 * widths[0]


def test_calibration_scales_the_intervals():
    calibration = Calibration((0.01,), ((2.0,),))
    plain = inferred(Discrepancy(0.02, 5.0), 0.02)
    scaled = inferred(Discrepancy(0.02, 5.0, None, calibration), 0.02)
    ratio = np.ptp(scaled.interval(0.9)) / np.ptp(plain.interval(0.9))
    assert ratio == pytest.approx(2.0, rel=0.1)


def test_a_bad_fit_keeps_its_width():
    widths = []
    for calibration in (None, Calibration((0.01,), ((0.3,),))):
        joint = replace(RIGHT, discrepancy=Discrepancy(0.02, 5.0, None, calibration))
        noise = 0.01 * np.random.default_rng(0).normal(size=(2, 128))
        signal = (0.5 * WAVE + 0.1 * np.sin(12.0 * TIME) + noise)[:, :, None]
        belief = fit(Observed(np.full((2, 1), 0.5), signal), joint, QUICK, np.random.default_rng(0))
        assert not belief.good
        widths.append(np.ptp(belief.interval(0.9)))
    assert widths[1] == pytest.approx(widths[0])


def fitted(signal, duration=20.0):
    """Return the regression of a signal (2, 128) on the wheel, and its optimum (P,)."""
    joint = replace(RIGHT, discrepancy=Discrepancy(0.02, duration))
    parameters = Unknowns.of(joint, 2, ())
    observed = Observed(np.full((2, 1), 0.5), signal[:, :, None])
    regression = Regression(parameters, observed, None)
    starts = np.array([[0.5, 0.0, 0.0]])
    return regression, descend(regression.misfit(FINE), starts, 0.01, 10, 1e-9).theta[0]


def test_noise_is_found_slow_as_often_as_stated():
    rng = np.random.default_rng(3)
    found = [
        slow_errors(*fitted(0.5 * WAVE + 0.02 * rng.normal(size=(2, 128))), 20.0)
        for _ in range(400)
    ]
    assert 0.02 < np.mean(np.array(found) < 0.05) < 0.09
    assert 0.3 < np.mean(np.array(found) < 0.5) < 0.6


def test_a_slow_error_is_found_where_neighbouring_samples_say_little():
    rng, slow = np.random.default_rng(4), 0.01 * np.sin(3.0 * TIME)
    seen = []
    for _ in range(30):
        signal = 0.5 * WAVE + slow + 0.02 * rng.normal(size=(2, 128))
        regression, theta = fitted(signal)
        left = regression.misfit(FINE).residuals(theta[None])[0].reshape(2, 128, 1)
        found = slow_errors(regression, theta, 20.0)
        seen.append((found < 1e-3, goodness_of_fit(left, 3).whiteness_p < 1e-3))
    slowly, next_to = np.mean(seen, axis=0)
    assert slowly > 0.85
    assert slowly > next_to + 0.2


def test_spectrum_is_that_of_an_autoregression():
    rng, kept, count = np.random.default_rng(0), np.exp(-1.0 / 4.0), 4000

    white = rng.normal(size=(count, 164)) * np.sqrt(1.0 - kept**2)
    drawn = lfilter([1.0], [1.0, -kept], white, axis=1)[:, 100:]
    found = (dct(drawn, axis=1, norm="ortho") ** 2).mean(axis=0)
    assert found[2:] == pytest.approx(spectrum(64, 4.0)[2:], rel=0.2)


def test_what_the_first_trials_rule_out_is_never_fitted_again():
    hopeless = Hypothesis("the wheel has no rim", {"size": 0.1})
    robot = replace(RIGHT, hypotheses=[hopeless])
    always = replace(QUICK, alternatives="always", noise=0.01)
    rng, belief, fitted = np.random.default_rng(0), None, []
    signal = (0.5 * WAVE + 0.01 * rng.normal(size=(3, 128)))[:, :, None]
    for trials in (1, 2, 3):
        observed = Observed(np.full((trials, 1), 0.5), signal[:trials])
        belief = fit(observed, robot, always, rng, belief, progress=fitted.append)
    begun = [said for said in fitted if not said.endswith(" simulations")]
    assert begun == [robot.nominal.name, hopeless.name, *[robot.nominal.name] * 2]


FIN = replace(
    RIGHT,
    numbers={**NUMBERS, "servo": Number(0.0, 1.0, mean=1.0, switch=True)},
    parts={"fin": Part({"size": "size"}, hint="a faster fin would tell")},
)
SEIZED = Hypothesis("the servo is seized", {"servo": 0.0}, part="fin")
MISSING = Hypothesis("the fin is missing", {"size": 0.0}, part="fin")


def test_hypotheses_that_fit_alike_are_one_statement():
    fits = [Fit(SEIZED, 0.6, 0.0), Fit(MISSING, 0.3, 0.1), Fit(RIGHT.nominal, 0.1, 0.5)]
    assert faults(fits, FIN) == [
        "the servo is seized (60%); the data fit nearly alike if the fin is missing (30%) or "
        "nothing is wrong with it; a faster fin would tell"
    ]


def test_three_causes_that_fit_alike_share_a_sentence_that_begins_with_the_likeliest():
    fouled = Hypothesis("weed hangs on the fin", part="fin")
    fits = [Fit(SEIZED, 0.5, 0.0), Fit(MISSING, 0.3, 0.1), Fit(fouled, 0.2, 0.2)]
    assert faults(fits, FIN) == [
        "the servo is seized (50%); the data fit nearly alike if the fin is missing (30%) or "
        "weed hangs on the fin (20%); a faster fin would tell"
    ]


def test_a_hypothesis_that_alone_fits_is_named():
    fits = [Fit(SEIZED, 0.98, 0.0), Fit(MISSING, 0.02, 9.0), Fit(RIGHT.nominal, 0.0, 40.0)]
    assert faults(fits, FIN) == ["the servo is seized (98%)", "the fin is missing (2%)"]


def test_a_size_without_effect_stays_open_when_calibrated():
    def blind(values, _commands):
        return ((0.5 + 0.0 * values["size"][:, None]) * np.sin(7.0 * TIME))[:, :, None]

    calibration = Calibration((0.01,), ((0.5,),))
    joint = replace(RIGHT, simulate=blind, discrepancy=Discrepancy(0.02, 5.0, None, calibration))
    signal = (0.5 * WAVE + 0.02 * np.random.default_rng(0).normal(size=(2, 128)))[:, :, None]
    belief = fit(Observed(np.full((2, 1), 0.5), signal), joint, QUICK, np.random.default_rng(1))
    low, high = belief.interval(0.9)
    assert high[0] - low[0] > 0.8
