"""What may have broken in mid-swim: one to three faults of fins, with numbers on a grid.

Two faults are of different fins, or two sizes of one fin. A third one is of another fin.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from aquafish.online import thresholds
from aquafish_gym.damage import Damage, Fault
from aquafish_gym.damage.breaking import break_part
from aquafish_gym.damage.words import FIN_WORDS, Range, needs_number
from aquafish_gym.plans import BodyPlan
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats

#: The words about fins that are tried, with their first numbers; 0 of a word that takes none.
#: Thickness matters little to the motion. A dead servo is seized in mid-swim, a scaled one is weak,
#: and the model has no late ones.
FIRST_NUMBERS: dict[str, tuple[float, ...]] = {
    "length": (0.12, 0.2, 0.28, 0.36, 0.45, 0.55, 0.65, 0.75, 0.85),
    "width": (0.12, 0.28, 0.45, 0.55, 0.65, 0.75, 0.85),
    "entangled": (0.12, 0.25, 0.4, 0.6, 0.8, 1.0),
    "weak": (0.08, 0.15, 0.25, 0.4, 0.55, 0.7, 0.85),
    "missing": (0.0,),
    "reversed": (0.0,),
    "seized": (0.0,),
}


#: The words that take a number, and its range in the grammar.
NUMBERED: dict[str, Range] = {
    word: number for word in FIRST_NUMBERS if needs_number(number := FIN_WORDS[word])
}


def searched_range(word: str) -> tuple[float, float]:
    """Return in which part of a word's range its number is searched.

    A broken fin has less than a whole one, which a factor of 1 leaves whole. A factor of 0 is a fin
    that is missing or a servo that is seized, and a negative one a servo that is reversed.
    """
    number = NUMBERED[word]
    low = max(number.low, 0.0) + thresholds.NUMBER_MARGIN
    high = min(number.high, 1.0)
    return low, high - thresholds.NUMBER_MARGIN if number.neutral == 1.0 else high


FinFaults = tuple[tuple[str, str], ...]  # pairs of a fin and a word


class DamageGrid(NamedTuple):
    """Hypotheses of the same words: N damages that differ in their numbers."""

    words: FinFaults  #: k pairs (fin, word).
    numbers: Floats  #: (N, k), 0 of a word that takes none.

    def row(self, index: int) -> DamageGrid:
        """Return a grid of one of the damages."""
        return self._replace(numbers=self.numbers[[index]])

    def around(self, spacing: float) -> DamageGrid:
        """Return the damages whose numbers lie about those of the first one."""
        axes = [
            np.unique(
                np.clip(number + spacing * np.array(thresholds.STENCIL), *searched_range(word))
            ).tolist()
            if word in NUMBERED
            else [number]
            for (_, word), number in zip(self.words, self.numbers[0].tolist(), strict=True)
        ]
        return self._replace(numbers=_rows(axes))

    @property
    def free(self) -> list[int]:
        """Which of the k numbers may vary."""
        return [i for i, (_, word) in enumerate(self.words) if word in NUMBERED]

    def beside(self, difference: float) -> DamageGrid:
        """Return the first damage, and it with one number after the other changed a little."""
        free = self.free
        numbers = np.repeat(self.numbers[:1], 1 + len(free), axis=0)
        for row, i in enumerate(free, start=1):
            high = searched_range(self.words[i][1])[1]
            numbers[row, i] += difference if numbers[0, i] + difference <= high else -difference
        return self._replace(numbers=numbers)

    def along(self, step: Floats, lengths: Sequence[float]) -> DamageGrid:
        """Return the first damage, and it after a step (k,) of its numbers times each length."""
        numbers = self.numbers[0] + np.outer((0.0, *lengths), step)
        for i in self.free:
            numbers[:, i] = numbers[:, i].clip(*searched_range(self.words[i][1]))
        return self._replace(numbers=numbers)

    def with_another(self, plan: BodyPlan) -> list[DamageGrid]:
        """Return the first damage with each fault of each fin of a plan that is whole in it."""
        broken_fins = {fin for fin, _ in self.words}
        return [
            DamageGrid(
                (*self.words, (fin, word)),
                _rows([*((number,) for number in self.numbers[0].tolist()), numbers]),
            )
            for fin in plan.names
            if fin not in broken_fins
            for word, numbers in FIRST_NUMBERS.items()
        ]

    @property
    def prior_cost(self) -> float:
        """Minus the log prior of each of them."""
        return thresholds.WORD_COST * len(self.words) + thresholds.NUMBER_COST * len(self.free)

    def damage(self) -> Damage:
        """Return the first one."""
        return Damage(
            tuple(
                Fault(fin, word, number if needs_number(FIN_WORDS[word]) else None)
                for (fin, word), number in zip(self.words, self.numbers[0].tolist(), strict=True)
            )
        )


def _rows(axes: Sequence[Sequence[float]]) -> Floats:
    """Return all combinations (N, k) of the numbers on k axes."""
    rows = list(product(*axes))
    return np.array(rows).reshape(len(rows), len(axes))


def broken(robot: Scenario, grids: Sequence[DamageGrid]) -> Scenario:
    """Return the robots that all damages of grids make of one, side by side."""
    ends = np.cumsum([len(grid.numbers) for grid in grids]).tolist()
    robots = robot.take(np.zeros(ends[-1], np.intp))
    columns = robots.columns()
    for grid, end in zip(grids, ends, strict=True):
        rows = slice(end - len(grid.numbers), end)
        for (fin, word), number in zip(grid.words, grid.numbers.T, strict=True):
            break_part(robot.plan, columns, rows, fin, word, number)
    return robots


@cache
def all_hypotheses(plan: BodyPlan) -> tuple[DamageGrid, ...]:
    """Return nothing broken, each word, two words about two fins, and two sizes of one fin."""
    singles = [(fin, word) for fin in plan.names for word in FIRST_NUMBERS]
    apart = [pair for pair in combinations(singles, 2) if pair[0][0] != pair[1][0]]
    together = [
        ((fin, one), (fin, other))
        for fin in plan.names
        for one, other in combinations(("length", "width", "weak"), 2)
    ]
    several = [(), *((one,) for one in singles), *apart, *together]
    return tuple(
        DamageGrid(words, _rows([FIRST_NUMBERS[word] for _, word in words])) for words in several
    )
