"""Recognising in mid-swim what broke: hypotheses in the words of damage, all in one batch.

A hypothesis is one or two words about fins, with numbers. Each makes another robot, simulated from
the state before the change through the robot's own actions; the numbers of the best are narrowed.
A broken sensor deviates under every hypothesis. So each channel's own error is profiled out of the
likelihood, and a broken one costs all hypotheses alike; K is the number of observations::

    cost = sum over channels of K / 2 log(sigma^2 + sum of r^2 / K) - log prior
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from aquafish.online.self_model import FLOOR, noise_of, predict
from aquafish_gym.damage.faults import break_fin
from aquafish_gym.morphology import FINS
from aquafish_gym.physics.layout import start_rows
from aquafish_gym.scenario import CHANNELS, Scenario
from aquafish_gym.utils.array_types import Flags, Floats

#: The numbers of each word that are tried first.
GRID: dict[str, tuple[float, ...]] = {
    "length": (0.12, 0.2, 0.28, 0.36, 0.45, 0.55, 0.65, 0.75, 0.85),
    "width": (0.12, 0.28, 0.45, 0.55, 0.65, 0.75, 0.85),
    "entangled": (0.12, 0.25, 0.4, 0.6, 0.8, 1.0),
    "weak": (0.08, 0.15, 0.25, 0.4, 0.55, 0.7, 0.85),
    "missing": (0.0,),
    "reversed": (0.0,),
    "seized": (0.0,),
}
RANGES = {  # of the numbers of words that have one
    "length": (0.02, 0.98),
    "width": (0.02, 0.98),
    "entangled": (0.02, 1.0),
    "weak": (0.02, 0.98),
}
WORD_COST, NUMBER_COST, BIAS_COST = 2.0, 1.0, 4.0  # minus the log prior of each
COMPARED = 15  # actions over which all hypotheses are compared
NARROWED, LATER = 16, 4  # how many are narrowed, and after two rounds
ROUNDS, SPACING, SHRINK = 6, 0.12, 2.6
STENCIL = np.array([-1.0, -1 / 3, 0.0, 1 / 3, 1.0])
STEADY = 0.3  # of a bias: a smaller deviation about it is a bias
WHITE = 0.4  # correlation of an error with the one before: less is noise
SLACK = 0.25  # of a channel's tolerance: as noise, less error of the model does not count
LOUD = 5.0  # of chance's 1.4: the sum of N squared errors in standard deviations is N +- sqrt(2 N)
FEWEST, FEWEST_WHITE = 3, 8  # observations that show a bias or a stuck channel; and noise
GYRO = slice(6, 9)
POSES = 16  # of each fin, from which its initial angle is narrowed
SENSORS = ("gyro_noise", "sensor_bias", "sensor_stuck", "sensor_dropped")


class Hypothesis(NamedTuple):
    """What may have broken: words about fins, and their numbers."""

    words: tuple[tuple[str, str], ...]  #: (fin, word) each.
    numbers: tuple[float, ...]  #: As many; 0 of a word that has none.

    def then(self, other: Hypothesis) -> Hypothesis:
        """Return both: what broke before, and what broke then."""
        return Hypothesis(self.words + other.words, self.numbers + other.numbers)

    def __str__(self) -> str:
        parts = [
            f"{fin}:{word}" + (f"={number:.3g}" if word in RANGES else "")
            for (fin, word), number in zip(self.words, self.numbers, strict=True)
        ]
        return "; ".join(parts) or "none"


@dataclass(frozen=True, eq=False)
class Recognised:
    """What explains the observations best.

    Attributes
    ----------
    hypothesis, before
        What broke, and the number of the robot that it happened to.
    sensors
        What is broken of its sensors, in words.
    robot
        What it became, its sensors included: a scenario of one.
    state
        (25,) of that robot after the last action.
    explained
        Whether this explains most channels; False is "none of my hypotheses".
    alternatives
        The best hypotheses of different words, the likeliest first.
    """

    hypothesis: Hypothesis
    before: int
    sensors: tuple[str, ...]
    robot: Scenario
    state: Floats
    explained: bool
    alternatives: tuple[Alternative, ...] = ()


class Alternative(NamedTuple):
    """What may have broken, and how likely that is among the alternatives."""

    hypothesis: Hypothesis
    #: Likelihood times prior at the best numbers, relative to the sum over the alternatives.
    weight: float
    robot: Scenario  #: What it would be: a scenario of one.


def broken(robot: Scenario, hypotheses: Sequence[Hypothesis]) -> Scenario:
    """Return the N robots that hypotheses make of one; those of the same words side by side."""
    robots = robot.take(np.zeros(len(hypotheses), np.intp))
    first = 0
    while first < len(hypotheses):
        words, last = hypotheses[first].words, first
        while last < len(hypotheses) and hypotheses[last].words == words:
            last += 1
        rows = slice(first, last)
        those = replace(robots, body=robots.body[rows], servo_gain=robots.servo_gain[rows])  # views
        numbers = np.array([h.numbers for h in hypotheses[rows]]).reshape(last - first, len(words))
        for (fin, word), number in zip(words, numbers.T, strict=True):
            break_fin(those, fin, word, number)
        first = last
    return robots


@cache
def all_hypotheses() -> tuple[Hypothesis, ...]:
    """Return nothing broken, each word, two words about two fins, and two sizes of one fin."""
    singles = [(fin, word) for fin in FINS for word in GRID]
    apart = [pair for pair in combinations(singles, 2) if pair[0][0] != pair[1][0]]
    together = [
        ((fin, one), (fin, other))
        for fin in FINS
        for one, other in combinations(("length", "width", "weak"), 2)
    ]
    shapes = [(), *((one,) for one in singles), *apart, *together]
    return tuple(
        Hypothesis(words, numbers)
        for words in shapes
        for numbers in product(*(GRID[word] for _, word in words))
    )


def _prior_cost(hypothesis: Hypothesis) -> float:
    numbers = sum(word in RANGES for _, word in hypothesis.words)
    return WORD_COST * len(hypothesis.words) + NUMBER_COST * numbers


def recognise(
    before: Sequence[Scenario],
    states: Sequence[Floats],
    observed: Floats,
    actions: Floats,
    drift: Floats,
    tolerance: Floats,
    hold: int = 20,
) -> Recognised:
    """Return what explains K observations best.

    Parameters
    ----------
    before
        What the robot may have been until then, scenarios of one; the present belief first, the
        last with its sensors whole.
    states
        (25,) the states before the first action, the second, and so on, at any of which something
        may have broken.
    observed, actions
        (K, 9) observations, NaN where a channel was not observed, each after its action (K, 3).
    drift
        (9,) rms error of the model's own predictions.
    tolerance
        (9,) the rms error from which on a channel is taken to be broken.
    hold
        For how many steps of 0.01 s an action is held.
    """
    noise = np.hypot(noise_of(before[-1]), drift)
    silent, zero = _repeated(observed)
    counted = np.where(silent, np.inf, noise)
    everything = all_hypotheses()

    def costs(robots: Scenario, b: int, since: int, until: int | None = None) -> Floats:
        """Return minus the log likelihoods (N,) of robots, with the sensors of the b-th before."""
        predicted, _ = predict(robots, states[since], actions[since:until], hold)
        seen = observed[since:until] - before[b].sensor_bias[0]
        return mismatch(predicted, seen, counted)

    # Compare all, then narrow the numbers of the best. Until a later onset the robot was as before.
    cases = [(b, onset) for b in range(len(before)) for onset in range(len(states))]
    until, prior = COMPARED + len(states), np.array([_prior_cost(one) for one in everything])
    earlier = [float(costs(before[0], 0, 0, k)[0]) if k else 0.0 for k in range(len(states))]
    banks = [broken(robot, everything) for robot in before]
    first = np.array([costs(banks[b], b, k, until) + prior + earlier[k] for b, k in cases])
    order = np.argsort(first, axis=None, kind="stable")[:NARROWED]
    chosen = [(i // len(everything), everything[i % len(everything)]) for i in order.tolist()]
    spacing = SPACING
    best: dict[Hypothesis, tuple[float, int, Hypothesis]] = {}  # by their words
    for turn in range(ROUNDS):
        ends = []
        for case in sorted({case for case, _ in chosen}):
            (b, onset), ones = cases[case], [one for which, one in chosen if which == case]
            tried = [_around(one, spacing) for one in ones]
            flat = [one for several in tried for one in several]
            values = costs(broken(before[b], flat), b, onset) + earlier[onset]
            parts = np.split(values, np.cumsum([len(several) for several in tried])[:-1])
            for one, part, several in zip(ones, parts, tried, strict=True):
                total = float(part.min()) + _prior_cost(one)
                ends.append((total, case, several[int(part.argmin())]))
        ends.sort(key=lambda end: end[:2])
        for end in ends:
            key = end[2]._replace(numbers=())
            best[key] = min(end, best.get(key, end), key=lambda one: one[0])
        chosen = [end[1:] for end in ends[: NARROWED if turn < 1 else LATER]]
        spacing /= SHRINK
    case, hypothesis = chosen[0]
    b, onset = cases[case]
    robot = broken(before[b], [hypothesis])
    robot = replace(robot, **{name: getattr(before[-1], name) for name in SENSORS})
    predicted, ended = predict(robot, states[onset], actions[onset:], hold)
    used = np.isfinite(noise) & np.isfinite(observed).any(axis=0)
    errors = np.where(used, observed[onset:] - predicted[0], 0.0)
    silent &= used
    robot, words, odd = _with_sensors(robot, errors, silent, zero, noise, tolerance)
    explained = odd <= max(1, int(used.sum()) // 3)
    others = [(total, cases[k][0], one) for total, k, one in best.values()]
    return Recognised(
        hypothesis, b, words, robot, ended[:, 0], explained, _alternatives(others, before)
    )


def _alternatives(
    found: list[tuple[float, int, Hypothesis]], before: Sequence[Scenario]
) -> tuple[Alternative, ...]:
    """Return hypotheses about robots ``before`` with their weights, of costs in nats."""
    found = sorted(found, key=lambda one: one[0])
    likelihoods = np.exp([found[0][0] - cost for cost, *_ in found])
    weights = (likelihoods / likelihoods.sum()).tolist()
    return tuple(
        Alternative(one, weight, broken(before[b], [one]))
        for weight, (_, b, one) in zip(weights, found, strict=True)
    )


def mismatch(predicted: Floats, observed: Floats, noise: Floats) -> Floats:
    """Return minus the log likelihoods (N,) of predictions (N, K, 9).

    Each channel's own error is profiled out. Channels of infinite ``noise`` (9,) do not count, and
    neither do observations that are NaN.
    """
    seen = np.isfinite(observed)
    used = np.isfinite(noise) & seen.any(axis=0)
    seen, count = seen[:, used], seen[:, used].sum(axis=0)
    variance = np.square(noise[used]) + FLOOR**2
    errors = predicted[:, :, used] - observed[:, used]
    errors[:, ~seen] = 0.0
    squares = np.square(errors).sum(axis=1)
    found = 0.5 * count * np.log(variance + squares / count)
    around = squares - count * np.square(errors.sum(axis=1) / count)
    biased = 0.5 * count * np.log(variance + around / count)
    biased += np.where(count >= FEWEST, BIAS_COST + 0.5 * np.log(count), np.inf)
    found = np.minimum(found, biased)
    total: Floats = found.sum(axis=1)
    return np.where(np.isfinite(total), total, np.inf)


def find_fins(
    waters: Sequence[Scenario], observed: Floats, actions: Floats, hold: int = 20
) -> Floats:
    """Return the fin angles (3,), rad, at which a robot began at rest.

    ``waters`` are scenarios of one robot, in the waters that it may be in. It observed (K, 9) after
    each of its actions (K, 3).
    """
    turn = 2 * np.pi * np.arange(POSES) / POSES
    spacing, grid, stencil = turn[1], np.stack(np.meshgrid(turn, turn, turn), -1), np.arange(-1, 2)
    around = np.stack(np.meshgrid(stencil, stencil, stencil), -1).reshape(-1, 3)
    poses: Floats = grid.reshape(-1, 3)
    for _ in range(ROUNDS):
        costs = np.min(
            [
                mismatch(
                    predict(
                        robot.take(np.zeros(len(poses), np.intp)), start_rows(poses), actions, hold
                    )[0],
                    observed,
                    noise_of(robot),
                )
                for robot in waters
            ],
            axis=0,
        )
        best = poses[np.argsort(costs, kind="stable")[:NARROWED]]
        spacing /= 2
        poses = (best[:, None] + spacing * around).reshape(-1, 3)
    found: Floats = best[0]
    return found


def _repeated(observed: Floats) -> tuple[Flags, Flags]:
    """Return which channels (9,) of observations (K, 9) are silent, and which read 0 at last.

    No whole channel repeats itself.
    """
    silent, zero = np.zeros((2, observed.shape[1]), np.bool_)
    for i, column in enumerate(observed.T):
        last = column[np.isfinite(column)][-FEWEST:]
        if len(last):
            zero[i] = last[-1] == 0.0
            silent[i] = (last == last[-1]).all() if len(last) == FEWEST else zero[i]
    return silent, zero


def _with_sensors(
    robot: Scenario, errors: Floats, silent: Flags, zero: Flags, expected: Floats, tolerance: Floats
) -> tuple[Scenario, tuple[str, ...], int]:
    """Return a robot with the sensors that errors (K, 9) show, in words, and how many are odd.

    Errors of what was not observed are NaN. ``expected`` (9,) is the rms error of whole channels.
    An odd channel observes something else than its robot should, for no reason known here. It is
    not used, as if it were stuck.
    """
    seen, noise = np.isfinite(errors), robot.gyro_noise
    errors, count = np.where(seen, errors, 0.0), np.maximum(seen.sum(axis=0), 1)
    mean = errors.sum(axis=0) / count
    deviation = np.sqrt((np.square(errors - mean) * seen).sum(axis=0) / count)
    off = ~silent & (np.sqrt(np.square(errors).sum(axis=0) / count) > tolerance)
    biased = off & (deviation < STEADY * np.abs(mean)) & (count >= FEWEST)
    odd, words = off & ~biased, list[str]()
    # All channels of a noisy gyroscope are, though one by itself may not be over its tolerance.
    heard = ~(silent | biased)[GYRO] & np.isfinite(expected[GYRO]) & seen[:, GYRO].any(axis=0)
    gyro, size = errors[:, GYRO][:, heard], int(seen[:, GYRO][:, heard].sum())
    if gyro.shape[1] >= 2 and size >= FEWEST_WHITE * gyro.shape[1]:
        power, usual = np.square(gyro).sum(), np.hypot(expected, SLACK * tolerance)[GYRO][heard]
        louder = power > np.square(usual).mean() * (size + LOUD * size**0.5)
        if louder and (gyro[1:] * gyro[:-1]).sum() < WHITE * power:  # white
            noise, odd[GYRO] = np.sqrt(power / size).reshape(1), False
            words = [f"gyro:noise={noise[0]:.3g}"]
    kinds = {"dropped": silent & zero, "stuck": silent & ~zero, "bias": biased, "odd": odd}
    for name, flags in kinds.items():
        for i in np.flatnonzero(flags):
            words.append(f"{CHANNELS[i]}:{name}" + (f"={mean[i]:.3g}" if name == "bias" else ""))
    sensors = {
        "gyro_noise": noise,
        "sensor_bias": robot.sensor_bias + np.where(biased, mean, 0.0),
        "sensor_dropped": robot.sensor_dropped | kinds["dropped"],
        "sensor_stuck": robot.sensor_stuck | kinds["stuck"] | odd,
    }
    return replace(robot, **sensors), tuple(words), int(odd.sum())


def _around(hypothesis: Hypothesis, spacing: float) -> list[Hypothesis]:
    """Return a hypothesis with its numbers on a grid about them."""
    axes = [
        np.unique(np.clip(number + spacing * STENCIL, *RANGES[word])).tolist()
        if word in RANGES
        else [number]
        for (_, word), number in zip(hypothesis.words, hypothesis.numbers, strict=True)
    ]
    return [hypothesis._replace(numbers=numbers) for numbers in product(*axes)]
