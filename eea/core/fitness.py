"""The paper's fitness functions (Eqs. 1, 3, 4), scores of chance and of the best genome."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from eea.core.angles import Floats
from eea.core.behavior import MAX, Coefficients
from eea.core.checks import finite
from eea.core.genome import BitLayout


def action_fitness(behaviors: Coefficients) -> Floats:
    """Return ACT_FIT (A,) of A actions (Eq. 1): the mean of 1 - sim over all pairs of models.

    Behaviours are (A, M, F): A actions, M models, F coefficients.
    """
    models = behaviors.shape[1]
    sums = np.array([_pairwise_sum(action) for action in behaviors])
    return disagreement(sums / behaviors.shape[2], models)


def disagreement(apart: Floats, models: int) -> Floats:
    """Return ACT_FIT (Eq. 1) from the sum of the mean differences over all pairs of models."""
    pairs = models * (models - 1) / 2  # C(M, 2)
    fitness: Floats = apart / (MAX * pairs)  # Eq. 1
    return fitness


def _pairwise_sum(behaviors: Coefficients) -> float:
    """Return the sum of all pairs' differences for one action, behaviours (M, F).

    Each model is compared with all later ones, in place on real and imaginary parts. This fits a
    core's cache and is ten times as fast as gathering pairs of complex numbers.
    """
    real, imaginary = (np.ascontiguousarray(part) for part in (behaviors.real, behaviors.imag))
    squares = np.empty_like(real)
    buffer = np.empty_like(real)
    total = 0.0
    for i in range(len(behaviors) - 1):
        later = len(behaviors) - 1 - i
        apart = np.subtract(real[i + 1 :], real[i], out=squares[:later])
        other = np.subtract(imaginary[i + 1 :], imaginary[i], out=buffer[:later])
        np.square(apart, out=apart)
        apart += np.square(other, out=other)
        total += float(np.sqrt(apart, out=apart).sum())
    return total


def model_fitness(similarities: Floats) -> Floats:
    """Return the mean similarity over all experiments (Eq. 3): (N, E) to (N,)."""
    mean: Floats = similarities.mean(axis=-1)  # Eq. 3
    return mean


def dimension_errors(models: ArrayLike, target: ArrayLike, layout: BitLayout) -> Floats:
    """Return the distances of models (..., n) from the target (n,), as shares of the ranges.

    A target that is not finite or has another shape raises ``ConfigurationError``.
    """
    truth = finite("target", target, (len(layout),))
    errors: Floats = np.abs(np.asarray(models, dtype=np.float64) - truth) / layout.span
    return errors


def objective_fitness(models: ArrayLike, target: ArrayLike, layout: BitLayout) -> Floats:
    """Return OBJ_FIT (...,), 1 - mean dimension error (Eq. 4); no search may use this oracle.

    See :func:`dimension_errors` for the parameters.
    """
    fitness: Floats = 1.0 - dimension_errors(models, target, layout).mean(axis=-1)  # Eq. 4
    return fitness


def chance_errors(target: ArrayLike, layout: BitLayout) -> Floats:
    """Return the exact mean errors (n,) of uniform random genomes, as shares of the ranges."""
    truth = finite("target", target, (len(layout),))
    pairs = zip(layout.variables, truth, strict=True)
    return np.array([np.abs(v.levels - true).mean() / (v.high - v.low) for v, true in pairs])


def chance_level(target: ArrayLike, layout: BitLayout) -> float:
    """Return the exact mean OBJ_FIT of uniform random genomes against a target (n,)."""
    return float(1.0 - chance_errors(target, layout).mean())


def mid_range_level(target: ArrayLike, layout: BitLayout) -> float:
    """Return the OBJ_FIT of the body at the middle of every range against a target (n,)."""
    return float(objective_fitness(0.5 * (layout.low + layout.high), target, layout))


def quantisation_errors(target: ArrayLike, layout: BitLayout) -> Floats:
    """Return the errors (n,) of the genome nearest to a target (n,), as shares of the ranges.

    An error is not zero where a size lies between two levels.
    """
    truth = finite("target", target, (len(layout),))
    return dimension_errors(layout.decode(layout.encode(truth[None]))[0], truth, layout)


def quantisation_limit(target: ArrayLike, layout: BitLayout) -> float:
    """Return the OBJ_FIT of the genome nearest to a target (n,): no search can do better."""
    return float(1.0 - quantisation_errors(target, layout).mean())
