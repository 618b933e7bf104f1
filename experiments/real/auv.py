"""What has changed in an AUV since fifty healthy swims; no faulty swim is used.

Three numbers of a swim, each of which physics names for one fault beforehand:

- the depth read at the surface: the depth sensor is off;
- how far it descends at the rate at which its rotors turn: the robot is heavier;
- the strength of a damaged rotor's line in the yaw rate (``rotor_line``): a propeller is damaged.

A session is a log whose samples are swims, each with these three numbers. So healthy sessions tell
how each number scatters from swim to swim, which is its noise, and from session to session. A swim
in question is a log of one sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from aquafish_gym.runs.progress import track
from eea import FitConfig, Hypothesis, Number, Robot, Trial
from eea.infer.known import Known
from eea.infer.statement import Values
from experiments.real.haizhe import CONDITIONS, RATE_HZ, Floats, Swim, read_swims, sessions
from experiments.real.rotor_line import Rotor, Spectra, find_rotor, learn_spectrum, spectra

Labels = NDArray[np.int64]

KNOWN_SWIMS = 50
DRAWS = 3  # of them, for each pair of sessions
HELD_OUT_SESSIONS = 2  # healthy ones, of which the false alarms are counted
VERDICTS = 3  # on each swim, given draws of known swims in which its session is not known
DESCENT_SECONDS = (2.0, 4.5)  # of healthy swims, the least spread over the response to thrust
LEAST_DESCENT_M = 0.02
ODDS = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 10.0)  # of nothing to each fault, beforehand
CHOSEN_ODDS = 3.0  # at which at most 10% of healthy swims are called broken

NUMBERS = {"depth at rest": "m", "descent at the rotors' rate": "log m", "rotor line": "sd"}


RANGES = {  # of a healthy robot, and of one that is broken
    "depth at rest": Number(-1.0, 1.0),
    "descent at the rotors' rate": Number(-6.0, 3.0),
    "rotor line": Number(-20.0, 40.0),
}
FAULTS = (
    Hypothesis(
        "it is heavier", moves={"descent at the rotors' rate": Number(mean=0.0, sd=0.3, low=0.0)}
    ),
    Hypothesis("the depth sensor is off", moves={"depth at rest": Number(0.0, sd=0.1)}),
    Hypothesis("a propeller is damaged", moves={"rotor line": Number(mean=0.0, sd=3.0, low=0.0)}),
)
NOTHING = "nothing is broken"
CALLED = (NOTHING, *(fault.name for fault in FAULTS))
RIGHT = (0, 1, 2, 3, 3)  # index in CALLED of each of CONDITIONS


def numbers_of_swims(values: Values, _: object) -> Floats:
    """Return ``NUMBERS`` (B, KNOWN_SWIMS, 3) of swims of B robots: the same in every swim."""
    rows = np.stack([values[name] for name in NUMBERS], axis=-1)
    return np.repeat(rows[:, None], KNOWN_SWIMS, axis=1)


AUV = Robot(
    simulate=numbers_of_swims,
    numbers=RANGES,
    channels=NUMBERS,
    hypotheses=FAULTS,
)
#: The numbers are linear in what is sought, so that few starting points do.
CONFIG = FitConfig(alternatives="always", bodies=4, poses=1, descents=2, polished=1, restarts=0)


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


def learn(known: Floats, session: Labels) -> Known:
    """Return what healthy swims tell, given ``NUMBERS`` (K, 3) and the session (K,) of each."""
    logs = [Trial(known[session == label]) for label in np.unique(session)]
    reference: Known = AUV.learn(logs, config=CONFIG)
    return reference


def evidence(reference: Known, numbers: Floats) -> Floats:
    """Return the evidence (4,) of each of ``CALLED``, given ``NUMBERS`` (3,) of one swim.

    At equal odds they are the probabilities; what is most improbable has 0.
    """
    found = reference.infer([Trial(numbers[None])], config=CONFIG)
    return np.array([found.probability(name) for name in CALLED])


@dataclass(frozen=True)
class Split:
    """Which swims (rows) are known and which are judged."""

    known: Labels  #: healthy ones, drawn from ``others``
    others: Labels  #: all healthy ones of the sessions that are not held out
    unseen: Labels  #: healthy ones of the sessions held out, and all faulty ones
    judged: Labels  #: of the unseen, so that each swim is judged ``VERDICTS`` times in all


def splits(healthy: NDArray[np.bool_], session: Labels, seed: int) -> list[Split]:
    """Return ``DRAWS`` splits for each pair of sessions of ``healthy`` (N,) that is held out."""
    rng = np.random.default_rng(seed)
    found = []
    for held_out in combinations(np.unique(session[healthy]).tolist(), HELD_OUT_SESSIONS):
        unseen = np.isin(session, held_out)
        others = np.flatnonzero(healthy & ~unseen)
        for _ in range(DRAWS):
            known = rng.choice(others, min(KNOWN_SWIMS, len(others)), replace=False)
            found.append((known, others, unseen | ~healthy))
    judged = np.zeros((len(found), len(healthy)), bool)
    for swim, able in enumerate(np.transpose([unseen for *_, unseen in found])):
        judged[rng.choice(np.flatnonzero(able), VERDICTS, replace=False), swim] = True
    return [
        Split(known, others, np.flatnonzero(unseen), np.flatnonzero(rows))
        for (known, others, unseen), rows in zip(found, judged, strict=True)
    ]


def auv_table(data: Path, seed: int = 0) -> dict[str, Any]:
    """Return how often each fault is named, and how often a healthy swim is called broken.

    Each pair of healthy sessions is held out in turn. The rotors' rate is found in the other
    healthy swims; ``KNOWN_SWIMS`` of them, drawn at random, are all that is known besides. Judged
    are faulty swims and the healthy ones held out, so that no session is known in part.

    Returns
    -------
    dict
        ``weight``, ``depth_sensor``, ``thruster_slight``, ``thruster_bad``: shares named right.
        ``false_alarms``: share of healthy swims in which a fault is named. All at ``odds``, those
        of nothing to each fault. ``called``: condition -> ``CALLED`` -> share. ``at_odds``: odds
        -> the five shares. ``rotor_of_known``: the five shares if the rotors' rate is found in the
        known swims alone. ``rotor_hz``: the rate found in each split. ``sessions``: condition ->
        number. Of the first split, ``numbers``: condition -> ``NUMBERS`` (n, 3) of the unseen
        swims; ``healthy_95``: the interval of each number in 95% of healthy swims.

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
    counts = np.zeros((len(ODDS), len(CONDITIONS), len(CALLED)))
    of_known = np.zeros_like(counts)
    drawn: dict[str, Any] = {}
    drawn_splits = splits(condition == 0, session, seed)
    for split in track(drawn_splits, "draws of known swims", len(drawn_splits)):
        for rows, into in ((split.others, counts), (split.known, of_known)):
            rotor = find_rotor(recorded.spectra.take(rows))
            numbers = recorded.numbers(rotor, split.known, session)
            reference = learn(numbers[split.known], session[split.known])
            into += called(reference, numbers[split.judged], condition[split.judged])
            if into is counts:
                rotors.append(rotor)
                drawn = drawn or _drawn(reference, numbers[split.unseen], condition[split.unseen])
    shares = counts / counts.sum(axis=2, keepdims=True)
    chosen = ODDS.index(CHOSEN_ODDS)
    what = list(CONDITIONS.values())
    return {
        **summary(shares[chosen]),
        "odds": CHOSEN_ODDS,
        "called": {
            name: dict(zip(CALLED, row, strict=True))
            for name, row in zip(what, shares[chosen].tolist(), strict=True)
        },
        "at_odds": {f"{odds:g}": summary(shares[i]) for i, odds in enumerate(ODDS)},
        "rotor_of_known": summary((of_known / of_known.sum(axis=2, keepdims=True))[chosen]),
        "rotor_hz": [rotor.rate_hz for rotor in rotors],
        "sessions": {n: len(np.unique(session[condition == i])) for i, n in enumerate(what)},
        **drawn,
    }


def called(reference: Known, numbers: Floats, condition: Labels) -> Floats:
    """Return how many swims of each condition are called what (odds, conditions, ``CALLED``)."""
    counts = np.zeros((len(ODDS), len(CONDITIONS), len(CALLED)))
    odds_of_nothing = np.array(ODDS)
    for swim, truth in zip(numbers, condition, strict=True):
        of_each = np.tile(evidence(reference, swim), (len(ODDS), 1))
        of_each[:, 0] *= odds_of_nothing
        counts[np.arange(len(ODDS)), truth, of_each.argmax(axis=1)] += 1.0
    return counts


def summary(shares: Floats) -> dict[str, float]:
    """Return the figures of a table of shares (conditions, ``CALLED``)."""
    right = [float(row[k]) for row, k in zip(shares, RIGHT, strict=True)]
    names = ("weight", "depth_sensor", "thruster_slight", "thruster_bad")
    return {**dict(zip(names, right[1:], strict=True)), "false_alarms": 1.0 - right[0]}


def _drawn(reference: Known, numbers: Floats, condition: Labels) -> dict[str, Any]:
    """Return what the picture shows of swims."""
    return {
        "numbers": {
            what: numbers[condition == i].round(3).tolist()
            for i, what in enumerate(CONDITIONS.values())
        },
        "healthy_95": healthy_interval(reference, 0.95).tolist(),
    }


def healthy_interval(reference: Known, share: float) -> Floats:
    """Return the interval (3, 2) of each of ``NUMBERS`` that holds a share of healthy swims."""
    prior = reference.robot.prior
    assert prior is not None  # which was learned
    centre = AUV.low + AUV.span * prior.mean
    sd = np.hypot(AUV.span * np.sqrt(np.diag(prior.covariance)), reference.channel_noise.sd)
    ends: Floats = centre[:, None] + sd[:, None] * np.array(norm.interval(share))
    return ends
