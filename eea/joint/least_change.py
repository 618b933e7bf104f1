"""How small a change would not show: where it is as probable as none."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eea.joint.hypothesis_posterior import HypothesisPosterior
from eea.joint.problem import Hypothesis
from eea.joint.robot_model import RobotModel
from eea.statistics.truncated_normal import log_mass

LEAST_PRECISION = 1e-9  # in 1/range^2: of a number that the trials do not determine
FLAT_SD = 1e3  # of a range: a normal prior of this sd is flat
MOST_SDS = 40.0  # that a change is tried up to
TRIED_CHANGES = 8001


def moved_alone(robot: RobotModel) -> dict[str, Hypothesis]:
    """Return the numbers that a hypothesis moves by themselves, with it."""
    alone: dict[str, Hypothesis] = {}
    for hypothesis in robot.alternatives:
        if len(hypothesis.moves) == 1 and hypothesis.changes == 1:
            (name,) = hypothesis.moves
            if name not in robot.each_trial:
                alone.setdefault(name, hypothesis)
    return alone


def would_not_show(branches: Sequence[HypothesisPosterior], name: str) -> float | None:
    """Return the least change of a number that would be named; smaller ones would not show.

    It is where the evidence for the change and for none are equal, if all is normal. The trials
    determine a change x to a standard deviation s, and beforehand it is normal with mean m and sd w
    within its bounds, and of odds o. Then, with v^2 = s^2 + w^2, ::

        log odds = log(o s / v) + x^2 / (2 s^2) - (x - m)^2 / (2 v^2)
                   + log(mass within the bounds after the trials / before)

    None where that hypothesis was not fitted, infinity where no change within the range would show.
    """
    robot = branches[0].parameters.robot
    hypothesis = moved_alone(robot).get(name)
    fitted = [b for b in branches if hypothesis and b.hypothesis is hypothesis]
    if hypothesis is None or not fitted:
        return None
    parameters = fitted[0].parameters
    i = parameters.names.index(name)
    low, high = robot.ranges[name]
    span = high - low
    # The change's own prior is no evidence.
    information = fitted[0].posterior.modes[0].information + LEAST_PRECISION * np.eye(
        len(parameters)
    )
    precision = 1.0 / np.linalg.inv(information)[i, i] - parameters.prior_precision[i]
    spread = span * max(precision, LEAST_PRECISION) ** -0.5
    if robot.prior is not None and name in robot.prior.names:  # what it was is not known exactly
        at = robot.prior.names.index(name)
        spread = math.hypot(spread, span * robot.prior.covariance[at, at] ** 0.5)
    change = hypothesis.moves[name]
    ends = low + span * np.array([parameters.low[i], parameters.high[i]]) - robot.usual[name]
    wide = min(change.sd, FLAT_SD * span)
    both = math.hypot(spread, wide)
    steps = spread * np.linspace(-MOST_SDS, MOST_SDS, TRIED_CHANGES)
    tried = steps[(steps >= ends[0]) & (steps <= ends[1])][:, None]
    after = (ends - (tried * wide**2 + change.mean * spread**2) / both**2) * both / (spread * wide)
    before = (ends - change.mean) / wide
    odds = math.log(hypothesis.odds / robot.nominal.odds * spread / both)
    odds = (
        odds + 0.5 * (tried[:, 0] / spread) ** 2 - 0.5 * ((tried[:, 0] - change.mean) / both) ** 2
    )
    odds = odds + log_mass(after[:, 0], after[:, 1]) - log_mass(before[0], before[1])
    return float(np.abs(tried[odds > 0.0]).min(initial=math.inf))
