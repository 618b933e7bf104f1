"""Random points that are spread evenly over a box."""

from __future__ import annotations

import numpy as np

from eea.core.angles import Floats


def latin_hypercube(count: int, width: int, rng: np.random.Generator) -> Floats:
    """Return points (count, width) in [0, 1], one in each of ``count`` slices of every axis.

    McKay, Beckman and Conover (1979); the same draws as scipy's, whose statistics take a second
    to import.

    Examples
    --------
    >>> points = latin_hypercube(4, 2, np.random.default_rng(0))
    >>> np.sort((4 * points).astype(int), axis=0).T
    array([[0, 1, 2, 3],
           [0, 1, 2, 3]])
    """
    (rng,) = rng.spawn(1)
    within = rng.random((count, width))
    slices = np.tile(np.arange(1, count + 1), (width, 1))
    for row in slices:
        rng.shuffle(row)
    points: Floats = (slices.T - within) / count
    return points
