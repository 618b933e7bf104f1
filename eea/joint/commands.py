"""The next command of joint inference: servos at the ends of their ranges."""

from __future__ import annotations

from itertools import product

import numpy as np

from eea.core.angles import Floats
from eea.core.genome import BitLayout

MOST_CORNERS = 32


def corners(actions: BitLayout, rng: np.random.Generator) -> Floats:
    """Return fast commands (C, c): every servo that turns both ways at one end of its range.

    The other servos run at full or three quarters of their highest speed: at the lowest they may
    stand still, and at half speed their rhythm may lock to that of the others. Beyond 32 corners,
    32 random ones are returned.

    Examples
    --------
    >>> from eea.core.genome import action_layout
    >>> corners(action_layout([("fin", -0.5, 0.5), ("tail", 0.0, 1.0)]), np.random.default_rng(0))
    array([[-0.5 ,  0.75],
           [-0.5 ,  1.  ],
           [ 0.5 ,  0.75],
           [ 0.5 ,  1.  ]])
    """
    low = np.where(actions.low < 0.0, actions.low, 0.25 * actions.low + 0.75 * actions.high)
    if 2 ** len(actions) > MOST_CORNERS:
        upper = rng.random((MOST_CORNERS, len(actions))) < 0.5
    else:
        upper = np.array(list(product((False, True), repeat=len(actions))))
    return np.where(upper, actions.high, low)


def fast_command(actions: BitLayout, performed: Floats, rng: np.random.Generator) -> Floats:
    """Return a random one of the corners (c,) that commands (E, c) came close to least often.

    No corner is repeated before all have been performed.
    """
    fast = corners(actions, rng)
    apart = np.abs(performed[:, None] - fast) / actions.span
    times = np.bincount(apart.sum(axis=-1).argmin(axis=1), minlength=len(fast))
    command: Floats = fast[rng.choice(np.flatnonzero(times == times.min()))]
    return command
