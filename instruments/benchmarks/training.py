"""Rows of how long PPO takes until it swims, as docs/howto/train.md trains it."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from importlib import import_module
from typing import Any

import gymnasium as gym

from gait.learning.train import isolated_rng
from gait.swims.evaluation import evaluate
from instruments.benchmarks.gait import NO_LEARNING
from instruments.benchmarks.rows import Group, Row, Settings

REFERENCE_RETURN = 59.9  # of "PPO, fins" in AquaFish-v0: docs/results/scores/table.md
SHARE = 0.9
ROLLOUT = 50  # steps of each robot
ROBOTS = 64
MOST_STEPS = 2_000_000
BETWEEN_SCORES = 5  # rollouts


def until_it_swims(settings: Settings, _cleanup: ExitStack) -> Group:
    """Return PPO on the batched environment, against PPO on as many single ones."""
    title, unit = f"PPO until {SHARE:.0%} of the reference return: time", "training"
    try:
        vec_env: Any = import_module("stable_baselines3.common.vec_env")
        adapter: Any = import_module("gait.learning.sb3_env").SB3VecEnv
    except ImportError:
        return Group(title, unit, [], [NO_LEARNING])
    count = 2 if settings.quick else ROBOTS

    def single() -> Any:
        return gym.make("AquaFish-v0", engine="numba", observe_fins=True)

    def one_by_one() -> Any:
        return vec_env.DummyVecEnv([single] * count)

    def batched() -> Any:
        return adapter(
            gym.make_vec(
                "AquaFish-v0", count, observe_fins=True, autoreset_mode="Disabled",
                threads=settings.cores,
            )
        )  # fmt: skip

    def row(
        what: str, make: Callable[[], Any], dtype: str, threads: int, against: Row | None = None
    ) -> Row:
        call = partial(_train, make, settings)
        return Row(what, "numba", dtype, count, threads, 1, call, against, as_time=True,
                   own_clock=True, most_turns=1)  # fmt: skip

    first = row("PPO, DummyVecEnv", one_by_one, "float64", 1)
    return Group(
        title, unit, [first, row("PPO, SB3VecEnv", batched, "float32", settings.cores, first)]
    )


def _train(make: Callable[[], Any], settings: Settings) -> float:
    """Return the seconds of training, without those of the scores, until a score is enough."""
    sb3: Any = import_module("stable_baselines3")
    vec_env: Any = import_module("stable_baselines3.common.vec_env")
    wanted = float("-inf") if settings.quick else SHARE * REFERENCE_RETURN
    with isolated_rng():
        envs = vec_env.VecNormalize(vec_env.VecMonitor(make()), gamma=0.99)
        model = sb3.PPO(
            "MlpPolicy", envs, n_steps=ROLLOUT, batch_size=ROLLOUT * envs.num_envs // 4,
            n_epochs=6, gamma=0.99, learning_rate=1e-3, device="cpu", seed=settings.seed,
        )  # fmt: skip
        taken, steps = 0.0, BETWEEN_SCORES * ROLLOUT * envs.num_envs
        while taken == 0.0 or evaluate(model, observe_fins=True).mean < wanted:
            if model.num_timesteps >= MOST_STEPS:
                raise RuntimeError(f"the return stays under {wanted:.1f} in {MOST_STEPS} steps")
            start = time.perf_counter()
            model.learn(steps, reset_num_timesteps=False)
            taken += time.perf_counter() - start
        envs.close()
    return taken
