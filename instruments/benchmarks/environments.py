"""Rows of the Gymnasium environments, and of one that everybody knows.

All with their defaults: a step of ours is ``frame_skip`` physics steps of 0.01 s, 20 today; one of
the swimmer is four.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import gymnasium as gym
import numpy as np

from aquafish_gym import Morphology  # registers AquaFish-v0
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.scenario import Scenario
from instruments.benchmarks.rows import Group, Row, Settings, missing_mujoco, missing_pybullet

ROBOTS = 1024
DRAWN_ACTIONS = 64  # drawn before, so that drawing is not timed


def single_and_vector(settings: Settings, cleanup: ExitStack) -> Group:
    """Return single environments on both engines, the batched one, and MuJoCo's swimmer."""
    notes = missing_pybullet()
    rows: list[Row] = []
    reference = None
    if not notes:
        env = gym.make("AquaFish-v0", engine="pybullet")
        reference = Row("AquaFish-v0", "pybullet", "float64", 1, 1, 1,
                        _stepper(env, settings, cleanup))  # fmt: skip
        rows.append(reference)
    env = gym.make("AquaFish-v0", engine="numba")
    rows.append(Row("AquaFish-v0", "numba", "float64", 1, 1, 1,
                    _stepper(env, settings, cleanup), reference))  # fmt: skip
    robots = min(ROBOTS, settings.robots)
    rows += _vector_rows(robots, 1, reference, settings, cleanup)
    if settings.cores > 1:
        rows += _vector_rows(robots, settings.cores, rows[-2], settings, cleanup)
    no_mujoco = missing_mujoco()
    if not no_mujoco:
        env = gym.make("Swimmer-v5")
        rows.append(Row("Swimmer-v5", "mujoco", "float64", 1, 1, 1,
                        _stepper(env, settings, cleanup), reference))  # fmt: skip
    return Group("environments: env-steps", "env-step", rows, notes + no_mujoco)


def _vector_rows(
    robots: int, threads: int, against: Row | None, settings: Settings, cleanup: ExitStack
) -> list[Row]:
    """Return the steps of a batch, and its engine's part of them."""
    envs: Any = gym.make_vec("AquaFish-v0", num_envs=robots, threads=threads)
    cleanup.callback(envs.close)
    envs.reset(seed=settings.seed)
    envs.action_space.seed(settings.seed)
    actions = [envs.action_space.sample() for _ in range(DRAWN_ACTIONS)]
    count = 0

    def step() -> None:
        nonlocal count
        envs.step(actions[count % DRAWN_ACTIONS])
        count += 1

    bodies = np.tile(Morphology.nominal().to_array(), (robots, 1))
    lanes = LaneBatch(Scenario.create(bodies), threads=threads)
    commands = np.full((robots, 3), 0.25)
    whole = Row("make_vec", "numba", "float32", robots, threads, robots, step, against)
    physics = Row("of which physics", "numba", "float32", robots, threads, robots,
                  lambda: lanes.advance(commands, envs.frame_skip), whole, share=True)  # fmt: skip
    return [whole, physics]


def _stepper(env: gym.Env[Any, Any], settings: Settings, cleanup: ExitStack) -> Callable[[], None]:
    """Return what takes one step, and resets when an episode is over."""
    cleanup.callback(env.close)
    env.reset(seed=settings.seed)
    env.action_space.seed(settings.seed)
    actions = [env.action_space.sample() for _ in range(DRAWN_ACTIONS)]
    count = 0

    def step() -> None:
        nonlocal count
        _, _, terminated, truncated, _ = env.step(actions[count % DRAWN_ACTIONS])
        count += 1
        if terminated or truncated:
            env.reset()

    return step
