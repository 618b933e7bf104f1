"""Which fault explains what was observed: hypotheses in the words of damage, in one batch.

Each hypothesis is one or two words about fins, with numbers. All are simulated side by side from
the state before the change through the robot's own commands; the numbers of the best are narrowed.
A channel whose sensor broke deviates under every hypothesis, so each channel's own error is
profiled out of the likelihood: a broken one then costs a constant ::

    cost = sum over channels of K / 2 log(sigma^2 + sum of r^2 / K) + 2 per fault
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish.online.self_model import Robot, predict
from aquafish_gym.damage.faults import kind_of
from aquafish_gym.morphology import FINS

Floats = NDArray[np.float64]

#: The numbers of each word that are simulated first, and the range in which they are narrowed.
GRID: dict[str, tuple[float, ...]] = {
    "length": (0.12, 0.2, 0.28, 0.36, 0.45, 0.55, 0.65, 0.75, 0.85),
    "width": (0.12, 0.28, 0.45, 0.55, 0.65, 0.75, 0.85),
    "entangled": (0.12, 0.25, 0.4, 0.6, 0.8, 1.0),
    "weak": (0.08, 0.15, 0.25, 0.4, 0.55, 0.7, 0.85),
    "missing": (0.0,),
    "reversed": (-1.0,),
    "seized": (0.0,),
}
RANGES = {"length": (0.02, 0.98), "width": (0.02, 0.98), "entangled": (0.02, 1.0), "weak": (0.02, 0.98)}
PENALTY, NUMBER_PENALTY = 2.0, 1.0  # of a fault, and of a number in it, in log likelihood
KEPT = 16  # hypotheses that are narrowed, KEPT_LATER after two rounds
KEPT_LATER = 4
ROUNDS, SPACING, SHRINK = 6, 0.12, 2.6
LONGEST = 15  # actions by which all hypotheses are compared
BIAS_COST = 4.0  # of a channel's bias, in log likelihood

Word = tuple[str, str]  # a fin, and what happened to it


class _Numbered(NamedTuple):
    """What a row of the table of faults needs to edit N robots at once."""

    part: str
    word: str
    number: Floats | None

    @property
    def amount(self) -> Floats | float:
        """The number of a fault that needs one."""
        return 0.0 if self.number is None else self.number

    @property
    def index(self) -> int:
        """Of the fin."""
        return FINS.index(self.part)


class Hypothesis(NamedTuple):
    """Words about fins, and their numbers, of a robot that was ``base`` before."""

    words: tuple[Word, ...]
    numbers: tuple[float, ...]
    base: Robot

    @property
    def penalty(self) -> float:
        """Minus its log prior."""
        free = sum(word in RANGES for _, word in self.words)
        return PENALTY * len(self.words) + NUMBER_PENALTY * free

    def __str__(self) -> str:
        parts = [
            f"{fin}:{word}" + (f"={number:.3g}" if word in RANGES else "")
            for (fin, word), number in zip(self.words, self.numbers, strict=True)
        ]
        return "; ".join(parts) or "none"


@dataclass(frozen=True)
class Recognised:
    """What explains the observations best.

    Attributes
    ----------
    hypothesis, robot
        What broke, and what it made of the robot.
    cost
        Minus its log likelihood.
    bias
        (9,) of each channel.
    lost
        (9,) which channels observe nothing that the robot would.
    noise
        (9,) standard deviations of what is left.
    onset
        The action before which it broke, counted as ``actions`` are.
    state
        (25,) of the robot now.
    explained
        Whether it fits: False is "none of my hypotheses".
    simulated
        Robot-steps of 0.01 s.
    """

    hypothesis: Hypothesis
    robot: Robot
    cost: float
    bias: Floats
    lost: NDArray[np.bool_]
    noise: Floats
    onset: int
    state: Floats
    explained: bool
    simulated: int


def broken(robot: Robot, words: Sequence[Word], numbers: Floats) -> list[Robot]:
    """Return robots (N) that words with ``numbers`` (N, len(words)) broke."""
    count = len(numbers)
    robots = {
        "body": np.tile(robot.body, (count, 1)),
        "servo_gain": np.tile(robot.servo_gain, (count, 1)),
    }
    for (fin, word), number in zip(words, numbers.T, strict=True):
        kind_of(fin, word).edit(robots, _Numbered(fin, word, number if word in RANGES else None))
    return [
        Robot(body, gain, robot.reactive) for body, gain in zip(*robots.values(), strict=True)
    ]


@cache
def shapes() -> tuple[tuple[Word, ...], ...]:
    """Return all sets of words: none, one, two of different fins, and two numbers of one fin."""
    singles = [(fin, word) for fin in FINS for word in GRID]
    pairs = [pair for pair in combinations(singles, 2) if pair[0][0] != pair[1][0]]
    within = [
        ((fin, one), (fin, other))
        for fin in FINS
        for one, other in combinations(("length", "width", "weak"), 2)
    ]
    return ((), *((one,) for one in singles), *pairs, *within)


def bank(robot: Robot) -> tuple[list[Hypothesis], list[Robot]]:
    """Return every hypothesis on the grid, and the robots that they make."""
    hypotheses, robots = [], []
    for words in shapes():
        grid = list(product(*(GRID[word] for _, word in words)))
        numbers = np.array(grid).reshape(len(grid), len(words))
        hypotheses += [Hypothesis(words, tuple(row), robot) for row in numbers.tolist()]
        robots += broken(robot, words, numbers)
    return hypotheses, robots


class Recognition:
    """The search for what broke a robot.

    Parameters
    ----------
    bases
        What it may have been, the present belief first.
    noise
        (9,) standard deviations of the observations, the model's own error included; infinite for
        a channel that is not used.
    hold
        Steps of 0.01 s that an action is held for.
    """

    def __init__(self, bases: Sequence[Robot], noise: Floats, hold: int = 20) -> None:
        self.robot, self.hold = bases[0], hold
        self._used = np.flatnonzero(np.isfinite(noise))
        self._noise = noise[self._used]
        self._hypotheses: list[Hypothesis] = []
        self._robots: list[Robot] = []
        for base in bases:
            hypotheses, robots = bank(base)
            self._hypotheses += hypotheses
            self._robots += robots
        self._penalties = np.array([h.penalty for h in self._hypotheses])

    def find(
        self,
        states: Sequence[Floats],
        observed: Floats,
        actions: Floats,
        silent: NDArray[np.bool_],
        tolerance: Floats,
    ) -> Recognised:
        """Return what explains the observations (K, 9) after the actions (K, 3) best.

        Parameters
        ----------
        states
            The states (25,) before the first, second, ... action, in any of which it may have
            broken.
        silent
            (9,) channels that no longer change.
        tolerance
            (9,) rms error of a channel above which it is broken.
        """
        best: tuple[float, int, Hypothesis, float] | None = None
        simulated = 0
        before = 0.0
        for onset, state in enumerate(states):
            seen, done = observed[onset:], actions[onset:]
            few = slice(0, LONGEST)
            costs = self._costs(self._robots, state, seen[few], done[few], silent)
            costs += self._penalties
            order = np.argsort(costs, kind="stable")[:KEPT]
            found = [self._hypotheses[i] for i in order]
            hypothesis, cost, spent = self._narrowed(found, state, seen, done, silent)
            simulated += len(self._robots) * min(len(seen), LONGEST) * self.hold + spent
            total = cost + before
            if best is None or total < best[0] - 1e-9:
                best = total, onset, hypothesis, cost
            # A later onset explains the observations before it as those of the old robot.
            if onset + 1 < len(states):
                before = float(
                    self._costs(
                        [self.robot], states[0], observed[: onset + 1], actions[: onset + 1], silent
                    )[0]
                )
        assert best is not None
        total, onset, hypothesis, _ = best
        (robot,) = broken(hypothesis.base, hypothesis.words, np.array([hypothesis.numbers]))
        predicted, ended = predict([robot], states[onset], actions[onset:], self.hold)
        residuals = observed[onset:] - predicted[0]
        rms, spread = np.sqrt((residuals**2).mean(axis=0)), residuals.std(axis=0)
        off = silent | (rms > tolerance)
        biased = off & ~silent & (spread < 0.3 * np.abs(residuals.mean(axis=0))) & (len(residuals) > 2)
        lost = off & ~biased
        used = np.zeros(9, np.bool_)
        used[self._used] = True
        return Recognised(
            hypothesis,
            robot,
            total,
            np.where(biased, residuals.mean(axis=0), 0.0),
            lost,
            spread,
            onset,
            ended[:, 0],
            bool((lost & used & ~silent).sum() <= max(1, used.sum() // 3)),
            simulated,
        )

    def _costs(
        self,
        robots: list[Robot],
        state: Floats,
        observed: Floats,
        actions: Floats,
        silent: NDArray[np.bool_],
    ) -> Floats:
        """Return minus the log likelihoods (N,) of robots."""
        predicted, _ = predict(robots, state, actions, self.hold)
        residuals = predicted[:, :, self._used] - observed[:, self._used]
        count = len(observed)
        squares = (residuals**2).sum(axis=1)

        def profiled(left: Floats) -> Floats:
            return 0.5 * count * np.log(self._noise**2 + left / count)

        costs = profiled(squares)
        if count >= 3:
            around = squares - count * residuals.mean(axis=1) ** 2
            costs = np.minimum(costs, profiled(around) + BIAS_COST + 0.5 * np.log(count))
        total: Floats = np.where(silent[self._used], 0.0, costs).sum(axis=1)
        return np.where(np.isfinite(total), total, np.inf)

    def _narrowed(
        self,
        hypotheses: list[Hypothesis],
        state: Floats,
        observed: Floats,
        actions: Floats,
        silent: NDArray[np.bool_],
    ) -> tuple[Hypothesis, float, int]:
        """Return the best of hypotheses with the best numbers, its cost and the robot-steps."""
        spacing, simulated = SPACING, 0
        costs = np.zeros(len(hypotheses))
        for turn in range(ROUNDS):
            tried = [list(_around(one, spacing)) for one in hypotheses]
            robots = [
                robot
                for many in tried
                for robot in broken(many[0].base, many[0].words, np.array([h.numbers for h in many]))
            ]
            found = self._costs(robots, state, observed, actions, silent)
            simulated += len(robots) * len(actions) * self.hold
            first = 0
            for k, many in enumerate(tried):
                those = found[first : first + len(many)]
                first += len(many)
                costs[k] = those.min() + many[0].penalty
                hypotheses[k] = many[int(those.argmin())]
            if turn == 1:
                order = np.argsort(costs, kind="stable")[:KEPT_LATER]
                hypotheses, costs = [hypotheses[i] for i in order], costs[order]
            spacing /= SHRINK
        best = int(costs.argmin())
        return hypotheses[best], float(costs[best]), simulated


def _around(hypothesis: Hypothesis, spacing: float) -> Iterator[Hypothesis]:
    """Yield a hypothesis with its numbers on a grid about them."""
    axes = []
    for (_, word), number in zip(hypothesis.words, hypothesis.numbers, strict=True):
        if word in RANGES:
            offsets = np.array([-1.0, -1 / 3, 0.0, 1 / 3, 1.0]) * spacing
            axes.append(np.clip(number + offsets, *RANGES[word]).tolist())
        else:
            axes.append([number])
    for numbers in product(*axes):
        yield hypothesis._replace(numbers=numbers)
