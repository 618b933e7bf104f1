"""Two drones whose propellers were cut shorter: what have they lost since they were known?

    python -m experiments.real drones --data DIR --out OUT

DIR holds CrazyPAD (:mod:`experiments.real.crazypad`). Two questions are asked of each condition,
which is a drone with its propellers as they are, flown three to six times:

- *since a known condition*: the first of the same session is known. Of the damaged flights, those
  of that condition alone are used.
- *since other builds*: healthy flights alone are known, of the same drone before its
  propellers were touched. No damaged flight is used.

How far a healthy drone's commands spread is learned from healthy flights. All else is blade theory
and the firmware's map (:mod:`experiments.real.quadrotor`).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquafish_gym.runs.progress import track
from eea.core.config import FitConfig
from eea.infer.answer import Answer
from eea.infer.design import would_not_show
from eea.infer.known import widening
from eea.infer.trials import Trial
from experiments.real.crazypad import MOTORS, SESSIONS, Floats, build, flights, session
from experiments.real.hover import AXES, Hover, hover
from experiments.real.quadrotor import Known, Spread, quadrotor

STEP_MM = 0.5  # between the conditions of a session
MASS = 0.9  # of intervals
SAMPLES = 4000
#: A hover is nearly linear in what is sought, so that few starting points do.
CONFIG = FitConfig(alternatives="always", bodies=16, poses=1, descents=4, polished=1, restarts=0)
LEAST_SD = 1e-6


@dataclass(frozen=True, eq=False)
class Verdict:
    """What was found about the propellers of one drone; all lengths are lost since it was known."""

    broken: bool  #: Whether a fault is more probable than that nothing is broken.
    nothing: float  #: The probability that nothing is broken.
    median: Floats  #: (4,), mm
    mean: Floats  #: (4,), mm
    if_cut: Floats  #: (4, 3), mm: median and ends of the interval of each, if it is cut at all
    hidden: Floats  #: (4,), mm: a smaller loss would not show; nan where something is broken


def infer(known: Known, hovers: Sequence[Hover], noise: Mapping[str, float]) -> Verdict:
    """Return what a drone has lost, given flights of one condition."""
    robot = quadrotor(known)
    trials = [Trial(one.signal, one.speed) for one in hovers]
    found = robot.infer(trials, config=CONFIG, noise=noise)
    lost = found.sample(SAMPLES, np.random.default_rng(0))[:, : len(MOTORS)]
    names = [f"{motor} lost" for motor in MOTORS]
    nominal = robot.nominal.name
    return Verdict(
        found.branches[0].hypothesis.name != nominal,
        found.probability(nominal),
        np.median(lost, axis=0),
        lost.mean(axis=0),
        np.array([found.broken(name, MASS) or [math.nan] * 3 for name in names]),
        np.array([_hidden(found, name) for name in names]),
    )


def _hidden(found: Answer, name: str) -> float:
    least = would_not_show(found.branches, name)
    return math.nan if least is None else least


@dataclass(frozen=True, eq=False)
class Healthy:
    """Healthy flights, and what they tell of a drone of which nothing is broken."""

    hovers: Sequence[Hover]

    def without(self, name: str) -> Healthy:
        """Return the flights of all builds but one."""
        return Healthy([one for one in self.hovers if build(one.flight) != name])

    @property
    def builds(self) -> dict[str, Floats]:
        """The signal's mean in each flight (n, 4), by build."""
        found = defaultdict(list)
        for one in self.hovers:
            found[build(one.flight)].append(one.mean)
        return {name: np.array(rows) for name, rows in sorted(found.items())}

    @property
    def flight_sd(self) -> Floats:
        """The standard deviation (4,) from flight to flight within a build."""
        builds = self.builds.values()
        left = np.concatenate([rows - rows.mean(axis=0) for rows in builds])
        found: Floats = np.sqrt((left**2).sum(axis=0) / (len(left) - len(builds)))
        return found

    @property
    def build_sd(self) -> tuple[Floats, int]:
        """The standard deviation (4,) from build to build of one drone, and its freedom."""
        means = defaultdict(list)
        for name, rows in self.builds.items():
            means[name.split()[0]].append(rows.mean(axis=0))
        left = np.concatenate([rows - np.mean(rows, axis=0) for rows in means.values()])
        freedom = len(left) - len(means)
        return np.sqrt((left**2).sum(axis=0) / freedom), freedom

    @property
    def noise(self) -> dict[str, float]:
        """The standard deviation of a window within a flight, by axis."""
        left = np.concatenate([one.signal - one.mean for one in self.hovers])
        return dict(zip(AXES, left.std(axis=0).tolist(), strict=True))

    def since(self, known: Sequence[Hover], cuts: Sequence[float]) -> Known:
        """Return a drone as it was in some flights, of the same session as those to judge.

        Since then a propeller was touched, so that each motor's gain may differ by as much as that
        of two flights of a build; the battery is another, so that all four may differ by as much as
        in two builds.
        """
        means = np.array([one.mean for one in known])
        more = math.sqrt(1.0 + 1.0 / len(known))
        flight = self.flight_sd
        gain = float(np.sqrt((flight**2).sum())) * more
        battery = float(self.build_sd[0][0])
        return Known(means.mean(axis=0), np.array(cuts), Spread(flight, gain, battery))

    def since_builds(self, drone: str) -> Known:
        """Return a whole drone as other builds of it were.

        Builds are few: their spread is Student's t, for which a normal distribution of the same
        90% interval stands.
        """
        own = [rows.mean(axis=0) for name, rows in self.builds.items() if name.startswith(drone)]
        spread, freedom = self.build_sd
        wider = widening(freedom)
        gain = float(np.sqrt((spread**2).sum())) * math.sqrt(1.0 + 1.0 / len(own)) * wider
        return Known(np.mean(own, axis=0), np.zeros(4), Spread(self.flight_sd, gain, LEAST_SD))


def conditions(hovers: Sequence[Hover]) -> dict[str, list[list[Hover]]]:
    """Return the conditions of each session, the least damaged first: lists of flights."""
    found: dict[str, dict[Any, list[Hover]]] = defaultdict(lambda: defaultdict(list))
    for one in hovers:
        if one.flight.cuts is not None:
            found[session(one.flight)][one.flight.cuts].append(one)
    return {
        name: [of[cuts] for cuts in sorted(of, key=lambda cuts: (sum(cuts), cuts))]
        for name, of in sorted(found.items(), key=lambda item: SESSIONS.index(item[0]))
    }


def cuts_of(condition: Sequence[Hover]) -> Floats:
    """Return how much shorter the propellers of a condition are (4,), mm."""
    return np.array(condition[0].flight.cuts)


def judged(
    sessions: Mapping[str, Sequence[Sequence[Hover]]],
    known: Callable[[Sequence[Sequence[Hover]]], Known],
    noise: Mapping[str, float],
    skipped: int,
) -> Iterator[dict[str, Any]]:
    """Yield a row for each condition but the ``skipped`` first of a session."""
    asked = [
        (name, reference, condition)
        for name, of in sessions.items()
        for reference in [known(of)]
        for condition in of[skipped:]
    ]
    for name, reference, condition in track(asked, "conditions", len(asked)):
        verdict = infer(reference, condition, noise)
        yield {
            "session": name,
            "flights": len(condition),
            "lost": (cuts_of(condition) - reference.cuts).tolist(),
            "known": reference.cuts.tolist(),
            "median": verdict.median.tolist(),
            "mean": verdict.mean.tolist(),
            "if_cut": verdict.if_cut.tolist(),
            "nothing": verdict.nothing,
        }


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures of some conditions: errors in mm, shares of conditions and propellers."""
    errors: dict[str, list[float]] = defaultdict(list)
    errors_if_cut: dict[str, list[float]] = defaultdict(list)
    errors_of_zero: dict[str, list[float]] = defaultdict(list)
    named = []
    held: list[bool] = []
    widths: list[float] = []
    for row in rows:
        lost = np.array(row["lost"])
        damaged = lost + np.array(row["known"]) > 0.0
        middle, low, high = np.array(row["if_cut"]).T
        new = lost > 0.0
        name = row["session"]
        errors[name] += (np.array(row["median"]) - lost)[damaged].tolist()
        errors_if_cut[name] += (middle - lost)[new].tolist()
        errors_of_zero[name] += lost[damaged].tolist()
        mean = np.array(row["mean"])
        named.append(bool(mean.max() > 0.0 and lost[mean.argmax()] >= lost.max() - STEP_MM))
        held += ((low <= lost) & (lost <= high))[new].tolist()
        widths += (high - low)[new].tolist()
    return {
        "rmse_mm": {name: rms(of) for name, of in errors.items()},
        "rmse_if_cut_mm": {name: rms(of) for name, of in errors_if_cut.items()},
        "rmse_of_zero_mm": {name: rms(of) for name, of in errors_of_zero.items()},
        "named": float(np.mean(named)),
        "held_90_if_cut": float(np.mean(held)),
        "width_if_cut_mm": float(np.mean(widths)),
    }


def rms(errors: Sequence[float]) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(errors))))


def alarms(healthy: Healthy, known: Callable[[Hover], Known]) -> dict[str, Any]:
    """Return how many healthy flights are called broken, and what would not show in one of them."""
    judged_hovers = track(healthy.hovers, "healthy flights", len(healthy.hovers))
    verdicts = [infer(known(one), [one], healthy.noise) for one in judged_hovers]
    return {
        "false_alarms": sum(verdict.broken for verdict in verdicts),
        "healthy_flights": len(verdicts),
        "least_probability_of_nothing": min(verdict.nothing for verdict in verdicts),
        "would_not_show_mm": float(np.nanmedian([verdict.hidden for verdict in verdicts])),
    }


def drones_table(data: Path) -> dict[str, Any]:
    """Return the figures of both questions, and what was found about each condition.

    Parameters
    ----------
    data
        The folder of the download.

    Raises
    ------
    InvalidArgumentError
        If it is another folder, or a log in it cannot be read.
    """
    hovers = [hover(flight) for flight in flights(data)]
    healthy = Healthy([one for one in hovers if one.flight.healthy])
    sessions = conditions(hovers)

    def same_session(of: Sequence[Sequence[Hover]]) -> Known:
        return healthy.since(of[0], cuts_of(of[0]).tolist())

    def other_builds(of: Sequence[Sequence[Hover]]) -> Known:
        return healthy.since_builds(of[0][0].flight.drone)

    def own_build(one: Hover) -> Known:
        mine = build(one.flight)
        mates = [o for o in healthy.hovers if build(o.flight) == mine and o is not one]
        return healthy.without(mine).since(mates, [0.0] * 4)

    def another_build(one: Hover) -> Known:
        return healthy.without(build(one.flight)).since_builds(one.flight.drone)

    rows = list(judged(sessions, same_session, healthy.noise, 1))
    others = list(judged(sessions, other_builds, healthy.noise, 0))
    return {
        **summary(rows),
        **alarms(healthy, own_build),
        "other_builds": {**summary(others), **alarms(healthy, another_build)},
        "found": rows,
        "found_from_other_builds": others,
    }
