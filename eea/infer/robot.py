"""A robot, stated by its numbers and a simulator, and what can be asked about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from eea.core.config import FALSE_ALARM_RATE, FitConfig
from eea.infer.statement import RobotModel

if TYPE_CHECKING:  # they load scipy, and a statement needs none
    from eea.infer.answer import Answer
    from eea.infer.density import LogDensity
    from eea.infer.known import Follower, Known
    from eea.infer.trials import Noise, Trial


class Robot(RobotModel):
    """A robot whose numbers are inferred together.

    Parameters
    ----------
    simulate
        See :class:`eea.infer.statement.Simulate`.
    numbers
        What the signal depends on, by name: each a :class:`~eea.infer.statement.Number`.
    channels
        The unit of each channel of the signal, by name, in the order of its last axis. ``"rad,
        wraps"``, ``"deg, wraps"`` and ``"rev, wraps"`` are of angles that jump by a whole turn, as
        a compass does. Four channels of the unit ``"quaternion"`` are as near as q or -q is.
    hypotheses
        What may have changed or broken. None: each ``healthy`` number may be anywhere in its
        range, with odds of 0.1 in all.
    at_once
        How many of the hypotheses may hold at the same time.
    parts
        Numbers that belong together, for the findings.
    nominal
        What holds unless something is broken.
    prior
        Instead of the numbers' own priors.
    discrepancy
        How far ``simulate`` may be from the robot.
    stride
        Early stages of a search compare every n-th sample, at most.
    loudest
        Noise of unknown size is none if it is louder, in the channels' unit.
    plan
        What a posterior's file says of the robot's body, ready for JSON.

    Raises
    ------
    ConfigurationError
        If a range is empty, or a hypothesis or part refers to an unknown name.

    Examples
    --------
    A pendulum with a motor, of unknown length, whose gyroscope has a bias:

    >>> import numpy as np
    >>> from eea.infer.statement import Number
    >>> def swing(values, torque):
    ...     time = 0.01 * np.arange(1, 65)
    ...     phase = torque[:, :1] * time + values["angle"][:, None]
    ...     rate = values["length"][:, None] * np.sin(phase) + values["bias"][:, None]
    ...     return rate[:, :, None]
    >>> pendulum = Robot(
    ...     simulate=swing,
    ...     numbers={
    ...         "length": Number(0.2, 2.0),
    ...         "bias": Number(0.0, sd=0.05),
    ...         "angle": Number.angle(),
    ...     },
    ...     channels={"gyro": "rad/s"},
    ... )
    >>> pendulum.names
    ('length', 'bias', 'angle')
    """

    def infer(
        self,
        trials: Sequence[Trial],
        seed: int = 0,
        config: FitConfig | None = None,
        noise: Mapping[str, float] | Noise | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> Answer:
        """Return the posterior given recorded trials; see :func:`eea.infer.fit.infer`.

        Ctrl-C, or the budget of ``config``, ends the search with the best so far.
        """
        from eea.infer.fit import infer

        return infer(self, trials, seed, config, noise, progress=progress, interruptible=True)

    def log_density(
        self, trials: Sequence[Trial], noise: Mapping[str, float] | Noise
    ) -> LogDensity:
        """Return the log density of the numbers given trials, for a sampler of one's own.

        See :class:`eea.infer.density.LogDensity`.
        """
        from eea.infer.density import LogDensity

        return LogDensity(self, trials, noise)

    def learn(
        self,
        known_good: Sequence[Trial],
        sessions: Sequence[object] | None = None,
        seed: int = 0,
        config: FitConfig | None = None,
        ongoing: object = None,
    ) -> Known:
        """Return what logs that are known to be good tell; see :func:`eea.infer.known.learn`.

        ``sessions`` label the logs' sessions, in their order: a session, or build, is a time in
        which the robot is not repaired. ``ongoing`` is the label of the one that still goes on.
        """
        from eea.infer.known import learn

        return learn(self, known_good, sessions, seed, config, ongoing)

    def follow(
        self,
        noise: Mapping[str, float] | Noise,
        alarm: float = FALSE_ALARM_RATE,
        drift: Mapping[str, float] | None = None,
        seed: int = 0,
    ) -> Follower:
        """Return what follows the numbers through a log, window by window.

        See :class:`eea.infer.known.Follower`.
        """
        from eea.infer.known import Follower

        return Follower(self, noise, alarm, drift, seed)
