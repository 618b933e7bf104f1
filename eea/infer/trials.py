"""Observed trials, which may differ in length, rate and noise.

Trials are rows of one array. One that is shorter than the longest is filled up, and what fills it
has no weight. Neither has a missing sample.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import dct

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, all_of, brief, real_numbers
from eea.infer.simulating import simulated
from eea.infer.statement import RobotModel, Values

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
    squares, counts = np.zeros((2, len(least)))
    for left, mask in zip(residuals, there, strict=True):
        squares += (left**2).sum(axis=(0, 2))
        counts += mask.sum(axis=(0, 2))
    freedom = counts * np.maximum(1.0 - unknowns / counts.sum(), 0.1)
    sd = np.maximum(np.sqrt(squares / np.maximum(freedom, 1.0)), least)
    gaps, share, pairs = np.array(
        [_following(residuals, there, channel) for channel in range(len(least))]
    ).T
    certain = share > SIGNIFICANT_SDS / np.sqrt(np.maximum(pairs, 1.0))
    neighbours = np.maximum(share, 0.0) ** (1.0 / gaps)
    return Noise(sd, np.where(certain, np.minimum(neighbours, MOST_CORRELATION), 0.0))


def _following(
    residuals: Sequence[Floats], there: Sequence[NDArray[np.bool_]], channel: int
) -> tuple[float, float, float]:
    """Return the commonest gap in samples, the correlation of pairs so apart, and their number.

    The correlation is that of the pairs' own squares, so it is 1 at most. A pair is of samples that
    follow each other, with none between that is not missing: 1 apart where no sample is missing, 3
    apart where a channel has every third.
    """
    gaps = []
    pairs = []
    for left, mask in zip(residuals, there, strict=True):
        for one, own in zip(left[:, channel], mask[:, channel], strict=True):
            places = np.flatnonzero(own)
            gaps.append(np.diff(places))
            pairs.append(np.stack([one[places[:-1]], one[places[1:]]]))
    gap = np.concatenate(gaps)
    if not len(gap):
        return 1.0, 0.0, 0.0
    commonest = int(np.bincount(gap).argmax())
    first, second = np.concatenate(pairs, axis=1)[:, gap == commonest]
    squares = 0.5 * float((first**2 + second**2).sum())
    return float(commonest), float(first @ second) / max(squares, 1e-300), float(len(first))


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

    Residuals (..., E, C, T) become ``scale * (weight * r[t] - back * weight * r[before])``, of the
    last sample before t that is not missing.
    """

    weight: Floats  #: (E, C, T)
    back: Floats | None  #: (E, C, T), None where no noise is coloured
    scale: Floats | None  #: (E, C, T), with ``back``
    before: NDArray[np.intp] | None  #: (E, C, T), None where that is t - 1

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
                if self.before is None:
                    last = white[..., :-1].copy()
                else:
                    places = self.before[trials].reshape(len(trials), *middle, channels, samples)
                    every = np.broadcast_to(places, white.shape)
                    last = np.take_along_axis(white, every, axis=-1)[..., 1:]
                white[..., 1:] -= of(self.back)[..., 1:] * last
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


# Of the mean distance of two samples: readings within it of even times count as even.
EVEN_TIME_SHARE = 0.5
LEAST_DISTINCT = 10  # values of a trial that is not equal to another by chance
LEAST_SHARED = 20  # rows at the end of one trial and the start of another
LARGEST_NUMBER = 1e100  # of a signal, in any unit: its square, summed and weighed, is finite


@dataclass(frozen=True, eq=False)
class Trial:
    """A recorded trial.

    Examples
    --------
    >>> Trial([[0.1], [0.2], [np.nan]], inputs=[1.0]).signal.shape  # the last sample is missing
    (3, 1)
    """

    signal: ArrayLike  #: (T, channels), in the channels' units; NaN where a sample is missing.
    #: What the simulator takes of the trial: a command, a series of them, or other numbers.
    inputs: ArrayLike | None = None
    remarks: Sequence[str] = ()  #: Sentences on how the samples were made of a recorder's rows.

    def __post_init__(self) -> None:
        object.__setattr__(self, "remarks", all_of("remarks", self.remarks, str))
        signal = real_numbers("signal", self.signal)
        if signal.ndim != 2 or not np.isfinite(signal).any():
            raise ConfigurationError(
                "signal must have shape (samples, channels) and a finite sample; got shape "
                f"{signal.shape}"
            )
        if (loudest := np.nanmax(np.abs(signal))) > LARGEST_NUMBER:
            raise ConfigurationError(
                f"signal must be at most {LARGEST_NUMBER:g}, or NaN where missing; got {loudest:g}"
            )
        object.__setattr__(self, "signal", signal)
        if self.inputs is not None:
            inputs = real_numbers("inputs", self.inputs)
            if not np.isfinite(inputs).all():
                raise ConfigurationError(f"inputs must be finite; got {brief(self.inputs)}")
            object.__setattr__(self, "inputs", inputs)


@dataclass(frozen=True, eq=False)
class Observed:
    """E trials of the robot."""

    #: (E, ...), a row for each trial, of what a simulator takes of it; or a list of E arrays of
    #: different shapes, or of E times None.
    inputs: Any
    signal: Floats  #: (E, T, axes), in the channels' units.
    #: (E, T, axes), or given as (E, T), factors that give all samples the noise of one reading; 0
    #: where there is no sample. None for 1.
    weight: Floats | None = None
    #: (E, T), times of the samples in the unit of a discrepancy's duration; None for 1, 2, ...
    time: Floats | None = None
    noise: Noise | None = None  #: Of each channel; None where all have the same, white noise.
    #: The first two trials, from 1, that have samples in common, as windows that overlap; if any.
    shared: tuple[int, int] | None = None
    _bases: dict[tuple[int, float], SlowBasis] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.weight is not None and self.weight.ndim == 2:
            weight = np.broadcast_to(self.weight[:, :, None], self.signal.shape)
            object.__setattr__(self, "weight", weight)

    @classmethod
    def of(cls, trials: Sequence[Trial], robot: RobotModel) -> Observed:
        """Return recorded trials, which may be of unequal length and have missing samples."""
        channels = len(robot.channels)
        if not all_of("trials", trials, Trial):
            raise ConfigurationError("trials must be one or more; got none")
        signals: list[Floats] = [np.asarray(trial.signal) for trial in trials]
        for signal in signals:
            if signal.shape[1] != channels:
                raise ConfigurationError(
                    f"signal must have the {channels} channels {', '.join(robot.channels)}; "
                    f"got shape {signal.shape}"
                )
        joined = np.full((len(trials), max(map(len, signals)), channels), np.nan)
        for row, signal in zip(joined, signals, strict=True):
            row[: len(signal)] = signal
        there = np.isfinite(joined)
        without = [number for number, one in enumerate(trials, 1) if one.inputs is None]
        if 0 < len(without) < len(trials):
            raise ConfigurationError(
                f"trials must all have inputs, or none of them; trial {without[0]} of "
                f"{len(trials)} has none"
            )
        inputs: Any = [None if t.inputs is None else np.asarray(t.inputs) for t in trials]
        shared = twice(signals)
        if shared is not None:
            one, two = shared
            places = one - 1, two - 1
            if all(_same(*(given[k] for k in places)) for given in (signals, inputs)):
                raise ConfigurationError(
                    "trials must be recordings of their own, each given once; got the same in "
                    f"trials {one} and {two}"
                )
        shapes = {None if one is None else one.shape for one in inputs}
        if len(shapes) == 1 and shapes != {None}:
            inputs = np.stack(inputs)
        weight = None if there.all() else there.astype(np.float64)
        return cls(inputs, np.where(there, joined, 0.0), weight, shared=shared)

    def __len__(self) -> int:
        return len(self.signal)

    def simulate(
        self, robot: RobotModel, values: Values, trials: NDArray[np.intp], fine: bool
    ) -> NDArray[Any]:
        """Return simulated signals (B, T, axes) of ``values`` (B,) by name, of ``trials`` (B,).

        Trials whose inputs have the same shape are simulated together.
        """
        samples, channels = self.signal.shape[1:]
        if isinstance(self.inputs, np.ndarray):
            some = simulated(robot, values, self.inputs[trials], fine, (len(trials), samples))
            return some[:, :samples]
        shapes = [None if one is None else one.shape for one in self.inputs]
        signal = np.zeros((len(trials), samples, channels))
        for shape in dict.fromkeys(shapes[trial] for trial in trials):
            rows = np.flatnonzero([shapes[trial] == shape for trial in trials])
            own = {name: value[rows] for name, value in values.items()}
            inputs = None if shape is None else np.stack([self.inputs[e] for e in trials[rows]])
            longest = max(self.counts[trial] for trial in trials[rows])
            some = simulated(robot, own, inputs, fine, (len(rows), longest))
            signal[rows, :longest] = some[:, :longest]
        return signal

    @cached_property
    def there(self) -> NDArray[np.bool_]:
        """Which samples there are, (E, T, axes)."""
        if self.weight is None:
            return np.ones(self.signal.shape, np.bool_)
        return np.asarray(self.weight > 0.0, np.bool_)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """The number of samples of each trial, up to the last that is not missing."""
        any_axis = self.there.max(axis=2)
        last = any_axis.shape[1] - any_axis[:, ::-1].argmax(axis=1)
        return tuple(np.where(any_axis.max(axis=1), last, 0).tolist())

    @property
    def missing(self) -> int:
        """The number of samples that are missing within trials, of all axes."""
        return int(sum(self.counts) * self.signal.shape[2]) - self.size

    @property
    def size(self) -> int:
        """The number of samples of all trials and axes."""
        return self.sampled(range(len(self)), 1)

    def sampled(self, trials: Iterable[int], stride: int) -> int:
        """Return the number of samples of some trials and all axes if every n-th is taken."""
        return int(self.there[list(trials), ::stride].sum())

    def whitening(self, stride: int) -> Whitening | None:
        """Return what whitens the residuals of every n-th sample; None where nothing does."""
        if self.weight is None and self.noise is None:
            return None
        samples = self.signal[:, ::stride].swapaxes(1, 2).shape  # (E, axes, T')
        weight = np.ones(samples)
        if self.weight is not None:
            weight *= self.weight[:, ::stride].swapaxes(1, 2)
        if self.noise is None:
            return Whitening(weight, None, None, None)
        weight = weight / self.noise.sd[:, None]
        if not self.noise.correlation.any():
            return Whitening(weight, None, None, None)
        there = weight > 0.0
        place = np.arange(samples[2])
        last = np.maximum.accumulate(np.where(there, place, -1), axis=2)
        before = np.concatenate([np.full((*samples[:2], 1), -1), last[:, :, :-1]], axis=2)
        shared = (self.noise.correlation[:, None] ** stride) ** (place - before)
        back = np.where(there & (before >= 0), shared, 0.0)
        scale = (1.0 - back**2) ** -0.5
        follows = bool((there[:, :, 1:] <= there[:, :, :-1]).all())  # none is missing in between
        return Whitening(weight, back, scale, None if follows else np.maximum(before, 0))

    @cached_property
    def weighted(self) -> Floats:
        """The signal (E, T, axes) times the weights."""
        return self.signal if self.weight is None else self.signal * self.weight

    def simulated(self, residuals: Iterable[Floats]) -> list[Floats]:
        """Return the signals (T, axes) of trials that leave some weighted residuals (T, axes).

        The trials have no ``noise``, and no sample is missing within them.
        """
        found = []
        for e, left in enumerate(residuals):
            own = slice(self.counts[e])
            apart = left if self.weight is None else left / self.weight[e, own]
            found.append(self.signal[e, own] + apart)
        return found

    def slow_basis(self, trial: int, duration: float) -> SlowBasis:
        """Return the basis for errors of a trial that are correlated by exp(-|t - t'| / duration).

        For evenly sampled errors it is nearly the cosine transform. All axes have the weights of
        the first.
        """
        key = trial, duration
        if key not in self._bases:
            self._bases[key] = self._slow_basis(trial, duration)
        return self._bases[key]

    def _slow_basis(self, trial: int, duration: float) -> SlowBasis:
        count = self.counts[trial]
        weight = np.ones(count) if self.weight is None else self.weight[trial, :count, 0]
        time = np.arange(count, dtype=float) if self.time is None else self.time[trial, :count]
        pace = float(np.diff(time).mean())
        uneven = np.abs(time - time[0] - pace * np.arange(count)).max() > EVEN_TIME_SHARE * pace
        if not uneven and np.ptp(weight) == 0.0:
            return SlowBasis(weight[0] ** 2 * spectrum(count, duration / pace), None)
        covariance = np.exp(-np.abs(time[:, None] - time) / duration) * np.outer(weight, weight)
        variances, vectors = np.linalg.eigh(covariance)
        return SlowBasis(np.maximum(variances, 0.0), vectors)


def twice(signals: Sequence[Floats]) -> tuple[int, int] | None:
    """Return the first two trials, from 1, of which one has samples (T, C) of the other, if any.

    One is a part of the other, or begins before the other ends, as windows that overlap do. Trials
    of few values, such as a switch's, may be equal by chance.
    """
    samples = [np.ascontiguousarray(signal).tobytes() for signal in signals]
    first: dict[bytes, int] = {}
    for i, own in enumerate(samples):
        longer = [k for k, other in enumerate(samples) if len(own) < len(other) and own in other]
        others = {first.setdefault(own, i), *longer} - {i}
        if others and _tells(signals[i]):
            one, two = sorted((min(others) + 1, i + 1))
            return one, two
    heads = {}
    for i, (own, signal) in enumerate(zip(samples, signals, strict=True)):
        if len(signal) >= LEAST_SHARED and _tells(signal[:LEAST_SHARED]):
            heads[own[: signal[:LEAST_SHARED].nbytes]] = i
    for i, (own, signal) in enumerate(zip(samples, signals, strict=True)):
        row = signal[:1].nbytes
        for start in range(row, len(own) - LEAST_SHARED * row + 1, row):
            other = heads.get(own[start : start + LEAST_SHARED * row], i)
            if other != i and samples[other].startswith(own[start:]):
                one, two = sorted((other + 1, i + 1))
                return one, two
    return None


def _same(one: Any, other: Any) -> bool:
    """Return whether two signals or inputs are the same; None is none."""
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other, equal_nan=one.dtype.kind in "fc")


def _tells(signal: Floats) -> bool:
    """Return whether samples have too many values to be equal to others by chance."""
    return len(np.unique(signal[np.isfinite(signal)])) >= LEAST_DISTINCT
