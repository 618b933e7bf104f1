"""Split-conformal prediction: factors that make intervals hold as often as they say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, brief, finite


@dataclass(frozen=True)
class Calibration:
    """Factors of split-conformal prediction on the half widths of intervals.

    With them, 90% intervals hold 90% of each parameter in the robots that they were made with.

    Examples
    --------
    >>> calibration = Calibration((0.01, 0.1), ((0.8, 0.9), (1.0, 0.7)))
    >>> calibration.factors(0.0316).round(2)
    array([0.9, 0.8])
    """

    #: Noise divided by the signal's norm, ascending; one level for each row.
    levels: tuple[float, ...]
    rows: tuple[tuple[float, ...], ...]  #: A row for each level, a factor for each parameter.

    def __post_init__(self) -> None:
        levels = finite("levels", self.levels, (None,))
        if not len(levels) or (levels <= 0.0).any() or (np.diff(levels) <= 0.0).any():
            raise ConfigurationError(
                f"levels must be ascending and more than 0; got {brief(self.levels)}"
            )
        finite("rows", self.rows, (len(levels), None))

    def factors(self, level: float) -> Floats:
        """Return the factors (n,) at a level, constant beyond the first and the last level."""
        at = np.log(max(level, 1e-12))
        knots = np.log(self.levels)
        return np.array([np.interp(at, knots, row) for row in zip(*self.rows, strict=True)])
