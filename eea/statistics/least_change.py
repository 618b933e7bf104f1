"""How small a change would not show: where it is as probable as none."""

from __future__ import annotations

import math

import numpy as np

from eea.core.angles import Floats
from eea.statistics.truncated_normal import log_mass

MOST_SDS = 40.0  # that a change is tried up to
TRIED_CHANGES = 8001


def least_change(spread: float, mean: float, sd: float, ends: Floats, odds: float) -> float:
    """Return the size of the least change that is more probable than none, if all is normal.

    Trials determine a change x to a standard deviation s, the ``spread``. Beforehand it is normal
    with ``mean`` m and ``sd`` w between its ``ends`` (2,), and of ``odds`` o. Then, with
    v^2 = s^2 + w^2, ::

        log odds = log(o s / v) + x^2 / (2 s^2) - (x - m)^2 / (2 v^2)
                   + log(mass between the ends after the trials / before)

    Infinity where no change between the ends is.
    """
    both = math.hypot(spread, sd)
    steps = spread * np.linspace(-MOST_SDS, MOST_SDS, TRIED_CHANGES)
    tried = steps[(steps >= ends[0]) & (steps <= ends[1])]
    centre = (tried * sd**2 + mean * spread**2) / both**2
    after = (ends - centre[:, None]) * both / (spread * sd)
    before = (ends - mean) / sd
    log_odds = math.log(odds * spread / both)
    log_odds = log_odds + 0.5 * (tried / spread) ** 2 - 0.5 * ((tried - mean) / both) ** 2
    log_odds = log_odds + log_mass(after[:, 0], after[:, 1]) - log_mass(before[0], before[1])
    return float(np.abs(tried[log_odds > 0.0]).min(initial=math.inf))
