"""Goodness of fit: tests whether residuals are noise, at a stated rate of false alarms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc, fdtrc, log_ndtr, stdtr

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, finite
from eea.core.config import FALSE_ALARM_RATE

LAGS = 10  # samples
LEAST_LOG_SPREAD = 0.05  # of known-good logs' misfits, which are never quite alike
LEAST_RELATIVE_RMS = 3e-6  # of the signal's rms: residuals of a smaller rms are rounding
LEAST_NOISE_SHARE = 0.01  # of known noise: smaller residuals are what an exact fit leaves


@dataclass(frozen=True)
class Goodness:
    """The result of :func:`goodness_of_fit`.

    Examples
    --------
    >>> swing = 0.02 * np.sin(np.arange(256) / 20)[None, :, None] * np.ones((1, 1, 3))
    >>> noise = np.random.default_rng(0).normal(0, 0.01, (1, 256, 3))
    >>> goodness_of_fit(noise, parameters=12, sigma=0.01).good
    True
    >>> print(goodness_of_fit(noise + swing, parameters=12, unit="rad/s").verdict)
    no robot explains the log: the best fit leaves 0.0177 rad/s, which is not noise: neighbouring
    samples correlate by 0.68 (p < 1e-6)
    """

    rms: float  #: Of the residuals, in the signal's unit.
    #: The p-values of: size, from noise of the known sd (None if it is unknown), correlation in
    #: time from white noise, and the largest residual from normal noise.
    size_p: float | None
    whiteness_p: float
    peak_p: float
    p: float  #: Of all together (Bonferroni).
    #: Whether ``p`` is at least the rate of false alarms, and the residuals are no louder than
    #: noise of unknown size may be.
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
    unit: str = "times the noise",
    loudest: float = math.inf,
    missing: int = 0,
    what: str = "robot",
    samples: int = 0,
) -> Goodness:
    """Test the residuals (T, axes) of each trial for being white noise.

    Size: the sum of squares over sigma^2 against chi-square with as many degrees of freedom as
    samples minus parameters, or an F distribution where sigma is an estimate. Whiteness: a
    portmanteau test (Ljung and Box 1978) of the autocorrelations, averaged over trials and axes,
    where a model's errors add up. A fit of P
    parameters leaves N white samples with correlations of -P / (N - P) at most on average, by
    which negative correlations are corrected: otherwise 27 parameters of 3072 samples triple the
    false alarms. Peak: the largest residual against normal noise. They are joined by Bonferroni,
    with ``slow_p`` where it is given. Of 6000 white residuals 0.10% raised an alarm at a rate of
    0.1%. Trials of at most 10 samples are not tested for whiteness.

    Parameters
    ----------
    residuals
        Of each trial, (T, axes), 0 where a sample is missing.
    parameters
        Their number.
    sigma
        Standard deviation of the noise, if known. Residuals of less than a hundredth of it are
        rounding, too: those of a simulated log without noise, which a prior draws from the fit.
    floor
        Residuals of an rms up to this are rounding.
    slow_p
        The p-value of slow errors.
    unit
        The residuals' unit.
    loudest
        White residuals above it are no noise unless ``sigma`` says so.
    missing
        How many samples are missing.
    what
        What the verdict calls that which explains the log, or does not.
    samples
        Number of samples behind ``sigma``, where it is an estimate.

    Raises
    ------
    ConfigurationError
        If residuals are not finite, or no more than the parameters while ``sigma`` is not known.
    """
    trials = [finite("residuals", trial, (None, None)) for trial in residuals]
    count = sum(trial.size for trial in trials) - missing
    shortest = min(map(len, trials), default=0)
    floor = max(floor, LEAST_NOISE_SHARE * (sigma or 0.0))
    if count <= parameters and sigma is None:
        raise ConfigurationError(f"residuals must outnumber parameters, {parameters}; got {count}")
    squares = sum(float((trial**2).sum()) for trial in trials)
    rms = (squares / count) ** 0.5
    if count <= parameters:
        words = f"{count} samples are too few to tell how well {parameters} numbers explain them"
        return Goodness(rms, None, 1.0, 1.0, 1.0, good=True, verdict=words)
    if rms <= floor:
        words = f"the best fit explains the log up to rounding ({rms:.1g} {unit})"
        return Goodness(rms, sigma and 1.0, 1.0, 1.0, 1.0, good=True, verdict=words)
    shares, spread = autocorrelation(trials, LAGS, floor)
    corrected = np.minimum(shares + parameters / (count - parameters), 0.0)
    excess = np.where(shares > 0.0, shares, corrected)
    peak, off = _largest(trials, floor)
    size_p = None
    tests = {}  # complaint: p-value
    if sigma is not None:
        freedom = count - parameters
        size = squares / sigma**2
        size_p = float(
            fdtrc(freedom, samples, size / freedom) if samples else chdtrc(freedom, size)
        )
        tests[f"{rms / sigma:.3g} times the noise"] = size_p
    whiteness_p = 1.0
    if shortest > LAGS:
        whiteness_p = float(chdtrc(LAGS, float(((excess / spread) ** 2).sum())))
        tests[f"not noise: neighbouring samples correlate by {shares[0]:.2f}"] = whiteness_p
    peak_p = min(1.0, float(2.0 * count * np.exp(log_ndtr(-peak))))
    tests[f"not noise: a sample is off by {off:.2g} {unit}"] = peak_p
    if slow_p is not None:
        tests["not noise: it changes slowly"] = slow_p
    worst = min(tests, key=lambda name: tests[name])
    p = min(1.0, len(tests) * tests[worst])
    how_sure = f"p = {p:.2g}" if p >= 1e-6 else "p < 1e-6"
    words = f"the best fit leaves {rms:.3g} {unit}"
    loud = sigma is None and rms > loudest
    if p >= FALSE_ALARM_RATE and loud:
        words = (
            f"no {what} explains the log: {words}, more than a sensor's noise (if it is noise, "
            "its standard deviation must be given)"
        )
    elif p >= FALSE_ALARM_RATE:
        words += f", as noise would ({how_sure})"
    else:
        words = f"no {what} explains the log: {words}, which is {worst} ({how_sure})"
    good = p >= FALSE_ALARM_RATE and not loud
    return Goodness(rms, size_p, whiteness_p, peak_p, p, good, words, slow_p)


# Of the noise: of more, intervals may be too narrow. In all of a hundred samples alike, it moves a
# number by half of its sd.
LOUD_JITTER = 0.05
TOO_LOUD_JITTER = 1.0  # of the noise: of more, they are; kinks and strong bends look like less


def of_rough_simulator(goodness: Goodness, jitter: float, too_wide: Sequence[str] = ()) -> Goodness:
    """Return the goodness of a fit whose simulator is rough by a share of the noise.

    Errors of a solver are alike in all samples, and do not average out as noise does. The ranges of
    some numbers may be ``too_wide`` for derivatives.
    """
    if goodness.good and too_wide:
        words = (
            f"the log tells {' and '.join(too_wide)} to a millionth of the range, within which the "
            "simulator is not smooth: state a narrower range, or the logarithm"
        )
        return replace(goodness, good=False, verdict=words)
    if not goodness.good or jitter <= TOO_LOUD_JITTER:
        return goodness
    words = (
        f"the simulator jitters by {jitter:.1g} of the noise, too much for intervals: give it a "
        f"smaller tolerance, or double precision (its best fit leaves {goodness.rms:.3g})"
    )
    return replace(goodness, good=False, verdict=words)


def beside_rounding(
    goodness: Goodness,
    residuals: Sequence[Floats],
    rounded: NDArray[np.bool_],
    count: int,
    parameters: int,
    what: str = "robot",
) -> Goodness:
    """Return the goodness of a fit, some of whose channels (C,) are ``rounded`` by a recorder.

    Errors of rounding are neither white nor normal, so the ``residuals`` (T, C) of the others are
    tested, as multiples of their noise. ``count`` is the number of the others' samples.
    """
    if rounded.all():
        words = f"the best fit leaves {goodness.rms:.3g} times the noise, as rounding would"
        return replace(goodness, whiteness_p=1.0, peak_p=1.0, p=1.0, good=True, verdict=words)
    others = [np.where(rounded, 0.0, one) for one in residuals]
    missing = sum(one.size for one in others) - count
    found = goodness_of_fit(others, parameters, 1.0, missing=missing, what=what)
    return replace(found, unexplained=goodness.unexplained)


def against_known_good(
    misfit: float, usual: Floats, away: float, freedom: int, what: str = "robot"
) -> Goodness:
    """Return the goodness of a fit, judged by those of logs that are known to be good.

    Parameters
    ----------
    misfit
        The mean square of the residuals over the noise's.
    usual
        (n,) those of the known-good logs. Their logarithms are taken as normal, of unknown mean and
        spread.
    away
        The squared distance of the fitted numbers from those of known-good logs, in their spread.
    freedom
        How many these numbers are.
    what
        What the verdict calls that which explains the log, or does not.
    """
    size_p = student_p(misfit, usual)
    far_p = float(chdtrc(freedom, away)) if freedom else 1.0
    p = min(1.0, 2.0 * min(size_p, far_p))
    rms = misfit**0.5
    most = float(np.sqrt(np.max(usual)))
    good = p >= FALSE_ALARM_RATE
    words = f"the best fit leaves {rms:.3g} times the noise"
    if size_p <= far_p:
        words += f", and of {len(usual)} known-good logs up to {most:.3g} times"
    else:
        words += f", with numbers {away**0.5:.2g} sd from those of known-good logs"
    how_sure = f"p = {p:.2g}" if p >= 1e-6 else "p < 1e-6"
    words += f" ({how_sure})"
    if not good:
        words = f"no {what} explains the log: {words}"
    return Goodness(rms, size_p, 1.0, 1.0, p, good, words)


def student_p(value: float, known: Floats) -> float:
    """Return the chance of a positive number of at least ``value``, given n ``known`` ones (n,).

    Their logarithms are taken as normal: Student's t with n - 1 degrees of freedom.
    """
    logs = np.log(np.maximum(known, 1e-300))
    count = len(logs)
    spread = max(float(logs.std(ddof=1)), LEAST_LOG_SPREAD) * (1.0 + 1.0 / count) ** 0.5
    away = (math.log(max(value, 1e-300)) - float(logs.mean())) / spread
    return float(stdtr(count - 1, -away))


def autocorrelation(
    residuals: Sequence[Floats] | Floats, lags: int, floor: float = 0.0
) -> tuple[Floats, Floats]:
    """Return the autocorrelations (lags,) of trials' residuals (T, axes), and white noise's sd.

    Deviations are from zero, not from the mean: a constant residual is an error. An axis of a trial
    with an rms up to ``floor`` is left out. A residual of 0 is a missing one, of no pair.
    """
    above = np.zeros(lags)
    weight = 0.0
    variance = np.zeros(lags)
    for trial in residuals:
        length = len(trial)
        powers = (trial**2).sum(axis=0)
        used = trial[:, powers > length * floor**2]
        powers = powers[powers > length * floor**2]
        there = used != 0.0
        counts = there.sum(axis=0)
        for lag in range(1, min(lags, length - 1) + 1):
            products = (used[lag:] * used[:-lag]).sum(axis=0)
            pairs = (there[lag:] & there[:-lag]).sum(axis=0)
            above[lag - 1] += float((counts * products / powers).sum())
            variance[lag - 1] += float((counts * pairs / (counts + 2.0)).sum())
        weight += float(counts.sum())
    if not weight:
        return np.zeros(lags), np.ones(lags)
    return above / weight, np.sqrt(np.where(variance > 0.0, variance, weight)) / weight


def _largest(trials: Sequence[Floats], floor: float) -> tuple[float, float]:
    """Return the largest residual, divided by its axis's rms over all trials, and in their unit.

    Missing samples, whose residuals are 0, do not count: they would make the others look large.
    """
    samples = np.concatenate(trials)
    there = np.maximum(np.count_nonzero(samples, axis=0), 1)
    rms = np.sqrt((samples**2).sum(axis=0) / there)
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
