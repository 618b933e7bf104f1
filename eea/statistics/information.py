"""Information matrices that may be singular: their inverses, and intervals that are scaled."""

from __future__ import annotations

import numpy as np

from eea.core.angles import Floats

LEAST_EIGENVALUE_SHARE = 1e-12  # of the largest; directions below have no information


def scaled_inverse(information: Floats) -> tuple[Floats, Floats]:
    """Return the pseudo-inverse (P, P) of the information scaled to a unit diagonal, and the scale.

    The covariance is the pseudo-inverse over the product of two scales (P,). Without the scale a
    well known number would hide the information on others.
    """
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    unit = information / np.outer(scale, scale)
    return np.linalg.pinv(unit, rcond=LEAST_EIGENVALUE_SHARE, hermitian=True), scale


def scaled(information: Floats, gradient: Floats, factors: Floats) -> tuple[Floats, Floats]:
    """Return information and gradient of the same centre, with sds times ``factors`` (P,)."""
    information = 0.5 * (information + information.T)
    inverse, scale = scaled_inverse(information)
    step = inverse @ (gradient / scale) / scale
    narrowed: Floats = information / np.outer(factors, factors)
    return narrowed, narrowed @ step
