"""Recognising in mid-swim what broke: all hypotheses are simulated in one batch.

Hypotheses (``aquafish.online.hypotheses``) are simulated from the state before the change, with the
robot's own actions. The numbers of the best are narrowed.
A broken sensor deviates under every hypothesis. So each channel's own error is profiled out of the
likelihood, and a broken one costs all hypotheses alike; K is the number of observations::

    cost = sum over channels of K / 2 log(sigma^2 + sum of r^2 / K) - log prior
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from aquafish.online.hypotheses import DamageGrid, FinFaults, all_hypotheses, broken
from aquafish.online.self_model import LEAST_OBSERVATION_SD, noise_of, predict
from aquafish_gym.damage import Damage
from aquafish_gym.damage.sensors import GYRO_CHANNELS
from aquafish_gym.physics.layout import start_rows
from aquafish_gym.scenario import CHANNELS, Scenario
from aquafish_gym.utils.array_types import Flags, Floats

BIAS_COST = 4.0  # minus its log prior
COMPARED_ACTIONS = 15  # over which all hypotheses are compared
NARROWED_HYPOTHESES = 16  # in the first two rounds
LATE_HYPOTHESES = 4  # in later rounds
NARROWING_ROUNDS = 6
FIRST_SPACING = 0.12  # of the numbers that are tried
SPACING_RATIO = 2.6  # of the spacing in a round to that in the next
BIAS_DEVIATION = 0.3  # errors that deviate less from their mean, relative to it, are a bias
NOISE_CORRELATION = 0.4  # errors that correlate less with the one before are noise
TOLERATED_NOISE = 0.25  # of a channel's tolerance: as noise, less error of the model does not count
# By chance the sum of N squared errors, in standard deviations, is N +- 1.4 sqrt(N).
NOISE_EXCESS = 5.0
FEWEST_OBSERVATIONS = 3  # that show a bias or a stuck channel
FEWEST_NOISE_OBSERVATIONS = 8  # that show noise
POSES_PER_FIN = 16  # from which its initial angle is narrowed
SENSOR_FIELDS = ("gyro_noise", "sensor_bias", "sensor_stuck", "sensor_dropped")


@dataclass(frozen=True, eq=False)
class Recognised:
    """What explains the observations best.

    Attributes
    ----------
    damage, before
        What broke of its fins, and the number of the robot that it happened to.
    sensors
        What is broken of its sensors, in words.
    robot
        What it became, its sensors included: a scenario of one.
    state
        (25,) of that robot after the last action.
    explained
        Whether this explains most channels; False is "none of my hypotheses".
    alternatives
        The best damages of different words, the likeliest first.
    """

    damage: Damage
    before: int
    sensors: tuple[str, ...]
    robot: Scenario
    state: Floats
    explained: bool
    alternatives: tuple[Alternative, ...] = ()


class Alternative(NamedTuple):
    """What may have broken, and how likely that is among the alternatives."""

    damage: Damage
    #: Likelihood times prior at the best numbers, relative to the sum over the alternatives.
    weight: float
    robot: Scenario  #: What it would be: a scenario of one.


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
        (25,) the states before the first action, the second, and so on. Something may have broken
        at any of them.
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
    until = COMPARED_ACTIONS + len(states)
    each = [(grid, row) for grid in everything for row in range(len(grid.numbers))]
    sizes = [len(grid.numbers) for grid in everything]
    prior = np.repeat([grid.prior_cost for grid in everything], sizes)
    earlier = [float(costs(before[0], 0, 0, k)[0]) if k else 0.0 for k in range(len(states))]
    banks = [broken(robot, everything) for robot in before]
    first = np.array([costs(banks[b], b, k, until) + prior + earlier[k] for b, k in cases])
    order = np.argsort(first, axis=None, kind="stable")[:NARROWED_HYPOTHESES]
    chosen = []
    for place in order.tolist():
        case, number = divmod(place, len(prior))
        grid, row = each[number]
        chosen.append((case, grid.row(row)))
    spacing = FIRST_SPACING
    best: dict[FinFaults, tuple[float, int, DamageGrid]] = {}  # by their words
    for turn in range(NARROWING_ROUNDS):
        ends = []
        for case in sorted({case for case, _ in chosen}):
            (b, onset), ones = cases[case], [one for which, one in chosen if which == case]
            tried = [one.around(spacing) for one in ones]
            values = costs(broken(before[b], tried), b, onset) + earlier[onset]
            parts = np.split(values, np.cumsum([len(grid.numbers) for grid in tried])[:-1])
            for part, grid in zip(parts, tried, strict=True):
                total = float(part.min()) + grid.prior_cost
                ends.append((total, case, grid.row(int(part.argmin()))))
        ends.sort(key=lambda end: end[:2])
        for end in ends:
            words = end[2].words
            best[words] = min(end, best.get(words, end), key=lambda one: one[0])
        chosen = [end[1:] for end in ends[: NARROWED_HYPOTHESES if turn < 1 else LATE_HYPOTHESES]]
        spacing /= SPACING_RATIO
    case, likeliest = chosen[0]
    b, onset = cases[case]
    damage = likeliest.damage()
    robot = damage.edit(before[b])
    robot = replace(robot, **{name: getattr(before[-1], name) for name in SENSOR_FIELDS})
    predicted, ended = predict(robot, states[onset], actions[onset:], hold)
    used = np.isfinite(noise) & np.isfinite(observed).any(axis=0)
    errors = np.where(used, observed[onset:] - predicted[0], 0.0)
    silent &= used
    robot, sensors, odd = _with_sensors(robot, errors, silent, zero, noise, tolerance)
    explained = odd <= max(1, int(used.sum()) // 3)
    others = [(total, cases[k][0], one.damage()) for total, k, one in best.values()]
    return Recognised(
        damage, b, sensors, robot, ended[:, 0], explained, _alternatives(others, before)
    )


def _alternatives(
    found: list[tuple[float, int, Damage]], before: Sequence[Scenario]
) -> tuple[Alternative, ...]:
    """Return damages of robots ``before`` with their weights, of costs in nats."""
    found = sorted(found, key=lambda one: one[0])
    likelihoods = np.exp([found[0][0] - cost for cost, *_ in found])
    weights = (likelihoods / likelihoods.sum()).tolist()
    return tuple(
        Alternative(one, weight, one.edit(before[b]))
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
    variance = np.square(noise[used]) + LEAST_OBSERVATION_SD**2
    errors = predicted[:, :, used] - observed[:, used]
    errors[:, ~seen] = 0.0
    squares = np.square(errors).sum(axis=1)
    found = 0.5 * count * np.log(variance + squares / count)
    around = squares - count * np.square(errors.sum(axis=1) / count)
    biased = 0.5 * count * np.log(variance + around / count)
    biased += np.where(count >= FEWEST_OBSERVATIONS, BIAS_COST + 0.5 * np.log(count), np.inf)
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
    turn = 2 * np.pi * np.arange(POSES_PER_FIN) / POSES_PER_FIN
    spacing = turn[1]
    grid = np.stack(np.meshgrid(turn, turn, turn), -1)
    stencil = np.arange(-1, 2)
    around = np.stack(np.meshgrid(stencil, stencil, stencil), -1).reshape(-1, 3)
    poses: Floats = grid.reshape(-1, 3)
    for _ in range(NARROWING_ROUNDS):
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
        best = poses[np.argsort(costs, kind="stable")[:NARROWED_HYPOTHESES]]
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
        last = column[np.isfinite(column)][-FEWEST_OBSERVATIONS:]
        if len(last):
            zero[i] = last[-1] == 0.0
            silent[i] = (last == last[-1]).all() if len(last) == FEWEST_OBSERVATIONS else zero[i]
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
    biased = off & (deviation < BIAS_DEVIATION * np.abs(mean)) & (count >= FEWEST_OBSERVATIONS)
    odd, words = off & ~biased, list[str]()
    # All channels of a noisy gyroscope are, though one by itself may not be over its tolerance.
    heard = (
        ~(silent | biased)[GYRO_CHANNELS]
        & np.isfinite(expected[GYRO_CHANNELS])
        & seen[:, GYRO_CHANNELS].any(axis=0)
    )
    gyro, size = errors[:, GYRO_CHANNELS][:, heard], int(seen[:, GYRO_CHANNELS][:, heard].sum())
    if gyro.shape[1] >= 2 and size >= FEWEST_NOISE_OBSERVATIONS * gyro.shape[1]:
        power = np.square(gyro).sum()
        usual = np.hypot(expected, TOLERATED_NOISE * tolerance)[GYRO_CHANNELS][heard]
        louder = power > np.square(usual).mean() * (size + NOISE_EXCESS * size**0.5)
        if louder and (gyro[1:] * gyro[:-1]).sum() < NOISE_CORRELATION * power:  # white
            noise, odd[GYRO_CHANNELS] = np.sqrt(power / size).reshape(1), False
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
