"""What may be broken, in sentences with probabilities and numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from eea.joint.hypothesis_posterior import HypothesisPosterior
from eea.joint.least_change import moved_alone, would_not_show
from eea.joint.problem import Hypothesis
from eea.joint.robot_model import RobotModel

SENTENCE_MASS = 0.9  # of the intervals in sentences
# Less probable hypotheses, and sets of sizes, have no sentence. Of a robot with parts the nominal
# one has none either, so that its alternatives are the only sign of doubt.
LEAST_STATED_PROBABILITY = 0.05
LEAST_STATED_PROBABILITY_WITH_PARTS = 0.01
# Hypotheses whose costs differ by less fit alike. A missing part has three sizes fewer to fit noise
# with: this raises the cost by less in 99% of cases.
EQUAL_FIT_COST = 5.7


class Fit(NamedTuple):
    """A hypothesis and its fit to the data."""

    hypothesis: Hypothesis
    probability: float
    excess: float  #: Its best cost, minus the least cost of all hypotheses.
    numbers: str = ""  #: The numbers that it moves, with their intervals.

    @property
    def stated(self) -> str:
        """The hypothesis with its probability, and its numbers."""
        said = f"{self.hypothesis.name} ({self.probability:.0%})"
        return f"{said}: {self.numbers}" if self.numbers else said


def fits_of(branches: Sequence[HypothesisPosterior]) -> list[Fit]:
    """Return the fits of hypotheses; their numbers where no part has sentences on its sizes."""
    least = min(branch.cost for branch in branches)
    return [
        Fit(
            branch.hypothesis,
            branch.probability,
            branch.cost - least,
            "" if branch.parameters.robot.parts else _numbers(branch),
        )
        for branch in branches
    ]


def faults(fits: Sequence[Fit], robot: RobotModel) -> list[str]:
    """Return sentences on the hypotheses that may hold, the most probable first.

    Causes that fit alike differ only in the volume of their priors, so they share a sentence, with
    the trials that would tell. Of a robot with parts, only causes about parts can be alike, and the
    nominal hypothesis is no sentence, but may be alike.
    """
    parts = bool(robot.parts)
    least = LEAST_STATED_PROBABILITY_WITH_PARTS if parts else LEAST_STATED_PROBABILITY
    likely = [f for f in fits if f.probability > least]
    causes = [f for f in likely if f.hypothesis.name != robot.nominal.name]
    nominal = [f for f in fits if f.hypothesis.name == robot.nominal.name]
    alike = [f for f in causes if f.excess < EQUAL_FIT_COST and (f.hypothesis.part or not parts)]
    ways = [f.stated for f in alike]
    if parts:
        ways += ["nothing is wrong with it" for f in nominal if f.excess < EQUAL_FIT_COST]
    said: list[str] = []
    for fit in causes if parts else likely:
        if fit not in alike or len(ways) < 2:
            said.append(fit.stated)
        elif fit is alike[0]:
            hints = dict.fromkeys(_hint(f.hypothesis, robot) for f in alike)
            told = f"{ways[0]}; the data fit nearly alike if {' or '.join(ways[1:])}"
            said.append("; ".join(filter(None, [told, ", or ".join(filter(None, hints))])))
    return said


def unnoticed(branches: Sequence[HypothesisPosterior]) -> list[str]:
    """Return a sentence on the changes that would not show, if probably nothing is broken."""
    robot = branches[0].parameters.robot
    if branches[0].hypothesis.name != robot.nominal.name:
        return []
    least = {name: would_not_show(branches, name) for name in moved_alone(robot)}
    small = [
        f"of {name}" + (f" by less than {robot.with_unit(name, x)}" if x < math.inf else "")
        for name, x in least.items()
        if x is not None
    ]
    return [f"a change {' or '.join(small)} would not show"] if small else []


def _numbers(branch: HypothesisPosterior) -> str:
    """Return the numbers that a hypothesis moves, with their intervals."""
    if not branch.hypothesis.moves:
        return ""
    parameters = branch.parameters
    table = branch.table(SENTENCE_MASS)
    numbers = []
    for name in branch.hypothesis.moves:
        middle, low, high = table[parameters.names[parameters.first_entry(name)]]
        width = max((high - low) / max(abs(low), abs(high), 1e-300), 1e-9)
        digits = max(3, 1 - math.floor(math.log10(width)))  # two of the interval's width
        told = parameters.robot.with_unit(name, middle, digits)
        numbers.append(f"{name} {told}, {low:.{digits}g} to {high:.{digits}g}")
    return "; ".join(numbers)


def _hint(hypothesis: Hypothesis, robot: RobotModel) -> str:
    """Return which trial would tell a hypothesis from others, if that is known."""
    if hypothesis.hint:
        return f"{hypothesis.hint} to find out"
    return robot.parts[hypothesis.part].hint if hypothesis.part else ""
