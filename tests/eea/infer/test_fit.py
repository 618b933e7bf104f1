"""Whether a simulator explains the trials, and intervals that count what it may get wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import dct
from scipy.signal import lfilter

from aquafish_gym import Morphology
from aquafish_gym.plans import AQUAFISH
from eea import FitConfig
from eea.fish.simulator_error import (
    Assumed,
    Calibration,
    Discrepancy,
    Material,
    contradiction,
    slow_errors,
)
from eea.infer.descent import descend
from eea.infer.fit import fit
from eea.infer.goodness import autocorrelation, effective_count, goodness_of_fit
from eea.infer.misfit import COARSE, FINE, Regression
from eea.infer.robot import Robot
from eea.infer.statement import Hypothesis, Number
from eea.infer.trials import Noise, Observed, spectrum
from eea.infer.unknowns import Unknowns
from tests.golden import fit_of_fins

TIME = 0.01 * np.arange(1, 129)
WAVE = np.sin(7.0 * TIME)
QUICK = FitConfig(bodies=8, poses=4, descents=4, polished=2, restarts=0)


def wheel(values, _commands):
    return (values["size"][:, None] * np.sin(7.0 * TIME))[:, :, None]


def wave(values, commands):
    return 0.05 * wheel(values, commands)[:, None]


NUMBERS = {"size": Number(0.0, 1.0), "a": Number.angle()}
RIGHT = Robot(wheel, NUMBERS, {"gyro": "rad/s"})


def fit_wave(robot, noise, beside=0.0, seed=0, config=QUICK):
    """Return the posterior of two trials of the wheel of size 0.5."""
    rng = np.random.default_rng(seed)
    signal = (0.5 * WAVE + beside + noise * rng.normal(size=(2, 128)))[:, :, None]
    return fit(Observed(np.full((2, 1), 0.5), signal), robot, config, rng)


def inferred(discrepancy, noise):
    return fit_wave(replace(RIGHT, discrepancy=discrepancy), noise)


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


def test_a_longer_discrepancy_and_its_calibration_scale_the_intervals():
    widths = [np.ptp(inferred(Discrepancy(0.02, t), 0.001).interval(0.9)) for t in (1.0, 5.0)]
    assert widths[1] > 1.3 * widths[0]
    calibration = Calibration((0.01,), ((2.0,),))
    plain = inferred(Discrepancy(0.02, 5.0), 0.02)
    scaled = inferred(Discrepancy(0.02, 5.0, None, calibration), 0.02)
    ratio = np.ptp(scaled.interval(0.9)) / np.ptp(plain.interval(0.9))
    assert ratio == pytest.approx(2.0, rel=0.1)


def test_a_bad_fit_keeps_its_width():
    widths = []
    for calibration in (None, Calibration((0.01,), ((0.3,),))):
        joint = replace(RIGHT, discrepancy=Discrepancy(0.02, 5.0, None, calibration))
        belief = fit_wave(joint, 0.01, beside=0.1 * np.sin(12.0 * TIME))
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
        for _ in range(150)
    ]
    assert 0.01 < np.mean(np.array(found) < 0.05) < 0.1
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
    rng, kept = np.random.default_rng(0), np.exp(-1.0 / 4.0)
    white = rng.normal(size=(4000, 164)) * np.sqrt(1.0 - kept**2)
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


def test_a_size_without_effect_stays_open_when_calibrated():
    def blind(values, _commands):
        return ((0.5 + 0.0 * values["size"][:, None]) * WAVE)[:, :, None]

    calibration = Calibration((0.01,), ((0.5,),))
    joint = replace(RIGHT, simulate=blind, discrepancy=Discrepancy(0.02, 5.0, None, calibration))
    low, high = fit_wave(joint, 0.02).interval(0.9)
    assert high[0] - low[0] > 0.8


COMMANDS = np.array([[1.0], [0.6], [0.3]])
LENGTHS = (128, 40, 77)


def turning_wheel(values, commands):
    phase = 9.0 * commands * TIME + values["a"][:, None]
    return (values["size"][:, None] * np.sin(phase))[:, :, None]


JOINT = Robot(
    turning_wheel, {"size": Number(0.0, 1.0), "a": Number.angle()}, {"gyro": "rad/s"},
    discrepancy=Discrepancy(0.01, 20.0),
)  # fmt: skip


def measured(noise=0.01, filler=0.0):
    """Return three trials of unequal lengths; what fills them up has no weight."""
    rng = np.random.default_rng(0)
    signal = turning_wheel({"size": np.full(3, 0.5), "a": np.array([0.3, 2.0, -1.0])}, COMMANDS)
    signal += noise * rng.normal(size=signal.shape)
    weight = np.ones((3, 128))
    for e, length in enumerate(LENGTHS):
        signal[e, length:], weight[e, length:] = filler, 0.0
    return Observed(COMMANDS, signal, weight)


def test_what_fills_a_short_trial_up_does_not_count():
    zero, junk = measured(), measured(filler=7.0)
    assert zero.counts == LENGTHS
    assert zero.size == sum(LENGTHS)
    assert zero.sampled((0, 1), 3) == 43 + 14
    parameters = Unknowns.of(JOINT, 3, ())
    theta = np.array([[0.4, 0.1, 1.9, -0.8]])
    whole = []
    for observed in (zero, junk):
        regression = Regression(parameters, observed, None)
        fine, coarse = regression.misfit(FINE), regression.misfit(COARSE)
        assert fine.count == sum(LENGTHS)
        assert coarse.count == sum(-(-n // 2) for n in LENGTHS)
        whole.append([fine.squares(theta)[0], coarse.squares(theta)[0]])
        belief = fit(observed, JOINT, QUICK, np.random.default_rng(1))
        whole[-1] += [belief.sigma, belief.goodness.p, *np.ravel(belief.interval(0.9))]
    assert whole[0] == whole[1]
    apart = turning_wheel({"size": np.full(3, 0.4), "a": theta[0, 1:]}, COMMANDS) - zero.signal
    alone = sum((apart[e, :n] ** 2).sum() for e, n in enumerate(LENGTHS))
    assert whole[0][0] == pytest.approx(alone)


def test_weights_give_readings_of_unequal_noise_the_noise_of_one():
    """As if each sample was the mean of so many readings."""
    even = measured(noise=0.0)
    averaged = np.where(np.arange(128) < 60, 10.0, 1.0)
    rng = np.random.default_rng(2)
    signal = even.signal + 0.01 * rng.normal(size=(3, 128, 1)) / np.sqrt(averaged)[:, None]
    weighted = Observed(COMMANDS, signal, even.weight * np.sqrt(averaged)[:, None])
    belief = fit(weighted, JOINT, QUICK, np.random.default_rng(1))
    assert belief.good, belief.verdict
    assert belief.sigma == pytest.approx(0.01, rel=0.1)
    ignored = fit(replace(weighted, weight=even.weight), JOINT, QUICK, np.random.default_rng(1))
    assert ignored.sigma < 0.008


def test_slow_errors_of_uneven_times_have_a_basis_of_their_own():
    time, weight = np.cumsum(np.repeat([0.01, 0.05], 60)), np.repeat([3.0, 1.0], 60)
    observed = Observed(np.zeros((1, 1)), np.zeros((1, 120, 1)), weight[None], time[None])
    basis = observed.slow_basis(0, 0.27)
    assert basis.vectors is not None
    correlation = np.exp(-np.abs(time[:, None] - time) / 0.27)
    found = (basis.vectors * basis.variances) @ basis.vectors.T
    np.testing.assert_allclose(found, correlation * np.outer(weight, weight), atol=1e-9)
    assert basis.transform(np.eye(120), 1).shape == (120, 1, 120)
    # Of even times they have the weights of the first axis.
    even, weight = 0.02 * np.arange(120)[None], np.tile([2.0, 3.0], (1, 120, 1))
    basis = Observed(np.zeros((1, 1)), np.zeros((1, 120, 2)), weight, even).slow_basis(0, 0.27)
    assert basis.vectors is None
    np.testing.assert_allclose(basis.variances, 4.0 * spectrum(120, 0.27 / 0.02))


def test_whitened_residuals_are_independent_across_missing_samples():
    rng = np.random.default_rng(0)
    there = rng.random((2, 12, 2)) < 0.5
    noise = Noise(np.array([0.5, 2.0]), np.array([0.9, 0.4]))
    observed = Observed(np.zeros((2, 1)), np.zeros(there.shape), there.astype(float), noise=noise)
    apart = rng.normal(size=(2, 2, 12)) * there.swapaxes(1, 2)  # of each trial and channel
    for stride in (1, 2):
        whitening = observed.whitening(stride)
        assert whitening is not None
        one = apart[:, :, ::stride]
        samples = one.shape[2]
        white = whitening(one.reshape(1, 2, -1), np.arange(2)).reshape(one.shape)
        for trial, channel in np.ndindex(2, 2):
            own = np.flatnonzero(there[trial, ::stride, channel])
            share = noise.correlation[channel] ** stride
            covariance = noise.sd[channel] ** 2 * share ** np.abs(own[:, None] - own)
            left = one[trial, channel, own]
            wanted = left @ np.linalg.solve(covariance, left)
            assert (white[trial, channel] ** 2).sum() == pytest.approx(wanted, rel=1e-9)
            absent = np.setdiff1d(np.arange(samples), own)
            assert not white[trial, channel, absent].any()


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


def test_missing_samples_do_not_make_the_others_look_large():
    noise = np.random.default_rng(0).normal(0.0, 0.01, (2, 400, 2))
    whole = goodness_of_fit(noise[:1], parameters=4, sigma=0.01)
    noise[1] = 0.0  # a trial that is missing
    half = goodness_of_fit(noise, parameters=4, sigma=0.01, missing=800)
    assert half.peak_p == pytest.approx(whole.peak_p)


SLOW, FAST = np.sin(7.0 * TIME), np.sin(23.0 * TIME)
SLIP = Assumed("the slip of the wheel", 0.0, 0.1, "m", "the size")
SLIP_NOISE = 0.05


def slipped(slip, mixed, seed=0):
    """Return the posterior of trials with a slip, which the simulator assumes to be none.

    It makes some of the wave of the size, and a wave of its own.
    """

    def shapes(values, _commands):
        wave = SLIP.sd * (SLOW + mixed * FAST)
        return np.tile(wave[None, None, :, None], (len(values["size"]), 1, 1, 1))

    discrepancy = Discrepancy(1e-4, 5.0, assumed=(SLIP,), assumed_shapes=shapes)
    joint = replace(RIGHT, discrepancy=discrepancy)
    return fit_wave(joint, SLIP_NOISE, slip * (SLOW + mixed * FAST), seed)


def test_a_contradicted_assumption_becomes_a_nuisance_of_the_intervals():
    """Its amplitude is told by the fast wave alone, to 0.05 / sqrt(128) / 0.3 = 0.015."""
    belief, plain = slipped(0.05, 0.3), slipped(0.0, 0.3)
    assert belief.good
    (said,) = belief.findings
    assert said.startswith("the log contradicts what is assumed: the slip of the wheel, 0 m; the")
    low, high = belief.interval(0.9)
    assert low[0] < 0.5 < high[0]
    assert high[0] - low[0] > 2.0 * np.ptp(np.array(plain.interval(0.9))[:, 0])
    assert plain.findings == []  # it holds
    found = contradiction(plain.best_fit)
    assert found.p > 0.05
    assert found.spread[0] == pytest.approx(SLIP_NOISE / 128**0.5 / 0.3, rel=0.2)


def test_an_assumption_that_the_data_do_not_tell_is_said_to_be_one():
    assert slipped(0.05, 0.0).findings == [
        "assumed, not measured: the slip of the wheel, 0 m; the size depends on it"
    ]


def test_contradictions_of_true_assumptions_are_as_rare_as_stated():
    p = np.array([contradiction(slipped(0.0, 0.3, seed).best_fit).p for seed in range(25)])
    assert (p < 0.05).sum() <= 5
    assert (p < 0.5).mean() == pytest.approx(0.5, abs=0.3)


def test_rough_fins_rub_like_thicker_ones_that_weigh_the_same():
    bodies = Morphology.nominal().to_array()[None]
    own = Material().fields(AQUAFISH, bodies, np.ones((1, 2)))  # the engine's
    assert own["body"].tolist() == bodies.tolist()
    assert (own["fin_density"] == 1.0).all()
    assert (own["drag"] == 1.0).all()
    rough = Material(friction=3.0).fields(AQUAFISH, bodies, np.ones((1, 2)))
    thickness = bodies[:, [2, 5, 6]]
    thicker = rough["body"][:, [2, 5, 6]]
    assert (thicker > thickness).all()
    np.testing.assert_allclose(thicker * rough["fin_density"], thickness)


@pytest.mark.parametrize("density", [1.5, 1.0])
def test_dense_fins_are_found_out(density):
    belief = fit_of_fins(density)
    assert belief.good
    said = " ".join(belief.findings)
    assert ("the intervals allow for another value" in said) == (density != 1.0)
