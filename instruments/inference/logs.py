"""Logs as experiments: a body from rows at some rate, between which the commands change."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from aquafish_gym import simulate
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH
from eea import SwimLog, infer_log
from instruments.inference.robots import SPANS, Floats

#: Kinds of rows, each measured as often: rows a second; rows 0.02 to 0.06 s apart; and rows every
#: 0.001 s with two holes, then every 0.02 s.
RATES = ("100", "50", "33", "25", "20", "10", "uneven", "falling")
LOGS = {"rows": 20 * len(RATES)}
SECONDS = 10.0
NOISE = 0.02  # rad/s
HELD = (0.8, 2.2)  # s: how long a command lasts
SLOWEST_TAIL = 0.2  # Hz, so that each log tells something of each fin


def measure_log(number: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return what one log tells of its body."""
    rate = RATES[number % len(RATES)]
    shares = rng.uniform(0.5, 1.0, len(AQUAFISH.dimensions))
    body = Morphology.from_array(shares * Morphology.nominal().to_array())
    log = recorded(rate, body, rng)
    began = time.process_time()
    found = infer_log(log, seed=number, truth=body, threads=1)
    seconds = time.process_time() - began
    low, high = found.interval(0.9)
    truth = body.to_array()
    return {
        "rate": rate,
        "fitness": found.objective_fitness,
        "covered": ((low <= truth) & (truth <= high)).tolist(),
        "width": ((high - low) / SPANS).tolist(),
        "good": bool(found.belief.good),
        "seconds": seconds,
    }


def recorded(rate: str, body: Morphology, rng: np.random.Generator) -> SwimLog:
    """Return the log of a swim of random commands, which begins after the first of them."""
    steps = round(SECONDS / TIMESTEP)
    lowest = np.append(AQUAFISH.command_low[:2], SLOWEST_TAIL)
    changes = np.cumsum(rng.uniform(*HELD, round(SECONDS / HELD[0])))
    commands = rng.uniform(lowest, AQUAFISH.command_high, (len(changes) + 1, 3))
    # A step in which a command changes has the mean.
    edges = TIMESTEP * np.arange(steps + 1)
    times = np.concatenate([[0.0], changes])
    turned = np.cumsum(commands[:-1] * np.diff(times)[:, None], axis=0)
    turned = np.concatenate([np.zeros((1, 3)), turned])
    passed = np.stack([np.interp(edges, times, axis) for axis in turned.T], axis=1)
    series = np.clip(
        np.diff(passed, axis=0) / TIMESTEP, AQUAFISH.command_low, AQUAFISH.command_high
    )
    angles = rng.uniform(-np.pi, np.pi, 3)
    swum = simulate(
        body, series[None], angles, steps, dtype="float64", record="gyro", interval=1, threads=1
    )
    rates = np.concatenate([np.zeros((1, 3)), np.asarray(swum.gyro)[0]])
    rows = _rows(rate, rng)
    gyro = np.stack([np.interp(rows, edges, axis) for axis in rates.T], axis=1)
    gyro += rng.normal(0.0, NOISE, gyro.shape)
    return SwimLog(rows, gyro, commands[np.searchsorted(changes, rows, "right")])


def _rows(rate: str, rng: np.random.Generator) -> Floats:
    """Return the times of the rows, s."""
    last = SECONDS - TIMESTEP
    if rate == "uneven":
        time = np.cumsum(rng.uniform(0.02, 0.06, round(SECONDS / 0.02)))
        return time[time < last]
    if rate == "falling":
        fast = np.arange(rng.uniform(0.0, 0.001), 0.4 * SECONDS, 0.001)
        fast = np.delete(fast, np.r_[500:620, 2503:2623])
        slow = np.arange(0.4 * SECONDS + rng.uniform(0.0, 0.02), last, 0.02)
        return np.concatenate([fast, slow])
    step = 1.0 / float(rate)
    return np.arange(rng.uniform(0.0, step), last, step)


def summarise_logs(documents: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the logs' part of the report, by the rate of their rows."""
    return {
        rate: _summary([one for one in documents if one["rate"] == rate])
        for rate in RATES
        if any(one["rate"] == rate for one in documents)
    }


def _summary(documents: Sequence[dict[str, Any]]) -> dict[str, Any]:
    good = [one for one in documents if one["good"]]
    fitness = [one["fitness"] for one in documents]
    return {
        "logs": len(documents),
        "good": len(good),
        "median": float(np.median(fitness)),
        "least": float(np.min(fitness)),
        "covered": float(np.mean([one["covered"] for one in good])) if good else None,
        "seconds": float(np.mean([one["seconds"] for one in documents])),
    }
