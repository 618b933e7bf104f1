"""Experiments and their context, and the two things the EEA talks to (Sec. 3.2 and 3.3).

A *target* is the robot itself: it can be told what to do, and tells what its IMU felt. It does
not say where its fins were when it began. A *simulator* stands in for it during the search and is
told everything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from inspect import getattr_static
from typing import Any, Protocol, Self, TypeGuard

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import sample_range
from eea.core.behavior import Coefficients, Log

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Trials:
    """A batch of B simulations, one row each.

    Attributes
    ----------
    morphologies
        Shape (B, n): the bodies.
    commands
        Shape (B, 3): the servos' speeds, held for the whole trial.
    fin_angles
        Shape (B, 3): where the fins begin, in rad.
    """

    morphologies: Floats
    commands: Floats
    fin_angles: Floats

    def __len__(self) -> int:
        return len(self.commands)


class Target(Protocol):
    """The robot to be modelled. A physical one needs to implement nothing but this."""

    def perform(self, command: Floats) -> Log:
        """Carry out a command (3,) from wherever the fins are; return the log of one trial.

        It must hold the signal that the behaviour is of: ``gyro``, or ``rpy`` for the attitude.
        """


class RevealingTarget(Target, Protocol):
    """A target that can tell afterwards where its fins began: the Ideal condition needs it."""

    @property
    def last_fin_angles(self) -> Floats:
        """The angles (3,) in rad at the start of the last performed command."""


class ResumableTarget(Target, Protocol):
    """A target that can be put back: a simulated one. A robot in a tank is where it is."""

    def save_state(self) -> dict[str, Any]:
        """Return all that the next commands' logs depend on, ready for ``eea.core.state.pack``."""

    def restore_state(self, saved: dict[str, Any]) -> None:
        """Go back to what ``save_state`` returned."""


def resumes(target: Target) -> TypeGuard[ResumableTarget]:
    """Return whether a target can be put back to an earlier state."""
    return all(
        getattr_static(target, name, None) is not None for name in ("save_state", "restore_state")
    )


def reveals(target: Target) -> TypeGuard[RevealingTarget]:
    """Return whether a target has ``last_fin_angles``, without asking for them."""
    return getattr_static(target, "last_fin_angles", None) is not None


class Simulator(Protocol):
    """A model of the robot in which the body and the fins' angles can be chosen."""

    def simulate(self, trials: Trials) -> Log:
        """Run B trials; return their logs, (B, T, 3). A trial must not depend on the others."""


@dataclass(frozen=True)
class Context:
    """What is believed of the fins' angles when an experiment began.

    Attributes
    ----------
    min_angle, max_angle
        The range of each fin's angle in rad, shape (3,) each, ``min_angle <= max_angle``.
    confidence
        The probability, in [0, 1], that the true angles lie in that range.
    """

    min_angle: Floats
    max_angle: Floats
    confidence: float

    @classmethod
    def known(cls, pose: Floats) -> Self:
        """Return the context of certainty about one pose (3,)."""
        return cls(pose, pose, 1.0)

    @classmethod
    def unknown(cls, fins: int, confidence: float) -> Self:
        """Return the context whose range is every fin's whole turn."""
        return cls(np.full(fins, -np.pi), np.full(fins, np.pi), confidence)

    @property
    def fixed(self) -> bool:
        """Whether every trial in this context begins at the same angles."""
        return self.confidence >= 1.0 and bool((self.min_angle == self.max_angle).all())

    @property
    def middle(self) -> Floats:
        """The middle of the range, shape (3,)."""
        return 0.5 * (self.min_angle + self.max_angle)


@dataclass
class Experiment:
    """One command performed on the target, its behaviour, and what is believed of its start.

    Attributes
    ----------
    command
        Shape (3,).
    behavior
        The target's coefficients, shape (F,).
    context
        Replaced by the inference as it learns.
    true_angles
        Where the fins began, shape (3,), if the target revealed it. Only the Ideal condition
        and the records look at it.
    """

    command: Floats
    behavior: Coefficients
    context: Context
    true_angles: Floats | None = field(default=None, repr=False)


def perform_angles(
    experiments: Sequence[Experiment], count: int, rng: np.random.Generator
) -> Floats:
    """Return the angles at which ``count`` models begin each experiment, shape (count, E, 3).

    This is PERFORM of Sec. 3.3: with the context's confidence the fins are set uniformly in its
    range, else anywhere. Contexts that leave no choice draw no random numbers.
    """
    fins = len(experiments[0].context.min_angle)
    angles = np.empty((count, len(experiments), fins))
    for e, experiment in enumerate(experiments):
        context = experiment.context
        if context.fixed:
            angles[:, e] = context.min_angle
            continue
        believed = rng.random(count) <= context.confidence  # rand() <= confidence
        inside = sample_range(context.min_angle, context.max_angle, count, rng)
        anywhere = rng.uniform(-np.pi, np.pi, size=(count, fins))
        angles[:, e] = np.where(believed[:, None], inside, anywhere)
    return angles
