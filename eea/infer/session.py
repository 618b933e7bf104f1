"""Joint inference online: perform fast commands and fit all trials, round by round."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from eea.core.angles import Floats
from eea.core.behavior import similarity, summarize
from eea.core.checks import ConfigurationError, brief, instance
from eea.core.config import JointConfig
from eea.core.experiment import Context, RecordedLog, Target
from eea.core.fitness import model_fitness
from eea.core.genome import BitLayout
from eea.core.problem import Problem
from eea.core.result import RoundFit
from eea.core.session import Session, Streams, Trial, streams
from eea.infer.answer import Answer
from eea.infer.fit import check_nuisances, fit
from eea.infer.robot import Robot
from eea.infer.trials import Observed

MOST_CORNERS = 32


def corners(actions: BitLayout, rng: np.random.Generator) -> Floats:
    """Return fast commands (C, c): every servo that turns both ways at one end of its range.

    The other servos run at full or three quarters of their highest speed: at the lowest they may
    stand still, and at half speed their rhythm may lock to that of the others. Beyond 32 corners,
    32 random ones are returned.

    Examples
    --------
    >>> from eea.core.genome import action_layout
    >>> corners(action_layout([("fin", -0.5, 0.5), ("tail", 0.0, 1.0)]), np.random.default_rng(0))
    array([[-0.5 ,  0.75],
           [-0.5 ,  1.  ],
           [ 0.5 ,  0.75],
           [ 0.5 ,  1.  ]])
    """
    low = np.where(actions.low < 0.0, actions.low, 0.25 * actions.low + 0.75 * actions.high)
    if 2 ** len(actions) > MOST_CORNERS:
        upper = rng.random((MOST_CORNERS, len(actions))) < 0.5
    else:
        upper = np.array(list(product((False, True), repeat=len(actions))))
    return np.where(upper, actions.high, low)


def fast_command(actions: BitLayout, performed: Floats, rng: np.random.Generator) -> Floats:
    """Return a random one of the corners (c,) that commands (E, c) came close to least often.

    No corner is repeated before all have been performed.
    """
    fast = corners(actions, rng)
    apart = np.abs(performed[:, None] - fast) / actions.span
    times = np.bincount(apart.sum(axis=-1).argmin(axis=1), minlength=len(fast))
    command: Floats = fast[rng.choice(np.flatnonzero(times == times.min()))]
    return command


SESSION_MASS = 0.9  # probability of the intervals in the records and in the stopping rule


class JointState(NamedTuple):
    """The trials so far and their posterior."""

    observed: Observed
    posterior: Answer | None


class JointInference(Session[JointState]):
    """One run of joint inference against one target; iterate over it for a record of each round.

    Parameters
    ----------
    robot
        The model of the target: its numbers and its simulator.
    problem
        The commands that the target takes, and the parameters of ``robot`` as the core knows them.
    target, config, seed, truth
        See :class:`eea.core.session.Session`.

    Raises
    ------
    ConfigurationError
        If ``config`` names groups that ``robot`` lacks, ``problem`` has other dimensions, hidden
        angles or channels than it, or ``truth`` is not of shape (n,).

    Examples
    --------
    A wheel turns at the commanded speed from an unknown angle. Its gyroscope reads the unknown
    radius times the sine of the angle:

    >>> from eea.core.genome import action_layout, model_layout
    >>> from eea.core.problem import Problem
    >>> from eea.infer.statement import Number
    >>> def spin(values, command):
    ...     turned = 0.1 * command * np.arange(64) + values["angle"][:, None]
    ...     return (values["radius"][:, None] * np.sin(turned))[:, :, None]
    >>> class Target:
    ...     def perform(self, command):
    ...         values = {"radius": np.array([0.6]), "angle": np.array([0.5])}
    ...         gyro = spin(values, command)
    ...         return RecordedLog(gyro=gyro + np.random.default_rng(0).normal(0, 0.01, gyro.shape))
    >>> numbers = {"radius": Number(0.0, 1.0), "angle": Number.angle()}
    >>> wheel = Robot(spin, numbers, {"gyro": "rad/s"})
    >>> problem = Problem(
    ...     model_layout([("radius", 1.0, 6)]), action_layout([("speed", 0.0, 2.0)]), ("angle",), 1
    ... )
    >>> config = JointConfig(steps=64, rounds=1)
    >>> result = JointInference(Target(), wheel, problem, config).run()
    >>> low, high = result.interval(0.9)
    >>> bool(low[0] < 0.6 < high[0]), bool(high[0] - low[0] < 0.01)
    (True, True)
    """

    config: JointConfig

    def __init__(
        self,
        target: Target,
        robot: Robot,
        problem: Problem,
        config: JointConfig,
        seed: int = 0,
        truth: Floats | None = None,
    ) -> None:
        instance("config", config, JointConfig)
        instance("robot", robot, Robot)
        instance("problem", problem, Problem)
        check_nuisances(robot, config)
        stated = (problem.models.names, problem.hidden, problem.axes)
        if stated != (robot.sought, robot.angles, len(robot.channels)):
            raise ConfigurationError(
                f"problem must have the dimensions {brief(robot.sought)}, the hidden angles "
                f"{brief(robot.angles)} and {len(robot.channels)} axes; got {brief(stated)}"
            )
        self._robot = robot
        no_trials = Observed(
            np.empty((0, len(problem.actions))), np.empty((0, config.steps, problem.axes))
        )
        state = JointState(no_trials, None)
        super().__init__(target, problem, config, seed, truth, state, streams(seed))

    def _choose(self, state: JointState, rngs: Streams) -> tuple[Floats, float | None]:
        """Return a fast command, one of those performed least often, and no ACT_FIT."""
        performed = state.observed.inputs
        return fast_command(self._problem.actions, performed, rngs["exploration"]), None

    def _fit(self, state: JointState, trial: Trial, rngs: Streams) -> tuple[JointState, RoundFit]:
        """Return the state and the record after a fit of all trials, this one included."""
        observed = Observed(
            np.concatenate([state.observed.inputs, trial.command[None]]),
            np.concatenate([state.observed.signal, trial.gyro[None]]),
        )
        posterior = fit(observed, self._robot, self.config, rngs["estimation"], state.posterior)
        return JointState(observed, posterior), round_fit(posterior)

    def _posterior(self, state: JointState) -> Answer | None:
        return state.posterior

    def _accurate(self, state: JointState) -> bool:
        """Return whether every interval is narrow enough and the goodness of fit is acceptable."""
        posterior = state.posterior
        widest = self.config.max_interval_width
        if widest is None or posterior is None or not posterior.good:
            return False
        low, high = posterior.interval(SESSION_MASS)
        return bool(((high - low) <= widest * self._robot.span).all())


def round_fit(posterior: Answer) -> RoundFit:
    """Return the record of a posterior from :func:`eea.infer.fit.fit`.

    The record holds the intervals of the newest trial's hidden angles.
    """
    warm_start = posterior.warm_start
    assert warm_start is not None
    best = posterior.best_fit
    observed = best.regression.observed
    simulated = observed.simulated(best.residuals)
    similarities = np.concatenate([
        similarity(summarize(RecordedLog(log)), summarize(RecordedLog(signal[: len(log)])))
        for log, signal in zip(simulated, observed.signal, strict=True)
    ])  # fmt: skip
    return RoundFit(
        posterior.model,
        float(model_fitness(similarities)),
        Context(*posterior.angles(len(observed) - 1, SESSION_MASS), confidence=SESSION_MASS),
        posterior.spread,
        warm_start.robots,
    )
