"""Numbers that differ between groups and within them: where those of a new group lie.

The numbers x of member i in group s are ::

    x[s, i] = mean + between[s] + within[s, i]

and a new member of a new group lies about the mean of the n groups with the variance
(1 + 1/n) between + within. A new member of a group of m lies about the mean of that group with the
variance (1 + 1/m) within. Few groups, or members, tell little of their spread: it is Student's t,
for which a normal distribution of the same 90% interval stands.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from eea.core.angles import Floats

NORMAL_95 = 1.6448536269514722


def new_member(
    values: Floats,
    uncertain: Floats,
    labels: Sequence[object],
    group: object = None,
    widened: bool = False,
) -> tuple[Floats, Floats]:
    """Return the mean (k,) and covariance (k, k) of a new member.

    It is of the ``group`` of that label, if given; else of a new group, or of the only one.
    ``values`` (n, k) are known up to the covariance ``uncertain`` (k, k), and members of a group
    have the same label. ``widened`` by Student's t, as few groups, or members of one, tell little
    of their spread.
    """
    members = len(values)
    groups = [np.array([label == other for other in labels]) for label in dict.fromkeys(labels)]
    count = len(groups)
    means = np.array([values[of].mean(axis=0) for of in groups])
    apart = values - sum(np.outer(of, mean) for of, mean in zip(groups, means, strict=True))
    seen = apart.T @ apart / max(members - count, 1)
    within = seen + uncertain
    own = np.array([label == group for label in labels]) if group is not None else groups[0]
    if group is None and count > 1:
        mean = means.mean(axis=0)
        each = np.mean([1.0 / of.sum() for of in groups])
        between = np.cov(means, rowvar=False).reshape(within.shape) - each * seen
        covariance = (1.0 + 1.0 / count) * _positive(between) + within
        freedom = count - 1
    else:
        mean = values[own].mean(axis=0)
        covariance = (1.0 + 1.0 / own.sum()) * within
        freedom = members - count
    if widened:
        covariance = covariance * widening(freedom) ** 2
    return mean, covariance


def widening(freedom: float) -> float:
    """Return the sd of a normal whose 90% interval is that of Student's t, over the t's scale."""
    return float(stdtrit(freedom, 0.95)) / NORMAL_95


def _positive(matrix: Floats) -> Floats:
    """Return the nearest matrix without negative eigenvalues."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    found: Floats = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return found
