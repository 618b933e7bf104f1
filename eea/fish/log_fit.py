"""The fit of a recorded swim whose commands change at its rows, or between two rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from eea.core.config import FitConfig
from eea.fish.windows import LogWindows
from eea.infer.answer import Answer
from eea.infer.fit import fit
from eea.infer.optima import Optima
from eea.infer.robot import Robot

#: s. Times of changes between closer rows never matter.
CLOSEST_ROWS_SECONDS = 0.002


def fit_log(
    windows: LogWindows,
    finer: LogWindows,
    robot: Callable[[LogWindows], Robot],
    config: FitConfig,
    draw: Callable[[], np.random.Generator],
    doubt: Callable[[Optima], bool] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Answer:
    """Return the posterior of a log.

    Where no body explains ``windows``, which take changes of command between close rows at their
    rows, the times of these changes are unknown, too, as in ``finer`` windows of the same log: they
    rarely matter, and each costs a simulation more.

    Parameters
    ----------
    windows, finer
        The log's, by :func:`eea.fish.windows.log_windows`.
    robot
        Returns the fish in some windows.
    config, doubt, progress
        See :func:`eea.infer.fit.fit`.
    draw
        Returns the generator of the starting points.
    """
    if finer.unknown() > windows.unknown():
        once = replace(config, restarts=0)
        found = fit(
            windows.observed, robot(windows), once, draw(), progress=progress, doubt=lambda _: False
        )
        if found.good:
            return found
        windows = finer
    fish = robot(windows)
    return fit(windows.observed, fish, config, draw(), progress=progress, doubt=doubt)
