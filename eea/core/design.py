"""How much a trial would tell before it is performed: optimal experiment design, of any robot.

Near a body the signal is linear in all that is unknown, and white noise of standard deviation
sigma makes the Fisher information J^T J / sigma^2 of its derivatives J. The new trial's own
unknowns, such as its hidden angles, are of no interest and are marginalised (Schur complement).
What is then known is averaged over bodies that the trials so far allow, each from other angles,
since neither the body nor the angles are known (K. Chaloner and I. Verdinelli, "Bayesian
experimental design: a review", Statistical Science 10, 1995).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.bits import BitLayout
from eea.core.checks import TargetError

Criterion = Literal["a-optimal", "d-optimal", "information"]
Designed = Literal[Criterion, "gait"]
#: How far each of K gaits swims on each of N bodies (N, n), in natural units: (K, N).
Utility = Callable[[Floats], Floats]

DIFFERENCE = 2e-3  # of a range, or rad: it suits single precision
CANDIDATES = 48  # commands that are compared: all corners, and random ones
MOST_CORNERS = 32
EVALUATED_AT = 8  # bodies that derivatives are taken at
MOST_ROBOTS = 2**12  # a batch
# One over the variance of what is uniform on a turn, or in its range.
ANGLE_INFORMATION, UNIFORM_INFORMATION = 3.0 / np.pi**2, 12.0
DRAWS = 4  # of the noise that a trial on a body may have


@dataclass(frozen=True, eq=False)
class Forecast:
    """What is believed before a trial, and how the robot would then move.

    Sizes and nuisances are shares of their ranges, and angles are in rad.
    """

    #: Shape (N, d): what the trials so far allow; the first ``body`` numbers of each are the body.
    samples: Floats
    body: int
    information: Floats  #: Shape (d, d), of all trials so far and the prior.
    #: Shape (S, o): what the new trial has of its own, such as hidden angles, drawn from its prior
    #: for each of the first S samples, at which the derivatives are taken.
    own: Floats
    own_information: Floats  #: Shape (o,), of that prior; infinite if the trial will reveal it.
    #: From samples (B, d), own (B, o) and commands (B, c) to the signal (B, T, axes).
    simulate: Callable[[Floats, Floats, Floats], NDArray[np.floating]]
    sigma: float  #: Standard deviation of the signal's noise.

    def informations(self, commands: Floats) -> Floats:
        """Return what each command (C, c) would tell at each of S samples, (C, S, d, d).

        A robot that leaves the finite numbers tells nothing.

        Examples
        --------
        A spring scale weighs two stones together or their difference: only the sum, here.

        >>> scale = Forecast(np.full((1, 2), 0.5), 2, np.eye(2), np.zeros((1, 0)), np.zeros(0),
        ...     lambda stones, _, signs: (stones * signs).sum(axis=1)[:, None, None], sigma=0.1)
        >>> scale.informations(np.array([[1.0, 1.0]])).round(6)[0, 0]
        array([[100., 100.],
               [100., 100.]])
        """
        count, own = self.own.shape
        known = self.samples.shape[1]
        base = np.concatenate([self.samples[:count], self.own], axis=1)
        step = np.where(base + DIFFERENCE > 1.0, -DIFFERENCE, DIFFERENCE)  # a share stays one
        width = known + own
        moved = np.repeat(base[:, None], width + 1, axis=1)
        moved[:, np.arange(1, width + 1), np.arange(width)] += step
        robots = moved.reshape(-1, width)
        told = np.empty((len(commands), count, known, known))
        at_once = max(1, MOST_ROBOTS // len(robots))
        for first in range(0, len(commands), at_once):
            some = commands[first : first + at_once]
            rows = np.tile(robots, (len(some), 1))
            asked = np.repeat(some, len(robots), axis=0)
            with np.errstate(invalid="ignore", over="ignore"):
                signal = self.simulate(rows[:, :known], rows[:, known:], asked)
                felt = signal.astype(np.float64).reshape(len(some), count, width + 1, -1)
                slopes = (felt[:, :, 1:] - felt[:, :, :1]) / (step[:, :, None] * self.sigma)
            lost = ~np.isfinite(slopes).all(axis=(-1, -2), keepdims=True)
            slopes = np.where(lost, 0.0, slopes)
            told[first : first + at_once] = self._without_own(slopes @ slopes.swapaxes(-1, -2))
        return told

    def _without_own(self, whole: Floats) -> Floats:
        """Return informations (..., d, d) of (..., d + o, d + o), own unknowns marginalised."""
        known = self.samples.shape[1]
        told = whole[..., :known, :known]
        hidden = np.flatnonzero(np.isfinite(self.own_information))
        if not len(hidden):
            return told
        cross = whole[..., :known, known + hidden]
        inner = whole[..., known + hidden[:, None], known + hidden]
        inner = inner + np.diag(self.own_information[hidden])
        marginal: Floats = told - cross @ np.linalg.solve(inner, cross.swapaxes(-1, -2))
        return marginal


def gains(forecast: Forecast, told: Floats, criterion: Criterion) -> Floats:
    """Return what trials that tell (C, S, d, d) are worth, (C,); none is less than nothing.

    ``"a-optimal"`` is by how much the mean variance of the body's sizes, as shares of their ranges,
    falls: by the trace of the body's covariance that is expected after the trial. ``"d-optimal"``
    is by how much the logarithm of the standard deviation ellipsoid's volume falls, in nats: by
    that covariance's determinant. ``"information"`` is the expected information, in nats, about
    all that is unknown, nuisances included: the mean over the samples of log det(I + Sigma F) / 2.
    The first guards against bodies on which a trial tells little, the last does not.
    """
    before, after = forecast.information, forecast.information + told
    if criterion == "information":
        told_all: Floats = np.linalg.slogdet(after)[1].mean(axis=1) - np.linalg.slogdet(before)[1]
        return 0.5 * told_all
    was = _covariance(before, forecast.body)
    will = _covariance(after, forecast.body).mean(axis=1)
    if criterion == "a-optimal":
        variances: Floats = np.einsum("ii", was) - np.einsum("cii->c", will)
        return variances / forecast.body
    volumes: Floats = np.linalg.slogdet(was)[1] - np.linalg.slogdet(will)[1]
    return 0.5 * volumes


def gait_gains(
    forecast: Forecast, told: Floats, utilities: Floats, rng: np.random.Generator
) -> Floats:
    """Return how much farther the gait that is chosen after a trial would swim, (C,).

    The expected value of sample information (H. Raiffa and R. Schlaifer, "Applied statistical
    decision theory", 1961): every sample is the true body once, and then each sample m counts with
    the weight that the trial would leave it, exp(-(D_m - e)^T I (D_m - e) / 2) for its distance
    D_m from the true one and noise e of covariance I^-1. I is what the trial adds to the
    information on the body alone; a body takes it from one of those that derivatives were taken
    at. The gait chosen now is compared under the same weights, so that no gain is negative, and
    one is zero only if no outcome changes the choice.

    Parameters
    ----------
    told
        What C trials would tell, (C, S, d, d).
    utilities
        How far each of K gaits swims on each of the N samples' bodies, (K, N).
    rng
        Draws the noise, the same for all commands.
    """
    bodies = forecast.samples[:, : forecast.body]
    apart = bodies[None] - bodies[:, None]  # (truth, sample, body)
    taken_from = np.arange(len(bodies)) % told.shape[1]
    before = np.linalg.inv(_covariance(forecast.information, forecast.body))
    added = np.linalg.inv(_covariance(forecast.information + told, forecast.body)) - before
    values, vectors = np.linalg.eigh(added)
    roots: Floats = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    noise = rng.standard_normal((len(bodies), DRAWS, forecast.body))
    now = int(utilities.mean(axis=1).argmax())
    worth = np.empty(len(told))
    for c, root in enumerate(roots):
        seen = apart @ root[taken_from]  # in standard deviations
        weights = noise @ seen.swapaxes(-1, -2) - 0.5 * (seen**2).sum(axis=-1)[:, None]
        shares = np.exp(weights - weights.max(axis=-1, keepdims=True))
        shares /= shares.sum(axis=-1, keepdims=True)
        expected = shares @ utilities.T  # (truth, draw, gait)
        worth[c] = (expected.max(axis=-1) - expected[..., now]).mean()
    return worth


def _covariance(information: Floats, body: int) -> Floats:
    """Return the body's part (..., body, body) of the covariance that informations mean."""
    return np.asarray(np.linalg.inv(information)[..., :body, :body], dtype=np.float64)


def best_command(
    forecast: Forecast,
    commands: Floats,
    strategy: Designed,
    utilities: Floats | None,
    rng: np.random.Generator,
) -> tuple[Floats, float]:
    """Return the command (c,) of (C, c) that is worth most by a strategy, and what it is worth.

    Where several are worth as much to the gait, it is that of them which tells most; where the
    gait is certain and all are worth nothing to it, ``"gait"`` is ``"information"``.
    """
    told = forecast.informations(commands)
    if strategy != "gait":
        worth = gains(forecast, told, strategy)
        best = int(worth.argmax())
    else:
        assert utilities is not None
        worth = gait_gains(forecast, told, utilities, rng)
        alike = worth >= worth.max() - 1e-9 * float(np.ptp(utilities))
        best = int(np.where(alike, gains(forecast, told, "information"), -np.inf).argmax())
    return commands[best], float(worth[best])


def robustness(utilities: Floats) -> float:
    """Return what share of the best that is possible the chosen gait keeps on nearly all bodies.

    The gait that swims farthest on average over the bodies is chosen. On each body it swims some
    share of what the best of the gaits does there; returned is the share that it keeps on nine
    bodies in ten. A trial is worth nothing to who would choose the same gait whatever it told, so
    it says when to stop better than how much the gait's distance itself varies: a body that no
    gait moves is no reason to go on.

    Parameters
    ----------
    utilities
        How far each of K gaits swims on each of N bodies, (K, N).

    Examples
    --------
    >>> robustness(np.array([[4.0, 4.0, 6.0, 0.0], [3.0, 5.0, 3.0, 0.0]])).__round__(3)
    0.86
    """
    chosen = utilities[utilities.mean(axis=1).argmax()]
    best = utilities.max(axis=0)
    shares = np.divide(chosen, best, out=np.ones_like(best), where=best > 0.0)
    return float(np.quantile(shares, 0.1))


def checked_utilities(utility: Utility, bodies: Floats) -> Floats:
    """Return how far gaits swim on bodies (N, n), (K, N), or raise a ``TargetError``."""
    utilities = np.asarray(utility(bodies), dtype=np.float64)
    if utilities.ndim != 2 or utilities.shape[1] != len(bodies) or len(utilities) < 2:
        raise TargetError(
            "the utility must return how far each of K >= 2 gaits swims on each of "
            f"{len(bodies)} bodies, shape (K, {len(bodies)}); it returned {utilities.shape}"
        )
    if not np.isfinite(utilities).all():
        raise TargetError("the utility must return finite numbers; it returned NaN or infinity")
    return utilities


def corners(actions: BitLayout, rng: np.random.Generator) -> Floats:
    """Return fast commands (C, c): every servo that turns both ways at one end of its range.

    Others are at the upper end or at three quarters: the lower end may be standing still, and in
    the middle the rhythm may fall in with the other servos', whose angles then meet in few phases.
    Where there are more than 32 corners, 32 random ones are returned.

    Examples
    --------
    >>> from eea.core.bits import action_layout
    >>> corners(action_layout([("fin", -0.5, 0.5), ("tail", 0.0, 1.0)]), np.random.default_rng(0))
    array([[-0.5 ,  0.75],
           [-0.5 ,  1.  ],
           [ 0.5 ,  0.75],
           [ 0.5 ,  1.  ]])
    """
    low = np.where(actions.low < 0.0, actions.low, 0.25 * actions.low + 0.75 * actions.high)
    if 2 ** len(actions) > MOST_CORNERS:
        upper = rng.random((MOST_CORNERS, len(actions))) < 0.5
    else:
        upper = np.array(list(product((False, True), repeat=len(actions))))
    return np.where(upper, actions.high, low)


def fast_command(actions: BitLayout, performed: Floats, rng: np.random.Generator) -> Floats:
    """Return a random corner (c,) of those that fewest commands performed (E, c) are nearest to.

    So none is repeated before all have been performed.
    """
    fast = corners(actions, rng)
    apart = np.abs(performed[:, None] - fast) / actions.span
    times = np.bincount(apart.sum(axis=-1).argmin(axis=1), minlength=len(fast))
    command: Floats = fast[rng.choice(np.flatnonzero(times == times.min()))]
    return command


def candidates(actions: BitLayout, rng: np.random.Generator) -> Floats:
    """Return the commands (C, c) that are compared: the fast ones, and random ones."""
    fast = corners(actions, rng)
    some = actions.decode(actions.random(CANDIDATES - len(fast), rng))
    return np.concatenate([fast, some])
