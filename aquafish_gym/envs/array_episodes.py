"""Episodes of damage for batches on a device, drawn before they begin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from aquafish_gym.damage.damage import Damage, Parts
from aquafish_gym.utils.array_types import Rows

DRAWN_EPISODES = 4096  # of random damage, at a reset: each robot has one after the other of them


class Episodes(NamedTuple):
    """The damages of P episodes, which are not random, and their order for each of B robots."""

    damages: list[Damage]
    starts: Rows  #: (B,) the first episode of each robot
    following: Rows  #: (P,) the episode after each
    repeat: bool  #: whether each robot's episodes are all the same


def draw_episodes(
    damages: Sequence[Damage],
    first_damages: Sequence[Damage],
    parts: Parts,
    rng: np.random.Generator,
) -> Episodes:
    """Draw the episodes of random damages; robots of the same damage begin far apart in them."""
    robots: dict[Damage, list[int]] = {}
    for robot, damage in enumerate(damages):
        robots.setdefault(damage, []).append(robot)
    several = sum(damage.is_random for damage in robots)
    drawn: list[Damage] = []
    following: list[int] = []
    starts = np.zeros(len(damages), int)
    for damage, alike in robots.items():
        size = max(DRAWN_EPISODES // several, len(alike)) if damage.is_random else 1
        begin = len(drawn)
        starts[alike] = begin + np.arange(len(alike)) * size // len(alike)
        drawn += [damage.sample(rng, parts) for _ in range(size)]
        following += [*range(begin + 1, begin + size), begin]
    if first_damages is not damages:
        following += starts.tolist()
        starts = len(drawn) + np.arange(len(damages))
        drawn += [damage.sample(rng, parts) for damage in first_damages]
    repeat = first_damages is damages and not several
    return Episodes(drawn, starts, np.array(following), repeat)
