"""A normal distribution, as it is stated."""

from __future__ import annotations

import math
from dataclasses import dataclass

from eea.core.checks import ConfigurationError, real, real_or_infinite


@dataclass(frozen=True)
class Normal:
    """A normal distribution, truncated to [low, high]; with an infinite ``sd`` it is uniform.

    Examples
    --------
    >>> Normal(0.0, 0.2, low=0.0).low  # half of it: upwards only
    0.0
    """

    mean: float
    sd: float
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        real("mean", self.mean, -math.inf)
        for name, least in (("sd", 1e-12), ("low", -math.inf), ("high", -math.inf)):
            real_or_infinite(name, getattr(self, name), least)
        if not self.low < self.high:
            raise ConfigurationError(
                f"low must be less than high; got {self.low:g} and {self.high:g}"
            )
