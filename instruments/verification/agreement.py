"""How far the engines, and single and double precision, differ on the same trials."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP, simulate
from aquafish_gym.imu import ImuLog
from aquafish_gym.plans import AQUAFISH, BodyPlan
from instruments.verification.trials import Trials, random_trials

Array = NDArray[np.float64]

WHAT = {"rpy": "rad", "gyro": "rad/s", "position": "units"}
AT_ONCE = 250  # robots whose logs are kept in memory together


def swim(engine: str, dtype: str, trials: Trials, steps: int) -> ImuLog:
    """Return the whole log of trials in still water."""
    return simulate(
        trials.morphologies, trials.commands, trials.fin_angles, steps=steps, engine=engine,
        dtype=dtype, record="pose", plan=trials.plan,
    )  # fmt: skip


def differences(one: ImuLog, other: ImuLog) -> dict[str, Array]:
    """Return the largest difference so far, (B, T), of each of ``WHAT``."""
    found = {}
    for field in WHAT:
        gap = np.abs(np.asarray(getattr(one, field), np.float64) - getattr(other, field))
        found[field] = np.maximum.accumulate(gap.max(axis=2), axis=1)
    return found


def engines(
    robots: int = 20,
    lane_robots: int = 2000,
    steps: int = 512,
    seed: int = 0,
    plan: BodyPlan = AQUAFISH,
) -> list[dict[str, object]]:
    """Return how far PyBullet and the compiled engine differ, and how far its precisions.

    A robot's difference is the largest over its samples; a record has the median and the maximum
    over robots.
    """
    every = random_trials(max(robots, lane_robots), seed, plan)
    records: list[dict[str, object]] = []
    for name, first, second, count in (
        ("PyBullet, numba float64", ("pybullet", "float64"), ("numba", "float64"), robots),
        ("numba float32, float64", ("numba", "float32"), ("numba", "float64"), lane_robots),
    ):
        trials = _part(every, 0, count)
        gaps = differences(swim(*first, trials, steps), swim(*second, trials, steps))
        for field, unit in WHAT.items():
            worst = gaps[field][:, -1]
            records.append(
                {
                    "engines": name,
                    "robots": count,
                    "what": field,
                    "unit": unit,
                    "median": float(np.median(worst)),
                    "maximum": float(worst.max()),
                }
            )
    return records


def _part(trials: Trials, begin: int, end: int) -> Trials:
    return trials.rows(slice(begin, end))


DURATIONS = (0.32, 0.64, 1.28, 2.56, 5.12, 10.24, 20.0)
QUANTILES = {"median": 0.5, "90%": 0.9, "99%": 0.99, "maximum": 1.0}


def single_precision(
    robots: int = 2000,
    durations: tuple[float, ...] = DURATIONS,
    seed: int = 0,
    plan: BodyPlan = AQUAFISH,
) -> Iterator[dict[str, Array]]:
    """Yield float32's differences from float64 up to each duration, some robots at a time.

    Each maps what to an array (b, durations); :func:`quantiles` sums them up.
    """
    every = random_trials(robots, seed, plan)
    steps = [round(d / TIMESTEP) for d in durations]
    for begin in range(0, robots, AT_ONCE):
        trials = _part(every, begin, min(begin + AT_ONCE, robots))
        gaps = differences(
            swim("numba", "float32", trials, steps[-1]), swim("numba", "float64", trials, steps[-1])
        )
        at = [s - 1 for s in steps]
        yield {field: gap[:, at] for field, gap in gaps.items()}


def quantiles(
    parts: list[dict[str, Array]], durations: tuple[float, ...] = DURATIONS
) -> list[dict[str, object]]:
    """Return a record for each of ``WHAT`` and each duration: quantiles over robots."""
    records: list[dict[str, object]] = []
    for field, unit in WHAT.items():
        gaps = np.concatenate([part[field] for part in parts])
        for i, duration in enumerate(durations):
            shares = {name: float(np.quantile(gaps[:, i], q)) for name, q in QUANTILES.items()}
            records.append({"what": field, "unit": unit, "seconds": duration, **shares})
    return records
