"""The estimate of the current fin angles from a joint posterior."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.physics.arithmetic import TAU
from eea.core.angles import Floats, wrap
from eea.core.checks import ConfigurationError, instance
from eea.core.result import Result
from eea.fish.hypotheses import plan_of, servo_names
from eea.fish.joint import LAG, SERVO_GAIN
from eea.infer.answer import Answer
from eea.infer.branch import INTERVAL_SAMPLES


class Fins(NamedTuple):
    """Estimated fin angles, and the servos' gains.

    Examples
    --------
    >>> Fins(np.zeros(3), np.full(3, 0.02), np.ones(3)).spread.max() < np.radians(2.0)
    np.True_
    """

    angles: Floats  #: (F,) angles, or phases of fins that sweep, rad in [-pi, pi).
    spread: Floats  #: (F,) their circular standard deviations, rad.
    servo_gain: Floats  #: (F,) speed divided by command of each servo; 0 for a stuck servo.


def fins_after(result: Result) -> Fins:
    """Return the estimate of the fin angles at the end of the last trial.

    The angles follow from the initial angles by integrating the commands. ``Controller.policy`` and
    ``gait.swim`` continue this. The most probable hypothesis is used.

    Raises
    ------
    ConfigurationError
        If the result is of a log, has another condition than joint, or no trial.

    Examples
    --------
    >>> from eea import JointConfig, estimate_morphology
    >>> once = JointConfig(rounds=1)
    >>> found = estimate_morphology(None, "left_pectoral:length=0.5", once, target_engine="numba")
    >>> bool((fins_after(found).spread < 0.05).all())
    True
    """
    instance("result", result, Result)
    belief = result.belief
    if result.config is None or not isinstance(belief, Answer) or not belief.robot.angles:
        raise ConfigurationError(
            "result must be of a run of the condition joint, after a trial from unknown fin angles"
        )
    best = belief.branches[0]
    theta = best.posterior.sample(INTERVAL_SAMPLES, np.random.default_rng(0))
    values = best.parameters.values(best.parameters.local(theta)[:, -1])
    servos = servo_names(plan_of(belief.robot))
    angles = np.stack([values[fin] for fin in servos], axis=1)
    gains = np.stack([values[SERVO_GAIN] * values[name] for name in servos.values()], axis=1)
    turning = result.config.steps * TIMESTEP - values[LAG][:, None]
    command = np.array(result.rounds[-1].command)
    waves = np.exp(1j * (angles + TAU * gains * command * turning)).mean(axis=0)
    lengths = np.clip(np.abs(waves), 1e-12, 1.0)
    return Fins(
        angles=wrap(np.angle(waves)),
        spread=np.sqrt(-2.0 * np.log(lengths)),
        servo_gain=np.median(gains, axis=0),
    )
