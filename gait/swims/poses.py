"""Initial fin angles of swims, and the random streams that draw them."""

from __future__ import annotations

import numpy as np

from aquafish_gym.plans import AQUAFISH
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import integer
from gait.controllers.controller import MAXIMUM_SEED

MAXIMUM_POSES = 10_000
GOLDEN_RATIO = 1.2207440846057596  # of three dimensions: the root of x^4 = x + 1
ZERO_POSE = (0.0, 0.0, 0.0)  # both flippers arms-back, the tail straight

# "gait" in ASCII. One seed often serves the environments and the estimation, too, whose streams
# follow from the bare seed: without this a run's poses would be the angles that the target hides.
_GAIT = 0x67616974


def stream(seed: int, *key: int) -> np.random.SeedSequence:
    """Return this package's random stream ``key`` of a seed."""
    return np.random.SeedSequence([_GAIT, integer("seed", seed, 0, MAXIMUM_SEED)], spawn_key=key)


def random_poses(count: int, seed: int | np.random.SeedSequence) -> Floats:
    """Return ``count`` random fin angles (count, 3), uniform over whole turns, in rad."""
    source = seed if isinstance(seed, np.random.SeedSequence) else stream(seed)
    size = (integer("count", count, 0, MAXIMUM_POSES), len(AQUAFISH.names))
    return np.random.default_rng(source).uniform(-np.pi, np.pi, size)


def spread_poses(count: int, seed: np.random.SeedSequence) -> Floats:
    """Return ``count`` fin angles (count, 3) that fill whole turns evenly, in rad.

    Steps of the golden ratio's generalisation to three dimensions (Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018) from a random pose: each is uniform, and their
    mean distance varies less than that of independent ones.
    """
    steps = np.outer(np.arange(count), GOLDEN_RATIO ** -np.arange(1.0, 4.0))
    turns = (np.random.default_rng(seed).uniform(size=3) + steps) % 1.0
    return np.asarray(2.0 * np.pi * turns - np.pi)
