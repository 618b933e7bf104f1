"""What is broken, in sentences with numbers, and how small a change would not show.

These are for robots that state what whole means, or what may change. Robots with parts have the
sentences of :mod:`eea.joint.diagnostics`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from eea.joint.diagnostics import EQUAL_FIT_COST
from eea.joint.problem import Hypothesis
from eea.joint.robot import Robot
from eea.statistics.truncated_normal import log_mass

# The posteriors' module imports this one.
JointPosterior = Any
HypothesisPosterior = Any

SENTENCE_MASS = 0.9  # of the intervals in sentences
LEAST_STATED_PROBABILITY = 0.05  # less probable hypotheses have no sentence
LEAST_PRECISION = 1e-9  # in 1/range^2: of a number that the trials do not determine
FLAT_SD = 1e3  # of a range: a normal prior of this sd is flat
MOST_SDS = 40.0  # that a change is tried up to
TRIED_CHANGES = 8001


def what_is_broken(posterior: JointPosterior) -> list[str]:
    """Return sentences on what may be broken, the most probable first."""
    robot = posterior.robot
    nominal = robot.nominal.name
    likely = [b for b in posterior.branches if b.probability > LEAST_STATED_PROBABILITY]
    causes = [b for b in likely if b.hypothesis.name != nominal]
    costs = [min(mode.cost for mode in b.posterior.modes) for b in causes]
    alike = [b for b, cost in zip(causes, costs, strict=True) if cost - min(costs) < EQUAL_FIT_COST]
    said = []
    for branch in likely:
        if branch not in alike or len(alike) == 1:
            said.append(_stated(posterior, branch))
        elif branch is alike[0]:
            first, *rest = (_stated(posterior, b) for b in alike)
            hints = dict.fromkeys(b.hypothesis.hint for b in alike if b.hypothesis.hint)
            told = f"{first}; the data fit nearly alike if {' or '.join(rest)}"
            said.append(told + (f"; {', or '.join(hints)} to find out" if hints else ""))
    if likely[0].hypothesis.name == nominal:
        least = {name: would_not_show(posterior, name) for name in moved_alone(robot)}
        small = [
            f"of {name}" + (f" by less than {with_unit(x, robot, name)}" if x < math.inf else "")
            for name, x in least.items()
            if x is not None
        ]
        if small:
            said.append(f"a change {' or '.join(small)} would not show")
    return said


def _stated(posterior: JointPosterior, branch: HypothesisPosterior) -> str:
    """Return a hypothesis with its probability and the numbers that it moves."""
    robot = posterior.robot
    hypothesis = branch.hypothesis
    table = posterior.table(SENTENCE_MASS, hypothesis.name)
    numbers = []
    for name in hypothesis.moves:
        middle, low, high = table.get(name) or table[f"{name}@1"]
        width = max((high - low) / max(abs(low), abs(high), 1e-300), 1e-9)
        digits = max(3, 1 - math.floor(math.log10(width)))  # two of the interval's width
        told = with_unit(middle, robot, name, digits)
        numbers.append(f"{name} {told}, {low:.{digits}g} to {high:.{digits}g}")
    told = f"{hypothesis.name} ({branch.probability:.0%})"
    return f"{told}: {'; '.join(numbers)}" if numbers else told


def with_unit(value: float, robot: Robot, name: str, digits: int = 3) -> str:
    """Return a number with the unit of a parameter or nuisance, where it has one."""
    return f"{value:.{digits}g} {robot.units.get(name, '')}".strip()


def moved_alone(robot: Robot) -> dict[str, Hypothesis]:
    """Return the numbers that a hypothesis moves by themselves, with it."""
    alone: dict[str, Hypothesis] = {}
    for hypothesis in robot.alternatives:
        if len(hypothesis.moves) == 1 and hypothesis.changes == 1:
            (name,) = hypothesis.moves
            if name not in robot.each_trial:
                alone.setdefault(name, hypothesis)
    return alone


def would_not_show(posterior: JointPosterior, name: str) -> float | None:
    """Return the least change of a number that would be named; smaller ones would not show.

    It is where the evidence for the change and for none are equal, if all is normal. The trials
    determine a change x to a standard deviation s, and beforehand it is normal with mean m and sd w
    within its bounds, and of odds o. Then, with v^2 = s^2 + w^2, ::

        log odds = log(o s / v) + x^2 / (2 s^2) - (x - m)^2 / (2 v^2)
                   + log(mass within the bounds after the trials / before)

    None where that hypothesis was not fitted, infinity where no change within the range would show.
    """
    robot = posterior.robot
    hypothesis = moved_alone(robot).get(name)
    branches = [b for b in posterior.branches if hypothesis and b.hypothesis is hypothesis]
    if hypothesis is None or not branches:
        return None
    parameters = branches[0].parameters
    i = parameters.names.index(name)
    low, high = robot.ranges[name]
    span = high - low
    # The change's own prior is no evidence.
    information = branches[0].posterior.modes[0].information + LEAST_PRECISION * np.eye(
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
