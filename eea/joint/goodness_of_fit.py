"""Goodness of fit: tests whether residuals are noise, at a stated rate of false alarms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc, log_ndtr

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, finite

LAGS = 10  # samples
FALSE_ALARM_RATE = 1e-3  # rate of false alarms
LEAST_RELATIVE_RMS = 3e-6  # share of the signal's rms; smaller residuals are rounding errors
#: rad/s. A gyroscope for a dollar has a hundredth of this noise. Louder noise must be given.
LOUDEST_NOISE = 0.3


@dataclass(frozen=True)
class Goodness:
    """The result of :func:`goodness_of_fit`.

    Examples
    --------
    >>> swing = 0.02 * np.sin(np.arange(256) / 20)[None, :, None] * np.ones((1, 1, 3))
    >>> noise = np.random.default_rng(0).normal(0, 0.01, (1, 256, 3))
    >>> goodness_of_fit(noise, parameters=12, sigma=0.01).good
    True
    >>> print(goodness_of_fit(noise + swing, parameters=12, sigma=None).verdict)
    no body explains the log: the best fit leaves 0.0177 rad/s, which is not noise: neighbouring
    samples correlate by 0.68 (p < 1e-6)
    """

    rms: float  #: Root mean square of the residuals, rad/s.
    #: The p-values of: size, for noise of the known sd (None if it is unknown), correlation in
    #: time from white noise, and the largest residual from normal noise.
    size_p: float | None
    whiteness_p: float
    peak_p: float
    p: float  #: The p-value of all tests together (Bonferroni).
    #: Whether ``p`` is at least the rate of false alarms, and the residuals are small enough for a
    #: gyroscope's noise.
    good: bool
    verdict: str  #: The result in a sentence.
    #: The p-value of the test for slow errors, as simulators make them.
    slow_p: float | None = None
    unexplained: float | None = None  #: The residuals' rms as a share of the signal's, if known.


def goodness_of_fit(
    residuals: Sequence[ArrayLike] | Floats,
    parameters: int,
    sigma: float | None = None,
    floor: float = 0.0,
    slow_p: float | None = None,
) -> Goodness:
    """Test the residuals (T, axes) of each trial, rad/s, for being white noise.

    Size: the sum of squares over sigma^2 against chi-square with as many degrees of freedom as
    samples minus parameters. Whiteness: a portmanteau test (Ljung and Box 1978) of the
    autocorrelations, averaged over trials and axes, where a model's errors add up. A fit of P
    parameters to N white samples makes their mean correlation as low as -P / (N - P). Negative
    correlations are corrected for this: otherwise 27 parameters of 3072 samples triple the false
    alarms. Peak: the largest residual against normal noise. The tests are joined by Bonferroni,
    with ``slow_p`` of :mod:`eea.joint.slow_errors` where it is given. White residuals above
    0.3 rad/s are not taken for a gyroscope's noise unless ``sigma`` is given.

    ``parameters`` is the number of fitted parameters. ``sigma`` is the standard deviation of the
    noise if known, rad/s. Residuals with an rms up to ``floor``, rad/s, are rounding errors.

    Raises
    ------
    ConfigurationError
        If residuals are not finite, not longer than the lags, or fewer than the parameters.
    """
    trials = [finite("residuals", trial, (None, None)) for trial in residuals]
    count = sum(trial.size for trial in trials)
    shortest = min(map(len, trials), default=0)
    if count <= parameters or shortest <= LAGS:
        raise ConfigurationError(
            f"residuals must outnumber parameters, {parameters}, and each trial's lags, {LAGS}; "
            f"got {count} in trials of at least {shortest} samples"
        )
    squares = sum(float((trial**2).sum()) for trial in trials)
    rms = (squares / count) ** 0.5
    if rms <= floor:
        words = f"the best fit explains the log up to rounding ({rms:.1g} rad/s)"
        return Goodness(rms, sigma and 1.0, 1.0, 1.0, 1.0, good=True, verdict=words)
    shares, spread = autocorrelation(trials, LAGS, floor)
    corrected = np.minimum(shares + parameters / (count - parameters), 0.0)
    excess = np.where(shares > 0.0, shares, corrected)
    peak, off = _largest(trials, floor)
    size_p = None
    tests = {}  # complaint: p-value
    if sigma is not None:
        size_p = float(chdtrc(count - parameters, squares / sigma**2))
        tests[f"{rms / sigma:.3g} times the noise"] = size_p
    whiteness_p = float(chdtrc(LAGS, float(((excess / spread) ** 2).sum())))
    tests[f"not noise: neighbouring samples correlate by {shares[0]:.2f}"] = whiteness_p
    peak_p = min(1.0, float(2.0 * count * np.exp(log_ndtr(-peak))))
    tests[f"not noise: a sample is off by {off:.2g} rad/s"] = peak_p
    if slow_p is not None:
        tests["not noise: it changes slowly"] = slow_p
    worst = min(tests, key=lambda name: tests[name])
    p = min(1.0, len(tests) * tests[worst])
    how_sure = f"p = {p:.2g}" if p >= 1e-6 else "p < 1e-6"
    words = f"the best fit leaves {rms:.3g} rad/s"
    loud = sigma is None and rms > LOUDEST_NOISE
    if p >= FALSE_ALARM_RATE and loud:
        words = (
            f"no body explains the log: {words}, more than a gyroscope's noise (if it is noise, "
            "its standard deviation must be given)"
        )
    elif p >= FALSE_ALARM_RATE:
        words += f", as noise would ({how_sure})"
    else:
        words = f"no body explains the log: {words}, which is {worst} ({how_sure})"
    good = p >= FALSE_ALARM_RATE and not loud
    return Goodness(rms, size_p, whiteness_p, peak_p, p, good, words, slow_p)


def autocorrelation(
    residuals: Sequence[Floats] | Floats, lags: int, floor: float = 0.0
) -> tuple[Floats, Floats]:
    """Return the autocorrelations (lags,) of trials' residuals (T, axes), and white noise's sd.

    Deviations are from zero, not from the mean: a constant residual is an error. An axis of a trial
    with an rms up to ``floor`` is left out.
    """
    above = np.zeros(lags)
    weight = 0.0
    variance = np.zeros(lags)
    for trial in residuals:
        length = len(trial)
        powers = (trial**2).sum(axis=0)
        used = trial[:, powers > length * floor**2]
        powers = powers[powers > length * floor**2]
        for lag in range(1, min(lags, length - 1) + 1):
            products = (used[lag:] * used[:-lag]).sum(axis=0)
            above[lag - 1] += length * float((products / powers).sum())
            variance[lag - 1] += len(powers) * length * (length - lag) / (length + 2.0)
        weight += length * len(powers)
    if not weight:
        return np.zeros(lags), np.ones(lags)
    return above / weight, np.sqrt(variance) / weight


def _largest(trials: Sequence[Floats], floor: float) -> tuple[float, float]:
    """Return the largest residual, divided by its axis's rms over all trials, and in rad/s."""
    samples = np.concatenate(trials)
    rms = np.sqrt(np.mean(samples**2, axis=0))
    most = np.abs(samples).max(axis=0)
    worst = int(np.argmax(most / np.maximum(rms, max(floor, 1e-300))))
    return float(most[worst] / rms[worst]), float(most[worst])


def effective_count(residuals: Sequence[Floats] | Floats) -> float:
    """Return the effective number of independent samples of the residuals (T, axes) of trials.

    It is N / (1 + 2 (r1 + r2 + ...)), with the autocorrelations up to the first that is not
    positive (Geyer 1992).

    Examples
    --------
    >>> white = np.random.default_rng(0).normal(size=(4, 500, 3))
    >>> smooth = white[:, 4:] + white[:, 3:-1] + white[:, 2:-2] + white[:, 1:-3] + white[:, :-4]
    >>> round(smooth.size / effective_count(smooth))  # sums of five: 1 + 2 (0.8 + ... + 0.2)
    5
    """
    size = sum(trial.size for trial in residuals)
    most = max(min(map(len, residuals)) // 2, 1)
    lags = min(16, most)
    while (shares := autocorrelation(residuals, lags)[0]).min() > 0.0 and lags < most:
        lags = min(2 * lags, most)
    ends = np.flatnonzero(shares <= 0.0)
    total = float(shares[: ends[0] if len(ends) else len(shares)].sum())
    return max(size / (1.0 + 2.0 * total), 1.0)
