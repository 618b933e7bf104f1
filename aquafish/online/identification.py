"""System identification where no hypothesis in words fits: all sizes and servo gains at once.

Factors on all sizes and servo gains are fitted by Levenberg-Marquardt steps to what was observed
since something broke: first to a second of it, and then to more and more. The prior expects small
changes. Changes too small to matter are dropped, and the others fitted again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquafish.online import thresholds
from aquafish.online.hypotheses import DamageGrid, FinFaults, broken
from aquafish.online.search import Candidate, Search, cost_of
from aquafish_gym.plans import BodyPlan
from aquafish_gym.plans.plan import SIZES
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Flags, Floats

#: What is fitted of each fin, in the order of a change (4 F,): logarithms of factors on its sizes,
#: and what is added to a factor on its servo's gain.
_FIN_WORDS = (*SIZES, "weak")
_LARGEST_GAIN = 2.0  # of a servo, and factor on one
_ROUNDING = 1e-9


class _Fit(NamedTuple):
    """A change (4 F,) of the robot of a case."""

    cost: float  # nats, of the observations and the change
    case: int
    change: Floats


def identify(search: Search) -> Candidate:
    """Return the likeliest factors on all sizes and gains, without those near 1 if they may go.

    They are of the robot that is believed to be.
    """
    last = len(search.states) - 1
    count = len(search.observed)
    words = _words(search.before[0].plan)
    free = np.ones(len(words), np.bool_)
    believed = [case for case, (b, _) in enumerate(search.cases) if b == 0]
    fits = [_Fit(np.inf, case, np.zeros(len(words))) for case in believed]
    for seen in thresholds.FIRST_IDENTIFIED:
        if last + seen < count:
            fits = [_best_fit(search, fits, free, last + seen)]
    fit = _best_fit(search, fits, free, count)
    found = _candidate(fit, words)
    while not (left := np.abs(fit.change) > thresholds.SAME_GAIT_DIFFERENCE).all(where=free):
        free = free & left
        fewer = fit._replace(change=np.where(free, fit.change, 0.0))
        fit = _descend(search, fewer, free, count)
        found = min(found, _candidate(fit, words), key=cost_of)
    search.best[found.grid.words] = found
    return found


def _best_fit(search: Search, fits: list[_Fit], free: Flags, until: int) -> _Fit:
    """Return the likeliest of some changes whose ``free`` numbers are fitted; see ``_descend``."""
    return min((_descend(search, fit, free, until) for fit in fits), key=lambda fit: fit.cost)


def _descend(search: Search, fit: _Fit, free: Flags, until: int) -> _Fit:
    """Return a change after Levenberg-Marquardt steps of its ``free`` numbers.

    They fit it to the observations until one.
    """
    _, case, change = fit
    b, onset = search.cases[case]
    before = search.before[b]
    state = search.states[onset]
    low, high = _limits(before)
    precision = thresholds.CHANGE_SD**-2
    cost = np.inf
    for _ in range(thresholds.IDENTIFYING_STEPS):
        moved = np.full(len(change), thresholds.NUMBER_DIFFERENCE)
        moved[change + moved > high] *= -1.0
        near = np.concatenate([change[None], change + np.diag(moved)[free]])
        predicted = search.predict(_changed(before, near), case, state, until)
        slopes, errors = search.linearize(case, predicted, moved[free])
        curvature = slopes @ slopes.T + precision * np.eye(len(slopes))
        downhill = slopes @ errors - precision * change[free]
        tried = np.repeat(change[None], 1 + len(thresholds.DAMPINGS), axis=0)
        for row, damping in zip(tried[1:], thresholds.DAMPINGS, strict=True):
            damped = curvature + damping * np.diag(np.diag(curvature))
            row[free] += np.linalg.solve(damped, downhill)
        tried = tried.clip(low, high)
        costs = search.costs(_changed(before, tried), case, state, until)
        costs += 0.5 * precision * np.square(tried).sum(axis=1)
        best = int(costs.argmin())
        gained = cost - float(costs[best])
        cost = float(costs[best])
        change = tried[best]
        if gained < thresholds.STEP_NATS:
            break
    return _Fit(cost, case, change)


def _words(plan: BodyPlan) -> FinFaults:
    """Return what is fitted of a plan's fish."""
    return tuple((fin, word) for fin in plan.names for word in _FIN_WORDS)


def _changed(before: Scenario, changes: Floats) -> Scenario:
    """Return the robots that changes (N, 4 F) make of one."""
    return broken(before, [DamageGrid(_words(before.plan), _factors(changes))])


def _factors(changes: Floats) -> Floats:
    """Return the factors (..., 4 F) of changes."""
    is_gain = np.arange(changes.shape[-1]) % len(_FIN_WORDS) == len(SIZES)
    return np.where(is_gain, 1.0 + changes, np.exp(changes))


def _limits(before: Scenario) -> tuple[Floats, Floats]:
    """Return the least and the largest change (4 F,) that a robot's ranges allow."""
    plan = before.plan
    low = np.full((len(plan.fins), len(_FIN_WORDS)), np.log(thresholds.NUMBER_MARGIN))
    high = np.zeros_like(low)
    columns = plan.columns[:, [("width", "length", "thickness").index(size) for size in SIZES]]
    sizes = before.body[0, columns]
    room = plan.maxima[columns] / np.where(sizes, sizes, np.inf) * (1.0 - _ROUNDING)
    high[:, :-1] = np.log(room, out=np.zeros_like(room), where=room > 0.0)
    gains = np.abs(before.servo_gain[0])
    most = _LARGEST_GAIN / np.maximum(gains, 1.0) * (1.0 - _ROUNDING)
    low[:, -1] = -1.0 - most
    high[:, -1] = most - 1.0
    return low.ravel(), high.ravel()


def _candidate(fit: _Fit, words: FinFaults) -> Candidate:
    """Return a change as a hypothesis in words."""
    changed = np.abs(fit.change) > _ROUNDING
    words = tuple(word for word, one in zip(words, changed.tolist(), strict=True) if one)
    cost = fit.cost + (thresholds.WORD_COST + thresholds.NUMBER_COST) * len(words)
    return Candidate(cost, fit.case, DamageGrid(words, _factors(fit.change)[None, changed]))
