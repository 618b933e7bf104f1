"""What is broken, in sentences with numbers, and how small a change would not show.

These are for robots that state what whole means, or what may change. Robots with parts have the
sentences of :mod:`eea.joint.diagnostics`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from eea.joint.diagnostics import EQUAL_FIT_COST, LEAST_REPORTED_PROBABILITY
from eea.joint.problem import Hypothesis

if TYPE_CHECKING:
    from eea.joint.joint_posterior import HypothesisPosterior, JointPosterior
    from eea.joint.robot import Robot

SENTENCE_MASS = 0.9  # of the intervals in sentences


def what_is_broken(posterior: JointPosterior) -> list[str]:
    """Return sentences on what may be broken, the most probable first."""
    robot = posterior.robot
    best, *others = posterior.branches
    likely = [b for b in others if b.probability > LEAST_REPORTED_PROBABILITY]
    costs = [min(mode.cost for mode in b.posterior.modes) for b in posterior.branches]
    excess = {
        b.hypothesis.name: c - min(costs) for b, c in zip(posterior.branches, costs, strict=True)
    }
    said = [_stated(posterior, best)]
    alike = [
        b
        for b in likely
        if max(excess[b.hypothesis.name], excess[best.hypothesis.name]) < EQUAL_FIT_COST
    ]
    if alike:
        ways = " or ".join(_stated(posterior, b) for b in alike)
        hints = dict.fromkeys(b.hypothesis.hint for b in (best, *alike) if b.hypothesis.hint)
        said[0] += f"; the data fit nearly alike if {ways}"
        said[0] += f"; {', '.join(hints)} to find out" if hints else ""
    said += [_stated(posterior, b) for b in likely if b not in alike]
    if best.hypothesis.name == robot.nominal.name:
        least = {name: would_not_show(posterior, name) for name in moved_alone(robot)}
        small = [f"{n} below {with_unit(x, robot, n)}" for n, x in least.items() if x is not None]
        if small:
            said.append(f"a change would not show of {', '.join(small)}")
    return said


def _stated(posterior: JointPosterior, branch: HypothesisPosterior) -> str:
    """Return a hypothesis with its probability and the numbers that it moves."""
    robot = posterior.robot
    hypothesis = branch.hypothesis
    table = posterior.table(SENTENCE_MASS, hypothesis.name)
    numbers = []
    for name in hypothesis.moves:
        middle, low, high = table.get(name) or table[f"{name}@1"]
        numbers.append(f"{name} {with_unit(middle, robot, name)}, {low:.3g} to {high:.3g}")
    told = f"{hypothesis.name} ({branch.probability:.0%})"
    return f"{told}: {'; '.join(numbers)}" if numbers else told


def with_unit(value: float, robot: Robot, name: str) -> str:
    """Return a number with the unit of a parameter or nuisance, where it has one."""
    return f"{value:.3g} {robot.units.get(name, '')}".strip()


def moved_alone(robot: Robot) -> dict[str, Hypothesis]:
    """Return the numbers that a hypothesis moves by themselves, with it."""
    alone: dict[str, Hypothesis] = {}
    for hypothesis in robot.alternatives:
        if len(hypothesis.moves) == 1 and hypothesis.changes == 1:
            (name,) = hypothesis.moves
            alone.setdefault(name, hypothesis)
    return alone


def would_not_show(posterior: JointPosterior, name: str) -> float | None:
    """Return the least change of a number that would be named; smaller ones would not show.

    It is where the evidence for the change and for none are equal, to second order. With the
    standard deviation s to which the trials determine the number, and a change that may be anywhere
    in a range of width w, of odds o beforehand::

        o sqrt(2 pi) s / w exp(x^2 / (2 s^2)) = 1

    and likewise for a normal prior of the change. None where that hypothesis was not fitted.
    """
    hypothesis = moved_alone(posterior.robot).get(name)
    branches = {branch.hypothesis.name: branch for branch in posterior.branches}
    if hypothesis is None or hypothesis.name not in branches:
        return None
    branch = branches[hypothesis.name]
    parameters = branch.parameters
    names = [one.partition("@")[0] for one in parameters.names]
    i = names.index(name)
    low, high = parameters.natural(np.stack([np.zeros(len(names)), np.ones(len(names))]))[:, i]
    mode = branch.posterior.modes[0]
    spread = np.sqrt(np.linalg.pinv(mode.information, hermitian=True)[i, i]) * (high - low)
    known = posterior.robot.prior
    if known is not None and name in known.names:  # what it was is not known exactly
        at = known.names.index(name)
        spread = math.hypot(spread, known.covariance[at, at] ** 0.5 * (high - low))
    odds = hypothesis.odds / posterior.robot.nominal.odds
    wide = hypothesis.moves[name].sd
    if math.isinf(wide):
        ends = (parameters.high - parameters.low)[i] * (high - low)
        ratio = odds * math.sqrt(2.0 * math.pi) * spread / ends
        return float(spread * math.sqrt(2.0 * max(-math.log(ratio), 0.0)))
    ratio = odds * spread / math.hypot(spread, wide)
    narrowed = 1.0 / spread**2 - 1.0 / (spread**2 + wide**2)
    return float(math.sqrt(2.0 * max(-math.log(ratio), 0.0) / narrowed))
