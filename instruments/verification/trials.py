"""The random trials on which the studies compare, and engines' robots from bodies and angles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.engines.worlds import World, make_world
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.scenario import Scenario

STILL = (0.0, 0.0, 0.0)


class Trials(NamedTuple):
    """B trials of a body, a command and fin angles each."""

    morphologies: NDArray[np.float64]  #: (B, S)
    commands: NDArray[np.float64]  #: (B, F) rev/s or Hz
    fin_angles: NDArray[np.float64]  #: (B, F) rad: angles, or phases of fins that sweep
    plan: BodyPlan = AQUAFISH

    def rows(self, rows: slice) -> Trials:
        """Return some of them."""
        return Trials(
            self.morphologies[rows], self.commands[rows], self.fin_angles[rows], self.plan
        )


def random_trials(count: int, seed: int = 0, plan: BodyPlan = AQUAFISH) -> Trials:
    """Return trials with bodies, commands and fin angles drawn uniformly over their ranges."""
    rng = np.random.default_rng(seed)
    fins = len(plan.fins)
    bodies = rng.uniform(0, 1, (count, 3 * fins)) * plan.maxima
    commands = rng.uniform(plan.command_low, plan.command_high, (count, fins))
    return Trials(bodies, commands, rng.uniform(-np.pi, np.pi, (count, fins)), plan)


def lane_batch(
    bodies: ArrayLike,
    angles: ArrayLike,
    current: ArrayLike = STILL,
    dtype: type[np.floating] = np.float32,
    substeps: int = 1,
    threads: int | None = None,
    width: int | None = None,
    **fields: object,
) -> LaneBatch:
    """Return robots in the lanes; ``fields`` are of ``Scenario.create``."""
    scenario = Scenario.create(bodies, fin_angles=angles, current=current, **fields)  # type: ignore[arg-type]
    return LaneBatch(scenario, dtype, substeps, threads, width)


def one_world(
    engine: str,
    body: ArrayLike | None = None,
    angles: ArrayLike = STILL,
    current: ArrayLike = STILL,
    substeps: int = 1,
    **fields: object,
) -> World:
    """Return one robot in an engine; ``fields`` are of ``Scenario.create``."""
    scenario = Scenario.create(body, fin_angles=angles, current=current, **fields)  # type: ignore[arg-type]
    return make_world(engine, scenario, substeps)


def rotations(rpy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrices (T, 3, 3) from body to world of roll, pitch and yaw (T, 3), rad."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy).T, np.sin(rpy).T
    rows = [
        [cy * cr - sy * sp * sr, -sy * cp, cy * sr + sy * sp * cr],
        [sy * cr + cy * sp * sr, cy * cp, sy * sr - cy * sp * cr],
        [-cp * sr, sp, cp * cr],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
