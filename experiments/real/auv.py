"""What has changed in an AUV since fifty healthy swims; no faulty swim is used.

Three numbers of a swim, each of which physics names for one fault beforehand:

- the depth read at the surface: the depth sensor is off;
- how far it descends at the rate at which its rotors turn: the robot is heavier;
- the strength of a damaged rotor's line in the yaw rate (``rotor_line``): a propeller is damaged.

Healthy swims tell how each number scatters within a session and between sessions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import t as student

from experiments.real.haizhe import CONDITIONS, RATE_HZ, Floats, Swim, read_swims, sessions
from experiments.real.rotor_line import Rotor, Spectra, find_rotor, learn_spectrum, spectra

Labels = NDArray[np.int64]

KNOWN_SWIMS = 50
DRAWS = 3  # of them, for each pair of sessions
HELD_OUT_SESSIONS = 2  # healthy ones, of which the false alarms are counted
DESCENT_SECONDS = (2.0, 4.5)  # of healthy swims, the least spread over the response to thrust
LEAST_DESCENT_M = 0.02
ODDS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 10.0)  # of nothing to each fault, beforehand
CHOSEN_ODDS = 3.0  # at which at most 10% of healthy swims are called broken

NUMBERS = {"depth at rest": "m", "descent at the rotors' rate": "log m", "rotor line": "sd"}


@dataclass(frozen=True)
class Change:
    """A fault, as the number that it moves."""

    name: str
    number: str
    sd: float  #: of the change, in the number's unit
    upwards: bool  #: else either way


FAULTS = (
    Change("it is heavier", "descent at the rotors' rate", 0.3, upwards=True),
    Change("the depth sensor is off", "depth at rest", 0.1, upwards=False),
    Change("a propeller is damaged", "rotor line", 3.0, upwards=True),
)
NOTHING = "nothing is broken"
CALLED = (NOTHING, *(fault.name for fault in FAULTS))
RIGHT = (0, 1, 2, 3, 3)  # index in CALLED of each of CONDITIONS


@dataclass(frozen=True)
class Recorded:
    """What is taken from N swims before anything is learned."""

    depth: Floats  #: (N,) at the surface, m
    descent: Floats  #: (N,) log m
    spectra: Spectra

    def numbers(self, rotor: Rotor, known: Labels, session: Labels) -> Floats:
        """Return ``NUMBERS`` (N, 3), given the rows ``known`` and each swim's ``session``.

        The robot floats: only the thrust over its buoyancy pushes it down, and thrust is the square
        of the rotors' rate. So descent is a higher power of the rate, learned within sessions.
        """
        rate = rotor.log_rate(self.spectra)
        rates = _within(rate[known], session[known])
        power = float(rates @ _within(self.descent[known], session[known]) / (rates @ rates))
        healthy = learn_spectrum(self.spectra.take(known), rotor)
        line = healthy.strength(self.spectra)
        return np.column_stack([self.depth, self.descent - power * rate, line])


def record(swims: Sequence[Swim]) -> Recorded:
    """Return what is taken from swims."""
    first, last = (round(seconds * RATE_HZ) for seconds in DESCENT_SECONDS)
    depth = np.array([np.nanmean(swim.thrust["depth"][first:last]) for swim in swims])
    surface = np.array([swim.surface_depth_m for swim in swims])
    return Recorded(
        surface,
        np.log(np.maximum(depth - surface, LEAST_DESCENT_M)),
        spectra(swims),
    )


def _within(values: Floats, session: Labels) -> Floats:
    """Return values less the mean of their session."""
    labels, index = np.unique(session, return_inverse=True)
    means = np.array([values[session == label].mean() for label in labels])
    return np.asarray(values - means[index])


@dataclass(frozen=True)
class Spread:
    """Student's t of a number in the next swim of a session that is not known."""

    centre: float
    scale: float
    freedom: float

    def log_density(self, values: Floats) -> Floats:
        """Return the log density of values in which nothing has changed."""
        return np.asarray(student.logpdf(values, self.freedom, self.centre, self.scale))

    def interval(self, share: float) -> tuple[float, float]:
        """Return the central interval that holds a share of such values."""
        low, high = student.interval(share, self.freedom, self.centre, self.scale)
        return float(low), float(high)


def learn(known: Floats, session: Labels) -> list[Spread]:
    """Return the spread of each of ``NUMBERS`` (K, 3) of healthy swims."""
    return [learn_spread(known[:, c], session) for c in range(known.shape[1])]


def learn_spread(values: Floats, session: Labels) -> Spread:
    """Return how a number (K,) of healthy swims varies within a session and between sessions.

    With few sessions their mean is uncertain, sqrt(1 + 1/n), and so is their spread: the degrees
    of freedom are Satterthwaite's of the two variances.
    """
    labels, counts = np.unique(session, return_counts=True)
    means = np.array([values[session == label].mean() for label in labels])
    inner = len(values) - len(labels)
    outer = len(labels) - 1
    within = float((_within(values, session) ** 2).sum()) / inner
    of_means = float(means.var(ddof=1))
    between = max(of_means - within * float((1.0 / counts).mean()), 0.0) + of_means / len(labels)
    variance = within + between
    freedom = variance**2 / (within**2 / inner + between**2 / outer)
    return Spread(float(means.mean()), float(np.sqrt(variance)), float(freedom))


def log_evidence(known: Floats, session: Labels, numbers: Floats) -> Floats:
    """Return the log evidence (N, 4) of each of ``CALLED``, up to a constant a swim.

    Parameters
    ----------
    known, session
        ``NUMBERS`` (K, 3) of healthy swims, and the session (K,) of each.
    numbers
        Those of the swims in question (N, 3).
    """
    spreads = learn(known, session)
    same = np.column_stack([s.log_density(numbers[:, c]) for c, s in enumerate(spreads)])
    nothing = same.sum(axis=1)
    found = [nothing]
    for fault in FAULTS:
        c = list(NUMBERS).index(fault.number)
        found.append(nothing - same[:, c] + _changed(spreads[c], numbers[:, c], fault))
    return np.column_stack(found)


def probabilities(evidence: Floats, odds: float) -> Floats:
    """Return the probability (N, 4) of each of ``CALLED``, at odds of nothing to each fault."""
    logs = evidence + np.log([odds, *(1.0 for _ in FAULTS)])
    return np.asarray(np.exp(logs - logsumexp(logs, axis=1, keepdims=True)))


def _changed(spread: Spread, values: Floats, fault: Change) -> Floats:
    """Return the log density (N,) of values that a fault of unknown size has moved."""
    sizes = fault.sd * np.linspace(0.0, 8.0, 161)[1:]
    sizes = sizes if fault.upwards else np.concatenate([-sizes, sizes])
    prior = np.exp(-0.5 * (sizes / fault.sd) ** 2)
    densities = spread.log_density(values[:, None] - sizes) + np.log(prior / prior.sum())
    return np.asarray(logsumexp(densities, axis=1))


@dataclass(frozen=True)
class Split:
    """Which swims (rows) are known and which are judged."""

    known: Labels  #: healthy ones, drawn from ``others``
    others: Labels  #: all healthy ones of the sessions that are not held out
    judged: Labels  #: healthy ones of the sessions held out, and all faulty ones


def splits(healthy: NDArray[np.bool_], session: Labels, seed: int) -> list[Split]:
    """Return ``DRAWS`` splits for each pair of sessions of ``healthy`` (N,) that is held out."""
    rng = np.random.default_rng(seed)
    found = []
    for held_out in combinations(np.unique(session[healthy]).tolist(), HELD_OUT_SESSIONS):
        unseen = np.isin(session, held_out)
        others = np.flatnonzero(healthy & ~unseen)
        for _ in range(DRAWS):
            known = rng.choice(others, min(KNOWN_SWIMS, len(others)), replace=False)
            found.append(Split(known, others, np.flatnonzero(unseen | ~healthy)))
    return found


def auv_table(data: Path, seed: int = 0) -> dict[str, Any]:
    """Return how often each fault is named, and how often a healthy swim is called broken.

    Each pair of healthy sessions is held out in turn. The rotors' rate is found in the other
    healthy swims; ``KNOWN_SWIMS`` of them, drawn at random, are all that is known besides. Judged
    are all faulty swims and the healthy ones held out, so that no session is known in part.

    Returns
    -------
    dict
        ``weight``, ``depth_sensor``, ``thruster_slight``, ``thruster_bad``: shares named right.
        ``false_alarms``: share of healthy swims in which a fault is named. All at ``odds``, those
        of nothing to each fault. ``called``: condition -> ``CALLED`` -> share. ``at_odds``: odds
        -> the five shares. ``rotor_of_known``: the five shares if the rotors' rate is found in the
        known swims alone. ``rotor_hz``: the rate found in each split. ``sessions``: condition ->
        number. Of the first split, ``numbers``: condition -> ``NUMBERS`` (n, 3) of swims that are
        judged; ``healthy_95``: the interval of each number in 95% of healthy swims.

    Raises
    ------
    InvalidArgumentError, DamagedFileError
        See ``read_swims``.
    """
    swims = read_swims(data)
    session = sessions(swims)
    condition = np.array([list(CONDITIONS).index(swim.condition) for swim in swims])
    recorded = record(swims)
    rotors: list[Rotor] = []
    shares: list[Floats] = []
    of_known: list[Floats] = []
    drawn: dict[str, Any] = {}
    for split in splits(condition == 0, session, seed):
        rotors.append(find_rotor(recorded.spectra.take(split.others)))
        numbers = recorded.numbers(rotors[-1], split.known, session)
        shares.append(called(numbers, split, session, condition))
        drawn = drawn or _drawn(numbers, split, session, condition)
        rotor = find_rotor(recorded.spectra.take(split.known))
        numbers = recorded.numbers(rotor, split.known, session)
        of_known.append(called(numbers, split, session, condition))
    mean = np.mean(shares, axis=0)
    chosen = ODDS.index(CHOSEN_ODDS)
    what = list(CONDITIONS.values())
    return {
        **summary(mean[chosen]),
        "odds": CHOSEN_ODDS,
        "called": {
            name: dict(zip(CALLED, row, strict=True))
            for name, row in zip(what, mean[chosen].tolist(), strict=True)
        },
        "at_odds": {f"{odds:g}": summary(mean[i]) for i, odds in enumerate(ODDS)},
        "rotor_of_known": summary(np.mean(of_known, axis=0)[chosen]),
        "rotor_hz": [rotor.rate_hz for rotor in rotors],
        "sessions": {n: len(np.unique(session[condition == i])) for i, n in enumerate(what)},
        **drawn,
    }


def called(numbers: Floats, split: Split, session: Labels, condition: Labels) -> Floats:
    """Return the shares (odds, conditions, ``CALLED``) of the judged swims of each condition."""
    rows = split.judged
    evidence = log_evidence(numbers[split.known], session[split.known], numbers[rows])
    shares = np.zeros((len(ODDS), len(CONDITIONS), len(CALLED)))
    for i, odds in enumerate(ODDS):
        found = probabilities(evidence, odds).argmax(axis=1)
        for j in range(len(CONDITIONS)):
            these = found[condition[rows] == j]
            shares[i, j] = np.bincount(these, minlength=len(CALLED)) / len(these)
    return shares


def summary(shares: Floats) -> dict[str, float]:
    """Return the figures of a table of shares (conditions, ``CALLED``)."""
    right = [float(row[k]) for row, k in zip(shares, RIGHT, strict=True)]
    names = ("weight", "depth_sensor", "thruster_slight", "thruster_bad")
    return {**dict(zip(names, right[1:], strict=True)), "false_alarms": 1.0 - right[0]}


def _drawn(numbers: Floats, split: Split, session: Labels, condition: Labels) -> dict[str, Any]:
    """Return what the picture shows of a split."""
    spreads = learn(numbers[split.known], session[split.known])
    return {
        "numbers": {
            what: numbers[split.judged][condition[split.judged] == i].round(3).tolist()
            for i, what in enumerate(CONDITIONS.values())
        },
        "healthy_95": [spread.interval(0.95) for spread in spreads],
    }
