"""Findings on a robot of parts: what a posterior determines about them, and what it leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from eea.core.angles import Floats
from eea.joint.faults import LEAST_STATED_PROBABILITY, Fit, faults
from eea.joint.problem import Hypothesis
from eea.joint.robot_model import RobotModel
from eea.statistics.posterior import Posterior

DIAGNOSTIC_MASS = 0.9  # probability of the intervals that are judged
# A part is absent if the 95% quantile of its area is below this share of the largest area.
ABSENT_AREA_SHARE = 0.02
# Sizes trade off above this correlation if both intervals exceed this share of their ranges.
TRADE_OFF_CORRELATION = 0.8
TRADE_OFF_WIDTH = 0.1
UNINFORMATIVE_WIDTH = 0.5  # share of the range; wider intervals determine nothing
BEYOND_RANGE_SDS = 4.0  # standard deviations from the bound to a best fit outside the range
BOUND_DISTANCE = 1e-6  # share of a range
MODE_DRAWS = 512  # draws of a mode that locate its sizes
UNCONSTRAINED = "the data do not constrain the body: no size is determined"
UNCONSTRAINED_REST = "the data do not constrain the rest of the body: no other size is determined"


class _Size(NamedTuple):
    """A dimension of a part."""

    part: str  # as in a sentence: "the tail"
    label: str
    place: int  # in the posterior, as a share of its range
    low: float
    high: float
    unit: str  # of the size, if it has one
    hint: str  # as a clause: "; move the tail faster to find out"

    @property
    def name(self) -> str:
        return f"{self.part}'s {self.label}"

    def value(self, share: Floats) -> Floats:
        """Return shares of the range in the unit of the size."""
        return np.asarray(self.low + share * (self.high - self.low))

    def stated(self, value: float) -> str:
        """Return a value of the size in a sentence."""
        return f"{value:.2g} {self.unit}".strip()


def findings(posterior: Posterior, robot: RobotModel, fits: Sequence[Fit] = ()) -> list[str]:
    """Return sentences on faults, and on what is absent, ambiguous, traded off or undetermined.

    ``posterior`` belongs to the first of the hypotheses' ``fits``. An absent part has no other
    sentence: neither its sizes nor its servo have an effect.
    """
    present: list[_Size] = []
    absences: dict[str, str] = {}
    for name in robot.parts:
        sizes = _sizes(robot, name)
        absence = _absence(posterior, [sizes[dimension] for dimension in robot.parts[name].area])
        if absence:
            absences[name] = absence
        else:
            present += sizes.values()
    best = fits[0].hypothesis if fits else robot.nominal
    removed = {name for name in absences if _removes(best, robot, name)}
    moot = [f for f in fits if f.hypothesis.part in absences and f.hypothesis.part not in removed]
    moot += [f for f in fits if f.hypothesis.part in removed and f.hypothesis is not best]
    said = faults([f for f in fits if f not in moot], robot)
    said += [absence for name, absence in absences.items() if name not in removed]
    low, high = posterior.interval(DIAGNOSTIC_MASS)
    width = (high - low) / (posterior.high - posterior.low)
    if len(present) > 1 and min(width[size.place] for size in present) > UNINFORMATIVE_WIDTH:
        return [*said, UNCONSTRAINED_REST if absences else UNCONSTRAINED]
    said += _beyond(posterior, present)
    said += _several(posterior, present)
    trading = set()
    for first, second in combinations(present, 2):
        a = first.place
        b = second.place
        if (
            abs(posterior.correlation[a, b]) > TRADE_OFF_CORRELATION
            and min(width[a], width[b]) > TRADE_OFF_WIDTH
        ):
            trading |= {a, b}
            hint = (first if width[a] >= width[b] else second).hint
            other = second.label if first.part == second.part else second.name
            said.append(f"{first.name} and {other} trade off{hint}")
    for size in present:
        if width[size.place] > UNINFORMATIVE_WIDTH and size.place not in trading:
            least, most = size.value(np.array([low[size.place], high[size.place]])).tolist()
            said.append(
                f"the data do not tell {size.name}: anything from {least:.2g} to "
                f"{size.stated(most)}{size.hint}"
            )
    return said


def beyond_range(posterior: Posterior, robot: RobotModel) -> list[str]:
    """Return a sentence on each size of a part that may be beyond its range."""
    sizes = [size for name in robot.parts for size in _sizes(robot, name).values()]
    return _beyond(posterior, sizes)


def _sizes(robot: RobotModel, name: str) -> dict[str, _Size]:
    """Return the dimensions of a part, by name."""
    part = robot.parts[name]
    hint = f"; {part.hint}" if part.hint else ""
    sizes = {}
    for dimension, label in part.sizes.items():
        i = list(robot.parameters).index(dimension)
        low, high = robot.parameters[dimension]
        unit = robot.units.get(dimension, "")
        sizes[dimension] = _Size(f"the {name}", label, i, low, high, unit, hint)
    return sizes


def _removes(hypothesis: Hypothesis, robot: RobotModel, name: str) -> bool:
    """Return whether a hypothesis says that a part is missing."""
    area = robot.parts[name].area
    return bool(area) and all(dimension in hypothesis.fixed for dimension in area)


def _beyond(posterior: Posterior, sizes: Sequence[_Size]) -> list[str]:
    return [
        f"{size.name} is at the end of its range, {size.stated(size.high)}, and may be beyond it"
        for size in sizes
        if _is_beyond(posterior, size.place)
    ]


def _absence(posterior: Posterior, area: Sequence[_Size]) -> str | None:
    """Return a sentence that a part is absent, if the product of two sizes is nearly zero."""
    if not area:
        return None
    one, other = area
    areas = one.value(posterior.draws[:, one.place]) * other.value(posterior.draws[:, other.place])
    most = float(np.quantile(areas, 0.95))
    if most > ABSENT_AREA_SHARE * (one.high * other.high):
        return None
    unit = f"{one.unit} {other.unit}" if one.unit != other.unit else one.unit and f"{one.unit}^2"
    return f"{one.part} is absent: its area is at most {most:.2g} {unit}".strip()


def _is_beyond(posterior: Posterior, index: int) -> bool:
    """Return whether the optimum of the most probable mode lies far beyond the upper bound.

    With the information A and the gradient g there, that optimum lies -A^-1 g away.
    """
    mode = posterior.modes[int(np.argmax(posterior.weights))]
    if mode.gradient[index] >= 0.0 or mode.theta[index] < posterior.high[index] - BOUND_DISTANCE:
        return False
    spread = mode.covariance()
    return bool(-spread[index] @ mode.gradient > BEYOND_RANGE_SDS * np.sqrt(spread[index, index]))


def _several(posterior: Posterior, sizes: Sequence[_Size]) -> list[str]:
    """Return a sentence on the robots that explain the data, if there are several.

    Modes that differ only in angles or nuisances are one robot. So are two modes whose sizes all
    differ by less than two standard deviations or a hundredth of the range.
    """
    if not sizes or len(posterior.modes) == 1:
        return []
    indices = [size.place for size in sizes]
    reach = 0.01 * (posterior.high - posterior.low)[indices]
    robots: list[tuple[float, Floats, Floats]] = []  # weight, median, standard deviation
    for place in np.argsort(-posterior.weights, kind="stable"):
        drawn = posterior.components[place].sample(MODE_DRAWS, np.random.default_rng(0))[:, indices]
        middle = np.median(drawn, axis=0)
        spread = drawn.std(axis=0)
        weight = float(posterior.weights[place])
        for k, (known, there, wide) in enumerate(robots):
            if (np.abs(middle - there) <= np.maximum(2.0 * np.maximum(spread, wide), reach)).all():
                robots[k] = (known + weight, there, wide)
                break
        else:
            robots.append((weight, middle, spread))
    robots = sorted((b for b in robots if b[0] >= LEAST_STATED_PROBABILITY), key=lambda b: -b[0])
    if len(robots) < 2:
        return []
    apart = np.ptp([middle for _, middle, _ in robots], axis=0)
    spread = np.max([spread for _, _, spread in robots], axis=0)
    differ = np.flatnonzero(apart > np.maximum(reach, 2.0 * spread)).tolist()
    described = []
    for weight, middle, _ in robots:
        values = [(sizes[k], float(sizes[k].value(middle[k]))) for k in differ]
        told = " and ".join(f"{size.name} {size.stated(value)}" for size, value in values)
        described.append(f"{weight:.0%} {told}")
    return [f"{len(robots)} bodies explain it: " + ", or ".join(described)]
