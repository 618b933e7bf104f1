"""How small a change of a robot's numbers would not show."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eea.joint.hypothesis_posterior import HypothesisPosterior
from eea.joint.problem import Hypothesis
from eea.joint.robot_model import RobotModel
from eea.statistics.least_change import least_change

LEAST_PRECISION = 1e-9  # in 1/range^2: of a number that the trials do not determine
FLAT_SD = 1e3  # of a range: a normal prior of this sd is flat


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

    See :func:`eea.statistics.least_change.least_change`. None where that hypothesis was not fitted,
    infinity where no change within the range would show.
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
    odds = hypothesis.odds / robot.nominal.odds
    return least_change(spread, change.mean, min(change.sd, FLAT_SD * span), ends, odds)
