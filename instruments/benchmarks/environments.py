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
DAMAGE = "random:moderate@2-10"  # as policies are trained


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
    batches = _vector_rows(robots, 1, reference, settings, cleanup)
    rows += batches
    if settings.cores > 1:
        rows += _vector_rows(robots, settings.cores, batches[0], settings, cleanup)
    no_mujoco = missing_mujoco()
    if not no_mujoco:
        env = gym.make("Swimmer-v5")
        rows.append(Row("Swimmer-v5", "mujoco", "float64", 1, 1, 1,
                        _stepper(env, settings, cleanup), reference))  # fmt: skip
    return Group("environments: env-steps", "env-step", rows, notes + no_mujoco)


def _vector_rows(
    robots: int, threads: int, against: Row | None, settings: Settings, cleanup: ExitStack
) -> list[Row]:
    """Return whole episodes of a batch with random damage and without, and parts of them."""
    broken = _make_vec(robots, threads, DAMAGE, settings, cleanup)
    intact = _make_vec(robots, threads, None, settings, cleanup)
    actions = [intact.action_space.sample() for _ in range(DRAWN_ACTIONS)]
    steps = intact.episode_steps + 1  # in the last one, the next episode begins

    def swim(envs: Any, count: int) -> None:
        for i in range(count):
            envs.step(actions[i % DRAWN_ACTIONS])

    bodies = np.tile(Morphology.nominal().to_array(), (robots, 1))
    lanes = LaneBatch(Scenario.create(bodies), threads=threads)
    commands = np.full((robots, 3), 0.25)

    def row(what: str, amount: int, call: Callable[[], object], *of: Row, share: bool) -> Row:
        other = of[0] if of else against
        return Row(what, "numba", "float32", robots, threads, amount, call, other, share=share)

    many = robots * steps
    first = row("damaged episodes", many, lambda: swim(broken, steps), share=False)
    whole = row("intact episodes", many, lambda: swim(intact, steps), first, share=False)
    physics = row(
        "of which physics",
        robots,
        lambda: lanes.advance(commands, intact.frame_skip),
        whole,
        share=True,
    )
    return [first, whole, physics]


def resets(settings: Settings, cleanup: ExitStack) -> Group:
    """Return resets of all robots of a batch, without seeds."""
    robots = min(ROBOTS, settings.robots)
    rows: list[Row] = []
    for what, damage in (("intact", None), ("damaged", DAMAGE)):
        envs = _make_vec(robots, 1, damage, settings, cleanup)
        rows.append(
            Row(
                f"reset, {what}", "numba", "float32", robots, 1, 1, envs.reset,
                rows[0] if rows else None, as_time=True,
            )
        )  # fmt: skip
    return Group("resets of all robots: time", "reset", rows)


def _make_vec(
    robots: int, threads: int, damage: str | None, settings: Settings, cleanup: ExitStack
) -> Any:
    """Return a batch that has begun."""
    envs: Any = gym.make_vec("AquaFish-v0", num_envs=robots, threads=threads, damage=damage)
    cleanup.callback(envs.close)
    envs.reset(seed=settings.seed)
    envs.action_space.seed(settings.seed)
    return envs


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
