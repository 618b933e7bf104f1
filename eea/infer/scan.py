"""Starting points of descents: random bodies and poses, and jumps between valleys.

A descent ends in the valley in which it begins. A trial's angles have several valleys: a slow fin
on the other side of its cycle moves almost alike. A lag has one valley for each sample: the robot
starts with a jerk that a sample either contains or not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats, circular_distance, wrap
from eea.core.config import FitConfig
from eea.infer.descent import descend
from eea.infer.misfit import COARSE, Precision, Regression
from eea.infer.unknowns import FIXED_PRECISION, Unknowns

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
    if not lined(parameters):
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
    for entry, tried in lined(parameters):
        line, cost = _along(regression, theta, sigma, entry, tried)
        own = np.abs(tried - theta[:, entry, None]) <= 0.5 / len(tried)
        best = np.argsort(np.where(own, np.inf, cost[:, 1:]), axis=1, kind="stable")[:, :each]
        found.append(line[np.arange(len(theta))[:, None], best + 1].reshape(-1, len(parameters)))
    return np.concatenate(found)


def aligned(regression: Regression, theta: Floats, sigma: float) -> tuple[Floats, Floats]:
    """Return vectors (S, P) with each number in its best valley, and costs (S,)."""
    pick = np.arange(len(theta))
    cost = np.zeros(len(theta))
    for entry, tried in lined(regression.parameters):
        line, costs = _along(regression, theta, sigma, entry, tried)
        at = costs.argmin(axis=1)
        theta = line[pick, at]
        cost = costs[pick, at]
    return theta, cost


def lined(parameters: Unknowns) -> list[tuple[int, Floats]]:
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
