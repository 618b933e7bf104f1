"""Trials of unequal lengths, rates and noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eea import FitConfig
from eea.fish.simulator_error import Discrepancy
from eea.infer.fit import fit
from eea.infer.misfit import COARSE, FINE, Regression
from eea.infer.robot import Robot
from eea.infer.statement import Number
from eea.infer.trials import Noise, Observed, spectrum
from eea.infer.unknowns import Unknowns

TIME = 0.01 * np.arange(1, 129)
QUICK = FitConfig(bodies=8, poses=4, descents=4, polished=2, restarts=0)
COMMANDS = np.array([[1.0], [0.6], [0.3]])
LENGTHS = (128, 40, 77)


def wheel(values, commands):
    phase = 9.0 * commands * TIME + values["a"][:, None]
    return (values["size"][:, None] * np.sin(phase))[:, :, None]


JOINT = Robot(
    wheel, {"size": Number(0.0, 1.0), "a": Number.angle()}, {"gyro": "rad/s"},
    discrepancy=Discrepancy(0.01, 20.0),
)  # fmt: skip


def measured(noise=0.01, filler=0.0):
    """Return three trials of unequal lengths; what fills them up has no weight."""
    rng = np.random.default_rng(0)
    signal = wheel({"size": np.full(3, 0.5), "a": np.array([0.3, 2.0, -1.0])}, COMMANDS)
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
    apart = wheel({"size": np.full(3, 0.4), "a": theta[0, 1:]}, COMMANDS) - zero.signal
    alone = sum((apart[e, :n] ** 2).sum() for e, n in enumerate(LENGTHS))
    assert whole[0][0] == pytest.approx(alone)


def test_the_noise_of_unequal_trials_is_found_and_the_fit_is_good():
    belief = fit(measured(), JOINT, QUICK, np.random.default_rng(1))
    assert belief.good, belief.verdict
    assert belief.samples == sum(LENGTHS)
    assert belief.sigma == pytest.approx(0.01, rel=0.1)
    assert belief.model[0] == pytest.approx(0.5, abs=0.005)


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
    even = Observed(np.zeros((1, 1)), np.zeros((1, 120, 1)), None, 0.02 * np.arange(120)[None])
    basis = even.slow_basis(0, 0.27)
    assert basis.vectors is None
    np.testing.assert_allclose(basis.variances, spectrum(120, 0.27 / 0.02))


def test_slow_errors_have_the_weights_of_the_first_axis():
    weight = np.tile([2.0, 3.0], (1, 64, 1))
    basis = Observed(np.zeros((1, 1)), np.zeros((1, 64, 2)), weight).slow_basis(0, 4.0)
    np.testing.assert_allclose(basis.variances, 4.0 * spectrum(64, 4.0))


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
