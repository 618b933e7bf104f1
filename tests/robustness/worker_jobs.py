"""What the process tests run in other processes; spawned ones import it by name."""

from __future__ import annotations

import hashlib
from typing import Any

import gymnasium as gym
import numpy as np

import aquafish_gym
from aquafish_gym.plans import AQUAFISH

STEPS = 8
ACTIONS = np.random.default_rng(5).uniform(-1, 1, (STEPS, 3)).astype(np.float32)
ENGINES = ("numba", "pybullet")


def make_env(engine: str, seed: int) -> gym.Env[Any, Any]:
    """Return an environment that draws its starts from ``seed``."""
    env = gym.make("AquaFish-v0", engine=engine, frame_skip=5, observe_fins=True)
    env.reset(seed=seed)
    return env


def make_numba() -> gym.Env[Any, Any]:
    return gym.make("AquaFish-v0", engine="numba", frame_skip=5, observe_fins=True)


def make_pybullet() -> gym.Env[Any, Any]:
    return gym.make("AquaFish-v0", engine="pybullet", fin_angles="random", observe_fins=True)


MAKERS = (make_numba, make_pybullet)


def digest(*arrays: Any) -> str:
    """Return a fingerprint of arrays' bytes."""
    found = hashlib.sha256()
    for one in arrays:
        found.update(np.ascontiguousarray(one).tobytes())
    return found.hexdigest()


def run_simulate(job: tuple[str, int]) -> str:
    """Return the fingerprint of 64 random trials, in threads, on an engine."""
    engine, seed = job
    rng = np.random.default_rng(seed)
    count = 64 if engine == "numba" else 4
    log = aquafish_gym.simulate(
        rng.uniform(0, AQUAFISH.maxima, (count, 9)),
        rng.uniform((-0.5, -0.5, 0), (0.5, 0.5, 1), (count, 3)),
        rng.uniform(-3, 3, (count, 3)),
        steps=300,
        engine=engine,
        threads=2 if engine == "numba" else None,
        record="pose",
    )
    return digest(log.rpy, log.gyro, log.position, log.quaternion, log.fin_angles)


def play(env: gym.Env[Any, Any], actions: Any = ACTIONS) -> list[Any]:
    """Return what the environment answers to some actions."""
    answers = []
    for action in actions:
        seen, reward, terminated, truncated, info = env.step(action)
        answers.append((seen.tobytes(), reward, terminated, truncated, info["y_position"]))
    return answers
