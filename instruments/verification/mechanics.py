"""The multibody mechanics without water, against MuJoCo's.

Random robots are set moving, their servos run for 5 s, and three statements of the motion are
compared with the one that MuJoCo's inertia matrix and bias forces give: the momentum form, and
the engines' scheme at ever shorter steps.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import AQUAFISH, BodyPlan
from instruments.verification.convergence import attitude_gap
from instruments.verification.harness import (
    POSITION,
    QUATERNION,
    march,
)
from instruments.verification.momentum import (
    Momentum,
    angular_momentum,
    hinge_motion,
    total_momentum,
)
from instruments.verification.mujoco_robot import DryRobot
from instruments.verification.trials import Trials, random_trials

Array = NDArray[np.float64]

SECONDS = 5.0
ORACLE_STEP = 0.005
STEPS = (0.01, 0.005, 0.0025)
EXTRAPOLATED = "extrapolated"
WHAT = {"position": "units", "attitude": "rad", "momentum": "units^4/s", "angular": "units^5/s"}


def random_starts(count: int, seed: int, plan: BodyPlan = AQUAFISH) -> tuple[Trials, Array, Array]:
    """Return trials, and a velocity (count, 3) and a spin (count, 3) to start them with."""
    rng = np.random.default_rng(seed + 1)
    velocity, spin = 0.3 * rng.normal(size=(count, 3)), rng.normal(size=(count, 3))
    return random_trials(count, seed, plan), velocity, spin


def moving_rows(trials: Trials, velocity: Array, spin: Array) -> Array:
    """Return states (state_rows, B), upright, whose servos already run."""
    _, rates, _ = hinge_motion(trials.plan, trials.fin_angles, 2 * np.pi * trials.commands)
    return layout(trials.plan).start(trials.fin_angles, velocity, spin, rates)


def compare(
    robots: int = 20, seed: int = 0, seconds: float = SECONDS, plan: BodyPlan = AQUAFISH
) -> Iterator[dict[str, Array]]:
    """Yield each robot's gaps to MuJoCo: ``{statement: (4,)}`` in the order of ``WHAT``.

    The statement ``mujoco`` is MuJoCo's motion itself, whose momenta should not have changed;
    its first two gaps are 0.
    """
    trials, velocity, spin = random_starts(robots, seed, plan)
    rows = moving_rows(trials, velocity, spin)

    def scheme(h: float) -> Array:
        bodies, commands, steps = trials.morphologies, trials.commands, round(seconds / h)
        return march("float64", bodies, rows, commands, h, steps, wet=False, plan=plan)

    ends = {h: scheme(h) for h in STEPS}
    for b in range(robots):
        yield _compare_one(b, trials, velocity[b], spin[b], ends, seconds)


def _compare_one(
    b: int, trials: Trials, velocity: Array, spin: Array, ends: dict[float, Array], seconds: float
) -> dict[str, Array]:
    plan, sizes = trials.plan, trials.morphologies[b]
    body = Morphology.from_array(sizes, plan)
    dry = DryRobot(body, trials.commands[b], trials.fin_angles[b])
    count = round(seconds / ORACLE_STEP)
    start = np.concatenate([np.zeros(3), [0, 0, 0, 1.0], velocity, spin])
    truth = dry.run(start, ORACLE_STEP, count)
    linear, angular = dry.momenta(0.0, start)

    def gaps(position: Array, quaternion: Array, p: Array, momentum: Array) -> Array:
        return np.array(
            [
                np.linalg.norm(position - truth[:3]),
                attitude_gap(quaternion, truth[3:7]),
                np.linalg.norm(p - linear),
                np.linalg.norm(momentum - angular),
            ]
        )

    found = {"mujoco": gaps(truth[:3], truth[3:7], *dry.momenta(seconds, truth))}
    model = Momentum.of(trials, b, wet=False)
    y = model.run(model.moving(velocity, spin), ORACLE_STEP, count)
    found["momentum"] = gaps(y[:3], y[3:7], *model.momenta(y))
    for h, end in ends.items():
        row = end[:, b]
        momenta = total_momentum(sizes, row, plan), angular_momentum(sizes, row, plan)
        found[f"{h:g}"] = gaps(row[POSITION], row[QUATERNION], *momenta)
    row = extrapolate(*(end[:, b] for end in ends.values()))
    row[QUATERNION] /= np.linalg.norm(row[QUATERNION])
    momenta = total_momentum(sizes, row, plan), angular_momentum(sizes, row, plan)
    found[EXTRAPOLATED] = gaps(row[POSITION], row[QUATERNION], *momenta)
    return found


def extrapolate(coarse: Array, middle: Array, fine: Array) -> Array:
    """Return what three steps, each half of the one before, tend to (Richardson).

    It cancels errors in the first and second power of the step, and so shows a wrong term that
    the scheme's own error would hide.
    """
    limit: Array = (coarse - 6 * middle + 8 * fine) / 3
    return limit


def summary(parts: list[dict[str, Array]]) -> list[dict[str, object]]:
    """Return median and maximum over robots for each statement and each of ``WHAT``."""
    records: list[dict[str, object]] = []
    for statement in parts[0]:
        gaps = np.array([part[statement] for part in parts])
        for i, (what, unit) in enumerate(WHAT.items()):
            records.append(
                {
                    "statement": statement,
                    "what": what,
                    "unit": unit,
                    "median": float(np.median(gaps[:, i])),
                    "maximum": float(gaps[:, i].max()),
                }
            )
    return records
