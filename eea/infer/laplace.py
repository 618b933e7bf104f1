"""The linearised posterior: the normal distribution that stands for it near a vector theta.

With the residuals r, their derivatives J, white noise of precision w = 1 / sigma^2, and a normal
prior of mean m and precision L, the cost -log posterior has near theta ::

    gradient     g = w J^T r + L (theta - m)
    information  A = w J^T J + L

so its least is at theta - A^-1 g, and its covariance is A^-1 (Gauss and Newton; MacKay 2003,
ch. 27).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats

Entries = Sequence[int] | NDArray[np.intp]
LEAST_EIGENVALUE_SHARE = 1e-12  # of the largest; directions below have no information


def pseudo_inverse(information: Floats) -> Floats:
    """Return the pseudo-inverse (P, P) of an information, taken after it has a unit diagonal.

    Otherwise a well known number would hide the information on others. Directions without
    information have none.
    """
    diagonal = np.diag(information)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    sizes = np.outer(scale, scale)
    unit = information / sizes
    unit = 0.5 * (unit + unit.T)
    return np.asarray(np.linalg.pinv(unit, rcond=LEAST_EIGENVALUE_SHARE, hermitian=True) / sizes)


@dataclass(frozen=True, eq=False)
class Laplace:
    """A posterior near a vector, to second order of its logarithm.

    The fields may be those of S vectors, with a first axis of that length; ``one[k]`` is that of
    the k-th. The methods are of one.

    Examples
    --------
    Two numbers of which only the sum is measured, and the second is known besides:

    >>> near = Laplace(np.zeros(2), np.array([[4.0, 4.0], [4.0, 8.0]]), np.array([-6.0, -8.0]))
    >>> near.centre.round(6).tolist(), near.covariance().round(6).tolist()
    ([1.0, 0.5], [[0.5, -0.25], [-0.25, 0.25]])
    >>> near.marginal([0]).information.round(6).tolist()
    [[2.0]]
    """

    theta: Floats  #: (P,): shares of ranges, and rad where circular.
    #: (P, P), symmetric. It may be singular: numbers without information are uniform over their
    #: ranges.
    information: Floats
    gradient: Floats  #: (P,) of the cost, nonzero where a bound holds the optimum.

    def __getitem__(self, k: int) -> Laplace:
        """Return that of the k-th of S vectors, its information symmetric to the last bit."""
        information = self.information[k]
        information = 0.5 * (information + information.T)
        return Laplace(self.theta[k], information, self.gradient[k])

    def covariance(self, least: Floats | float = 0.0) -> Floats:
        """Return the covariance (P, P), after a prior of precisions ``least`` (P,).

        Directions without information have none.
        """
        return pseudo_inverse(self.information + least * np.eye(len(self.theta)))

    @property
    def centre(self) -> Floats:
        """Where the cost is least (P,), which may be outside of the bounds."""
        return np.asarray(self.theta - self.covariance() @ self.gradient)

    def given(self, entries: Entries) -> Laplace:
        """Return that of some entries (n,), the others being as they are."""
        kept = np.asarray(entries, dtype=np.intp)
        block = np.ix_(kept, kept)
        return Laplace(self.theta[kept], self.information[block], self.gradient[kept])

    def marginal(self, entries: Entries, least: Floats | float = 0.0) -> Laplace:
        """Return that of some entries (n,), the others integrated out.

        The others have a prior of precisions ``least`` (P,) besides; without any information they
        follow nothing.
        """
        places = np.asarray(entries, dtype=np.intp)
        others = np.setdiff1d(np.arange(len(self.theta)), places)
        kept = self.given(places)
        cross = self.information[np.ix_(places, others)]
        inner = self.information + least * np.eye(len(self.theta))
        follows = cross @ pseudo_inverse(inner[np.ix_(others, others)])
        left = kept.information - follows @ cross.T
        return Laplace(
            kept.theta, 0.5 * (left + left.T), kept.gradient - follows @ self.gradient[others]
        )

    def scaled(self, factors: Floats) -> Self:
        """Return that of the same centre, with standard deviations times ``factors`` (P,)."""
        information = 0.5 * (self.information + self.information.T)
        narrowed = information / np.outer(factors, factors)
        step = pseudo_inverse(information) @ self.gradient
        return replace(self, information=narrowed, gradient=narrowed @ step)

    def score_test(self, least: float) -> tuple[float, int]:
        """Return the chi-square of ``theta`` being right, and its degrees of freedom.

        C. R. Rao's score test (1948), along the directions of an information above ``least``. Of
        some entries, while others are fitted, it is that of their :meth:`marginal`.
        """
        values, vectors = np.linalg.eigh(0.5 * (self.information + self.information.T))
        tested = values > least
        along = vectors.T @ self.gradient
        return float((along[tested] ** 2 / values[tested]).sum()), int(tested.sum())
