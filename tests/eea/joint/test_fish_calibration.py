"""Is joint inference honest on the fish itself? Small versions of ``python -m tests.inference``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eea import JointConfig
from tests.inference.cases import DRAWS, MASSES, WORSE, examine
from tests.inference.settings import Setting
from tests.inference.summary import NAMES, covered

# As much of a search as one trial needs, and no hypotheses: nothing here is seized.
QUICK = JointConfig(bodies=48, poses=48, descents=16, restarts=0, alternatives="never")
ROBOTS = 24
PRIOR = Setting("one trial, everything from the prior", ROBOTS, "prior", "prior", 1, noise=0.01)


def examined(setting, numbers, seed=7):
    """Return what was found of a setting's robots."""
    return [examine(setting, i, np.random.default_rng([seed, i]), QUICK) for i in numbers]


@pytest.fixture(scope="module")
def found():
    return examined(PRIOR, range(ROBOTS))
