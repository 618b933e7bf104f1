"""Held-out damages: lists of texts by number, which no change of random damage touches."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.plans import AQUAFISH, PLANS, BodyPlan
from aquafish_gym.utils.storage import read_packaged
from aquafish_gym.utils.validation import InvalidArgumentError, brief, integer, one_of

FILE = "held_out.json"
SCHEMA = "aquafish_gym.held_out/1"


def held_out(
    name: str, numbers: Sequence[int] | NDArray[np.integer[Any]] | None = None
) -> list[str]:
    """Return damages of a list as texts, which no method was developed on.

    They stand in a file of the package, and are the same in every version.

    Parameters
    ----------
    name
        "severe", "moderate" and "mild" last from the start. With an onset, as "severe@15-30",
        something breaks then. Those of other fish begin with the plan: "four-fins severe".
        docs/environments/damage.md has all lists.
    numbers
        Those to return, in this order; all of the list by default.

    Raises
    ------
    InvalidArgumentError, UnknownNameError
        If there is no such list, or it lacks a number.

    Examples
    --------
    >>> held_out("recovery", [2, 0])
    ['left_pectoral:missing', 'right_pectoral:length=0.35']
    >>> len(held_out("severe", range(100)))
    100
    """
    known = [one for one in lists() if _plan_of(one) == _plan_of(name)]
    damages = lists()[one_of("name", name, known)]
    if numbers is None:
        return list(damages.values())
    several = isinstance(numbers, Sequence) and not isinstance(numbers, str | bytes)
    if not several and not (isinstance(numbers, np.ndarray) and numbers.ndim):
        raise InvalidArgumentError(
            f"numbers must be a list of whole numbers, such as range(100); got {brief(numbers)}"
        )
    wanted = [integer("numbers", number, 0) for number in numbers]
    for number in wanted:
        if number not in damages:
            raise InvalidArgumentError(
                f"numbers must be those of the list {name!r}, which has {spans(list(damages))}; "
                f"got {number}"
            )
    return [damages[number] for number in wanted]


def recovery_list(plan: BodyPlan) -> str:
    """Return the name of the list of ten held-out damages of a plan's body.

    InvalidArgumentError where there is none.
    """
    name = "recovery" if plan == AQUAFISH else f"{plan.name} recovery"
    if name not in lists():
        raise InvalidArgumentError(
            f"held-out damages are of the plans {', '.join(PLANS)}; got the plan {plan.name}"
        )
    return name


def _plan_of(name: object) -> str:
    """Return the plan's name that a list's begins with; empty of the paper's fish."""
    first = name.partition(" ")[0] if isinstance(name, str) else ""
    return first if first in PLANS else ""


@cache
def lists() -> dict[str, dict[int, str]]:
    """Return all lists: the damages by their numbers."""
    found = read_packaged("aquafish_gym.damage", FILE, SCHEMA)["lists"]
    return {
        name: {int(number): text for number, text in damages.items()}
        for name, damages in found.items()
    }


def spans(numbers: Sequence[int]) -> str:
    """Return ascending numbers in words.

    Examples
    --------
    >>> spans([0, 1, 2, 7])
    '0 to 2 and 7'
    """
    ends = [[number, number] for number in numbers[:1]]
    for number in numbers[1:]:
        if number == ends[-1][1] + 1:
            ends[-1][1] = number
        else:
            ends.append([number, number])
    return " and ".join(
        f"{first}" if first == last else f"{first} to {last}" for first, last in ends
    )
