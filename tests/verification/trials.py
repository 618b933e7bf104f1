"""The random trials on which the studies compare."""

from __future__ import annotations

import numpy as np

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW
from aquafish_gym.engines.base import Trials
from aquafish_gym.morphology import MAXIMA


def random_trials(count: int, seed: int = 0) -> Trials:
    """Return trials with bodies, commands and fin angles drawn evenly over their ranges."""
    rng = np.random.default_rng(seed)
    bodies = rng.uniform(0, 1, (count, 9)) * MAXIMA
    commands = rng.uniform(COMMAND_LOW, COMMAND_HIGH, (count, 3))
    return Trials(bodies, commands, rng.uniform(-np.pi, np.pi, (count, 3)))
