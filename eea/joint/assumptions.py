"""Numbers that a simulator assumes and no fit seeks: whether the trials contradict them.

Each is a direction in which the signal changes, to first order. With r the residuals of the best
fit, J their derivatives by the unknowns and S those by the assumed numbers, in standard deviations
of their priors, the numbers' own information and slope are those left when the unknowns follow::

    M = S^T S / sigma^2 - S^T J A^-1 J^T S / sigma^4,      A = J^T J / sigma^2 + prior precision
    b = S^T r / sigma^2

and b^T M^-1 b is chi-square if the assumptions hold (C. R. Rao's score test). Where it is too large
for that, the numbers become nuisances of the intervals (:mod:`eea.joint.discrepancy`). Otherwise
they stay as assumed, since as nuisances they would widen every interval of what they trade off
with, and the log tells nothing against them. Whether it could have told is said in words.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from eea.core.angles import Floats
from eea.joint.discrepancy import differences
from eea.joint.evidence import precision_of_samples
from eea.joint.least_squares import FINE
from eea.joint.problem import Assumed
from eea.joint.search import Optima
from eea.joint.slow_errors import ACTIVE_BOUND_DISTANCE

CONTRADICTED_P = 0.05  # the chance of as large a contradiction where the assumptions hold
UNTOLD_SHARE = 0.5  # of a prior's standard deviation: a number known less well is not told
LEAST_INFORMATION = 1e-6  # in 1 / prior variance: a direction of less is not tested


@dataclass(frozen=True, eq=False)
class Contradiction:
    """What a log tells of assumed numbers."""

    assumed: tuple[Assumed, ...]
    estimate: Floats  #: (K,), in the numbers' own units.
    spread: Floats  #: (K,), the standard deviations of the estimates.
    p: float  #: The chance of as large a contradiction where the assumptions hold.

    @property
    def contradicted(self) -> bool:
        """Whether the assumptions do not hold."""
        return self.p < CONTRADICTED_P

    @property
    def findings(self) -> tuple[str, ...]:
        """What was measured of the numbers where they are contradicted, and what was not."""
        said = []
        told = self.spread <= UNTOLD_SHARE * np.array([one.sd for one in self.assumed])
        numbers = zip(self.assumed, self.estimate.tolist(), self.spread.tolist(), strict=True)
        if self.contradicted:
            measured = [
                f"{one.name} is {value:.2g} {one.unit} (sd {spread:.2g}), not {one.value:g}"
                for one, value, spread in numbers
                if spread <= UNTOLD_SHARE * one.sd
            ]
            measured = measured or [f"{' or '.join(o.name for o in self.assumed)} is not"]
            allowed = f"the intervals allow for it (p = {self.p:.1g})"
            said.append(f"{' and '.join(measured)} as assumed; {allowed}")
        if not told.all():
            untold = [one for one, known in zip(self.assumed, told, strict=True) if not known]
            each = " and ".join(f"{one.name}, {one.value:g} {one.unit}" for one in untold)
            about = " and ".join(dict.fromkeys(one.about for one in untold))
            said.append(f"assumed, not measured: {each}; {about} depends on it")
        return tuple(said)


def contradiction(optima: Optima) -> Contradiction | None:
    """Return what the best fit tells of the numbers that its simulator assumes, if it has any."""
    regression = optima.regression
    parameters = regression.parameters
    discrepancy = parameters.robot.discrepancy
    if discrepancy is None or discrepancy.assumed_shapes is None:
        return None
    theta = optima.fits.theta[:1]
    misfit = regression.misfit(FINE)
    linear = misfit.linearise(theta)
    directions = differences(optima, discrepancy.assumed_shapes, theta)[0]  # (E, K, M)
    weight = precision_of_samples(optima)
    inner = (theta[0] > parameters.low + ACTIVE_BOUND_DISTANCE) & (
        theta[0] < parameters.high - ACTIVE_BOUND_DISTANCE
    )
    cross = np.zeros((len(parameters), directions.shape[1]))
    for e, (used, entries) in enumerate(misfit.columns):
        cross[entries] += weight * linear.slopes[0, e, used] @ directions[e].T
    information = (weight * linear.normal[0] + parameters.prior_information)[np.ix_(inner, inner)]
    flat = np.einsum("ekm,elm->kl", directions, directions) * weight
    left = flat - cross[inner].T @ np.linalg.pinv(information, hermitian=True) @ cross[inner]
    slope = weight * np.einsum("ekm,em->k", directions, linear.residuals[0])
    values, vectors = np.linalg.eigh(0.5 * (left + left.T))
    told = values > LEAST_INFORMATION
    along = vectors.T @ slope
    square = float((along[told] ** 2 / values[told]).sum())
    p = float(chdtrc(int(told.sum()), square)) if told.any() else 1.0
    # Where nearly nothing is left, rounding may leave less than nothing.
    covariance = (vectors / (np.maximum(values, 0.0) + 1.0)) @ vectors.T
    sds = np.array([one.sd for one in discrepancy.assumed])
    means = np.array([one.value for one in discrepancy.assumed])
    return Contradiction(
        discrepancy.assumed,
        means - sds * (covariance @ slope),
        sds * np.sqrt(np.diag(covariance)),
        p,
    )
