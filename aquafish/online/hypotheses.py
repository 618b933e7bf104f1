"""What may have broken in mid-swim: one fault of a fin, or two, with numbers on a grid.

Two faults are of different fins, or two sizes of one fin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from aquafish_gym.damage import Damage, Fault
from aquafish_gym.damage.faults import break_fin
from aquafish_gym.damage.words import PARTS, Range, needs_number
from aquafish_gym.morphology import FINS
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
NUMBER_MARGIN = 0.02  # from a number that is another hypothesis


def _searched(number: Range) -> tuple[float, float]:
    """Return in which part of a word's range its number is searched.

    A broken fin has less than a whole one, which a factor of 1 leaves whole. A factor of 0 is a fin
    that is missing or a servo that is seized, and a negative one a servo that is reversed.
    """
    low = max(number.low, 0.0) + NUMBER_MARGIN
    high = min(number.high, 1.0)
    return low, high - NUMBER_MARGIN if number.neutral == 1.0 else high


#: Of the words that take a number.
NUMBER_RANGES = {
    word: _searched(number)
    for word in FIRST_NUMBERS
    if needs_number(number := PARTS["caudal"][word])
}
# Minus the log prior of each fault and number.
WORD_COST = 2.0
NUMBER_COST = 1.0
STENCIL = np.array([-1.0, -1 / 3, 0.0, 1 / 3, 1.0])  # of numbers about one, in their spacing

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
            np.unique(np.clip(number + spacing * STENCIL, *NUMBER_RANGES[word])).tolist()
            if word in NUMBER_RANGES
            else [number]
            for (_, word), number in zip(self.words, self.numbers[0].tolist(), strict=True)
        ]
        return self._replace(numbers=_rows(axes))

    @property
    def prior_cost(self) -> float:
        """Minus the log prior of each of them."""
        numbers = sum(word in NUMBER_RANGES for _, word in self.words)
        return WORD_COST * len(self.words) + NUMBER_COST * numbers

    def damage(self) -> Damage:
        """Return the first one."""
        return Damage(
            tuple(
                Fault(fin, word, number if word in NUMBER_RANGES else None)
                for (fin, word), number in zip(self.words, self.numbers[0].tolist(), strict=True)
            )
        )


def _rows(axes: Sequence[Sequence[float]]) -> Floats:
    """Return all combinations (N, k) of the numbers on k axes."""
    rows = list(product(*axes))
    return np.array(rows).reshape(len(rows), len(axes))


def damage_text(damage: Damage) -> str:
    """Return damage as text for people, with three digits of each number."""
    parts = [
        f"{fault.part}:{fault.word}" + ("" if fault.number is None else f"={fault.number:.3g}")
        for fault in damage
    ]
    return "; ".join(parts) or "none"


def broken(robot: Scenario, grids: Sequence[DamageGrid]) -> Scenario:
    """Return the robots that all damages of grids make of one, side by side."""
    ends = np.cumsum([len(grid.numbers) for grid in grids]).tolist()
    robots = robot.take(np.zeros(ends[-1], np.intp))
    for grid, end in zip(grids, ends, strict=True):
        rows = slice(end - len(grid.numbers), end)
        those = replace(robots, body=robots.body[rows], servo_gain=robots.servo_gain[rows])  # views
        for (fin, word), number in zip(grid.words, grid.numbers.T, strict=True):
            break_fin(those, fin, word, number)
    return robots


@cache
def all_hypotheses() -> tuple[DamageGrid, ...]:
    """Return nothing broken, each word, two words about two fins, and two sizes of one fin."""
    singles = [(fin, word) for fin in FINS for word in FIRST_NUMBERS]
    apart = [pair for pair in combinations(singles, 2) if pair[0][0] != pair[1][0]]
    together = [
        ((fin, one), (fin, other))
        for fin in FINS
        for one, other in combinations(("length", "width", "weak"), 2)
    ]
    several = [(), *((one,) for one in singles), *apart, *together]
    return tuple(
        DamageGrid(words, _rows([FIRST_NUMBERS[word] for _, word in words])) for words in several
    )
