"""Which commit moved a figure: a change-point test at each row of the history.

The rows of a figure since its last change are split in two at every row, and the means of both
parts are compared. With intervals, the parts' variances are known, and the test is a normal one. A
figure without them, such as a ratio of speeds, has only the scatter of its own rows: the test is
Student's, of logarithms, since that noise multiplies. Two of its rows can show no change. This is
the change-point model of Hawkins, Qiu and Kang (2003, Journal of Quality Technology 35, 355), with
Bonferroni's bound for their simulated limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from instruments.history.figures import Figure
from instruments.history.rows import Row

#: At most this is the chance that a row at which nothing changed makes the test name a change.
FALSE_ALARM_PROBABILITY = 0.01

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Change:
    """A figure that left its band.

    Attributes
    ----------
    figure
        Its name.
    row, noticed
        Indices of the rows: the first with the new value, and the one at which that was certain.
    before, since
        The mean before the change and since; the geometric mean of a figure without intervals.
    """

    figure: str
    row: int
    noticed: int
    before: float
    since: float


class Band(NamedTuple):
    """Where a figure's next value is expected.

    Attributes
    ----------
    first, last
        Indices of the rows that the band is from.
    low, high
        Its ends. They are infinitely far apart if the scatter is not known yet.
    """

    first: int
    last: int
    low: float
    high: float


def find_changes(rows: Sequence[Row]) -> list[Change]:
    """Return all changes of a history, by the rows that named them.

    The test at a row has :data:`FALSE_ALARM_PROBABILITY`, divided by the number of its figures.
    """
    series: dict[str, list[tuple[int, Figure]]] = {}
    found = []
    for number, row in enumerate(rows):
        for name, figure in row.figures.items():
            points = series.setdefault(name, [])
            points.append((number, figure))
            chance = FALSE_ALARM_PROBABILITY / len(row.figures)
            split = split_of([each for _, each in points], chance)
            if split is not None:
                parts = (points[:split], points[split:])
                before, since = (mean_of([each for _, each in part]) for part in parts)
                found.append(Change(name, points[split][0], number, before, since))
                del points[:split]
    return found


def find_bands(rows: Sequence[Row], changes: Sequence[Change]) -> dict[str, list[Band]]:
    """Return each figure's bands, one before each of its changes and one after the last.

    A next value with an interval like the last one's is in the band with a probability of 95%.
    """
    found: dict[str, list[Band]] = {}
    for name in dict.fromkeys(name for row in rows for name in row.figures):
        points = [(i, row.figures[name]) for i, row in enumerate(rows) if name in row.figures]
        starts = [change.row for change in changes if change.figure == name]
        for first, end in zip([0, *starts], [*starts, len(rows)], strict=True):
            inside = [(i, figure) for i, figure in points if first <= i < end]
            low, high = _ends([figure for _, figure in inside])
            found.setdefault(name, []).append(Band(inside[0][0], inside[-1][0], low, high))
    return found


def split_of(figures: Sequence[Figure], chance: float) -> int | None:
    """Return the index of the first figure after a change, or None where none is certain.

    Parameters
    ----------
    figures
        Values of one figure, in the order of their commits.
    chance
        The probability that an index is returned if nothing changed, at most.
    """
    values, sds = _scaled(figures)
    splits = np.arange(1, len(values))
    tails = _known_tails(values, sds) if sds is not None else _unknown_tails(values)
    if not len(tails):
        return None
    best = int(np.argmin(tails))
    return int(splits[best]) if len(splits) * tails[best] < chance else None


def mean_of(figures: Sequence[Figure]) -> float:
    """Return the mean, weighted by the inverse variances; without intervals the geometric mean."""
    values, sds = _scaled(figures)
    if sds is None:
        return float(np.exp(values.mean()))
    return float(np.average(values, weights=sds**-2.0))


def _scaled(figures: Sequence[Figure]) -> tuple[Floats, Floats | None]:
    """Return values and standard deviations, or logarithms of values and None."""
    values = np.array([figure.value for figure in figures])
    sds = [figure.sd for figure in figures]
    if None not in sds:
        return values, np.array(sds, dtype=np.float64)
    return np.log(values), None


def _known_tails(values: Floats, sds: Floats) -> Floats:
    """Return two-sided tail probabilities of the difference of means, at each split."""
    weights = sds**-2.0
    weight = np.cumsum(weights)
    weighted = np.cumsum(weights * values)
    before = weighted[:-1] / weight[:-1]
    rest = weight[-1] - weight[:-1]
    since = (weighted[-1] - weighted[:-1]) / rest
    gap = np.abs(since - before) / np.sqrt(1.0 / weight[:-1] + 1.0 / rest)
    return np.asarray(2.0 * ndtr(-gap))


def _unknown_tails(values: Floats) -> Floats:
    """Return Student's two-sided tail probabilities at each split; none of two values."""
    count = len(values)
    if count < 3:
        return np.zeros(0)
    tails = []
    for split in range(1, count):
        before = values[:split]
        since = values[split:]
        scatter = ((before - before.mean()) ** 2).sum() + ((since - since.mean()) ** 2).sum()
        sd = np.sqrt(scatter / (count - 2) * (1.0 / split + 1.0 / (count - split)))
        gap = abs(since.mean() - before.mean())
        tails.append(2.0 * stdtr(count - 2, -gap / sd) if sd > 0.0 else float(gap == 0.0))
    return np.array(tails)


def _ends(figures: Sequence[Figure]) -> tuple[float, float]:
    values, sds = _scaled(figures)
    count = len(values)
    if sds is not None:
        reach = float(ndtri(0.975) * np.sqrt(1.0 / (sds**-2.0).sum() + sds[-1] ** 2))
        mean = mean_of(figures)
        return mean - reach, mean + reach
    if count < 2:
        return 0.0, np.inf
    reach = float(stdtrit(count - 1, 0.975) * values.std(ddof=1) * np.sqrt(1.0 + 1.0 / count))
    return float(np.exp(values.mean() - reach)), float(np.exp(values.mean() + reach))
