"""Findings on a robot of parts: what a posterior determines about them, and what it leaves open."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.infer.branch import Branch, rivals
from eea.infer.design import moved_alone, would_not_show
from eea.infer.goodness import LEAST_RELATIVE_RMS, LOUD_JITTER
from eea.infer.mixture import Mixture
from eea.infer.optima import Optima
from eea.infer.recorder import Recorded
from eea.infer.statement import TURNS, Hypothesis, RobotModel
from eea.infer.trials import Noise, Observed
from eea.infer.unknowns import ALL_TRIALS, FIXED_PRECISION, Unknowns

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


def fits_of(branches: Sequence[Branch]) -> list[Fit]:
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


COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
EVEN_ODDS = 3.0  # of two answers: with less the probabilities are not said
LEAST_END_SDS = 0.5  # from the bound to a best fit outside of a range
NEAR_TURN = 0.2  # of a turn
LOUD_TURN = 0.05  # of a turn
NEAR_UNIT = 0.2  # of a squared length of 1
NEARLY_ALL = 0.9  # of the samples


def several(branch: Branch) -> list[str]:
    """Return a sentence on the values that explain the trials alike, if there are several."""
    parameters = branch.parameters
    if not len(branch.ambiguous):
        return []
    names = [parameters.names[i] for i in branch.ambiguous]
    weights = [weight for weight, _ in branch.answers]
    first = int(branch.ambiguous[0])
    uneven = max(weights) > EVEN_ODDS * min(weights)
    told = []
    for weight, mode in sorted(branch.answers, key=lambda pair: float(pair[1].theta[first])):
        natural = parameters.natural(parameters.into_bounds(mode.theta)).tolist()
        values = [
            parameters.robot.with_unit(name, natural[i])
            for name, i in zip(names, branch.ambiguous, strict=True)
        ]
        words = " and ".join(f"{n} {v}" for n, v in zip(names, values, strict=True))
        words = words if len(names) > 1 else values[0]
        told.append(f"{words} ({weight:.0%})" if uneven else words)
    count = COUNTS[len(told)] if len(told) < len(COUNTS) else str(len(told))
    if len(names) == 1:
        return [f"{count} values of {names[0]} explain the log alike: {_listed(told, 'and')}"]
    return [f"{count} answers explain the log alike: {', or '.join(told)}"]


def undecided(branches: Sequence[Branch]) -> list[str]:
    """Return a sentence on the hypotheses that may hold, if numbers differ among them."""
    others = rivals(branches)
    if not others:
        return []
    likely = [b for b in branches if b is branches[0] or b.hypothesis.name in others]
    told = [f"{b.hypothesis.name} ({b.probability:.0%})" for b in likely]
    names = list(dict.fromkeys(name for some in others.values() for name in some))
    return [
        f"{COUNTS[min(len(told), 9)]} hypotheses explain the log, with other values of "
        f"{_listed(names, 'and')}: {_listed(told, 'and')}"
    ]


def _listed(words: Sequence[str], last: str) -> str:
    """Return words as a list in a sentence."""
    return f" {last} ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def at_ends(branch: Branch) -> list[str]:
    """Return a sentence on each number that is at an end of its range."""
    parameters = branch.parameters
    mode = branch.posterior.modes[int(np.argmax(branch.posterior.weights))]
    spread = mode.covariance()
    step = -spread @ mode.gradient
    sought = np.flatnonzero(~parameters.circular & (parameters.prior_precision < FIXED_PRECISION))
    said = []
    for i in sought:
        for bound, outward in ((parameters.low, -1.0), (parameters.high, 1.0)):
            near = outward * (bound[i] - mode.theta[i]) < BOUND_DISTANCE
            sd = float(np.sqrt(spread[i, i]))
            if near and outward * step[i] > LEAST_END_SDS * sd > 0.0:
                said.append(at_end(parameters, int(i), float(bound[i])))
    return said


def at_end(parameters: Unknowns, entry: int, bound: float) -> str:
    """Return the sentence that an entry is at a bound of its range."""
    name = parameters.base(entry)
    trial = int(parameters.entry_trials[entry])
    theta = np.zeros(len(parameters))
    theta[entry] = bound
    value = parameters.robot.with_unit(name, float(parameters.natural(theta)[entry]), 4)
    where = name if trial == ALL_TRIALS else f"{name} of trial {trial + 1}"
    return f"{where} is at the end of its range, {value}, and may be beyond it"


def of_turns(optima: Optima) -> list[str]:
    """Return a sentence on each angle that jumps by a whole turn, and does not say that it wraps.

    It is asked of the log and of the best fit's simulation. Four channels whose sign changes at
    once are a quaternion.
    """
    observed = optima.regression.observed
    robot = optima.regression.parameters.robot
    there = observed.there & np.roll(observed.there, 1, axis=1)
    there[:, 0] = False
    logs = observed.signal
    simulated = optima.signal
    said = []
    for c, (name, unit) in enumerate(robot.channel_units.items()):
        turn = TURNS.get(unit, math.inf)
        if math.isfinite(robot.turns[c]) or math.isinf(turn):
            continue
        jumps = [
            int((np.abs(_steps(signal, c)[there[:, :, c]] - turn) < NEAR_TURN * turn).sum())
            for signal in (logs, simulated)
        ]
        if any(jumps):
            said.append(
                f"{name} jumps by a whole turn {jumps[0]} times in the log and {jumps[1]} times in "
                f"the simulation: state its unit as '{unit}, wraps'"
            )
        elif _one_wraps(logs, simulated, c, turn):
            said.append(
                f"{name} ends at half a turn in the log or in the simulation, and goes on in the "
                f"other: state its unit as '{unit}, wraps'"
            )
    names = list(robot.channels)
    taken = {c for four in robot.quaternions for c in range(four.start, four.stop)}
    for c in range(len(names) - 3):
        four = slice(c, c + 4)
        units: list[Floats] = [
            np.abs((q[:, :, four] ** 2).sum(axis=2) - 1.0) for q in (logs, simulated)
        ]
        whole = np.asarray(observed.there[:, :, four].all(axis=2))
        unit_length = any((one[whole] < NEAR_UNIT).mean() > NEARLY_ALL for one in units)
        flips = [_flips(q[:, :, four], whole) for q in (logs, simulated)]
        if unit_length and any(flips) and not taken & set(range(c, c + 4)):
            said.append(
                f"{', '.join(names[four])} change their sign at once {flips[0]} times in the log "
                f"and {flips[1]} times in the simulation: where they are a quaternion, state their "
                "unit as 'quaternion'"
            )
            break
    return said


def _one_wraps(logs: Floats, simulated: Floats, channel: int, turn: float) -> bool:
    """Return whether an angle ends at half a turn in one signal (E, T, C), not in the other."""
    apart = simulated[:, :, channel] - logs[:, :, channel]
    loud = float(np.sqrt((apart**2).mean())) > LOUD_TURN * turn
    ends = sorted(float(np.abs(one[:, :, channel]).max()) / turn for one in (logs, simulated))
    return bool(loud and 0.5 - LOUD_TURN < ends[0] <= 0.5 < 0.5 + LOUD_TURN < ends[1])


def _flips(signal: Floats, there: NDArray[np.bool_]) -> int:
    """Return how often four channels (E, T, 4) change their sign from sample to sample."""
    along = np.asarray((signal[:, 1:] * signal[:, :-1]).sum(axis=2))
    return int((along[there[:, 1:]] < -0.5).sum())


def _steps(signal: Floats, channel: int) -> Floats:
    """Return the sizes (E, T) of a channel's steps from sample to sample; the first is 0."""
    return np.abs(np.diff(signal[:, :, channel], axis=1, prepend=signal[:, :1, channel]))


def of_simulator(optima: Optima) -> list[str]:
    """Return sentences on numbers that act in steps, and on how rough the simulator is."""
    parameters = optima.regression.parameters
    said = []

    def value(entry: int, share: float) -> str:
        theta = np.zeros(len(parameters))
        theta[entry] = share
        natural = float(parameters.natural(theta)[entry])
        return parameters.robot.with_unit(parameters.names[entry], natural, 4)

    for one in optima.plateaus:
        kept = _listed([value(one.entry, share) for share in one.kept], "or")
        words = f"{parameters.names[one.entry]} acts in steps: {kept}"
        if one.worse:
            beside = _listed([value(one.entry, share) for share in one.worse], "and")
            worse = dict.fromkeys(f"{float(f'{much:.2g}'):g}" for much in one.worse.values())
            verb = "are" if len(one.worse) > 1 else "is"
            words += f"; {beside} {verb} worse by {_listed(list(worse), 'and')}"
        said.append(words)
        for bound in (parameters.low[one.entry], parameters.high[one.entry]):
            if abs(bound - one.best) < 0.5 * one.width + BOUND_DISTANCE:
                said.append(at_end(parameters, one.entry, float(bound)))
    rough = optima.regression.roughness
    if rough is None:
        return said
    if rough.unrepeated:
        said.append(
            f"simulate returned other numbers for the same values: {rough.unrepeated:.1g} of the "
            "noise"
        )
    steps = rough.steps[rough.steps > 0.0]
    if len(steps):
        ends = dict.fromkeys(f"{100.0 * step:.1g}%" for step in (steps.min(), steps.max()))
        words = f"simulate jitters by {rough.jitter:.1g} of the noise: derivatives use steps of "
        said.append(words + " to ".join(ends))
    if rough.jitter > LOUD_JITTER:
        said.append(
            f"simulate jitters or bends by {rough.jitter:.1g} of the noise within a few sds of a "
            "number: the intervals may be too narrow"
        )
    return said


def of_recorder(found: Sequence[Recorded], robot: RobotModel, mended: bool) -> list[str]:
    """Return sentences on what a recorder did to channels, and whether it was ``mended``."""
    said = []
    for one in found:
        name = list(robot.channels)[one.channel]
        value = f"{one.value:g} {robot.channel_units[name]}".strip()
        if one.kind == "steps":
            words = f"the readings of {name} come in steps of {value}, wider than the noise: "
            wider = (
                "they count as rounded to the nearest, neither down nor towards 0, and their noise "
                "as louder"
                if mended
                else "the intervals may be too narrow"
            )
        elif one.kind == "held":
            words = f"{name} repeats the reading before in {one.rows} of {one.of} rows: "
            wider = "they are left out" if mended else "give them as NaN"
        else:
            words = f"{name} is at its end, {value}, in {one.rows} of {one.of} rows: "
            wider = "they are left out" if mended else "give them as NaN"
        said.append(words + wider)
    return said


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


def unnoticed(branches: Sequence[Branch]) -> list[str]:
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


def _numbers(branch: Branch) -> str:
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


def findings(posterior: Mixture, robot: RobotModel, fits: Sequence[Fit] = ()) -> list[str]:
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


def beyond_range(posterior: Mixture, robot: RobotModel) -> list[str]:
    """Return a sentence on each size of a part that may be beyond its range."""
    sizes = [size for name in robot.parts for size in _sizes(robot, name).values()]
    return _beyond(posterior, sizes)


def _sizes(robot: RobotModel, name: str) -> dict[str, _Size]:
    """Return the dimensions of a part, by name."""
    part = robot.parts[name]
    hint = f"; {part.hint}" if part.hint else ""
    sizes = {}
    for dimension, label in part.sizes.items():
        i = robot.sought.index(dimension)
        number = robot.table[dimension]
        where = f"the {name}"
        sizes[dimension] = _Size(where, label, i, number.low, number.high, number.unit, hint)
    return sizes


def _removes(hypothesis: Hypothesis, robot: RobotModel, name: str) -> bool:
    """Return whether a hypothesis says that a part is missing."""
    area = robot.parts[name].area
    return bool(area) and all(dimension in hypothesis.fixed for dimension in area)


def _beyond(posterior: Mixture, sizes: Sequence[_Size]) -> list[str]:
    return [
        f"{size.name} is at the end of its range, {size.stated(size.high)}, and may be beyond it"
        for size in sizes
        if _is_beyond(posterior, size.place)
    ]


def _absence(posterior: Mixture, area: Sequence[_Size]) -> str | None:
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


def _is_beyond(posterior: Mixture, index: int) -> bool:
    """Return whether the optimum of the most probable mode lies far beyond the upper bound.

    With the information A and the gradient g there, that optimum lies -A^-1 g away.
    """
    mode = posterior.modes[int(np.argmax(posterior.weights))]
    if mode.gradient[index] >= 0.0 or mode.theta[index] < posterior.high[index] - BOUND_DISTANCE:
        return False
    spread = mode.covariance()
    return bool(-spread[index] @ mode.gradient > BEYOND_RANGE_SDS * np.sqrt(spread[index, index]))


def _several(posterior: Mixture, sizes: Sequence[_Size]) -> list[str]:
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


ALARM_FINDING = "something has changed; the next window tells what"


SHARE_SAMPLES = "have samples in common, which count twice: the intervals are too narrow"


def of_shared(trials: tuple[int, int] | None) -> list[str]:
    """Return a sentence on two trials that have samples in common, if there are such."""
    if trials is None:
        return []
    one, two = trials
    return [f"trials {one} and {two} {SHARE_SAMPLES}"]


REPEATED_FINDING = "the window repeats samples of the one before: they count twice"


def at_bounds(parameters: Unknowns, theta: Floats, entries: Sequence[int]) -> list[str]:
    """Return a sentence on each of some entries that a best fit (P,) has at an end of its range."""
    return [
        at_end(parameters, entry, float(bound))
        for entry in entries
        for bound in (parameters.low[entry], parameters.high[entry])
        if abs(theta[entry] - bound) < BOUND_DISTANCE
    ]


def contradicted(robot: RobotModel, found: Mapping[str, tuple[float, float, float]]) -> list[str]:
    """Return a sentence on each ``healthy`` number that known-good logs found elsewhere."""
    return [
        f"the known-good logs contradict healthy: {name} is {robot.with_unit(name, value)} in "
        f"them, {low:.3g} to {high:.3g}, and not {robot.healthy[name]:g}"
        for name, (value, low, high) in found.items()
    ]


def only_rounding(noise: Noise, observed: Observed, robot: RobotModel) -> list[str]:
    """Return a sentence on each channel whose noise is only rounding beside its signal."""
    loudest = np.abs(observed.signal).max(axis=(0, 1))
    return [
        f"the noise of {name}, {sd:.1g} {unit}, is only rounding: by it any noise in a log counts "
        "as a change"
        for (name, unit), sd, most in zip(
            robot.channel_units.items(), noise.sd, loudest, strict=True
        )
        if sd < LEAST_RELATIVE_RMS * most
    ]
