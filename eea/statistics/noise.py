"""Noise that is correlated in time: what whitens it, and bases in which it is independent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from eea.core.angles import Floats

NOISE_TOLERANCE = 0.03  # of a standard deviation, and in correlation
MOST_CORRELATION = 0.99
SIGNIFICANT_SDS = 3.0  # of white noise's correlation: a smaller correlation counts as none


class Noise(NamedTuple):
    """The noise of each channel (C,): AR(1), which is white without correlation."""

    sd: Floats  #: Standard deviation, in the channel's unit.
    correlation: Floats  #: Of neighbouring samples.

    def alike(self, other: Noise) -> bool:
        """Return whether two estimates of the noise are the same for all that follows."""
        louder = np.abs(np.log(self.sd / other.sd)).max()
        slower = np.abs(self.correlation - other.correlation).max()
        return bool(max(louder, slower) < NOISE_TOLERANCE)


def noise_of(
    residuals: Sequence[Floats], there: Sequence[NDArray[np.bool_]], unknowns: float, least: Floats
) -> Noise:
    """Return the noise of each channel that logs' residuals (E, C, T) are.

    ``there`` (E, C, T) says which samples there are; the residuals of others are 0. ``unknowns`` is
    how many the data have determined, ``least`` (C,) the least standard deviations.
    """
    squares, products, counts, pairs = np.zeros((4, len(least)))
    for left, mask in zip(residuals, there, strict=True):
        squares += (left**2).sum(axis=(0, 2))
        products += (left[:, :, 1:] * left[:, :, :-1]).sum(axis=(0, 2))
        counts += mask.sum(axis=(0, 2))
        pairs += (mask[:, :, 1:] & mask[:, :, :-1]).sum(axis=(0, 2))
    freedom = counts * np.maximum(1.0 - unknowns / counts.sum(), 0.1)
    sd = np.maximum(np.sqrt(squares / np.maximum(freedom, 1.0)), least)
    mean = squares / np.maximum(counts, 1.0)
    share = products / np.maximum(pairs * mean, 1e-300)
    certain = share > SIGNIFICANT_SDS / np.sqrt(np.maximum(pairs, 1.0))
    return Noise(sd, np.where(certain, np.minimum(share, MOST_CORRELATION), 0.0))


class SlowBasis(NamedTuple):
    """A basis in which slow errors of one trial are independent."""

    #: (T,), variances of the coefficients, for errors correlated by exp(-|t - t'| / d).
    variances: Floats
    vectors: Floats | None  #: (T, T), its columns are the basis; None for the cosine transform.

    def transform(self, signals: Floats, axes: int) -> Floats:
        """Return the coefficients (n, axes, T) of signals (n, axes times at least T)."""
        own = signals.reshape(len(signals), axes, -1)[:, :, : len(self.variances)]
        if self.vectors is not None:
            return np.asarray(own @ self.vectors)
        return np.asarray(dct(own, axis=-1, norm="ortho"))


class Whitening(NamedTuple):
    """What turns the residuals of trials into independent ones of variance 1.

    Residuals (..., E, C, T) become ``scale * (weight * r[t] - back * weight * r[t - 1])``.
    """

    weight: Floats  #: (E, C, T)
    back: Floats | None  #: (E, C, T), None where no noise is coloured
    scale: Floats | None  #: (E, C, T), with ``back``

    def __call__(self, residuals: NDArray[Any], trials: NDArray[np.intp]) -> NDArray[Any]:
        """Return whitened residuals (S, E', ..., C T) of some ``trials`` (E',), in their type."""
        channels, samples = self.weight.shape[1:]
        shape = residuals.shape
        middle = [1] * (residuals.ndim - 3)  # between the trials' axis and the samples'

        def of(table: Floats) -> NDArray[Any]:
            chosen = table[trials].astype(residuals.dtype)
            return chosen.reshape(len(trials), *middle, channels, samples)

        with np.errstate(invalid="ignore"):  # a robot that diverged
            white = residuals.reshape(*shape[:-1], channels, samples) * of(self.weight)
            if self.back is not None and self.scale is not None:
                before = white[..., :-1].copy()
                white[..., 1:] -= of(self.back)[..., 1:] * before
                white *= of(self.scale)
        found: NDArray[Any] = white.reshape(shape)
        return found


def spectrum(samples: int, duration: float) -> Floats:
    """Return the variances (T,) of the cosine transform of noise with exp(-t / duration).

    Examples
    --------
    >>> spectrum(4, 1e-3).round(6)
    array([1., 1., 1., 1.])
    """
    kept = np.exp(-1.0 / duration)
    angle = np.pi * np.arange(samples) / samples
    variances: Floats = (1.0 - kept**2) / (1.0 - 2.0 * kept * np.cos(angle) + kept**2)
    return variances
