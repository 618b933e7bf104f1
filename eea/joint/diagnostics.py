"""Findings: sentences on what a posterior determines about the body, and what it leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from eea.core.angles import Floats
from eea.joint.problem import Hypothesis
from eea.joint.robot import Robot
from eea.statistics.posterior import Posterior

DIAGNOSTIC_MASS = 0.9  # probability of the intervals that are judged
# A part is absent if the 95% quantile of its area is below this share of the largest area.
ABSENT_AREA_SHARE = 0.02
# Sizes trade off above this correlation if both intervals exceed this share of their ranges.
TRADE_OFF_CORRELATION = 0.8
TRADE_OFF_WIDTH = 0.1
UNINFORMATIVE_WIDTH = 0.5  # share of the range; wider intervals determine nothing
LEAST_REPORTED_WEIGHT = 0.05  # less probable bodies are not reported
LEAST_REPORTED_PROBABILITY = 0.01  # less probable hypotheses are not reported
# Hypotheses whose costs differ by less fit alike. A missing part has three sizes fewer to fit noise
# with: this raises the cost by less in 99% of cases.
EQUAL_FIT_COST = 5.7
BEYOND_RANGE_SDS = 4.0  # standard deviations from the bound to a best fit outside the range
BOUND_DISTANCE = 1e-6  # share of a range
MODE_DRAWS = 512  # draws of a mode that locate its body
UNCONSTRAINED_BODY = "the data do not constrain the body: no size is determined"
UNCONSTRAINED_REST = "the data do not constrain the rest of the body: no other size is determined"


class _Size(NamedTuple):
    """A dimension of a part."""

    part: str  # as in a sentence: "the tail"
    label: str
    place: int  # in the posterior, as a share of its range
    low: float
    high: float
    hint: str  # as a clause: "; move the tail faster to find out"

    @property
    def name(self) -> str:
        return f"{self.part}'s {self.label}"

    def value(self, share: Floats) -> Floats:
        """Return shares of the range in the unit of the size."""
        return np.asarray(self.low + share * (self.high - self.low))


def findings(posterior: Posterior, robot: Robot, fits: Sequence[Fit] = ()) -> list[str]:
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
        return [*said, UNCONSTRAINED_REST if absences else UNCONSTRAINED_BODY]
    said += _beyond(posterior, present)
    said += _bodies(posterior, present)
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
            least, most = size.value(np.array([low[size.place], high[size.place]]))
            said.append(
                f"the data do not tell {size.name}: anything from {least:.2g} to {most:.2g}"
                f"{size.hint}"
            )
    return said


def beyond_range(posterior: Posterior, robot: Robot) -> list[str]:
    """Return a sentence on each size of a part that may be beyond its range."""
    sizes = [size for name in robot.parts for size in _sizes(robot, name).values()]
    return _beyond(posterior, sizes)


def _sizes(robot: Robot, name: str) -> dict[str, _Size]:
    """Return the dimensions of a part, by name."""
    part = robot.parts[name]
    hint = f"; {part.hint}" if part.hint else ""
    sizes = {}
    for dimension, label in part.sizes.items():
        i = list(robot.parameters).index(dimension)
        low, high = robot.parameters[dimension]
        sizes[dimension] = _Size(f"the {name}", label, i, low, high, hint)
    return sizes


def _removes(hypothesis: Hypothesis, robot: Robot, name: str) -> bool:
    """Return whether a hypothesis says that a part is missing."""
    area = robot.parts[name].area
    return bool(area) and all(dimension in hypothesis.fixed for dimension in area)


def _beyond(posterior: Posterior, sizes: Sequence[_Size]) -> list[str]:
    return [
        f"{size.name} is at the end of its range, {size.high:.2g}, and may be beyond it"
        for size in sizes
        if _is_beyond(posterior, size.place)
    ]


class Fit(NamedTuple):
    """A hypothesis and its fit to the data."""

    hypothesis: Hypothesis
    probability: float
    excess: float  #: Its best cost, minus the least cost of all hypotheses.


def faults(fits: Sequence[Fit], robot: Robot) -> list[str]:
    """Return sentences on the hypotheses that may hold instead of the nominal one.

    Hypotheses about parts that fit alike differ only in the volume of their priors. They share one
    sentence, the most probable first. So do a hypothesis and the nominal one that fit alike.
    """
    nominal = [
        f for f in fits if f.hypothesis.name == robot.nominal.name and f.excess < EQUAL_FIT_COST
    ]
    odd = [f for f in fits if f.hypothesis.name != robot.nominal.name]
    odd = [f for f in odd if f.probability > LEAST_REPORTED_PROBABILITY]
    alike = [f for f in odd if f.hypothesis.part and f.excess < EQUAL_FIT_COST]
    said: list[str] = []
    for fit in odd:
        if fit not in alike or len(alike) + len(nominal) < 2:
            said.append(f"{fit.hypothesis.name} ({fit.probability:.0%})")
        elif fit is alike[0]:
            ways = [f"{f.hypothesis.name} ({f.probability:.0%})" for f in alike]
            ways += ["nothing is wrong with it"] * len(nominal)
            parts = dict.fromkeys(f.hypothesis.part for f in alike)
            hints = [robot.parts[part].hint for part in parts if robot.parts[part].hint]
            text = f"{ways[0]}, but the data fit alike if " + " or ".join(ways[1:])
            said.append(text + (f"; {', '.join(hints)}" if hints else ""))
    return said


def _absence(posterior: Posterior, area: Sequence[_Size]) -> str | None:
    """Return a sentence that a part is absent, if the product of two sizes is nearly zero."""
    if not area:
        return None
    one, other = area
    areas = one.value(posterior.draws[:, one.place]) * other.value(posterior.draws[:, other.place])
    most = float(np.quantile(areas, 0.95))
    if most > ABSENT_AREA_SHARE * (one.high * other.high):
        return None
    return f"{one.part} is absent: its area is at most {most:.2g}"


def _is_beyond(posterior: Posterior, index: int) -> bool:
    """Return whether the optimum of the most probable mode lies far beyond the upper bound.

    With the information A and the gradient g there, that optimum lies -A^-1 g away.
    """
    mode = posterior.modes[int(np.argmax(posterior.weights))]
    if mode.gradient[index] >= 0.0 or mode.theta[index] < posterior.high[index] - BOUND_DISTANCE:
        return False
    spread = np.linalg.pinv(mode.information, hermitian=True)
    return bool(-spread[index] @ mode.gradient > BEYOND_RANGE_SDS * np.sqrt(spread[index, index]))


def _bodies(posterior: Posterior, sizes: Sequence[_Size]) -> list[str]:
    """Return a sentence on the bodies that explain the data, if there are several.

    Modes that differ only in angles or nuisances are one body. So are two modes whose sizes all
    differ by less than two standard deviations or a hundredth of the range.
    """
    if not sizes or len(posterior.modes) == 1:
        return []
    indices = [size.place for size in sizes]
    reach = 0.01 * (posterior.high - posterior.low)[indices]
    bodies: list[tuple[float, Floats, Floats]] = []  # weight, median, standard deviation
    for place in np.argsort(-posterior.weights, kind="stable"):
        drawn = posterior.components[place].sample(MODE_DRAWS, np.random.default_rng(0))[:, indices]
        middle = np.median(drawn, axis=0)
        spread = drawn.std(axis=0)
        weight = float(posterior.weights[place])
        for k, (known, there, wide) in enumerate(bodies):
            if (np.abs(middle - there) <= np.maximum(2.0 * np.maximum(spread, wide), reach)).all():
                bodies[k] = (known + weight, there, wide)
                break
        else:
            bodies.append((weight, middle, spread))
    bodies = sorted((b for b in bodies if b[0] >= LEAST_REPORTED_WEIGHT), key=lambda b: -b[0])
    if len(bodies) < 2:
        return []
    apart = np.ptp([middle for _, middle, _ in bodies], axis=0)
    spread = np.max([spread for _, _, spread in bodies], axis=0)
    differ = np.flatnonzero(apart > np.maximum(reach, 2.0 * spread)).tolist()
    described = [
        f"{weight:.0%} "
        + " and ".join(f"{sizes[k].name} {sizes[k].value(middle[k]):.2g}" for k in differ)
        for weight, middle, _ in bodies
    ]
    return [f"{len(bodies)} bodies explain it: " + ", or ".join(described)]
