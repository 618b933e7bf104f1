"""Experiments and their context, and the two things the EEA talks to (Sec. 3.2 and 3.3).

A *target* is the robot itself: it can be told what to do, and tells what its IMU felt. It does
not say at which angles its joints began. A *simulator* stands in for it during the search and is
told everything.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from inspect import getattr_static
from typing import Protocol, Self, TypeGuard

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats, sample_range
from eea.core.behavior import BehaviorConfig, Coefficients, Log


@dataclass(frozen=True)
class Trials:
    """A batch of B simulations, one row each.

    Examples
    --------
    >>> len(Trials(np.ones((5, 2)), np.ones((5, 1)), np.zeros((5, 1))))
    5
    """

    models: Floats  #: Shape (B, n): the bodies.
    commands: Floats  #: Shape (B, c): what each is told to do.
    angles: Floats  #: Shape (B, h): where the hidden angles begin, in rad.

    def __len__(self) -> int:
        return len(self.commands)


@dataclass(frozen=True)
class Performed:
    """A target's answer where it says itself what it executed.

    Examples
    --------
    A servo that saturates tells so:

    >>> class Tank:
    ...     def perform(self, command):
    ...         executed = np.clip(command, -0.4, 0.4)
    ...         return Performed(self.swim(executed), executed)
    """

    log: Log  #: Of one trial.
    #: The command (c,) that was really executed; the log is credited to it, whatever was asked.
    command: Floats


class Target(Protocol):
    """The robot to be modelled. A physical one needs to implement nothing but this."""

    def perform(self, command: Floats) -> Log | Performed:
        """Carry out a command (c,) from wherever the joints are; return the log of one trial.

        The log must hold the signal that the behaviour is of: ``gyro``, or ``rpy`` for the
        attitude. A robot that executes another command than it was asked for answers
        ``Performed(log, command)``.
        """


class RevealingTarget(Target, Protocol):
    """A target that can tell afterwards where it began: the Ideal condition needs it."""

    @property
    def start_angles(self) -> Floats:
        """The hidden angles (h,) in rad at the start of the last performed command."""


def reveals(target: Target) -> TypeGuard[RevealingTarget]:
    """Return whether a target has ``start_angles``, without asking for them."""
    return getattr_static(target, "start_angles", None) is not None


class Comparer(Protocol):
    """Simulates and compares in one go, where a simulator can do that faster than numpy.

    What it answers is what ``behavior.py`` and ``fitness.py`` would, but for rounding. A robot
    that left the finite numbers gives an answer that is not finite.
    """

    def to_observed(
        self, trials: Trials, observed: Coefficients, which: NDArray[np.intp]
    ) -> Floats:
        """Return the mean difference (B,) of coefficients from ``observed[which]``.

        ``observed`` has shape (E, F), ``which`` (B,).
        """

    def between_models(self, trials: Trials, models: int) -> Floats:
        """Return, for each run of ``models`` trials, the sum over its pairs of that mean, (A,)."""


class Simulator(Protocol):
    """A model of the robot in which the body and the hidden angles can be chosen.

    A class that inherits from this one needs ``simulate`` only: its logs are compared by numpy.

    Examples
    --------
    >>> from eea.core.replay import RecordedLog
    >>> class Swing(Simulator):
    ...     def simulate(self, trials):
    ...         time = 0.01 * np.arange(1, 65)
    ...         rate = trials.models[:, :1] * np.sin(trials.commands[:, :1] * time + trials.angles)
    ...         return RecordedLog(gyro=rate[:, :, None])
    >>> Swing().simulate(Trials(np.ones((5, 2)), np.ones((5, 1)), np.zeros((5, 1)))).gyro.shape
    (5, 64, 1)
    """

    @abstractmethod
    def simulate(self, trials: Trials) -> Log:
        """Run B trials; return their logs, (B, T, axes). No trial may depend on the others."""

    def comparer(self, behavior: BehaviorConfig, steps: int) -> Comparer | None:  # noqa: ARG002
        """Return what compares such behaviours of trials of so many steps faster than numpy.

        None, the default, has the logs of ``simulate`` compared by numpy.
        """
        return None


@dataclass(frozen=True)
class Context:
    """What is believed of the hidden angles when an experiment began."""

    #: The range of each angle in rad, shape (h,) each, ``min_angle <= max_angle``.
    min_angle: Floats
    max_angle: Floats
    confidence: float  #: The probability, in [0, 1], that the true angles lie in that range.

    @classmethod
    def known(cls, pose: Floats) -> Self:
        """Return the context of certainty about one pose (h,)."""
        return cls(pose, pose, 1.0)

    @classmethod
    def unknown(cls, angles: int, confidence: float) -> Self:
        """Return the context whose range is the whole turn of every one of so many angles."""
        return cls(np.full(angles, -np.pi), np.full(angles, np.pi), confidence)

    def __len__(self) -> int:
        return len(self.min_angle)

    @property
    def fixed(self) -> bool:
        """Whether every trial in this context begins at the same angles."""
        return self.confidence >= 1.0 and bool((self.min_angle == self.max_angle).all())

    @property
    def middle(self) -> Floats:
        """The middle of the range, shape (h,)."""
        return 0.5 * (self.min_angle + self.max_angle)


@dataclass
class Experiment:
    """One command performed on the target, its behaviour, and what is believed of its start."""

    command: Floats  #: Shape (c,): what the target executed.
    behavior: Coefficients  #: The target's coefficients, shape (F,).
    context: Context  #: Replaced by the inference as it learns.
    #: Where the hidden angles began, shape (h,), if the target revealed it. Only the Ideal
    #: condition and the records look at it.
    true_angles: Floats | None = field(default=None, repr=False)


def perform_angles(
    experiments: Sequence[Experiment], count: int, rng: np.random.Generator
) -> Floats:
    """Return the angles at which ``count`` models begin each experiment, shape (count, E, h).

    This is PERFORM of Sec. 3.3: with the context's confidence the angles are uniform in its
    range, else anywhere. Contexts that leave no choice draw no random numbers.
    """
    width = len(experiments[0].context)
    angles = np.empty((count, len(experiments), width))
    for e, experiment in enumerate(experiments):
        context = experiment.context
        if context.fixed:
            angles[:, e] = context.min_angle
            continue
        believed = rng.random(count) <= context.confidence  # rand() <= confidence
        inside = sample_range(context.min_angle, context.max_angle, count, rng)
        anywhere = rng.uniform(-np.pi, np.pi, size=(count, width))
        angles[:, e] = np.where(believed[:, None], inside, anywhere)
    return angles
