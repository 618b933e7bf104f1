"""Damage that chance decides: how much breaks in each tier."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from aquafish_gym.damage.effect import Effect
from aquafish_gym.damage.fault import Fault, named
from aquafish_gym.damage.fins import FinMissing, FinScaled
from aquafish_gym.damage.words import WORDS
from aquafish_gym.morphology import FINS, SIZES
from aquafish_gym.utils.validation import InvalidArgumentError, one_of

SCALED = 0.2, 0.9  # of what a size was, where any fin may break


class Chance(NamedTuple):
    """One way to break: the word for it, how likely it is, and between which numbers."""

    word: str
    weight: float
    low: float = 0.0
    high: float = 0.0


class Tier(NamedTuple):
    """How many parts break, each in one of these ways, with weights that sum to 1."""

    parts: int
    chances: tuple[Chance, ...]


# The only statement of the tiers; docs/environments/damage.md shows this table.
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


@dataclass(frozen=True)
class RandomFaults(Fault):
    """What chance breaks, drawn anew for each episode: ``random:mild``, moderate or severe."""

    tier: str
    kind: str = named("RandomFaults")

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("tier", self.tier, TIERS)

    @property
    def what(self) -> str:
        """See :class:`~aquafish_gym.damage.Fault`."""
        return f"random:{self.tier}"

    @property
    def words(self) -> str:
        """See :class:`~aquafish_gym.damage.Fault`."""
        return f"{self.tier} damage that chance decides"

    @property
    def is_random(self) -> bool:
        """Always."""
        return True

    def strike(self, robot: Effect) -> Effect:  # noqa: ARG002
        """Refuse: what breaks is not known before it is drawn."""
        raise InvalidArgumentError(f"damage {self} is left to chance: draw it first (Damage.drawn)")

    def drawn(self, rng: np.random.Generator) -> tuple[Fault, ...]:
        """Return faults of different parts, which strike together."""
        tier, struck = TIERS[self.tier], self.at(rng)
        weights = [chance.weight for chance in tier.chances]
        whole = list(WORDS)
        found = []
        for _ in range(tier.parts):
            word, _, low, high = tier.chances[rng.choice(len(weights), p=weights)]
            part = str(rng.choice([part for part in whole if word in WORDS[part]]))
            number = float(rng.uniform(low, high) * (rng.choice((-1, 1)) if word == "bias" else 1))
            make, takes = WORDS[part][word]
            fault = make(part, number) if takes else make(part)
            found.append(replace(fault, onset=struck.onset, duration=struck.duration))
            whole.remove(part)
        return tuple(found)


def broken_fins(rng: np.random.Generator) -> tuple[Fault, ...]:
    """Return one fin or two broken, equally likely, each with one fault.

    A fin is missing one time in four; else its length, width or thickness is 0.2 to 0.9 of what
    it was, uniformly.
    """
    fins = rng.permutation(FINS)[: rng.integers(1, 3)].tolist()
    faults: list[Fault] = []
    for fin in fins:
        missing, size, factor = rng.random() < 0.25, rng.choice(SIZES), rng.uniform(*SCALED)
        faults.append(FinMissing(fin) if missing else FinScaled(fin, str(size), factor))
    return tuple(faults)
