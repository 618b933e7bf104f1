"""Is it still my body? A running check of what is felt against what is believed.

Each window is explained anew, with all that is believed as the prior, so that neither an unknown
start nor what the belief leaves open counts as a change. For the right body

    2 cost = sum of r^2 / sigma^2 + the prior's squared distance  ~  chi-square,

of as many degrees of freedom as the window has numbers, less the hidden angles, which have no
prior, or somewhat less: what a window begins with varies less than its prior. Where sigma was
itself found from N numbers the ratio has an F distribution.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, f

from eea.core.angles import Floats
from eea.core.checks import finite, real, whole
from eea.joint.initialization import pose
from eea.joint.joint_posterior import JointPosterior
from eea.joint.least_squares import COARSE, FINE, Misfit, Observed, descend
from eea.joint.parameters import Parameters
from eea.joint.problem import JointProblem

ALARM = 1e-6  # the chance of a false alarm in each window
EFFORTS = (64, 512, 4096)  # random starts, one after another until one explains the window
UNSUSPICIOUS = 1e-2  # a chance that needs no closer look
STARTS, DRAWS = 6, 4000
LEAST_SD = 1e-6  # of a range: what is known better is known


class WindowTest(NamedTuple):
    """What a window looks like to one who believes to know the body."""

    p: float  #: The chance of so bad a fit with the body that is believed in.
    same: bool  #: Whether it is no less than the chance of a false alarm.
    excess: float  #: What the fit leaves, as a multiple of what it would on average.


class ChangeDetector:
    """Holds windows of a swim against a belief, each by itself.

    Parameters
    ----------
    joint
        The robot as it begins in mid-swim: what a trial begins with are nuisances that are
        ``start``. What the belief says of its other nuisances holds, by name.
    belief
        What is believed of the body. The most probable hypothesis counts.
    alarm
        The chance of a false alarm in each window.
    seed
        Of the starting points that are tried.

    Examples
    --------
    See ``eea.watch_swims``, which watches the fish.
    """

    def __init__(
        self, joint: JointProblem, belief: JointPosterior, alarm: float = ALARM, seed: int = 0
    ) -> None:
        real("alarm", alarm, 0.0, 1.0)
        whole("seed", seed, 0)
        self.alarm = alarm
        self._rng = np.random.default_rng(seed)
        self._sigma, self._samples = belief.sigma, belief.samples
        best = belief.branches[0]
        groups = {n.group for n in joint.nuisances if n.name in best.parameters.names}
        plain = Parameters.of(joint, 1, groups, best.hypothesis)
        shared = [name for name in plain.names if "@" not in name]
        known = [best.parameters.names.index(name) for name in shared]
        theta = best.posterior.sample(DRAWS, np.random.default_rng(0))[:, known]
        mean, count = plain.prior_mean.copy(), len(shared)
        mean[:count] = theta.mean(axis=0)
        information = plain.prior_information.copy()
        covariance = np.cov(theta, rowvar=False) + LEAST_SD**2 * np.eye(count)
        information[:count, :count] = np.linalg.inv(covariance)
        turning = plain.circular[:count]  # a seized servo's angle: it may have been moved since
        information[:count][turning] = information[:, :count][:, turning] = 0.0
        self._one = replace(plain, prior_mean=mean, prior_information=information)

    def look(self, commands: NDArray[Any], signal: Floats) -> WindowTest:
        """Return what one window looks like.

        Parameters
        ----------
        commands
            (1, ...), what ``joint.simulate`` takes of one trial.
        signal
            (T, axes), finite.
        """
        signal = finite("signal", signal, (None, self._one.joint.problem.axes))
        observed = Observed(commands, signal[None])
        angles = len(self._one.joint.problem.hidden)
        freedom = signal.size - angles
        cost = np.inf
        for effort in EFFORTS:
            cost = min(cost, self._explained(observed, effort))
            ratio = 2.0 * cost / freedom
            if self._samples:
                p = float(f.sf(ratio, freedom, self._samples))
            else:
                p = float(chi2.sf(ratio * freedom, freedom))
            if p >= UNSUSPICIOUS:
                break
        return WindowTest(p, p >= self.alarm, ratio)

    def _explained(self, observed: Observed, effort: int) -> float:
        """Return the least cost found from so many random starts."""
        one, sigma = self._one, self._sigma
        typical, each = one.into_bounds(one.prior_mean[None]), -(-effort // STARTS)
        starts = np.concatenate(
            [pose(one, observed, typical, each, self._rng) for _ in range(STARTS)]
        )
        coarse = descend(Misfit(one, observed, COARSE), starts, sigma, 12, 1e-2)
        near = coarse.theta[np.argsort(coarse.cost, kind="stable")[:2]]
        return float(descend(Misfit(one, observed, FINE), near, sigma, 10, 1e-3).cost.min())
