"""Checks of a posterior from a file: values that no fit can return mean a damaged file."""

from __future__ import annotations

import numpy as np

from eea.core.checks import ConfigurationError, flag, real
from eea.joint.joint_posterior import JointPosterior
from eea.joint.observed import LARGEST_NUMBER
from eea.joint.parameters import Parameters
from eea.statistics.goodness_of_fit import Goodness
from eea.statistics.posterior import Mode

ROUNDING_TOLERANCE = 1e-6  # in shares of a range, rad, or probability
MOST_INFORMATION = 1e30  # 1/range^2 or 1/rad^2; a size that a hypothesis fixes has 1e12
MOST_COST = 1e15
OMITTED_PROBABILITY = 0.01  # of all hypotheses together that are less probable than 1e-4


def check_posterior(belief: JointPosterior) -> None:
    """Raise a ConfigurationError if no fit can return a posterior.

    Optima lie in the ranges, informations are symmetric without negative eigenvalues,
    probabilities sum to 1, and all numbers are finite and of a plausible size.
    """
    # In the unit of the robot's own sensors, so only what no signal can have is refused.
    real("its sigma", belief.sigma, 1.0 / LARGEST_NUMBER, LARGEST_NUMBER)
    shares = [branch.probability for branch in belief.branches]
    for share in shares:
        real("its probability", share, 0.0, 1.0)
    real("its probabilities' sum", sum(shares), 1.0 - OMITTED_PROBABILITY, 1.0 + ROUNDING_TOLERANCE)
    _check_goodness(belief.goodness)
    for branch in belief.branches:
        for part in (branch.posterior, branch.doubted):
            for mode in part.modes:
                check_mode(mode, branch.parameters)
            with np.errstate(all="ignore"):
                weights = part.weights
            if not (np.isfinite(weights).all() and abs(weights.sum() - 1.0) < ROUNDING_TOLERANCE):
                raise ConfigurationError("its modes must have probabilities that sum to 1")


def check_mode(mode: Mode, parameters: Parameters) -> None:
    """Raise a ConfigurationError if a mode is out of range or no normal distribution."""
    size = len(parameters)
    low = np.where(parameters.circular, -np.pi, parameters.low)
    high = np.where(parameters.circular, np.pi, parameters.high)
    for name, array, shape in (
        ("theta", mode.theta, (size,)),
        ("gradient", mode.gradient, (size,)),
        ("information", mode.information, (size, size)),
    ):
        if np.shape(array) != shape or not np.isfinite(array).all():
            raise ConfigurationError(f"its {name} must be finite, of shape {shape}")
    real("its cost", mode.cost, -MOST_COST, MOST_COST)
    outside = (mode.theta < low - ROUNDING_TOLERANCE) | (mode.theta > high + ROUNDING_TOLERANCE)
    if outside.any():
        i = int(outside.argmax())
        raise ConfigurationError(
            f"its theta of {parameters.names[i]} must lie in [{low[i]:.4g}, {high[i]:.4g}]; "
            f"it is {mode.theta[i]:.4g}"
        )
    diagonal = np.diag(mode.information)
    if diagonal.min() < -ROUNDING_TOLERANCE or diagonal.max() > MOST_INFORMATION:
        raise ConfigurationError(
            f"its information must be at least 0 and at most {MOST_INFORMATION:g} on the diagonal; "
            f"it is from {diagonal.min():.4g} to {diagonal.max():.4g}"
        )
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    unit = mode.information / np.outer(scale, scale)
    if np.abs(unit - unit.T).max() > ROUNDING_TOLERANCE:
        raise ConfigurationError("its information must be symmetric")
    if np.linalg.eigvalsh(unit).min() < -ROUNDING_TOLERANCE * size:
        raise ConfigurationError("its information must have no negative eigenvalue")


def _check_goodness(goodness: Goodness) -> None:
    """Raise a ConfigurationError if numbers of a goodness of fit are not probabilities."""
    flag("its good", goodness.good)
    real("its rms", goodness.rms, 0.0)
    for name in ("size_p", "whiteness_p", "peak_p", "p", "slow_p"):
        value = getattr(goodness, name)
        if value is not None or name not in ("size_p", "slow_p"):
            real(f"its {name}", value, 0.0, 1.0)
    if goodness.unexplained is not None:
        real("its unexplained share", goodness.unexplained, 0.0)
    if not isinstance(goodness.verdict, str):
        raise ConfigurationError("its verdict must be a sentence")
