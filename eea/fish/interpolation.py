"""Interpolation of simulated swims to the times at which a robot's gyroscope was read.

The log itself is not interpolated: that would correlate the noise of neighbouring samples, which
looks like a wrong model. Simulations have no noise.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib.recfunctions import append_fields
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP
from eea.core.angles import Floats

if TYPE_CHECKING:
    from eea.joint.problem import JointProblem, Simulate

NEAR = 1e-4  # s between a sample and the end of a step that counts as its time
POINTS = 4  # of a cubic


def steps_for(time: Floats) -> int:
    """Return the number of steps of 0.01 s that cover samples at these times, in s."""
    return max(POINTS, int(np.ceil((time.max() - NEAR) / TIMESTEP)))


def at_times(
    joint: JointProblem, observed: NDArray[np.void], time: Floats
) -> tuple[JointProblem, NDArray[np.void]]:
    """Return a joint problem whose signal is at times (E, T), and its observed commands.

    ``time`` is in s after the beginning of each of the E trials, from 0.01 s on. Both are returned
    unchanged if the times are the ends of the steps.
    """
    if (np.abs(time - TIMESTEP * np.arange(1, time.shape[1] + 1)) < NEAR).all():
        return joint, observed
    numbered: NDArray[np.void] = append_fields(
        observed, "trial", np.arange(len(observed)), usemask=False
    )
    return replace(
        joint, simulate=partial(_interpolated, time=time, simulate=joint.simulate)
    ), numbered


def cubic_weights(at: Floats, count: int) -> tuple[NDArray[np.intp], Floats]:
    """Return the first sample (T,) and the weights (T, 4) of Lagrange cubics at places (T,).

    Places are among ``count`` samples, the first at 0. For an oscillation at 2 Hz sampled every
    0.01 s the error is at most 1e-4 of the amplitude; linear interpolation has 2e-3.

    """
    first = np.clip(np.floor(at).astype(np.intp) - 1, 0, count - POINTS)
    away = (at - first)[:, None] - np.arange(POINTS)
    weights = np.empty((len(at), POINTS))
    for point in range(POINTS):
        others = [k for k in range(POINTS) if k != point]
        weights[:, point] = np.prod(away[:, others], axis=1) / np.prod([point - k for k in others])
    return first, weights


def _interpolated(
    bodies: Floats,
    nuisances: Floats,
    commands: NDArray[Any],
    angles: Floats,
    fine: bool,
    time: Floats,
    simulate: Simulate,
) -> NDArray[Any]:
    """Return the signal (B, T, axes) at times (E, T); see ``eea.joint.problem.Simulate``."""
    signal = simulate(bodies, nuisances, commands, angles, fine)
    seen = np.empty((len(signal), time.shape[1], signal.shape[2]), signal.dtype)
    for trial in np.unique(commands["trial"]):
        rows = np.flatnonzero(commands["trial"] == trial)
        first, weights = cubic_weights(time[trial] / TIMESTEP - 1.0, signal.shape[1])
        weights, one = weights.astype(signal.dtype)[:, :, None], signal[rows]
        seen[rows] = sum(weights[:, k] * one[:, first + k] for k in range(POINTS))
    return seen
