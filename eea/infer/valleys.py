"""Whether other values explain the trials as well as the best fit: mirrors, aliases and plateaus.

Descents of the search begin where a scan of bodies and poses is good. Here they begin where the
common numbers alone differ from the best fit: along each of them, with signs or values exchanged,
and on the plateaus of a number that acts in steps.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.infer.descent import Fitted, descend
from eea.infer.misfit import COARSE, FINE, Roughness
from eea.infer.optima import CLOSE_COST, Optima, Plateau, improved, optima_of, together
from eea.infer.roughness import Near, look, plateau
from eea.infer.search import downhill
from eea.infer.unknowns import UNIFORM_PRECISION, Unknowns

MOST_PROBES = 1000  # of a number's range
LEAST_PROBES = 4
PROBES_A_TURN = 0.5  # for each time that the signal changes by all of itself over the range
MOST_VALLEYS = 8  # in which descents begin
NEAR_COST = 30.0  # of a mirrored vector, above the best: a descent may end as low


def with_others(optima: Optima) -> Optima:
    """Return optima together with those of other valleys that are nearly as low."""
    starts = elsewhere(optima)
    if not len(starts):
        return optima
    ended = downhill(optima.regression, starts)
    excess = 0.5 * (ended.squares - optima.fits.squares[0]) / optima.sigma**2
    excess /= max(optima.regression.observed.size / optima.regression.misfit(COARSE).count, 1.0)
    near = ended.of(np.flatnonzero(excess < NEAR_COST))
    return improved(optima, near.theta) if len(near.theta) else optima


def elsewhere(optima: Optima) -> Floats:
    """Return vectors (S, P) from which descents may end in other valleys of the common numbers.

    Along each number alone, as often as the signal turns over its range; and where the signs of
    one number or of two, or the values of two with the same range, are exchanged.
    """
    regression = optima.regression
    parameters = regression.parameters
    theta = optima.fits.theta[0]
    misfit = regression.misfit(FINE)
    entries = parameters.common_entries()
    if not len(entries):
        return np.empty((0, len(theta)))
    normal = misfit.linearise(theta[None]).normal[0]
    lines = []
    for entry in entries:
        low = parameters.low[entry]
        span = parameters.high[entry] - low
        with np.errstate(over="ignore"):  # where the signal never changes
            turns = float(np.sqrt(normal[entry, entry])) * span / regression.loudness
        count = int(np.clip(np.ceil(PROBES_A_TURN * turns), LEAST_PROBES, MOST_PROBES))
        line = np.tile(theta, (count, 1))
        line[:, entry] = low + span * (np.arange(count) + 0.5) / count
        lines.append(line)
    mirrored = _mirrored(parameters, theta, entries)
    squares = misfit.squares(np.concatenate([*lines, mirrored]))
    found: list[tuple[float, Floats]] = []
    first = 0
    for entry, line in zip(entries, lines, strict=True):
        cost = squares[first : first + len(line)]
        first += len(line)
        # The valley of the fit itself is no other one.
        own = int(np.abs(line[:, entry] - theta[entry]).argmin())
        padded = np.concatenate([[np.inf], cost, [np.inf]])
        lowest = (cost <= padded[:-2]) & (cost <= padded[2:]) & np.isfinite(cost)
        lowest[max(own - 1, 0) : own + 2] = False
        found += [(float(cost[i]), line[i]) for i in np.flatnonzero(lowest)]
    found = sorted(found, key=lambda pair: pair[0])[:MOST_VALLEYS]
    excess = 0.5 * (squares[first:] - optima.fits.squares[0]) / optima.sigma**2
    near = [one for one, more in zip(mirrored, excess, strict=True) if more < NEAR_COST]
    return np.array([*near, *(start for _, start in found)]).reshape(-1, len(theta))


def _mirrored(parameters: Unknowns, theta: Floats, entries: NDArray[np.intp]) -> Floats:
    """Return vectors (S, P) with signs or values of one or two of some entries exchanged."""
    zero = parameters.natural(np.zeros(len(theta)))
    span = parameters.natural(np.ones(len(theta))) - zero
    turned = -theta - 2.0 * zero / span  # the shares of the negative values
    within = (turned >= parameters.low) & (turned <= parameters.high)
    flips = [i for i in entries.tolist() if within[i] and abs(turned[i] - theta[i]) > 1e-6]
    sets = [[i] for i in flips] + [list(pair) for pair in combinations(flips, 2)]
    found = []
    for some in sets:
        one = theta.copy()
        one[some] = turned[some]
        found.append(one)
    units = [parameters.robot.table[name].unit for name in parameters.robot.names]
    slots = parameters.entry_slots
    for i, j in combinations(entries.tolist(), 2):
        alike = zero[i] == zero[j] and span[i] == span[j]
        alike &= units[slots[i]] == units[slots[j]]
        if alike and abs(theta[i] - theta[j]) > 1e-6:
            one = theta.copy()
            one[[i, j]] = theta[[j, i]]
            found.append(one)
    return np.array(found).reshape(-1, len(theta))


MOST_TRIED = 200  # plateaus of one number
BEST_TRIED = 3  # of them, from which descents begin
MOST_KEPT = 12  # plateaus of one number
BESIDE = 1e-3  # of a plateau's width past its end


def stepped(optima: Optima) -> Optima:
    """Return optima on the right plateaus of the common numbers that act in steps.

    Descents do not leave a plateau, so all of one number are tried, and descents begin on the best
    and on those beside the ones that the trials allow.
    """
    precision = optima.regression.misfit(FINE).plateau_precision
    found = []
    for entry in optima.regression.parameters.common_entries():
        if precision[entry]:
            width = float((UNIFORM_PRECISION / precision[entry]) ** 0.5)
            optima, one = _on_plateaus(_tried(optima, entry, width), entry)
            found += one
    return replace(optima, plateaus=tuple(found))


def _tried(optima: Optima, entry: int, width: float) -> Optima:
    """Return optima, after descents from the best values of an entry, a plateau's width apart."""
    parameters = optima.regression.parameters
    best = optima
    while True:
        theta = best.fits.theta[0]
        below = np.floor((theta[entry] - parameters.low[entry]) / width)
        above = np.floor((parameters.high[entry] - theta[entry]) / width)
        apart = max(1.0, np.ceil((below + above) / MOST_TRIED))
        steps = np.arange(-below, above + 1.0, apart)
        line = np.tile(theta, (len(steps), 1))
        line[:, entry] = theta[entry] + width * steps
        squares = best.regression.misfit(FINE).squares(line)
        order = np.argsort(np.where(steps == 0.0, np.inf, squares), kind="stable")
        more = improved(best, line[order[:BEST_TRIED]])
        if more.fits.cost[0] > best.fits.cost[0] - 1.0:
            return more
        best = more


def _on_plateaus(optima: Optima, entry: int) -> tuple[Optima, list[Plateau]]:
    """Return optima in the middles of an entry's plateaus, and which the trials allow."""
    regression = optima.regression
    fine = regression.misfit(FINE)

    def plateau_of(theta: Floats) -> tuple[float, float] | None:
        return plateau(Near(regression, theta, optima.precision), entry)

    first = plateau_of(optima.fits.theta[0])
    if first is None:
        return optima, []
    best = optima.fits.theta[0]
    least = float(optima.fits.cost[0])
    fits = optima.fits.of([0])
    ends = {0.5 * (first[0] + first[1]): first}
    worse: dict[float, float] = {}
    for side in (0, 1):
        at = first
        theta = best
        for _ in range(MOST_KEPT):
            beside = at[side] + (2 * side - 1) * BESIDE * (at[1] - at[0])
            if not regression.parameters.low[entry] <= beside <= regression.parameters.high[entry]:
                break
            start = theta.copy()
            start[entry] = beside
            ended = descend(fine, start[None], optima.sigma, 40, 1e-6)
            theta = ended.theta[0]
            found = plateau_of(theta)
            if found is None:
                break
            at = found
            middle = 0.5 * (at[0] + at[1])
            more = float(ended.cost[0]) - least
            if more > CLOSE_COST:
                worse[middle] = 2.0 * more
                break
            ends[middle] = at
            fits = together(fits, ended)
    fits = together(fits, optima.fits.of(range(1, len(optima.fits.cost))))
    theta = fits.theta.copy()
    for row in theta:
        known = [middle for middle, (low, high) in ends.items() if low <= row[entry] <= high]
        if known:
            row[entry] = known[0]
        elif own := plateau_of(row):
            row[entry] = 0.5 * (own[0] + own[1])
    centred = optima_of(regression, Fitted(theta, fine.squares(theta), fits.cost))
    return centred, [
        Plateau(
            int(entry),
            0.5 * (first[0] + first[1]),
            first[1] - first[0],
            tuple(sorted(ends)),
            dict(sorted(worse.items())),
        )
    ]


def settled(optima: Optima, before: Roughness | None) -> tuple[Optima, Roughness]:
    """Return optima whose derivatives suit the simulator, and how rough it is.

    ``before`` is what is known of that already.
    """
    free = optima.regression.misfit(FINE).free
    if before is not None and before.looked[free].all():
        return optima, before
    regression = replace(optima.regression, roughness=before)
    found = look(regression, optima.fits.theta[0], optima.precision)
    found = found if before is None else before.joined(found)
    if found.smooth:
        return optima, found
    regression = replace(regression, roughness=found)
    return improved(replace(optima, regression=regression), optima.fits.theta), found
