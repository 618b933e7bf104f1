"""Targets, simulators, and experiments with contexts of their initial angles (Secs. 3.2, 3.3).

A *target* is the robot: it performs commands and returns gyroscope logs, without the initial angles
of its joints. A *simulator* replaces it during the search and takes bodies, commands and angles.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from inspect import getattr_static
from typing import Any, Protocol, Self, TypeGuard

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.behavior import Coefficients, Log


@dataclass(frozen=True)
class Trials:
    """A batch of B simulations, one row each.

    Examples
    --------
    >>> len(Trials(np.ones((5, 2)), np.ones((5, 1)), np.zeros((5, 1))))
    5
    """

    models: Floats  #: Shape (B, n): the bodies.
    commands: Floats  #: Shape (B, c).
    angles: Floats  #: Shape (B, h): initial values of the hidden angles, rad.

    def __len__(self) -> int:
        return len(self.commands)


@dataclass(frozen=True)
class RecordedLog:
    """A log of samples in memory.

    Examples
    --------
    >>> RecordedLog(gyro=np.zeros((256, 3))).gyro.shape
    (256, 3)
    """

    gyro: NDArray[Any]  #: See :class:`eea.core.behavior.Log`.


@dataclass(frozen=True)
class Performed:
    """A target's log together with the command that it executed.

    Examples
    --------
    A robot whose servos saturate reports the executed command:

    >>> class Tank:
    ...     def perform(self, command):
    ...         executed = np.clip(command, -0.4, 0.4)
    ...         return Performed(self.swim(executed), executed)
    """

    log: Log  #: Log of one trial.
    #: Executed command, shape (c,). The log belongs to it, not to the requested command.
    command: Floats


class Target(Protocol):
    """The robot to be modelled. A physical one needs to implement only this method."""

    def perform(self, command: Floats) -> Log | Performed:
        """Execute a command (c,) from the joints' present angles; return the log of one trial.

        A robot that executes another command than the requested one returns
        ``Performed(log, command)``.
        """


class RevealingTarget(Target, Protocol):
    """A target that reveals its initial angles afterwards, as the Ideal condition requires."""

    @property
    def start_angles(self) -> Floats:
        """The hidden angles (h,) at the start of the last performed command, rad."""


def reveals(target: Target) -> TypeGuard[RevealingTarget]:
    """Return whether a target has ``start_angles``, without reading them."""
    return getattr_static(target, "start_angles", None) is not None


class Comparer(Protocol):
    """Simulates and compares in one step, faster than numpy.

    Results equal those of ``behavior.py`` and ``fitness.py`` up to rounding. Results of a diverged
    robot are not finite.
    """

    def to_observed(
        self, trials: Trials, observed: Coefficients, which: NDArray[np.intp]
    ) -> Floats:
        """Return the mean difference (B,) of coefficients from ``observed[which]``.

        ``observed`` has shape (E, F), ``which`` (B,).
        """

    def between_models(self, trials: Trials, models: int) -> Floats:
        """Return the sum (A,) of mean differences over all pairs of each ``models`` trials."""


class Simulator(Protocol):
    """A model of the robot in which the body and the hidden angles can be chosen.

    A class that inherits from this one only needs ``simulate``: numpy compares its logs.
    """

    @abstractmethod
    def simulate(self, trials: Trials) -> Log:
        """Run B trials; return their logs, (B, T, axes). No trial may depend on the others."""

    def comparer(self, steps: int) -> Comparer | None:  # noqa: ARG002
        """Return a faster comparer of trials of ``steps`` samples than numpy, or None."""
        return None


@dataclass(frozen=True)
class Context:
    """Knowledge of the hidden angles at the start of an experiment."""

    #: The range of each angle in rad, shape (h,) each, ``min_angle <= max_angle``.
    min_angle: Floats
    max_angle: Floats
    confidence: float  #: Probability, in [0, 1], that the true angles lie in the range.

    @classmethod
    def known(cls, pose: Floats) -> Self:
        """Return the context of one certain pose (h,)."""
        return cls(pose, pose, 1.0)

    @classmethod
    def unknown(cls, angles: int, confidence: float) -> Self:
        """Return the context whose range is the whole turn of each of ``angles`` angles."""
        return cls(np.full(angles, -np.pi), np.full(angles, np.pi), confidence)

    @property
    def fixed(self) -> bool:
        """Whether every model begins at the same angles in this context."""
        return self.confidence >= 1.0 and bool((self.min_angle == self.max_angle).all())

    @property
    def middle(self) -> Floats:
        """The middle of the range, shape (h,)."""
        return 0.5 * (self.min_angle + self.max_angle)


@dataclass(frozen=True)
class Experiment:
    """One performed command, the target's behaviour, and the context of its initial angles."""

    command: Floats  #: Executed command, shape (c,).
    behavior: Coefficients  #: Coefficients of the target's behaviour, shape (F,).
    context: Context


def perform_angles(
    experiments: Sequence[Experiment], count: int, rng: np.random.Generator
) -> Floats:
    """Return the initial angles of ``count`` models in each experiment, shape (count, E, h).

    This is PERFORM of Sec. 3.3. With probability ``confidence`` the angles are uniform in the
    context's range, otherwise uniform over the turn. Fixed contexts draw no random numbers.
    """
    width = len(experiments[0].context.min_angle)
    angles = np.empty((count, len(experiments), width))
    for e, experiment in enumerate(experiments):
        context = experiment.context
        if context.fixed:
            angles[:, e] = context.min_angle
            continue
        within = rng.random(count) <= context.confidence  # rand() <= confidence
        spread = context.max_angle - context.min_angle
        inside = context.min_angle + spread * rng.random((count, width))
        anywhere = rng.uniform(-np.pi, np.pi, size=(count, width))
        angles[:, e] = np.where(within[:, None], inside, anywhere)
    return angles
