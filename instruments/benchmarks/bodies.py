"""Rows of what a changed body costs, before it swims."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from itertools import cycle

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.morphology import Morphology
from aquafish_gym.scenario import Scenario
from instruments.benchmarks.rows import (
    Group,
    Row,
    Settings,
    missing_mujoco,
    missing_pybullet,
)
from instruments.verification.mujoco_model import mujoco_model
from instruments.verification.trials import random_trials


def new_bodies(settings: Settings, cleanup: ExitStack) -> Group:
    """Return PyBullet building a robot, the lanes taking a batch, MuJoCo building a model."""
    from aquafish_gym.engines.compiled.lanes import LaneBatch

    trials = random_trials(settings.robots, settings.seed)
    bodies = trials.morphologies
    scenario = Scenario.create(bodies, fin_angles=trials.fin_angles)
    notes = missing_pybullet()
    rows: list[Row] = []
    reference = None
    if not notes:
        reference = Row("reset", "pybullet", "float64", 1, 1, 1, _bullet(bodies, cleanup),
                        as_time=True)  # fmt: skip
        rows.append(reference)
    for kind in (np.float32, np.float64):

        def fill(dtype: type[np.floating] = kind) -> object:
            return LaneBatch(scenario, dtype, threads=1)

        rows.append(
            Row("pack a batch", "numba", np.dtype(kind).name, len(bodies), 1, len(bodies),
                fill, reference, as_time=True)
        )  # fmt: skip
    no_mujoco = missing_mujoco()
    if not no_mujoco:
        rows.append(
            Row("build a model", "mujoco", "float64", 1, 1, 1, _mujoco(bodies), reference,
                as_time=True)
        )  # fmt: skip
    return Group("a new body: time each", "body", rows, notes + no_mujoco)


def _bullet(bodies: NDArray[np.float64], cleanup: ExitStack) -> Callable[[], object]:
    from aquafish_gym.engines.bullet.world import BulletWorld

    world = BulletWorld()
    cleanup.callback(world.close)
    following = cycle([Scenario.create(body) for body in bodies])
    return lambda: world.start(next(following))


def _mujoco(bodies: NDArray[np.float64]) -> Callable[[], object]:
    following = cycle([Morphology.from_array(body) for body in bodies])
    return lambda: mujoco_model(next(following), TIMESTEP)
