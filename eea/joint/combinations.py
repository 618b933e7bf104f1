"""Hypotheses that a robot's statement implies: any change, and several changes at once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

from eea.joint.problem import Hypothesis
from eea.statistics.normal import Normal

CHANGE_ODDS = 0.1  # of a change of any number, relative to none


def together(hypotheses: Sequence[Hypothesis], most: int) -> Iterator[Hypothesis]:
    """Yield the hypotheses, and those that up to ``most`` of them hold at once.

    Combinations of more are fitted only where none of fewer explains the trials. Those of one part,
    or of the same numbers, are left out.
    """
    yield from hypotheses
    for count in range(2, most + 1):
        for some in combinations(hypotheses, count):
            names = [n for one in some for n in {*one.fixed, *one.moves, *one.freed, one.part}]
            names = [name for name in names if name]
            if len(set(names)) == len(names):
                yield joined(some)


def joined(several: Sequence[Hypothesis]) -> Hypothesis:
    """Return several hypotheses as one."""
    fixed: dict[str, float] = {}
    moves: dict[str, Normal] = {}
    for one in several:
        fixed |= one.fixed
        moves |= one.moves
    return Hypothesis(
        " and ".join(one.name for one in several),
        fixed,
        tuple(name for one in several for name in one.shared_angles),
        tuple(name for one in several for name in one.freed),
        moves=moves,
        changes=sum(one.changes for one in several),
        odds=math.prod(one.odds for one in several),
    )


def any_change(whole: Mapping[str, float]) -> list[Hypothesis]:
    """Return the hypotheses that each number in ``whole`` may be anywhere in its range."""
    odds = CHANGE_ODDS / max(len(whole), 1)
    return [
        Hypothesis(f"{name} has changed", moves={name: Normal(0.0, math.inf)}, odds=odds)
        for name in whole
    ]
