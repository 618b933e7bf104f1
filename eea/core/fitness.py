"""The paper's fitnesses (Eqs. 1, 3, 4), and what guessing and the nearest genome score."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from eea.core.angles import Floats
from eea.core.behavior import BehaviorConfig, Coefficients
from eea.core.bits import BitLayout
from eea.core.checks import finite


def action_fitness(behaviors: Coefficients, config: BehaviorConfig) -> Floats:
    """Return ACT_FIT (A,), how much each action makes the models disagree (Eq. 1), exactly.

    It is the mean of 1 - sim over the C(M, 2) pairs of models; behaviours are (A, M, F), of A
    actions by M models by F coefficients.
    """
    models = behaviors.shape[1]
    if np.iscomplexobj(behaviors) or config.clamp:
        sums = np.array([_pairwise_sum(action, config) for action in behaviors])
    else:
        # sum over i < j of |x_i - x_j| is sum over ranks k of (2 k - (M - 1)) x_(k).
        weights = 2.0 * np.arange(models) - (models - 1)
        ordered = np.sort(behaviors, axis=1).astype(np.float64)
        sums = np.einsum("m,amf->a", weights, ordered)
    return disagreement(sums / behaviors.shape[2], models, config)


def disagreement(apart: Floats, models: int, config: BehaviorConfig) -> Floats:
    """Return ACT_FIT (Eq. 1) for the sum over pairs of models of their mean difference."""
    pairs = models * (models - 1) / 2  # C(M, 2)
    fitness: Floats = apart / (config.maximum * pairs)  # Eq. 1
    return fitness


def _pairwise_sum(behaviors: Coefficients, config: BehaviorConfig) -> float:
    """Return the sum of all pairs' differences for one action, behaviours (M, F).

    Each model against all later ones, in place on real parts: a block of numbers that fits a
    core's cache, and ten times as fast as gathering pairs of complex ones.
    """
    parts = [np.ascontiguousarray(part) for part in (behaviors.real, behaviors.imag)]
    squares, buffer = np.empty_like(parts[0]), np.empty_like(parts[0])
    total = 0.0
    for i in range(len(behaviors) - 1):
        later = len(behaviors) - 1 - i
        apart = np.subtract(parts[0][i + 1 :], parts[0][i], out=squares[:later])
        if np.iscomplexobj(behaviors):
            other = np.subtract(parts[1][i + 1 :], parts[1][i], out=buffer[:later])
            np.square(apart, out=apart)
            apart += np.square(other, out=other)
            np.sqrt(apart, out=apart)
        else:
            np.abs(apart, out=apart)
        if config.clamp:
            np.minimum(apart, config.maximum, out=apart)
        total += float(apart.sum())
    return total


def model_fitness(similarities: Floats) -> Floats:
    """Return the mean similarity over all experiments (Eq. 3): (N, E) to (N,)."""
    mean: Floats = similarities.mean(axis=-1)  # Eq. 3
    return mean


def dimension_errors(models: ArrayLike, target: ArrayLike, layout: BitLayout) -> Floats:
    """Return how far models (..., n) are from the target (n,), as shares (..., n) of the ranges.

    Raises
    ------
    ConfigurationError
        If the target is not finite or not of shape (n,).
    """
    truth = finite("target", target, (len(layout),))
    errors: Floats = np.abs(np.asarray(models, dtype=np.float64) - truth) / layout.span
    return errors


def objective_fitness(models: ArrayLike, target: ArrayLike, layout: BitLayout) -> Floats:
    """Return one less the mean dimensional error (Eq. 4): an oracle, never used in the search.

    Takes what :func:`dimension_errors` does; returns shape (...), in [0, 1].
    """
    fitness: Floats = 1.0 - dimension_errors(models, target, layout).mean(axis=-1)  # Eq. 4
    return fitness


def chance_level(target: ArrayLike, layout: BitLayout) -> float:
    """Return the exact mean OBJ_FIT of uniform random genomes against a target (n,)."""
    truth = finite("target", target, (len(layout),))
    errors = [
        np.abs(variable.levels - true).mean() / (variable.high - variable.low)
        for variable, true in zip(layout.variables, truth, strict=True)
    ]
    return float(1.0 - np.mean(errors))


def mid_range_level(target: ArrayLike, layout: BitLayout) -> float:
    """Return the OBJ_FIT of the body at the middle of every range against a target (n,)."""
    return float(objective_fitness(0.5 * (layout.low + layout.high), target, layout))


def quantisation_errors(target: ArrayLike, layout: BitLayout) -> Floats:
    """Return the errors (n,) of the genome nearest to a target (n,), as shares of the ranges.

    They are not zero where a size lies between two levels.
    """
    truth = finite("target", target, (len(layout),))
    return dimension_errors(layout.decode(layout.encode(truth[None]))[0], truth, layout)


def quantisation_limit(target: ArrayLike, layout: BitLayout) -> float:
    """Return the OBJ_FIT of the genome nearest to a target (n,): no search can do better."""
    return float(1.0 - quantisation_errors(target, layout).mean())
