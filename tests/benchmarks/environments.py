"""Rows of the Gymnasium environments, and of one that everybody knows.

A step of ours is five physics steps; one of the swimmer is four.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import gymnasium as gym

import aquafish_gym  # noqa: F401  # registers AquaFish-v0
from tests.benchmarks.rows import Group, Row, Settings, missing_mujoco, missing_pybullet

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
    one = _vector_row(robots, 1, reference, settings, cleanup)
    rows.append(one)
    if settings.cores > 1:
        rows.append(_vector_row(robots, settings.cores, one, settings, cleanup))
    no_mujoco = missing_mujoco()
    if not no_mujoco:
        env = gym.make("Swimmer-v5")
        rows.append(Row("Swimmer-v5", "mujoco", "float64", 1, 1, 1,
                        _stepper(env, settings, cleanup), reference))  # fmt: skip
    return Group("environments: env-steps", "env-step", rows, notes + no_mujoco)


def _vector_row(
    robots: int, threads: int, against: Row | None, settings: Settings, cleanup: ExitStack
) -> Row:
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

    return Row("make_vec", "numba", "float32", robots, threads, robots, step, against)


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
