"""The log density of a robot's numbers given trials, for a sampler of one's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from eea.core.angles import Floats, wrap
from eea.core.checks import finite
from eea.infer.fit import known_noise
from eea.infer.misfit import FINE, Regression
from eea.infer.statement import RobotModel
from eea.infer.trials import Noise, Observed, Trial
from eea.infer.unknowns import FIXED_PRECISION, Unknowns


class LogDensity:
    """The log of the posterior density, up to a constant, if nothing is broken.

    Call it with vectors (B, P), or one (P,), in natural units and in the order of ``names``; it
    returns (B,), or one number: minus infinity outside of a range or where no simulation is finite.

    Parameters
    ----------
    robot, trials
        As for ``Robot.infer``.
    noise
        The standard deviation of each channel's noise, by name, or the ``noise`` of an answer.

    Raises
    ------
    ConfigurationError
        If trials have other channels than the robot, or the noise is not that of each channel; and
        when called, if vectors have another shape.
    """

    def __init__(
        self, robot: RobotModel, trials: Sequence[Trial], noise: Mapping[str, float] | Noise
    ) -> None:
        observed = replace(Observed.of(trials, robot), noise=known_noise(noise, robot))
        self._unknowns = Unknowns.of(robot, len(observed), robot.groups)
        self._misfit = Regression(self._unknowns, observed, 1.0).misfit(FINE)
        self._sought = np.flatnonzero(self._unknowns.prior_precision < FIXED_PRECISION)
        ends = np.array([self._unknowns.low, self._unknowns.high])
        circular = self._unknowns.circular
        turn = np.where(circular, np.array([[-np.pi], [np.pi]]), ends)
        self.names = tuple(self._unknowns.names[i] for i in self._sought)
        #: (P,), the ends of the ranges, in natural units; an angle may have any value.
        self.low, self.high = self._unknowns.natural(turn)[:, self._sought]

    def __call__(self, vectors: ArrayLike) -> Floats:
        """Return the log densities of vectors (B, P), or of one (P,)."""
        rows = np.atleast_2d(np.asarray(vectors, np.float64))
        rows = finite("vectors", rows, (None, len(self.names)))
        unknowns = self._unknowns
        theta = np.tile(unknowns.prior_mean, (len(rows), 1))
        share = (rows - self.low) / (self.high - self.low)
        turning = unknowns.circular[self._sought]
        theta[:, self._sought] = np.where(turning, wrap(rows), np.clip(share, 0.0, 1.0))
        inside = ((share >= 0.0) & (share <= 1.0) | turning).all(axis=1)
        density = np.full(len(rows), -np.inf)
        if inside.any():
            cost = 0.5 * self._misfit.squares(theta[inside]) + unknowns.prior_cost(theta[inside])
            density[inside] = -cost
        return density if np.ndim(vectors) == 2 else density[0]
