"""What trials tell if one hypothesis holds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from eea.core.angles import Floats
from eea.infer.mixture import Mixture, holding
from eea.infer.statement import Hypothesis, Prior
from eea.infer.unknowns import Unknowns

INTERVAL_SAMPLES = 4000  # for medians and intervals
LEAST_SD = 1e-6  # share of a range, in a prior


@dataclass(frozen=True, eq=False)
class Branch:
    """One hypothesis, its probability, and the posterior if it holds."""

    hypothesis: Hypothesis
    probability: float
    parameters: Unknowns
    posterior: Mixture  #: The posterior if the simulator is right.
    doubted: Mixture  #: The posterior with the problem's ``discrepancy``.

    def prior(self) -> Prior:
        """Return what is known of the numbers that all trials share.

        Angles are left out: they may have changed since, even that of a seized servo.
        """
        names = self.parameters.names
        entries = np.flatnonzero(self.parameters.common & ~self.parameters.circular)
        theta = self.posterior.sample(INTERVAL_SAMPLES, np.random.default_rng(0))[:, entries]
        covariance = np.cov(theta, rowvar=False) + LEAST_SD**2 * np.eye(len(entries))
        return Prior(tuple(names[i] for i in entries), theta.mean(axis=0), covariance)

    @property
    def cost(self) -> float:
        """The cost of the best mode: -log posterior up to a constant common to all hypotheses."""
        return min(mode.cost for mode in self.posterior.modes)

    def table(self, mass: float) -> dict[str, tuple[float, float, float]]:
        """Return the median and the interval of everything, by name, in natural units."""
        parameters = self.parameters
        low, high = self.doubted.interval(mass)
        low, high, middle = holding(low, high, self.posterior.median(), parameters.circular)
        rows = map(tuple, parameters.natural(np.array([middle, low, high])).T.tolist())
        return dict(zip(parameters.names, rows, strict=True))


def mixed(
    branches: Sequence[Branch],
    count: int,
    rng: np.random.Generator,
    draw: Callable[[Branch, int], Floats],
) -> Floats:
    """Return ``count`` draws, as many of each hypothesis as its probability makes of them."""
    shares = np.array([branch.probability for branch in branches])
    counts = rng.multinomial(count, shares / shares.sum())
    drawn = [draw(one, int(times)) for one, times in zip(branches, counts, strict=True) if times]
    return np.concatenate(drawn)
