"""Initial fin angles of swims, and the random streams that draw them."""

from __future__ import annotations

import numpy as np

from aquafish_gym.plans import AQUAFISH, BodyPlan, PlanLike, check_plan
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import integer
from gait.controllers.controller import MAXIMUM_SEED

MAXIMUM_POSES = 10_000

# "gait" in ASCII. One seed often serves the environments and the estimation, too, whose streams
# follow from the bare seed: without this a run's poses would be the angles that the target hides.
_GAIT = 0x67616974


def stream(seed: int, *key: int) -> np.random.SeedSequence:
    """Return this package's random stream ``key`` of a seed."""
    return np.random.SeedSequence([_GAIT, integer("seed", seed, 0, MAXIMUM_SEED)], spawn_key=key)


def zero_pose(plan: BodyPlan = AQUAFISH) -> Floats:
    """Return the fin angles (1, F) of fins that point along their directions: 0 rad each."""
    return np.zeros((1, len(plan.fins)))


def random_poses(
    count: int, seed: int | np.random.SeedSequence, plan: PlanLike = AQUAFISH
) -> Floats:
    """Return ``count`` random fin angles (count, F), uniform over whole turns, in rad."""
    source = seed if isinstance(seed, np.random.SeedSequence) else stream(seed)
    size = (integer("count", count, 0, MAXIMUM_POSES), len(check_plan(plan).fins))
    return np.random.default_rng(source).uniform(-np.pi, np.pi, size)


def golden_ratio(dimensions: int) -> float:
    """Return the root of x^(dimensions + 1) = x + 1 above 1.

    Examples
    --------
    >>> golden_ratio(1)
    1.618033988749895
    """
    root = 2.0
    for _ in range(50):  # each halves the error at least
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    return root


def spread_poses(count: int, seed: np.random.SeedSequence, plan: BodyPlan = AQUAFISH) -> Floats:
    """Return ``count`` fin angles (count, F) that fill whole turns evenly, in rad.

    Steps of the golden ratio's generalisation to F dimensions (Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018) from a random pose: each is uniform, and their
    mean distance varies less than that of independent ones.
    """
    fins = len(plan.fins)
    steps = np.outer(np.arange(count), golden_ratio(fins) ** -np.arange(1.0, fins + 1.0))
    turns = (np.random.default_rng(seed).uniform(size=fins) + steps) % 1.0
    return np.asarray(2.0 * np.pi * turns - np.pi)
