"""The search for the likeliest of thousands of hypotheses about one swim.

All are simulated in one batch from the state before the change, with the robot's own actions. The
numbers of the best are narrowed.
A broken sensor deviates under every hypothesis. So each channel's own error is profiled out of the
likelihood, and a broken one costs all hypotheses alike; K is the number of observations::

    cost = sum over channels of K / 2 log(sigma^2 + sum of r^2 / K) - log prior
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from aquafish.online import thresholds
from aquafish.online.hypotheses import DamageGrid, FinFaults, all_hypotheses, broken
from aquafish.online.self_model import noise_of, predict
from aquafish_gym.damage import Damage
from aquafish_gym.physics.layout import FIELDS
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Flags, Floats


class Alternative(NamedTuple):
    """What may have broken, and how likely that is among the alternatives."""

    damage: Damage
    #: Likelihood times prior at the best numbers, relative to the sum over the alternatives.
    weight: float
    robot: Scenario  #: What it would be: a scenario of one.


class Candidate(NamedTuple):
    """A hypothesis with its best numbers."""

    cost: float  # nats
    case: int  # the number of its robot before and its onset among the cases
    grid: DamageGrid  # of one damage
    current: tuple[float, ...] = ()  # units/s; empty: none begins


def cost_of(end: Candidate) -> float:
    return end.cost


class Search:
    """Hypotheses, compared by the same observations; see :func:`recognise`.

    Attributes
    ----------
    cases
        Pairs of the number of a robot before, and the number of the state at which it broke.
    best
        The best hypothesis so far of each set of words.
    noise, silent, zero
        (9,) the expected rms error of each channel; whether it repeats itself; whether it reads 0.
    """

    def __init__(
        self,
        before: Sequence[Scenario],
        states: Sequence[Floats],
        observed: Floats,
        actions: Floats,
        drift: Floats,
        hold: int,
    ) -> None:
        self.before = before
        self.states = states
        self.observed = observed
        self.actions = actions
        self.drift = drift
        self.hold = hold
        self.noise = np.hypot(noise_of(before[-1]), drift)
        self.silent, self.zero = repeated_channels(observed)
        self._counted = np.where(self.silent, np.inf, self.noise)
        self.cases = [(b, onset) for b in range(len(before)) for onset in range(len(states))]
        self.best: dict[FinFaults, Candidate] = {}
        # Until a later onset the robot was as before.
        self._earlier = [0.0] * len(states)
        self._earlier = [
            float(self.costs(before[0], 0, states[0], k)[0]) if k else 0.0
            for k in range(len(states))
        ]

    def costs(self, robots: Scenario, case: int, start: Floats, until: int | None = None) -> Floats:
        """Return minus the log likelihoods (N,) of robots that begin in states (R, N) or (R,)."""
        b, onset = self.cases[case]
        seen = self.observed[onset:until] - self.before[b].sensor_bias[0]
        predicted = self.predict(robots, case, start, until)
        return mismatch(predicted, seen, self._counted) + self._earlier[onset]

    def predict(
        self, robots: Scenario, case: int, start: Floats, until: int | None = None
    ) -> Floats:
        """Return what robots (N) of a case would observe, (N, K, 9)."""
        actions = self.actions[self.cases[case][1] : until]
        return predict(robots, start, actions, self.hold)[0]

    def starts(self, case: int, currents: Floats) -> Floats:
        """Return the states (R, N) of a case in which water has begun to flow with (N, 3)."""
        starts = np.repeat(self.states[self.cases[case][1]][:, None], len(currents), axis=1)
        starts[FIELDS["velocity"]] -= currents.T
        return starts

    def best_candidate(self) -> Candidate:
        """Return the likeliest hypothesis; a third fault only if two leave more than noise."""
        found = min(self.pairs(), self.currents(), key=cost_of)
        if len(found.grid.words) > 1 and not self.fits(found):
            found = min(found, self.third(), key=cost_of)
        return found

    def decided(self, candidate: Candidate) -> bool:
        """Return whether a fault of the fins, if it states one, is much likelier than none.

        A current that begins looks like one for an observation or two.
        """
        least = math.log(thresholds.DECIDED_RATIO)
        return not candidate.grid.words or self.best[()].cost - candidate.cost > least

    def fits(self, candidate: Candidate) -> bool:
        """Return whether the errors that a hypothesis leaves are as small as chance allows."""
        b, onset = self.cases[candidate.case]
        start = self.starts(candidate.case, np.array([candidate.current or np.zeros(3)]))
        robot = broken(self.before[b], [candidate.grid])
        errors = self.observed[onset:] - self.before[b].sensor_bias[0]
        errors = errors - self.predict(robot, candidate.case, start)[0]
        return leaves_noise(errors, self._counted)

    def pairs(self) -> Candidate:
        """Return the best of all single faults and pairs."""
        everything = all_hypotheses(self.before[0].plan)
        prior = _priors(everything)
        banks = [broken(robot, everything) for robot in self.before]
        until = thresholds.COMPARED_ACTIONS + len(self.states)
        self._first = np.array(
            [
                self.costs(banks[b], case, self.states[onset], until) + prior
                for case, (b, onset) in enumerate(self.cases)
            ]
        )
        self._each = [(grid, row) for grid in everything for row in range(len(grid.numbers))]
        order = np.argsort(self._first, axis=None, kind="stable")[: thresholds.NARROWED_HYPOTHESES]
        chosen = []
        for place in order.tolist():
            case, number = divmod(place, len(prior))
            grid, row = self._each[number]
            chosen.append((case, grid.row(row)))
        return self._narrow(chosen)

    def third(self) -> Candidate:
        """Return the best of the best pairs with a third fault; after :meth:`pairs`.

        The pairs are those of the robot before and the onset of the best of all.
        """
        until = thresholds.COMPARED_ACTIONS + len(self.states)
        case = int(self._first.min(axis=1).argmin())
        b, onset = self.cases[case]
        pairs: dict[FinFaults, DamageGrid] = {}
        for number in np.argsort(self._first[case], kind="stable").tolist():
            grid, row = self._each[number]
            if len(grid.words) == 2 and grid.words not in pairs:
                pairs[grid.words] = grid.row(row)
            if len(pairs) == thresholds.THIRD_PAIRS:
                break
        grids = [more for pair in pairs.values() for more in pair.with_another(self.before[b].plan)]
        robots = broken(self.before[b], grids)
        costs = self.costs(robots, case, self.states[onset], until) + _priors(grids)
        ends = [
            Candidate(float(part.min()), case, grid.row(int(part.argmin())))
            for part, grid in zip(_parted(costs, grids), grids, strict=True)
        ]
        ends.sort(key=cost_of)
        several: dict[frozenset[tuple[str, str]], Candidate] = {}
        for end in ends:  # the same words come in different orders
            several.setdefault(frozenset(end.grid.words), end)
        ends = list(several.values())
        for count in thresholds.THIRD_DESCENTS:
            grids = [end.grid for end in ends[:count]]
            ends = sorted(self._descend(case, grids), key=cost_of)
        for end in ends:
            words = end.grid.words
            self.best[words] = min(end, self.best.get(words, end), key=cost_of)
        return ends[0]

    def _descend(self, case: int, grids: list[DamageGrid]) -> list[Candidate]:
        """Return hypotheses after a Gauss-Newton step of their numbers, each where that helps."""
        b, onset = self.cases[case]
        start = self.states[onset]
        tried = [grid.beside(thresholds.NUMBER_DIFFERENCE) for grid in grids]
        predicted = self.predict(broken(self.before[b], tried), case, start)
        ahead = []
        for grid, near, seen in zip(grids, tried, _parted(predicted, tried), strict=True):
            moved = (near.numbers[1:] - near.numbers[0]).sum(axis=1)
            step = np.zeros(grid.numbers.shape[1])
            step[grid.free] = self._gauss_newton(case, seen, moved)
            ahead.append(grid.along(step, thresholds.STEP_LENGTHS))
        costs = self.costs(broken(self.before[b], ahead), case, start) + _priors(ahead)
        return [
            Candidate(float(part.min()), case, grid.row(int(part.argmin())))
            for grid, part in zip(ahead, _parted(costs, ahead), strict=True)
        ]

    def _gauss_newton(self, case: int, predicted: Floats, moved: Floats) -> Floats:
        """Return a Gauss-Newton step (k,) of the parameters of a hypothesis; see ``linearize``."""
        slopes, errors = self.linearize(case, predicted, moved)
        return np.asarray(np.linalg.lstsq(slopes.T, errors, rcond=1e-6)[0], np.float64)

    def linearize(self, case: int, predicted: Floats, moved: Floats) -> tuple[Floats, Floats]:
        """Return the slopes (k, n) of a prediction, and its errors (n,), in standard deviations.

        ``predicted`` (1 + k, K, 9) is what a hypothesis predicts, and with each parameter ``moved``
        (k,). Channels are weighted by what they leave unexplained, as in :func:`mismatch`.
        """
        b, onset = self.cases[case]
        until = onset + predicted.shape[1]
        errors = self.observed[onset:until] - self.before[b].sensor_bias[0] - predicted[0]
        seen = np.isfinite(errors) & np.isfinite(self._counted)
        errors = np.where(seen, errors, 0.0)
        squares = np.square(errors).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
        scale = np.sqrt(self._counted**2 + thresholds.LEAST_OBSERVATION_SD**2 + squares)
        slopes = (predicted[1:] - predicted[0]) / moved[:, None, None]
        slopes = np.where(seen, slopes / scale, 0.0)
        errors = np.where(seen, errors / scale, 0.0)
        return slopes.reshape(len(moved), errors.size), errors.ravel()

    def _narrow(self, chosen: list[tuple[int, DamageGrid]]) -> Candidate:
        """Narrow the numbers of pairs of a case and a damage; return the best."""
        spacing = thresholds.FIRST_SPACING
        for turn in range(thresholds.NARROWING_ROUNDS):
            ends = []
            for case in sorted({case for case, _ in chosen}):
                b, onset = self.cases[case]
                tried = [one.around(spacing) for which, one in chosen if which == case]
                values = self.costs(broken(self.before[b], tried), case, self.states[onset])
                for part, grid in zip(_parted(values, tried), tried, strict=True):
                    total = float(part.min()) + grid.prior_cost
                    ends.append(Candidate(total, case, grid.row(int(part.argmin()))))
            ends.sort(key=lambda end: end[:2])
            for end in ends:
                words = end.grid.words
                self.best[words] = min(end, self.best.get(words, end), key=cost_of)
            count = thresholds.NARROWED_HYPOTHESES if turn < 1 else thresholds.LATE_HYPOTHESES
            chosen = [(end.case, end.grid) for end in ends[:count]]
            spacing /= thresholds.SPACING_RATIO
        return ends[0]

    def currents(self) -> Candidate:
        """Return the best current that begins while the robot remains what it was."""
        nothing = all_hypotheses(self.before[0].plan)[0]
        found = Candidate(np.inf, 0, nothing)
        near = np.concatenate([np.zeros((1, 3)), thresholds.CURRENT_DIFFERENCE * np.eye(3)])
        moved = np.full(3, thresholds.CURRENT_DIFFERENCE)
        lengths = np.array([0.0, *thresholds.STEP_LENGTHS])[:, None]
        for case, (b, _) in enumerate(self.cases):
            current = np.zeros(3)
            robots = self.before[b].take(np.zeros(len(lengths), np.intp))
            for _ in range(thresholds.CURRENT_DESCENTS):
                starts = self.starts(case, current + near)
                predicted = self.predict(robots.take(range(len(near))), case, starts)
                tried = current + lengths * self._gauss_newton(case, predicted, moved)
                costs = self.costs(robots, case, self.starts(case, tried)) + thresholds.CURRENT_COST
                best = tried[int(costs.argmin())]
                done = np.abs(best - current).max() < thresholds.CURRENT_PRECISION
                current = best
                if done:
                    break
            x, y, z = current.tolist()
            found = min(found, Candidate(float(costs.min()), case, nothing, (x, y, z)), key=cost_of)
        self.best[()] = min(found, self.best.get((), found), key=cost_of)
        return found

    def alternatives(self) -> tuple[Alternative, ...]:
        """Return the best damages of different words, with their weights."""
        ends = sorted(self.best.values(), key=cost_of)
        likelihoods = np.exp([ends[0].cost - end.cost for end in ends])
        weights = (likelihoods / likelihoods.sum()).tolist()
        found = []
        for end, weight in zip(ends, weights, strict=True):
            damage = end.grid.damage()
            before = self.before[self.cases[end.case][0]]
            found.append(Alternative(damage, weight, broken(before, [end.grid])))
        return tuple(found)


def _parted(rows: Floats, grids: Sequence[DamageGrid]) -> list[Floats]:
    """Return the rows of each grid, of those (N, ...) of all side by side."""
    return np.split(rows, np.cumsum([len(grid.numbers) for grid in grids])[:-1])


def _priors(grids: Sequence[DamageGrid]) -> Floats:
    """Return minus the log priors of all damages of grids."""
    sizes = [len(grid.numbers) for grid in grids]
    return np.repeat([grid.prior_cost for grid in grids], sizes)


def leaves_noise(errors: Floats, noise: Floats) -> bool:
    """Return whether errors (K, 9) are as small as chance allows.

    ``noise`` (9,) is their rms by chance. Those that are NaN, or of infinite noise, do not count.
    """
    seen = np.isfinite(errors) & np.isfinite(noise)
    count = float(seen.sum())
    relative = np.where(seen, errors / np.hypot(noise, thresholds.LEAST_OBSERVATION_SD), 0.0)
    squares = float(np.square(relative).sum())
    return squares <= count + thresholds.NOISE_EXCESS * math.sqrt(count)


def mismatch(predicted: Floats, observed: Floats, noise: Floats) -> Floats:
    """Return minus the log likelihoods (N,) of predictions (N, K, 9).

    Each channel's own error is profiled out. Channels of infinite ``noise`` (9,) do not count, and
    neither do observations that are NaN.
    """
    seen = np.isfinite(observed)
    used = np.isfinite(noise) & seen.any(axis=0)
    seen, count = seen[:, used], seen[:, used].sum(axis=0)
    variance = np.square(noise[used]) + thresholds.LEAST_OBSERVATION_SD**2
    errors = predicted[:, :, used] - observed[:, used]
    errors[:, ~seen] = 0.0
    squares = np.square(errors).sum(axis=1)
    found = 0.5 * count * np.log(variance + squares / count)
    around = squares - count * np.square(errors.sum(axis=1) / count)
    biased = 0.5 * count * np.log(variance + around / count)
    biased += np.where(
        count >= thresholds.FEWEST_OBSERVATIONS, thresholds.BIAS_COST + 0.5 * np.log(count), np.inf
    )
    found = np.minimum(found, biased)
    total: Floats = found.sum(axis=1)
    return np.where(np.isfinite(total), total, np.inf)


def repeated_channels(observed: Floats) -> tuple[Flags, Flags]:
    """Return which channels (9,) of observations (K, 9) are silent, and which read 0 at last.

    No whole channel repeats itself.
    """
    silent, zero = np.zeros((2, observed.shape[1]), np.bool_)
    for i, column in enumerate(observed.T):
        last = column[np.isfinite(column)][-thresholds.FEWEST_OBSERVATIONS :]
        if len(last):
            zero[i] = last[-1] == 0.0
            silent[i] = (
                (last == last[-1]).all() if len(last) == thresholds.FEWEST_OBSERVATIONS else zero[i]
            )
    return silent, zero
