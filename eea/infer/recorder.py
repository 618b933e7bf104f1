"""What a recorder does to a signal: it rounds readings, holds them, and cuts them off at its ends.

Each leaves equal readings in the log that no noise makes. The best fit tells them from a signal
that is constant, and from counts and switches, whose noise is a step or more.

- Readings that are **held**, because a sensor is slower than the log, a robot rests, or rows were
  filled up, are the first of each that are equal; the others tell nothing.
- Readings **at an end** are no readings of the signal, nor are those that noise kept from it: where
  the simulated signal is that near, or beyond, all are left out.
- A reading in **steps** h is off by up to half a step, and as far whenever the signal passes alike.
  With white noise of the standard deviation s before rounding, this error has the standard
  deviation t = h / sqrt(12) exp(-2 (pi s / h)^2) (B. Widrow and I. Kollar, "Quantization noise",
  2008, ch. 6 and 7), which n readings on m levels average over m, not over n.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.infer.optima import Optima
from eea.infer.trials import Noise, Observed

LEAST_EQUAL_SHARE = 0.25  # of neighbouring readings, where they are rounded
ON_GRID = 0.1  # of a step: levels of rounded readings are as near to multiples of it
FAR_ERROR = 0.75  # of a step
# Of the variance in steps squared: the share of readings that is as far off. That of a rare switch
# or count is all of the variance.
MOST_FAR = 0.25
SWITCH_VARIANCE = 0.12  # in steps squared: a switch of less is off by nearly a step at times
FINE_STEP = 0.25  # of what neighbouring residuals differ by: steps that are less make few equal
# Of readings in fine steps that are as the one before, beside the commonest, as often as by chance.
LEAST_HELD_SHARE = 0.2
HELD_RATIO = 2.0
LEAST_AT_END = 5  # readings at an end of a channel
LEAST_END_SHARE = 0.02  # of the readings
END_RATIO = 5.0  # times the number of the commonest other reading
LEAST_LEVELS = 10  # of readings that are no switch or count
NEAR_END_SDS = 2.0  # from an end: noise may keep the reading from it
LEAST_WIDENING = 1.05  # of a channel's noise: less changes nothing
ROUNDING = 1e-6  # of a signal: residuals of less are those of a log without noise


class Recorded(NamedTuple):
    """What a recorder did to a channel."""

    channel: int
    kind: str  #: "steps", "held", or "end".
    value: float  #: The step, or the end.
    rows: int  #: How many readings are concerned, in all trials,
    of: int  #: of how many.


def simulated(optima: Optima, observed: Observed) -> Floats:
    """Return the signal (E, T, C) of a best fit, also where it left samples out."""
    whole = replace(optima.regression, observed=observed)
    return replace(optima, regression=whole).signal


def recorded(optima: Optima) -> list[Recorded]:
    """Return what a recorder did to the channels of the trials of a best fit."""
    observed = optima.regression.observed
    found = []
    for c in range(observed.signal.shape[2]):
        there = observed.there[:, :, c]
        values = observed.signal[:, :, c][there]
        levels, counts = np.unique(values, return_counts=True)
        again = _again(observed, c)
        if max(counts.max(initial=0), again.sum()) < LEAST_AT_END:
            continue  # no simulation is needed
        signal = optima.signal[:, :, c]
        apart = signal[there] - values
        if np.abs(apart).max() <= ROUNDING * max(float(np.abs(values).max()), 1e-300):
            continue
        count = len(values)
        step = _step(levels)
        pairs = there[:, 1:] & there[:, :-1] & ~again[:, 1:]
        changes = np.diff(signal - observed.signal[:, :, c], axis=1)[pairs]
        changed = float(changes.std()) if len(changes) else 0.0
        fine = not step or step < FINE_STEP * changed
        if not fine and _are_rounded(observed, c, apart / step, len(levels)):
            found.append(Recorded(c, "steps", step, count, count))
        elif len(levels) > LEAST_LEVELS:
            moved = np.abs(np.diff(signal, axis=1, prepend=signal[:, :1]))
            rests = moved <= ROUNDING * np.ptp(levels)
            least = max(LEAST_AT_END, LEAST_END_SHARE * count, END_RATIO * counts[1:-1].max())
            for end, outward in ((0, -1.0), (-1, 1.0)):
                value = float(levels[end])
                at = there & (observed.signal[:, :, c] == value)
                beyond = outward * apart[values == value] >= 0.0
                if counts[end] < least or beyond.mean() <= LEAST_EQUAL_SHARE:
                    continue
                if rests[again & at].sum() <= 0.5 * (again & at).sum():
                    found.append(Recorded(c, "end", value, int(counts[end]), count))
                    again &= ~at
            if fine and _are_held(again, observed.signal[:, :, c], step and step / changed):
                found.append(Recorded(c, "held", 0.0, int(again.sum()), count))
    return found


def sound(
    observed: Observed, found: Sequence[Recorded], signal: Floats, sd: Floats
) -> NDArray[np.bool_]:
    """Return which readings (E, T, C) count, by the signal (E, T, C) of a best fit and ``sd`` (C,).

    These are of the noise.
    """
    there = observed.there.copy()
    for one in found:
        c = one.channel
        if one.kind == "held":
            for trial, places, starts, _ in _runs(observed, c):
                there[trial, :, c] = False
                there[trial, places[starts], c] = True
        elif one.kind == "end":
            inward = 1.0 if one.value <= observed.signal[:, :, c][there[:, :, c]].min() else -1.0
            near = inward * (signal[:, :, c] - one.value) < NEAR_END_SDS * sd[c]
            there[:, :, c] &= ~near & (observed.signal[:, :, c] != one.value)
    return there


def widened(optima: Optima, found: Sequence[Recorded], noise: Noise) -> Noise:
    """Return the noise that counts for channels whose readings come in steps."""
    observed = optima.regression.observed
    sd = noise.sd.copy()
    for one in found:
        if one.kind != "steps":
            continue
        c = one.channel
        there = observed.there[:, :, c]
        apart = (optima.signal - observed.signal)[:, :, c][there]
        rows = zip(observed.signal[:, :, c], there, strict=True)
        levels = sum(len(np.unique(row[own])) for row, own in rows)
        share = noise.correlation[c]
        independent = len(apart) * (1.0 - share) / (1.0 + share)
        variance = float(apart.var())
        rounding = one.value**2 / 12.0
        before = max(variance - rounding, 0.0)  # of the noise before it is rounded
        alike = rounding * np.exp(-4.0 * np.pi**2 * before / one.value**2)
        wide = max(independent / levels, 1.0) * alike + max(variance - alike, 0.0)
        sd[c] = max(float(sd[c]), wide**0.5)
    return noise._replace(sd=sd)


def _runs(
    observed: Observed, channel: int
) -> Iterator[tuple[int, NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]]:
    """Yield the places of each trial's readings, and the starts and ends of equal ones among them.

    An end is past the last.
    """
    for trial, there in enumerate(observed.there[:, :, channel]):
        places = np.flatnonzero(there)
        values = observed.signal[trial, places, channel]
        starts = np.flatnonzero(np.append(True, values[1:] != values[:-1])[: len(values)])
        yield trial, places, starts, np.append(starts[1:], len(values))[: len(starts)]


def _step(levels: Floats) -> float:
    """Return the step of which the distances of levels (n,), in order, are multiples; 0 if none."""
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * (levels[-1] - levels[0])]  # the same number, written in two ways
    if not len(gaps):
        return 0.0
    step = float(gaps[gaps < 1.5 * gaps.min()].mean())
    return step if np.abs(gaps / step - np.round(gaps / step)).max() < ON_GRID else 0.0


def _are_rounded(observed: Observed, channel: int, apart: Floats, levels: int) -> bool:
    """Return whether residuals (n,), in steps, are of rounding, and readings stay the same.

    Readings on two ``levels`` are those of a switch, unless hardly one is off by half a step.
    """
    runs = sum(len(starts) for _, _, starts, _ in _runs(observed, channel))
    apart = apart - apart.mean()
    far = (np.abs(apart) > FAR_ERROR).mean()
    variance = apart.var()
    few = far <= MOST_FAR * variance if levels > 2 else not far and variance < SWITCH_VARIANCE
    return bool(few and runs < (1.0 - LEAST_EQUAL_SHARE) * len(apart))


def _again(observed: Observed, channel: int) -> NDArray[np.bool_]:
    """Return which readings (E, T) are the same as the one before."""
    again = np.zeros(observed.signal.shape[:2], np.bool_)
    for trial, places, starts, _ in _runs(observed, channel):
        again[trial, np.delete(places, starts)] = True
    return again


def _are_held(again: NDArray[np.bool_], values: Floats, step: float) -> bool:
    """Return whether readings that are the same as the one before (E, T) are so by no chance.

    Two readings in a fine ``step``, in sds of their difference, are the same with the chance
    step / sqrt(2 pi). A count or a signal at rest is the same at one level.
    """
    if not step:
        return bool(again.sum() >= LEAST_AT_END)
    _, counts = np.unique(values[again], return_counts=True)
    others = float(counts.sum() - counts.max(initial=0)) / again.size
    return others > max(LEAST_HELD_SHARE, HELD_RATIO * float(step / np.sqrt(2.0 * np.pi)))
