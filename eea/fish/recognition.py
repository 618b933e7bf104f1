"""Recognising in mid-swim what broke: hypotheses in the words of damage, all in one batch.

A hypothesis is one or two words about fins, with numbers. Each makes another robot, simulated from
the state before the change through the robot's own actions; the numbers of the best are narrowed.
A broken sensor deviates under every hypothesis. So each channel's own error is profiled out of the
likelihood, and a broken one costs all hypotheses alike; K is the number of observations::

    cost = sum over channels of K / 2 log(sigma^2 + sum of r^2 / K) - log prior
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage.faults import break_fin
from aquafish_gym.morphology import FINS
from aquafish_gym.scenario import Scenario
from eea.fish.self_model import FLOOR, predict

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: The numbers of each word that are tried first.
GRID: dict[str, tuple[float, ...]] = {
    "length": (0.12, 0.2, 0.28, 0.36, 0.45, 0.55, 0.65, 0.75, 0.85),
    "width": (0.12, 0.28, 0.45, 0.55, 0.65, 0.75, 0.85),
    "entangled": (0.12, 0.25, 0.4, 0.6, 0.8, 1.0),
    "weak": (0.08, 0.15, 0.25, 0.4, 0.55, 0.7, 0.85),
    "missing": (0.0,),
    "reversed": (0.0,),
    "seized": (0.0,),
}
RANGES = {  # of the numbers of words that have one
    "length": (0.02, 0.98),
    "width": (0.02, 0.98),
    "entangled": (0.02, 1.0),
    "weak": (0.02, 0.98),
}
WORD_COST, NUMBER_COST, BIAS_COST = 2.0, 1.0, 4.0  # minus the log prior of each
COMPARED = 15  # actions over which all hypotheses are compared
NARROWED, LATER = 16, 4  # how many are narrowed, and after two rounds
ROUNDS, SPACING, SHRINK = 6, 0.12, 2.6
STENCIL = np.array([-1.0, -1 / 3, 0.0, 1 / 3, 1.0])
STEADY = 0.3  # of a bias: a smaller deviation about it is a bias
FEWEST = 3  # observations that show a bias, or a channel that is stuck


class Hypothesis(NamedTuple):
    """What may have broken: words about fins, and their numbers."""

    words: tuple[tuple[str, str], ...]  #: (fin, word) each.
    numbers: tuple[float, ...]  #: As many; 0 of a word that has none.

    def __str__(self) -> str:
        parts = [
            f"{fin}:{word}" + (f"={number:.3g}" if word in RANGES else "")
            for (fin, word), number in zip(self.words, self.numbers, strict=True)
        ]
        return "; ".join(parts) or "none"


@dataclass(frozen=True, eq=False)
class Recognised:
    """What explains the observations best.

    Attributes
    ----------
    hypothesis, robot
        What broke, and the robot that it made: a scenario of one.
    state
        (25,) of that robot after the last action.
    bias
        (9,) of each channel; 0 of those that have none.
    lost
        (9,) the channels that do not observe what the robot does.
    explained
        Whether the hypothesis explains most channels; False is "none of my hypotheses".
    """

    hypothesis: Hypothesis
    robot: Scenario
    state: Floats
    bias: Floats
    lost: Flags
    explained: bool


def broken(robot: Scenario, hypotheses: Sequence[Hypothesis]) -> Scenario:
    """Return the N robots that hypotheses make of one; those of the same words side by side."""
    robots = robot.take(np.zeros(len(hypotheses), np.intp))
    first = 0
    while first < len(hypotheses):
        words, last = hypotheses[first].words, first
        while last < len(hypotheses) and hypotheses[last].words == words:
            last += 1
        rows = slice(first, last)
        those = replace(robots, body=robots.body[rows], servo_gain=robots.servo_gain[rows])  # views
        numbers = np.array([h.numbers for h in hypotheses[rows]]).reshape(last - first, len(words))
        for (fin, word), number in zip(words, numbers.T, strict=True):
            break_fin(those, fin, word, number)
        first = last
    return robots


@cache
def all_hypotheses() -> tuple[Hypothesis, ...]:
    """Return nothing broken, each word, two words about two fins, and two sizes of one fin."""
    singles = [(fin, word) for fin in FINS for word in GRID]
    apart = [pair for pair in combinations(singles, 2) if pair[0][0] != pair[1][0]]
    together = [
        ((fin, one), (fin, other))
        for fin in FINS
        for one, other in combinations(("length", "width", "weak"), 2)
    ]
    shapes = [(), *((one,) for one in singles), *apart, *together]
    return tuple(
        Hypothesis(words, numbers)
        for words in shapes
        for numbers in product(*(GRID[word] for _, word in words))
    )


def _prior_cost(hypothesis: Hypothesis) -> float:
    numbers = sum(word in RANGES for _, word in hypothesis.words)
    return WORD_COST * len(hypothesis.words) + NUMBER_COST * numbers


def recognise(
    before: Sequence[Scenario],
    states: Sequence[Floats],
    observed: Floats,
    actions: Floats,
    noise: Floats,
    tolerance: Floats,
    hold: int = 20,
) -> Recognised:
    """Return what explains K observations best.

    Parameters
    ----------
    before
        What the robot may have been until then, scenarios of one; the present belief first.
    states
        (25,) the states before the first action, the second, and so on, at any of which something
        may have broken.
    observed, actions
        (K, 9) observations, each after its action (K, 3).
    noise
        (9,) standard deviations of the observations, with the model's own error; infinite of a
        channel that is not used.
    tolerance
        (9,) the rms error from which on a channel is taken to be lost.
    hold
        For how many steps of 0.01 s an action is held.
    """
    used = np.flatnonzero(np.isfinite(noise))
    silent = (
        (observed == observed[-1]).all(axis=0) if len(observed) >= FEWEST else observed[-1] == 0
    )
    counted = np.where(silent[used], 0.0, 1.0)
    variance = np.square(noise[used]) + FLOOR**2

    def costs(robots: Scenario, state: Floats, since: int, until: int | None = None) -> Floats:
        """Return minus the log likelihoods (N,) from an action on."""
        seen = observed[since:until][:, used]
        predicted, _ = predict(robots, state, actions[since:until], hold)
        errors = predicted[:, :, used] - seen
        count = len(seen)
        squares = np.square(errors).sum(axis=1)
        found = 0.5 * count * np.log(variance + squares / count)
        if count >= FEWEST:
            around = squares - count * np.square(errors.mean(axis=1))
            biased = 0.5 * count * np.log(variance + around / count)
            found = np.minimum(found, biased + BIAS_COST + 0.5 * np.log(count))
        total: Floats = (found * counted).sum(axis=1)
        return np.where(np.isfinite(total), total, np.inf)

    best: tuple[float, int, int, Hypothesis] | None = None
    everything = all_hypotheses()
    priors = np.array([_prior_cost(one) for one in everything])
    for b, robot in enumerate(before):
        bank = broken(robot, everything)
        for onset, state in enumerate(states):
            # Until a later onset the robot was what it had been.
            earlier = float(costs(before[0], states[0], 0, onset)[0]) if onset else 0.0
            first = costs(bank, state, onset, onset + COMPARED) + priors
            order = np.argsort(first, kind="stable")[:NARROWED]
            chosen = [everything[i] for i in order]
            spacing = SPACING
            for turn in range(ROUNDS):
                tried = [list(_around(one, spacing)) for one in chosen]
                flat = [one for several in tried for one in several]
                values = costs(broken(robot, flat), state, onset)
                parts = np.split(values, np.cumsum([len(several) for several in tried])[:-1])
                ends = [
                    (float(part.min()) + _prior_cost(several[0]), several[int(part.argmin())])
                    for part, several in zip(parts, tried, strict=True)
                ]
                ends.sort(key=lambda end: end[0])
                chosen = [one for _, one in ends[: NARROWED if turn < 1 else LATER]]
                spacing /= SHRINK
            total = ends[0][0] + earlier
            if best is None or total < best[0] - 1e-9:
                best = total, b, onset, ends[0][1]
    assert best is not None
    _, b, onset, hypothesis = best
    robot = broken(before[b], [hypothesis])
    predicted, ended = predict(robot, states[onset], actions[onset:], hold)
    errors = observed[onset:] - predicted[0]
    mean, rms = errors.mean(axis=0), np.sqrt(np.square(errors).mean(axis=0))
    off = silent | (rms > tolerance)
    biased = off & ~silent & (errors.std(axis=0) < STEADY * np.abs(mean)) & (len(errors) >= FEWEST)
    lost = off & ~biased
    unexplained = int((lost & ~silent)[used].sum())
    return Recognised(
        hypothesis,
        replace(robot, faults=np.array([len(hypothesis.words)])),
        ended[:, 0],
        np.where(biased, mean, 0.0),
        lost,
        unexplained <= max(1, len(used) // 3),
    )


def _around(hypothesis: Hypothesis, spacing: float) -> list[Hypothesis]:
    """Return a hypothesis with its numbers on a grid about them."""
    axes = [
        np.unique(np.clip(number + spacing * STENCIL, *RANGES[word])).tolist()
        if word in RANGES
        else [number]
        for (_, word), number in zip(hypothesis.words, hypothesis.numbers, strict=True)
    ]
    return [hypothesis._replace(numbers=numbers) for numbers in product(*axes)]
