"""The global search of joint inference: scan, descend, hop.

A scan of random bodies and poses gives starting points, damped least squares descends from the best
of them, and hops find other valleys. Where the residuals of the best fit do not look like noise,
the scan is repeated, since the most common reason is a wrong valley.

Starting points of descents: random bodies and poses, and jumps between valleys.

A descent ends in the valley in which it begins. A trial's angles have several valleys: a slow fin
on the other side of its cycle moves almost alike. A lag has one valley for each sample: the robot
starts with a jerk that a sample either contains or not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats, circular_distance, wrap
from eea.core.checks import TargetError
from eea.core.config import FitConfig
from eea.infer.descent import Fitted, descend
from eea.infer.goodness import (
    LEAST_RELATIVE_RMS,
    Goodness,
    against_known_good,
    effective_count,
    goodness_of_fit,
)
from eea.infer.laplace import Laplace
from eea.infer.misfit import COARSE, FINE, Precision, Regression, Roughness
from eea.infer.mixture import Mixture, Mode
from eea.infer.roughness import Near, look, plateau
from eea.infer.unknowns import FIXED_PRECISION, UNIFORM_PRECISION, Unknowns


def latin_hypercube(count: int, width: int, rng: np.random.Generator) -> Floats:
    """Return points (count, width) in [0, 1], one in each of ``count`` slices of every axis.

    McKay, Beckman and Conover (1979); the same draws as scipy's, whose statistics take a second
    to import.

    Examples
    --------
    >>> points = latin_hypercube(4, 2, np.random.default_rng(0))
    >>> np.sort((4 * points).astype(int), axis=0).T
    array([[0, 1, 2, 3],
           [0, 1, 2, 3]])
    """
    (rng,) = rng.spawn(1)
    within = rng.random((count, width))
    slices = np.tile(np.arange(1, count + 1), (width, 1))
    for row in slices:
        rng.shuffle(row)
    points: Floats = (slices.T - within) / count
    return points


EVERY_FOURTH_SAMPLE = Precision(fine=False, stride=4, difference=0.0)
EVERY_SAMPLE = Precision(fine=False, stride=1, difference=0.0)  # the jerk is in one sample
SCANNED_TRIALS = 4  # trials that rank the bodies
SHARED_VALUES = 16  # values tried for an angle that all trials share
HOP_STARTS = 32
HOP_MODES = 4
HOP_COST = 20.0
HOP_FITS = 16


def scan(regression: Regression, rng: np.random.Generator, effort: FitConfig) -> Floats:
    """Return the most promising of random bodies, as vectors (descents, P)."""
    parameters = regression.parameters
    observed = regression.observed
    freed = parameters.freed_entries()  # descents stay near a nominal value
    drawn = latin_hypercube(effort.bodies, parameters.body + len(freed), rng)
    theta = parameters.typical(drawn[:, : parameters.body])
    theta[:, freed] = drawn[:, parameters.body :]
    some = range(min(SCANNED_TRIALS, len(observed)))
    posed, squares = pose(regression, theta, effort.poses, rng, some)
    kept = posed[np.argsort(squares, kind="stable")[: 2 * effort.descents]]
    rest = range(len(some), len(observed))
    if rest:
        kept = pose(regression, kept, effort.poses, rng, rest)[0]
    if not _lined(parameters):
        return kept[: effort.descents]
    seen = observed.sampled(some, regression.stride(EVERY_FOURTH_SAMPLE))
    sigma = regression.noise or float(np.sqrt(squares.min() / seen))
    kept, cost = aligned(regression, kept, sigma)
    return kept[np.argsort(cost, kind="stable")[: effort.descents]]


def pose(
    regression: Regression,
    theta: Floats,
    count: int,
    rng: np.random.Generator,
    trials: range | None = None,
) -> tuple[Floats, Floats]:
    """Return vectors (S, P) with the best of ``count`` random initial states of each trial.

    Also return their sums of squares (S,) over the posed ``trials``, by default all.
    """
    parameters = regression.parameters
    observed = regression.observed
    trials = range(len(observed)) if trials is None else trials
    misfit = regression.misfit(EVERY_FOURTH_SAMPLE)
    angles = parameters.angle_entries(0)
    common = np.isin(angles, parameters.angle_entries(len(observed) - 1)) & (len(observed) > 1)
    groups = SHARED_VALUES if common.any() else 1
    local = parameters.local(theta)
    width = parameters.slots.shape[1]
    starts = parameters.start_slots()
    slots = np.concatenate([starts, np.arange(width - len(angles), width)])
    if not len(slots):  # the initial state is known
        return theta, misfit.squares(theta)
    each = -(-2 * count // groups) if groups > 1 else count
    shared = rng.uniform(-np.pi, np.pi, (groups, 1, len(angles)))
    total = np.zeros((len(theta), groups))
    chosen = np.empty((len(theta), groups, len(trials), len(slots)))
    for column, e in enumerate(trials):
        tried = rng.uniform(-np.pi, np.pi, (groups, each, len(angles)))
        tried = np.where(common, shared, tried)
        if len(starts):
            begun = _drawn(parameters, parameters.slots[e, starts], (groups, each), rng)
            tried = np.concatenate([begun, tried], axis=-1)
        rows = np.repeat(local[:, e], groups * each, axis=0).reshape(len(theta), -1, width)
        rows[:, :, slots] = tried.reshape(-1, len(slots))
        apart = misfit.differences(rows[:, None], np.array([e]))[:, 0]
        sums = np.einsum("scm,scm->sc", apart, apart).reshape(len(theta), groups, each)
        sums = np.where(np.isfinite(sums), sums, np.inf)
        at = sums.argmin(axis=2)
        total += np.take_along_axis(sums, at[:, :, None], 2)[:, :, 0]
        chosen[:, :, column] = tried[np.arange(groups), at]
    group = total.argmin(axis=1)
    pick = np.arange(len(theta))
    posed = theta.copy()
    for column, e in enumerate(trials):
        posed[:, parameters.slots[e, slots]] = chosen[pick, group, column]
    return posed, total[pick, group]


def _drawn(
    parameters: Unknowns,
    entries: NDArray[np.intp],
    shape: tuple[int, ...],
    rng: np.random.Generator,
) -> Floats:
    """Return draws (*shape, len(entries)) from the prior of entries that are not angles."""
    mean = parameters.prior_mean[entries]
    precision = parameters.prior_precision[entries]
    informed = precision > 0.0
    normal = mean + rng.standard_normal((*shape, len(entries))) / np.sqrt(
        np.where(informed, precision, 1.0)
    )
    drawn: Floats = np.where(informed, np.clip(normal, 0.0, 1.0), rng.random(normal.shape))
    return drawn


def hop(regression: Regression, theta: Floats, sigma: float, rng: np.random.Generator) -> Floats:
    """Return copies (H, P) of a vector (P,), each with one trial's angles in another valley."""
    parameters = regression.parameters
    observed = regression.observed
    hidden = len(parameters.angle_entries(0))
    others: list[tuple[float, Floats]] = []
    for e in range(len(observed) if hidden else 0):
        entries = parameters.angle_entries(e)
        movable = np.isin(entries, parameters.angle_entries(e - 1), invert=len(observed) > 1)
        here = theta[entries]
        mirrored = [
            np.where(np.arange(hidden) == i, turned, here)
            for i in range(hidden)
            for turned in (np.pi - here, -here, here + np.pi)
        ]
        starts = rng.uniform(-np.pi, np.pi, (HOP_STARTS, hidden))
        starts[: len(mirrored)] = mirrored[:HOP_STARTS]
        starts[-1] = here
        vectors = np.tile(theta, (HOP_STARTS, 1))
        vectors[:, entries] = np.where(movable, wrap(starts), here)
        fits = descend(regression.misfit(COARSE, only_of=e), vectors, sigma, 15, 1e-3)
        order = np.argsort(fits.squares, kind="stable")
        valleys: list[Floats] = [theta[entries]]
        for i in order:
            excess = 0.5 * (fits.squares[i] - fits.squares[order[0]]) / sigma**2
            excess *= regression.stride(COARSE)
            if excess > HOP_COST or len(valleys) > HOP_MODES:
                break
            angles = fits.theta[i, entries]
            if all(circular_distance(angles, valley).max() > 0.1 for valley in valleys):
                valleys.append(angles)
                hopped = theta.copy()
                hopped[entries] = angles
                others.append((excess, hopped))
    others.sort(key=lambda pair: pair[0])
    return np.array([hopped for _, hopped in others[:HOP_FITS]]).reshape(-1, len(theta))


def relined(regression: Regression, theta: Floats, sigma: float, each: int) -> Floats:
    """Return copies (H, P) of vectors (S, P), each in another valley of a number.

    The copies are the best ``each`` for every vector and every number with ``valleys``.
    """
    parameters = regression.parameters
    found = [np.empty((0, len(parameters)))]
    for entry, tried in _lined(parameters):
        line, cost = _along(regression, theta, sigma, entry, tried)
        own = np.abs(tried - theta[:, entry, None]) <= 0.5 / len(tried)
        best = np.argsort(np.where(own, np.inf, cost[:, 1:]), axis=1, kind="stable")[:, :each]
        found.append(line[np.arange(len(theta))[:, None], best + 1].reshape(-1, len(parameters)))
    return np.concatenate(found)


def aligned(regression: Regression, theta: Floats, sigma: float) -> tuple[Floats, Floats]:
    """Return vectors (S, P) with each number in its best valley, and costs (S,)."""
    pick = np.arange(len(theta))
    cost = np.zeros(len(theta))
    for entry, tried in _lined(regression.parameters):
        line, costs = _along(regression, theta, sigma, entry, tried)
        at = costs.argmin(axis=1)
        theta = line[pick, at]
        cost = costs[pick, at]
    return theta, cost


def _lined(parameters: Unknowns) -> list[tuple[int, Floats]]:
    """Return the entries of numbers with valleys, and the middle of each valley."""
    table = parameters.robot.table
    counts = [table[parameters.base(i)].valleys for i in range(len(parameters))]
    sought = parameters.prior_precision < FIXED_PRECISION
    return [
        (i, (np.arange(count) + 0.5) / count)
        for i, count in enumerate(counts)
        if count and sought[i]
    ]


def _along(
    regression: Regression, theta: Floats, sigma: float, entry: int, tried: Floats
) -> tuple[Floats, Floats]:
    """Return vectors (S, 1 + V, P), as given and with V ``tried`` values of an entry, and costs."""
    line = np.repeat(theta[:, None], len(tried) + 1, axis=1)
    line[:, 1:, entry] = tried
    flat = line.reshape(-1, theta.shape[1])
    squares = regression.misfit(EVERY_SAMPLE).squares(flat)
    cost = 0.5 * squares / sigma**2 + regression.parameters.prior_cost(flat)
    return line, cost.reshape(len(theta), -1)


CLOSE_COST = 10.0  # optima with a cost higher by this have under 1/20,000 of the best's weight
MAXIMUM_HOPS = 3  # rounds of hops from the best optimum
FIRST_ITERATIONS = 8  # then the worse half of the starting points is dropped
MEETING_ITERATIONS = 4  # then descents that have met go on as one
FEW_DESCENTS = 6  # that tell whether there is one optimum
SAME_OPTIMUM_DISTANCE = 1e-3  # share of a range, or rad; closer optima are one
# Share of a range. Bodies that differ by more in a size are kept beside a better one.
VALLEY_SIZE_DIFFERENCE = 0.05
SCAN_TOLERANCE = 1e-3  # of sigma: two scans that agree within it have found the optimum
RIVAL_SQUARES_RATIO = 1.5  # with more, relative to a rival hypothesis, a search is not completed
EXACT_FIT_SIGMA = 1e-3  # an exact fit of a signal of about 1 leaves less in single precision


class Plateau(NamedTuple):
    """What a number that acts in steps may be: the middles of its plateaus, as shares."""

    entry: int
    best: float
    width: float  #: Of the best one.
    kept: tuple[float, ...]  #: Those that the trials allow.
    worse: Mapping[float, float]  #: How much worse, in chi-square, those beside them are.


@dataclass(frozen=True, eq=False)
class Optima:
    """The best fits of some trials."""

    regression: Regression
    fits: Fitted  #: Fits, best first.
    sigma: float  #: Standard deviation of the noise, as given or from the best fit's residuals.
    plateaus: tuple[Plateau, ...] = ()  #: Of the numbers that act in steps.
    alone: bool = False  #: Whether descents from different places all ended in one optimum.

    def laplace(self, weight: float) -> Laplace:
        """Return the posterior near the fits, of residuals of the precision ``weight``."""
        misfit = self.regression.misfit(FINE)
        theta = self.fits.theta
        return misfit.laplace(theta, misfit.linearise(theta), weight)

    def mixture(self, best: Optima) -> Mixture:
        """Return the posterior, with noise estimated from the ``best`` fit of all hypotheses."""
        weight = best.precision
        near = self.laplace(weight)
        parameters = self.regression.parameters
        cost = 0.5 * weight * self.fits.squares + parameters.prior_cost(self.fits.theta)
        modes = [Mode(**vars(near[k]), cost=float(cost[k])) for k in range(len(cost))]
        return parameters.posterior(modes)

    @cached_property
    def precision(self) -> float:
        """1 / sigma^2 of the samples, times the share of them that counts as independent.

        Where residuals are correlated, only the effective number of samples counts.
        """
        residuals = self.residuals
        return effective_count(residuals) / sum(one.size for one in residuals) / self.sigma**2

    @cached_property
    def residuals(self) -> list[Floats]:
        """Weighted residuals (T, axes) of the best fit for each trial, simulated minus observed."""
        flat = self.regression.misfit(FINE).residuals(self.fits.theta[:1])[0]
        trials, samples, axes = self.regression.observed.signal.shape
        whole = flat.reshape(trials, axes, samples).swapaxes(1, 2)
        return [one[:n] for one, n in zip(whole, self.regression.observed.counts, strict=True)]

    @cached_property
    def signal(self) -> Floats:
        """The simulated signal (E, T, axes) of the best fit; where samples are missing, theirs."""
        observed = self.regression.observed
        inside = np.arange(observed.signal.shape[1]) < np.array(observed.counts)[:, None]
        observed = replace(observed, noise=None, weight=inside.astype(np.float64))
        plain = Regression(self.regression.parameters, observed, None)
        flat = plain.misfit(FINE).residuals(self.fits.theta[:1])[0]
        trials, samples, axes = observed.signal.shape
        left = flat.reshape(trials, axes, samples).swapaxes(1, 2)
        return np.asarray(observed.signal + left, np.float64)

    @cached_property
    def goodness(self) -> Goodness:
        """Whether the best fit leaves nothing but noise."""
        regression = self.regression
        parameters = regression.parameters
        floor = LEAST_RELATIVE_RMS * regression.rms
        discrepancy = parameters.robot.discrepancy
        slow_p = None
        if discrepancy is not None:
            slow_p = discrepancy.slow_p(regression, self.fits.theta[0])
        observed = regression.observed
        robot = parameters.robot
        if regression.usual is not None:
            theta = self.fits.theta[0]
            away = 2.0 * float(parameters.prior_cost(theta))
            misfit = float(self.fits.squares[0]) / observed.size
            return against_known_good(
                misfit, regression.usual, away, parameters.informed, robot.noun
            )
        found = goodness_of_fit(
            self.residuals,
            parameters.unknowns,
            regression.noise,
            floor,
            slow_p,
            "times the noise" if observed.noise is not None else robot.unit,
            robot.loudest,
            observed.missing,
            robot.noun,
        )
        return replace(found, unexplained=found.rms / regression.rms)


def search(
    regression: Regression,
    rng: np.random.Generator,
    effort: FitConfig,
    known: Floats | None = None,
    once: bool = True,
    rival: float = np.inf,
    before: Optima | None = None,
) -> Optima:
    """Return the best fits, from ``known`` vectors (K, P) and random starting points.

    Without ``once``, the search is repeated up to ``effort.restarts`` times, until a fit leaves
    nothing but noise, or two scans end in the same fit (then the model fails, not the search).
    ``before`` is the fit of an earlier scan, as of :func:`agreed`. The search is not completed
    where its squares far exceed ``rival``, a sum of squares.
    """
    parameters = regression.parameters
    if not parameters.unknowns:
        still = parameters.prior_mean[None]
        squares = regression.misfit(FINE).squares(still)
        return _optima(regression, Fitted(still, squares, squares))
    best = before
    alone = before is not None
    for attempt in range(effort.restarts + 1):
        starts = np.empty((0, len(parameters)))
        scanned = effort
        if known is not None:
            known = starts = _downhill(regression, known).theta
            exact = _exact(regression, starts)
            if exact is not None:
                return exact
            # Known optima need fewer descents, unless their fit has just failed.
            scanned = effort if attempt else halved(effort)
        starts = np.concatenate([starts, scan(regression, rng, scanned)])
        found = _refine(regression, starts, rng, effort, rival)
        same = best is not None and abs(found.sigma / best.sigma - 1.0) < SCAN_TOLERANCE
        best = found if best is None else _optima(regression, _together(best.fits, found.fits))
        alone = alone and same and len(best.fits.theta) == 1
        if once or same or best.goodness.good:
            break
    assert best is not None
    return replace(best, alone=True) if alone else best


def agreed(regression: Regression, rng: np.random.Generator, effort: FitConfig) -> Optima | None:
    """Return the optimum in which descents from a few places all end; None if they differ.

    They begin at the best of a small scan, as many as there are unknowns or more, or at as many as
    the effort allows. Then hops look for other valleys of a trial's angles. None, too, if there are
    too many unknowns for that, or a number is said to have valleys, or the scan moves no number.
    """
    parameters = regression.parameters
    sought = np.concatenate([np.arange(parameters.body), parameters.freed_entries()])
    moved = parameters.prior_precision[sought] < FIXED_PRECISION
    few = effort if effort.descents <= FEW_DESCENTS else halved(halved(effort))
    if _lined(parameters) or not moved.any() or parameters.unknowns > max(few.descents, 2):
        return None
    met = _downhill(regression, scan(regression, rng, few), MEETING_ITERATIONS)
    met = _unique(parameters, met, same=VALLEY_SIZE_DIFFERENCE)
    if len(met.theta) > 1:
        met = _downhill(regression, met.theta)
        met = _unique(parameters, met, same=VALLEY_SIZE_DIFFERENCE)
    if len(met.theta) > 1:
        return None
    found = replace(polished(regression, met.theta), alone=True)
    if found.sigma <= regression.least_sigma:
        return found
    hopped = hop(regression, found.fits.theta[0], found.sigma, rng)
    return improved(found, hopped) if len(hopped) else found


def polished(regression: Regression, theta: Floats) -> Optima:
    """Return the optima near vectors (S, P), which are near already."""
    exact = _exact(regression, theta)
    if exact is not None:
        return exact
    fine = regression.misfit(FINE)
    sigma = regression.sigma_near(fine, theta)
    return _optima(regression, descend(fine, theta, sigma, 40, 1e-6))


def as_they_are(regression: Regression, theta: Floats) -> Optima:
    """Return the optima that vectors (S, P) are taken for, without a search."""
    squares = regression.misfit(FINE).squares(theta)
    return _optima(regression, Fitted(theta, squares, squares))


def improved(optima: Optima, starts: Floats) -> Optima:
    """Return optima together with those of descents from vectors (S, P)."""
    regression = optima.regression
    ended = descend(regression.misfit(FINE), starts, optima.sigma, 40, 1e-6)
    found = _optima(regression, _together(optima.fits, ended))
    alone = optima.alone and len(found.fits.theta) == 1
    return replace(found, plateaus=optima.plateaus, alone=alone)


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


MOST_PROBES = 1000  # of a number's range
LEAST_PROBES = 4
PROBES_A_TURN = 0.5  # for each time that the signal changes by all of itself over the range
MOST_VALLEYS = 8  # in which descents begin
NEAR_COST = 30.0  # of a mirrored vector, above the best: a descent may end as low


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


def with_others(optima: Optima) -> Optima:
    """Return optima together with those of other valleys that are nearly as low."""
    starts = elsewhere(optima)
    if not len(starts):
        return optima
    ended = _downhill(optima.regression, starts)
    excess = 0.5 * (ended.squares - optima.fits.squares[0]) / optima.sigma**2
    excess /= max(optima.regression.observed.size / optima.regression.misfit(COARSE).count, 1.0)
    near = ended.of(np.flatnonzero(excess < NEAR_COST))
    return improved(optima, near.theta) if len(near.theta) else optima


MOST_TRIED = 200  # plateaus of one number
BEST_TRIED = 3  # of them, from which descents begin
MOST_KEPT = 12  # plateaus of one number


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
            fits = _together(fits, ended)
    fits = _together(fits, optima.fits.of(range(1, len(optima.fits.cost))))
    theta = fits.theta.copy()
    for row in theta:
        known = [middle for middle, (low, high) in ends.items() if low <= row[entry] <= high]
        if known:
            row[entry] = known[0]
        elif own := plateau_of(row):
            row[entry] = 0.5 * (own[0] + own[1])
    centred = _optima(regression, Fitted(theta, fine.squares(theta), fits.cost))
    return centred, [
        Plateau(
            int(entry),
            0.5 * (first[0] + first[1]),
            first[1] - first[0],
            tuple(sorted(ends)),
            dict(sorted(worse.items())),
        )
    ]


BESIDE = 1e-3  # of a plateau's width past its end


def halved(effort: FitConfig) -> FitConfig:
    """Return settings for a search of half the effort."""
    return replace(
        effort,
        bodies=max(2, effort.bodies // 2),
        poses=max(1, effort.poses // 2),
        descents=max(1, effort.descents // 2),
        polished=max(1, effort.polished // 2),
    )


def _downhill(regression: Regression, starts: Floats, iterations: int = 25) -> Fitted:
    """Descend from vectors (S, P) in single precision."""
    coarse = regression.misfit(COARSE)
    return descend(coarse, starts, regression.sigma_near(coarse, starts), iterations, 1e-3)


def _exact(regression: Regression, theta: Floats) -> Optima | None:
    """Return the optimum near vectors (S, P) if it fits up to rounding, else None."""
    fine = regression.misfit(FINE)
    squares = fine.squares(theta)
    sigma = regression.sigma(squares.min(), fine.count)
    if regression.noise is not None or sigma > EXACT_FIT_SIGMA:
        return None
    polished = descend(fine, theta[squares.argmin()][None], sigma, 400, 1e-9)
    if regression.sigma(polished.squares.min(), fine.count) > regression.least_sigma:
        return None
    return _optima(regression, polished)


def _refine(
    regression: Regression,
    starts: Floats,
    rng: np.random.Generator,
    effort: FitConfig,
    rival: float,
) -> Optima:
    """Descend from vectors (S, P), then hop from the best unless it is far worse than a rival."""
    parameters = regression.parameters
    fine = regression.misfit(FINE)
    begun = _downhill(regression, starts, FIRST_ITERATIONS)
    some = _different(parameters, begun, -(-len(starts) // 2))
    ended = _downhill(regression, some.theta)
    first = _different(parameters, ended, 2 * effort.polished).theta
    exact = _exact(regression, first)
    if exact is not None:
        return exact
    squares = fine.squares(first)
    if squares.min() > RIVAL_SQUARES_RATIO * rival:
        return _optima(regression, Fitted(first, squares, squares))
    again = pose(regression, first, 2 * effort.poses, rng)[0]
    again = again[(again != first).any(axis=1)]
    moved = relined(regression, first, regression.sigma_near(fine, first), 1)
    second = _downhill(regression, np.concatenate([first, again, moved]))
    chosen = _different(parameters, second, effort.polished).theta
    sigma = regression.sigma_near(fine, chosen)
    best = _best(descend(fine, chosen, sigma, 40, 1e-6), effort.polished)
    for _ in range(MAXIMUM_HOPS):
        sigma = regression.sigma(best.squares.min(), fine.count)
        if sigma <= regression.least_sigma:  # there is nothing better
            break
        hopped = np.concatenate(
            [
                hop(regression, best.theta[0], sigma, rng),
                relined(regression, best.theta[:1], sigma, 2),
            ]
        )
        if not len(hopped):
            break
        more = descend(fine, hopped, sigma, 15, 1e-6)
        before = best.cost[0]
        best = _unique(parameters, _together(best, more))
        if best.cost[0] > before - 1e-3:
            break
    return _optima(regression, best)


def _optima(regression: Regression, fitted: Fitted) -> Optima:
    """Return the fits close to the best, with noise from the best's residuals."""
    parameters = regression.parameters
    sigma = regression.sigma(fitted.squares.min(), regression.observed.size)
    cost = 0.5 * fitted.squares / sigma**2 + parameters.prior_cost(fitted.theta)
    found = _unique(parameters, fitted._replace(cost=cost))
    near = found.cost <= found.cost[0] + CLOSE_COST
    return Optima(regression, found.of(near), sigma)


def _together(one: Fitted, other: Fitted) -> Fitted:
    return Fitted(*(np.concatenate(parts) for parts in zip(one, other, strict=True)))


def _best(fitted: Fitted, count: int) -> Fitted:
    """Return the best few, best first."""
    return fitted.of(np.argsort(fitted.cost, kind="stable")[:count])


def _different(parameters: Unknowns, fitted: Fitted, count: int) -> Fitted:
    """Return the best few whose bodies differ, best first.

    A narrow corner may be slightly lower than a wide valley that has nearly all of the probability:
    many descents into the corner must not displace those into the valley.
    """
    return _best(
        _unique(parameters, fitted, parameters.body or None, VALLEY_SIZE_DIFFERENCE), count
    )


def _unique(
    parameters: Unknowns,
    fitted: Fitted,
    entries: int | None = None,
    same: float = SAME_OPTIMUM_DISTANCE,
) -> Fitted:
    """Return each optimum once, best first, compared in the first entries (None: in all)."""
    ordered = _best(fitted, len(fitted.cost))
    kept: list[int] = []
    for i in np.flatnonzero(np.isfinite(ordered.cost)).tolist():
        theta = ordered.theta[i]
        others = ordered.theta[kept]
        apart = np.where(
            parameters.circular, circular_distance(others, theta), np.abs(others - theta)
        )[:, :entries]
        if not kept or apart.max(axis=1).min() > same:
            kept.append(i)
    if not kept:
        raise TargetError("no values were found with a simulation that stays finite")
    return ordered.of(kept)
