"""A simulated swim, looked at whenever the robot's gyroscope was read rather than each 0.01 s.

A log is compared as it is: interpolating *it* would make the noise of neighbouring samples alike,
which looks like a model that is wrong. What is simulated has no noise.
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

NEAR = 1e-4  # s: as far as a sample may be from the end of a step to count as its own
POINTS = 4  # that a cubic passes through


def steps_for(time: Floats) -> int:
    """Return how many steps of 0.01 s cover samples at these times, in s."""
    return max(POINTS, int(np.ceil((time.max() - NEAR) / TIMESTEP)))


def at_times(
    joint: JointProblem, observed: NDArray[np.void], time: Floats
) -> tuple[JointProblem, NDArray[np.void]]:
    """Return a joint problem whose signal is at times (E, T), and what was observed for it.

    ``time`` is in s after the begin of each of the E trials, from 0.01 s on. Where it is each
    0.01 s, all is as it was.
    """
    if (np.abs(time - TIMESTEP * np.arange(1, time.shape[1] + 1)) < NEAR).all():
        return joint, observed
    numbered: NDArray[np.void] = append_fields(
        observed, "trial", np.arange(len(observed)), usemask=False
    )
    return replace(
        joint, simulate=partial(_looked_at, time=time, simulate=joint.simulate)
    ), numbered


def cubic_weights(at: Floats, count: int) -> tuple[NDArray[np.intp], Floats]:
    """Return where (T,) each cubic begins, and its weights (T, 4), to look between samples.

    ``at`` (T,) are places among ``count`` samples, 0 being the first. Lagrange's polynomial
    through four neighbours: of what swings at 2 Hz and is sampled each 0.01 s it is off by 1e-4
    of the amplitude at most, where a straight line is by 2e-3.

    Examples
    --------
    >>> first, weights = cubic_weights(np.array([2.0, 2.5]), count=8)
    >>> first.tolist(), weights[1].tolist()
    ([1, 1], [-0.0625, 0.5625, 0.5625, -0.0625])
    """
    first = np.clip(np.floor(at).astype(np.intp) - 1, 0, count - POINTS)
    away = (at - first)[:, None] - np.arange(POINTS)
    weights = np.empty((len(at), POINTS))
    for point in range(POINTS):
        others = [k for k in range(POINTS) if k != point]
        weights[:, point] = np.prod(away[:, others], axis=1) / np.prod([point - k for k in others])
    return first, weights


def _looked_at(
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
