"""What the law does to a fin over one stroke while the body is towed straight ahead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH
from instruments.verification.harness import drag
from instruments.verification.paper_robot import SWEEP

Array = NDArray[np.float64]

SPEEDS = (0.0, 0.5, 1.0)  # units/s at which the body is towed
ROWING = 0.5
ROWING_FLIPPER = f"flipper, speed varied by {ROWING:.0%}"


@dataclass(frozen=True)
class Stroke:
    """One turn of a flipper, or one cycle of the tail's sweep.

    ``cycle`` runs from 0 to 1; ``normal`` and ``tangential`` are the force along the fin's
    normal and its length, ``thrust`` and ``aside`` the same force along the body (forward is
    positive) and across it, in force units of the model; ``angle`` is the fin's, rad.
    """

    cycle: Array
    angle: Array
    normal: Array
    tangential: Array
    thrust: Array
    aside: Array

    @property
    def mean_thrust(self) -> float:
        """Return the mean over time; the cycle ends where it begins, and counts that once."""
        return float(self.thrust[:-1].mean())


def flipper_stroke(speed: float, modulation: float = 0.0, points: int = 360) -> Stroke:
    """Return a full turn of the nominal flipper at its highest mean speed.

    Parameters
    ----------
    speed
        At which the body is towed forward, units/s.
    modulation
        The flipper's speed is 1 - modulation sin(angle) times as much, so that it is faster in
        the half turn that pushes water back: it rows.
    points
        Of the cycle, one more than evenly spaced in time.
    """
    width, length, thickness = Morphology.nominal().left_pectoral
    omega = 2 * np.pi * float(AQUAFISH.command_high[0])
    cycle = np.linspace(0.0, 1.0, points + 1)
    # The time at an angle is d(angle) / rate; turned round on a fine grid.
    fine = np.linspace(0.0, 2 * np.pi, 20 * points + 1)
    slowness = 1 / (1 - modulation * np.sin(fine))
    time = np.concatenate([[0.0], np.cumsum((slowness[1:] + slowness[:-1]) / 2)])
    angle = np.interp(cycle, time / time[-1], fine)
    rate = omega * (1 - modulation * np.sin(angle))
    return _stroke((width, length, thickness), cycle, angle, rate, speed)


def rowing_stroke(speed: float) -> Stroke:
    """Return a turn of a flipper whose speed varies by ``ROWING`` of itself."""
    return flipper_stroke(speed, ROWING)


def tail_stroke(speed: float, points: int = 360) -> Stroke:
    """Return a cycle of the nominal tail at its highest frequency; see :func:`flipper_stroke`."""
    thickness, length, width = Morphology.nominal().caudal
    omega = 2 * np.pi * float(AQUAFISH.command_high[2])
    cycle = np.linspace(0.0, 1.0, points + 1)
    angle = SWEEP * np.sin(2 * np.pi * cycle)
    rate = SWEEP * omega * np.cos(2 * np.pi * cycle)
    return _stroke((width, length, thickness), cycle, angle, rate, speed)


def _stroke(
    size: tuple[float, float, float], cycle: Array, angle: Array, rate: Array, speed: float
) -> Stroke:
    """Ask the law along a motion; a hinge frame's second axis is forward for every fin."""
    c, s, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    motion = np.stack([zero, c * speed, -s * speed, rate, zero, zero])
    fins = np.tile(np.array(size)[:, None], (1, len(angle)))
    _, along, normal = drag("numba", fins, motion)[:3]
    return Stroke(cycle, angle, normal, along, c * along - s * normal, s * along + c * normal)


def study() -> list[dict[str, object]]:
    """Return the mean thrust of each fin at each towing speed."""
    return [
        {"fin": fin, "speed": speed, "mean_thrust": stroke(speed).mean_thrust}
        for fin, stroke in (
            ("flipper", flipper_stroke),
            (ROWING_FLIPPER, rowing_stroke),
            ("tail", tail_stroke),
        )
        for speed in SPEEDS
    ]
