"""Does the best fit explain what was felt? A test with a stated false-alarm rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc, log_ndtr

from eea.core.checks import ConfigurationError, brief, finite, real, whole

Floats = NDArray[np.float64]

LAGS = 10  # samples, over which residuals are held against one another
ALARM = 1e-3  # the false-alarm rate


@dataclass(frozen=True)
class Goodness:
    """How well the best fit explains the logs.

    Examples
    --------
    >>> swing = 0.02 * np.sin(np.arange(256) / 20)[None, :, None] * np.ones((1, 1, 3))
    >>> noise = np.random.default_rng(0).normal(0, 0.01, (1, 256, 3))
    >>> goodness_of_fit(noise, parameters=12, sigma=0.01).good
    True
    >>> print(goodness_of_fit(noise + swing, parameters=12, sigma=None).verdict)
    none of the bodies I can imagine swims like this: what the best fit leaves, 0.0177 rad/s, is no
    noise: neighbouring samples correlate by 0.68 (p < 1e-6)
    """

    rms: float  #: Of the residuals, in their unit.
    #: The chance of residuals as large from noise of the known sd; None if it is not known.
    size_p: float | None
    #: The chance of residuals as correlated in time from white noise.
    whiteness_p: float
    peak_p: float  #: The chance of a largest residual as large from normal noise.
    p: float  #: Of all together (Bonferroni): the chance of an alarm at this level.
    good: bool  #: Whether ``p`` is at least the alarm's rate.
    verdict: str  #: In a sentence.


def goodness_of_fit(
    residuals: Sequence[ArrayLike] | NDArray[np.float64],
    parameters: int,
    sigma: float | None = None,
    *,
    floor: float = 1e-6,
    lags: int = LAGS,
    alarm: float = ALARM,
) -> Goodness:
    """Test residuals for being but noise: whiteness, the largest, and size if the sd is known.

    Size: the sum of squares over sigma^2 against chi-square of as many degrees as samples less
    parameters; too large is bad. Whiteness: a portmanteau test (Ljung and Box 1978) of the
    autocorrelations, averaged over trials and axes first, where a model's errors add up and noise
    does not. A fit takes from white noise what its P parameters can imitate, and what is left of N
    samples correlates, by P / (N - P) on average at most, negatively where the parameters' effects
    are slow against the lags. So much is forgiven to a negative correlation: without it, 27
    parameters of 3072 samples triple the false alarms. The two are joined by Bonferroni, twice the
    smaller chance. Of 6000 white residuals 0.10% raised an alarm at the rate of 0.1%, of those of a
    fit fewer.

    Parameters
    ----------
    residuals
        (E, T, axes), or E arrays (T, axes) of different lengths: felt less predicted, rad/s.
    parameters
        How many were fitted, in all.
    sigma
        The noise's sd if known, rad/s.
    floor
        Residuals of a smaller rms are rounding, rad/s: a perfect fit, whatever their shape.
    lags
        Of the whiteness test, in samples.
    alarm
        The rate of false alarms, of correct models called wrong.

    Raises
    ------
    ConfigurationError
        If residuals are not finite, too short for the lags, or fewer than the parameters.
    """
    trials = _trials(residuals)
    whole("parameters", parameters, 0)
    whole("lags", lags, 1)
    real("floor", floor, 0.0)
    real("alarm", alarm, 0.0, 1.0)
    count = sum(trial.size for trial in trials)
    if count <= parameters or min(map(len, trials)) <= lags:
        raise ConfigurationError(
            f"residuals must outnumber parameters, {parameters}, and each trial lags, {lags}; "
            f"got {count} in trials of {min(map(len, trials))} samples or more"
        )
    squares = sum(float((trial**2).sum()) for trial in trials)
    rms = (squares / count) ** 0.5
    if rms <= floor:
        words = f"the best fit explains all that was felt, to rounding ({rms:.1g} rad/s)"
        return Goodness(rms, sigma and 1.0, 1.0, 1.0, 1.0, good=True, verdict=words)
    size_p = None
    if sigma is not None:
        real("sigma", sigma, np.finfo(float).tiny)
        size_p = float(chdtrc(count - parameters, squares / sigma**2))
    shares, spread = autocorrelation(trials, lags, floor)
    forgiven = parameters / (count - parameters)
    excess = np.where(shares > 0.0, shares, np.minimum(shares + forgiven, 0.0))
    whiteness_p = float(chdtrc(lags, float(((excess / spread) ** 2).sum())))
    peak, off = _largest(trials, floor)
    peak_p = min(1.0, float(2.0 * count * np.exp(log_ndtr(-peak))))
    chances = [whiteness_p, peak_p] + ([] if size_p is None else [size_p])
    p = min(1.0, len(chances) * min(chances))
    good = p >= alarm
    how_sure = f"p = {p:.2g}" if p >= 1e-6 else "p < 1e-6"
    if good:
        words = f"the best fit leaves {rms:.3g} rad/s, as noise would ({how_sure})"
    else:
        if min(chances) == size_p:
            how = f"{rms / (sigma or 1.0):.3g} times the noise"
        elif min(chances) == whiteness_p:
            how = f"no noise: neighbouring samples correlate by {shares[0]:.2f}"
        else:
            how = f"no noise: a sample is off by {off:.2g} rad/s"
        words = (
            "none of the bodies I can imagine swims like this: what the best fit leaves, "
            f"{rms:.3g} rad/s, is {how} ({how_sure})"
        )
    return Goodness(rms, size_p, whiteness_p, peak_p, p, good, words)


def autocorrelation(
    residuals: Sequence[ArrayLike] | NDArray[np.float64], lags: int, floor: float = 0.0
) -> tuple[Floats, Floats]:
    """Return the autocorrelations at lags 1 to ``lags`` over trials and axes, and white noise's sd.

    Both have shape (lags,). About zero, not the mean: a constant residual is an error, too. Each
    trial's axis counts by its length, whatever its size; those of an rms up to ``floor`` do not.
    """
    above, weight, variance = np.zeros(lags), 0.0, np.zeros(lags)
    for trial in _trials(residuals):
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
    """Return the largest residual, in its axis's rms over all trials, and as it is."""
    samples = np.concatenate(trials)
    rms = np.sqrt(np.mean(samples**2, axis=0))
    most = np.abs(samples).max(axis=0)
    worst = int(np.argmax(np.where(rms > floor, most / np.maximum(rms, floor), 0.0)))
    return float(most[worst] / rms[worst]), float(most[worst])


def effective_count(residuals: Sequence[ArrayLike] | NDArray[np.float64]) -> float:
    """Return how many independent samples correlated ``residuals`` are worth, N at most.

    N / (1 + 2 (r1 + r2 + ...)), the autocorrelations up to the first that is not positive (Geyer
    1992). Where a model errs, intervals that take sigma times sqrt(N / this) are nearer the truth.

    Examples
    --------
    >>> white = np.random.default_rng(0).normal(size=(4, 500, 3))
    >>> smooth = white[:, 4:] + white[:, 3:-1] + white[:, 2:-2] + white[:, 1:-3] + white[:, :-4]
    >>> round(smooth.size / effective_count(smooth))  # sums of five: 1 + 2 (0.8 + ... + 0.2)
    5
    """
    trials = _trials(residuals)
    count = sum(trial.size for trial in trials)
    most = max(max(map(len, trials)) // 2, 1)
    lags = min(16, most)
    while (shares := autocorrelation(trials, lags)[0]).min() > 0.0 and lags < most:
        lags = min(2 * lags, most)
    ends = np.flatnonzero(shares <= 0.0)
    total = float(shares[: ends[0] if len(ends) else len(shares)].sum())
    return max(count / (1.0 + 2.0 * total), 1.0)


def _trials(residuals: Sequence[ArrayLike] | NDArray[np.float64]) -> list[Floats]:
    """Return the residuals as a list of arrays (T, axes); at least one, with a sample."""
    trials = [finite("residuals", trial, (None, None)) for trial in residuals]
    if not trials or min(trial.size for trial in trials) == 0:
        raise ConfigurationError(f"residuals must hold samples; got {brief(residuals)}")
    return trials
