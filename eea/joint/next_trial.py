"""Which trial joint inference asks for next, and when it has enough."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats, wrap
from eea.core.bits import BitLayout
from eea.core.config import EEAConfig, JointConfig
from eea.core.design import (
    ANGLE_INFORMATION,
    EVALUATED_AT,
    UNIFORM_INFORMATION,
    Forecast,
    Utility,
    checked_utilities,
    robustness,
)
from eea.core.experiment import Simulator, Trials
from eea.core.exploration import Exploration
from eea.core.model_evaluator import ModelEvaluator
from eea.core.replay import RecordedLog
from eea.joint.joint_posterior import SAMPLES, JointPosterior
from eea.joint.parameters import Parameters

COMPARED = 128  # bodies that gaits are compared on
CORRELATION = 1e-9  # less than this below 1 is rounding
LEAST_SD = 1e-9  # of a range, or rad


def shared(one: Parameters) -> int:
    """Return how many unknowns, the first, are the same in all trials."""
    return sum("@" not in name for name in one.names)


class Believed(Simulator):
    """Runs rows of shared unknowns as the models of an exploration.

    Parameters
    ----------
    one
        The unknowns of one trial. Its own nuisances are nominal.
    """

    def __init__(self, one: Parameters) -> None:
        self._one = one

    def simulate(self, trials: Trials) -> RecordedLog:
        """Run B trials of models (B, shared unknowns), shares of their ranges."""
        one, known = self._one, trials.models.shape[1]
        entries = one.angle_entries(0)
        own = entries >= known  # a seized servo's angle is the model's
        theta = np.tile(one.prior_mean, (len(trials), 1))
        theta[:, :known] = trials.models
        theta[:, entries[own]] = trials.angles[:, own]
        return RecordedLog(gyro=_moved(one, theta, trials.commands))


def forecast(one: Parameters, theta: Floats, sigma: float, rng: np.random.Generator) -> Forecast:
    """Return what is expected of a trial.

    Parameters
    ----------
    one
        The unknowns of one trial, under the hypothesis of ``theta``.
    theta
        Samples (N, P) of what is believed after any number of trials, some thousand: their
        covariance counts as what is known.
    sigma
        Standard deviation of the signal's noise.
    rng
        Draws what the new trial may have of its own.
    """
    known = shared(one)
    turning, mean, precision = (
        part[known:] for part in (one.circular, one.prior_mean, one.prior_precision)
    )
    shape = (min(EVALUATED_AT, len(theta)), len(turning))
    told = precision > 0.0
    normal = mean + rng.standard_normal(shape) / np.sqrt(np.where(told, precision, 1.0))
    share = np.where(told, np.clip(normal, 0.0, 1.0), rng.random(shape))
    own = np.where(turning, rng.uniform(-np.pi, np.pi, shape), share)
    uniform = np.where(turning, ANGLE_INFORMATION, UNIFORM_INFORMATION)
    apart = theta[:, :known] - theta[0, :known]
    apart = np.where(one.circular[:known], wrap(apart), apart)
    return Forecast(
        theta[:COMPARED, :known],
        one.body,
        _information(apart),
        own,
        np.where(told, precision, uniform),
        lambda samples, own, commands: _moved(
            one, np.concatenate([samples, own], axis=1), commands
        ),
        sigma,
    )


def next_command(
    one: Parameters,
    belief: JointPosterior | None,
    config: EEAConfig,
    performed: Floats,
    utilities: Callable[[Forecast], Floats],
    rng: np.random.Generator,
) -> tuple[Floats, float | None]:
    """Return the command (c,) to perform next, and what it promises.

    Parameters
    ----------
    one
        The unknowns of one trial under the most probable hypothesis.
    belief
        None before the first trial.
    performed
        The commands so far, (E, c).
    utilities
        See ``Exploration.choose``; and there for the strategies.
    """
    problem = one.joint.problem
    evaluator = ModelEvaluator(Believed(one), config.behavior, config.steps, problem.axes)
    exploration = Exploration(
        problem.actions, len(problem.hidden), evaluator, config.exploration, config.genetic, rng
    )

    def sampled(count: int) -> Floats:
        assert belief is not None
        theta: Floats = belief.branches[0].posterior.sample(count, rng)
        return theta

    def models() -> tuple[Floats, Floats]:
        count = config.estimation.population
        return sampled(count)[:, : shared(one)], np.zeros(count)

    def ahead() -> Forecast:
        assert belief is not None
        return forecast(one, sampled(SAMPLES), belief.sigma, rng)

    return exploration.choose(config.strategy, performed, models, ahead, utilities)


def enough(
    belief: JointPosterior | None, layout: BitLayout, settings: JointConfig, utility: Utility | None
) -> str | None:
    """Return which stop rule holds, ``"narrow"`` or ``"robust"``, if any does.

    None does where the best fit leaves more than noise: no interval can be trusted there.
    """
    if belief is None or not belief.goodness.good:
        return None
    if settings.narrow is not None:
        low, high = belief.interval(0.9)
        if ((high - low) / layout.span).max() <= settings.narrow:
            return "narrow"
    if settings.robust is not None:
        assert utility is not None
        bodies = belief.sample(COMPARED, np.random.default_rng(0))
        if robustness(checked_utilities(utility, bodies)) >= settings.robust:
            return "robust"
    return None


def _moved(one: Parameters, theta: Floats, commands: Floats) -> NDArray[np.floating]:
    """Return the signal (B, T, axes) of vectors (B, P) of one trial and commands (B, c)."""
    inputs = one.inputs(one.local(theta)[:, 0])
    signal: NDArray[np.floating] = one.joint.simulate(
        inputs.bodies, inputs.nuisances, commands, inputs.angles, False
    )
    return signal


def _information(samples: Floats) -> Floats:
    """Return the inverse (d, d) of the covariance of samples (N, d)."""
    covariance = np.cov(samples, rowvar=False).reshape(samples.shape[1], -1)
    sd = np.maximum(np.sqrt(np.diag(covariance)), LEAST_SD)
    correlation = covariance / np.outer(sd, sd) + CORRELATION * np.eye(len(sd))
    information: Floats = np.linalg.inv(correlation) / np.outer(sd, sd)
    return information
