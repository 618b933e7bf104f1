"""What an agent notices and decides, and the results that its thinking time delays."""

from __future__ import annotations

import math
from typing import Generic, NamedTuple, TypeVar

Result = TypeVar("Result")


class Event(NamedTuple):
    """Something that the agent noticed or decided."""

    seconds: float  #: When, in the episode.
    #: "fins", "water", "sensor", "alarm", "inferred", "unknown", "chose" or "refined".
    what: str
    about: str  #: In words.
    cpu: float = 0.0  #: CPU seconds that it took.


class Thought(NamedTuple, Generic[Result]):
    """A result that can be used from an action on."""

    due: int
    event: Event
    result: Result


def thinking_actions(seconds: float, dt: float) -> int:
    """Return how many actions of ``dt`` seconds thinking takes: at least one.

    The present action is due now.

    Examples
    --------
    >>> thinking_actions(0.4, 0.2), thinking_actions(0.0, 0.2)
    (2, 1)
    """
    return max(1, math.ceil(seconds / dt - 1e-9))
