"""What the seconds before a moment tell of a fish: its pose and rates, and its tail's beat.

The tail is hidden. The heading swings with it, so a regression on a parabola and a wave gives the
beat's rate, the phase of the swing, and the rates without what is only noise.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aquafish_gym.physics.arithmetic import TAU
from experiments.real.michigan import STRIDE, Floats, Run
from experiments.real.planar_fish import FRAME

WINDOW = 45  # frames observed before a start
AHEAD = 150  # frames that are predicted
BEATS_HZ = np.arange(1.4, 2.81, 0.02)  # tried for the tail's beat


class Swing(NamedTuple):
    """How the heading swings with the tail's beat, of runs that are known."""

    beat: float  #: Mean, Hz.
    beat_sd: float  #: From run to run, Hz.
    noise: float  #: Of the heading, rad.


class State(NamedTuple):
    """The fish at a start, of the tracked point, as the frames before it tell."""

    x: float  #: m
    y: float  #: m
    heading: float  #: rad
    surge: float  #: m/s
    sway: float  #: m/s
    yaw_rate: float  #: rad/s
    phase: float  #: Of the heading's swing, rad.
    beat: float  #: Hz


@dataclass(frozen=True, eq=False)
class Case:
    """A start in a run, and what follows."""

    run: Run
    sample: int  #: At 5 Hz.

    @property
    def before(self) -> Floats:
        """The poses (T, 3) up to the start."""
        now = STRIDE * self.sample
        return self.run.pose[max(0, now - WINDOW) : now + 1]

    @property
    def after(self) -> Floats:
        """The poses (T, 3) from the start on, up to the last sample at 5 Hz."""
        now = STRIDE * self.sample
        end = min(now + AHEAD, STRIDE * (self.run.samples - 1))
        return self.run.pose[now : end + 1]


class Waves(NamedTuple):
    """Regressions on a parabola and a wave, for each of the beats that are tried."""

    design: Floats  #: (F, T, 5): 1, t, t^2, cos, sin
    solve: Floats  #: (F, 5, T), its pseudoinverse
    parabola: Floats  #: (3, T), the pseudoinverse of 1, t, t^2


@functools.cache
def _waves(frames: int) -> Waves:
    t = FRAME * np.arange(1 - frames, 1)
    angle = TAU * BEATS_HZ[:, None] * t
    powers = t[:, None] ** np.arange(3)
    design = np.concatenate(
        [
            np.broadcast_to(powers, (len(BEATS_HZ), frames, 3)),
            np.stack([np.cos(angle), np.sin(angle)], axis=2),
        ],
        axis=2,
    )
    return Waves(design, np.linalg.pinv(design), np.linalg.pinv(powers))


def _misfits(heading: Floats) -> Floats:
    """Return the sum of squares (F,) that a parabola and a wave of each beat leave."""
    design, solve, _ = _waves(len(heading))
    left = heading - (design @ (solve @ heading)[..., None])[..., 0]
    return np.asarray((left**2).sum(axis=1))


def learn_swing(cases: Sequence[Case]) -> Swing:
    """Return how the heading swings in known cases."""
    misfits = [_misfits(case.before[:, 2]) for case in cases]
    beats = np.array([BEATS_HZ[misfit.argmin()] for misfit in misfits])
    freedom = sum(len(case.before) - 6 for case in cases)  # five coefficients and the beat
    noise = np.sqrt(sum(misfit.min() for misfit in misfits) / freedom)
    return Swing(float(beats.mean()), float(beats.std()), float(noise))


def observe(pose: Floats, swing: Swing) -> State:
    """Return the state at the last of some poses (T, 3), from a parabola and a wave through them.

    The wave's beat is the most probable one, given the heading and the beats of known runs.
    """
    design, solve, parabola = _waves(len(pose))
    surprise = ((BEATS_HZ - swing.beat) / swing.beat_sd) ** 2
    best = int((_misfits(pose[:, 2]) / swing.noise**2 + surprise).argmin())
    beat = float(BEATS_HZ[best])
    now = design[best, -1]
    slope = np.array([0.0, 1.0, 0.0, 0.0, TAU * beat])  # of the design, now
    heading = solve[best] @ pose[:, 2]
    course = heading[0]  # now, without the swing
    cosine = np.cos(course)
    sine = np.sin(course)
    moved = pose[:, :2] - pose[-1, :2]
    # Across, the fish swings with the beat; along, the tail pushes it twice in a beat, and little.
    along = parabola @ (cosine * moved[:, 0] + sine * moved[:, 1])
    across = solve[best] @ (cosine * moved[:, 1] - sine * moved[:, 0])
    aside = now @ across
    swung = now @ heading
    off = swung - course
    surge = along[1]
    sway = slope @ across
    return State(
        pose[-1, 0] + cosine * along[0] - sine * aside,
        pose[-1, 1] + sine * along[0] + cosine * aside,
        swung,
        np.cos(off) * surge + np.sin(off) * sway,
        np.cos(off) * sway - np.sin(off) * surge,
        slope @ heading,
        np.arctan2(heading[3], heading[4]),
        beat,
    )


def cases_of(runs: Sequence[Run]) -> list[Case]:
    """Return all starts of runs."""
    return [Case(run, sample) for run in runs for sample in run.starts]
