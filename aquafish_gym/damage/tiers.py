"""The tiers of random damage: how much breaks in each."""

from __future__ import annotations

from typing import NamedTuple


class Chance(NamedTuple):
    """One way to break: its word, its weight, the range of its number, and which parts it breaks.

    Without ``parts`` it breaks any part that its word fits.
    """

    word: str
    weight: float
    low: float = 0.0
    high: float = 0.0
    parts: tuple[str, ...] = ()


class Tier(NamedTuple):
    """How many parts break, each in one of these ways, with weights that sum to 1."""

    parts: int
    chances: tuple[Chance, ...]


#: The only statement of the tiers, which docs/environments/damage.md shows. A tier that is added
#: here is understood as ``random:NAME``.
TIERS: dict[str, Tier] = {
    "mild": Tier(1, (
        Chance("length", 0.25, 0.7, 0.9),
        Chance("width", 0.25, 0.7, 0.9),
        Chance("entangled", 0.15, 0.1, 0.3),
        Chance("weak", 0.20, 0.7, 0.9),
        Chance("noise", 0.10, 0.01, 0.05),
        Chance("bias", 0.05, 0.01, 0.05),
    )),
    "moderate": Tier(1, (
        Chance("length", 0.25, 0.4, 0.7),
        Chance("width", 0.25, 0.4, 0.7),
        Chance("entangled", 0.10, 0.3, 0.6),
        Chance("weak", 0.15, 0.3, 0.7),
        Chance("seized", 0.10),
        Chance("noise", 0.05, 0.1, 0.3),
        Chance("bias", 0.05, 0.1, 0.3),
        Chance("stuck", 0.05),
    )),
    "severe": Tier(2, (
        Chance("length", 0.20, 0.1, 0.4),
        Chance("missing", 0.25),
        Chance("entangled", 0.05, 0.6, 1.0),
        Chance("weak", 0.05, 0.05, 0.3),
        Chance("reversed", 0.10),
        Chance("seized", 0.10),
        Chance("dead", 0.10),
        Chance("dropped", 0.15),
    )),
}  # fmt: skip
