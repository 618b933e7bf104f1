"""A MuJoCo robot: Gymnasium's Swimmer finds its weak motor from its own observations.

    python examples/mujoco_robot.py

It needs the extra mujoco. A trial's inputs are its actions, in which the candidates swim by
``mujoco.rollout``, a model for each.
"""

from __future__ import annotations

import copy
from typing import Any

import gymnasium as gym
import numpy as np
from mujoco import MjData
from mujoco.rollout import Rollout
from numpy.typing import NDArray

from eea import FitConfig, Hypothesis, Number, Robot, Trial

MOTORS = ("front motor", "rear motor")
OBSERVED = {"heading": "rad", "front joint": "rad", "rear joint": "rad", "surge": "m/s"}
OBSERVED |= {"sway": "m/s", "turn": "rad/s", "front rate": "rad/s", "rear rate": "rad/s"}
ACTIONS = 40  # in a trial
NOISE = 0.02  # sd of each observation, in its unit
WORLD: Any = gym.make("Swimmer-v5").unwrapped
MODELS = [WORLD.model]
POOL = Rollout(nthread=2)


def swim(values: Any, actions: NDArray[Any]) -> NDArray[Any]:
    """Return what B Swimmers observe (B, T, 8) who do ``actions`` (B, T, 2)."""
    while len(MODELS) < len(actions):
        MODELS.append(copy.copy(WORLD.model))
    models = MODELS[: len(actions)]
    strengths = np.stack([values[motor] for motor in MOTORS], axis=-1)
    for model, strength, density in zip(models, strengths, values["density"], strict=True):
        model.actuator_gear[:, 0] = 150.0 * strength  # N m
        model.opt.density = density
    start = np.zeros((len(models), 3 + len(OBSERVED)))  # first the time and the place
    start[:, 3:] = np.stack([values[f"{name} at first"] for name in OBSERVED], axis=-1)
    hold = WORLD.frame_skip
    data = [MjData(WORLD.model) for _ in range(2)]
    states, _ = POOL.rollout(models, data, start, np.repeat(actions, hold, axis=1))
    observed: NDArray[Any] = states[:, hold - 1 :: hold, 3:]
    return observed


STRENGTH = Number(0.0, 1.5, healthy=1.0)  # as a share of what it should be
WEAKER = Number(mean=0.0, sd=0.5, high=0.0)
SWIMMER = Robot(
    simulate=swim,
    numbers=dict.fromkeys(MOTORS, STRENGTH)
    | {"density": Number(4000.0, sd=100.0)}
    | {f"{name} at first": Number(0.0, sd=0.06, varies=True) for name in OBSERVED},
    channels=OBSERVED,
    hypotheses=[Hypothesis(f"the {m} is weak", moves={m: WEAKER}) for m in MOTORS],
)


def main(share: float = 0.7) -> Any:
    """Return what a swim tells of a rear motor that has a share of its strength."""
    rng = np.random.default_rng(0)
    env: Any = gym.make("Swimmer-v5")
    env.reset(seed=0)
    env.unwrapped.model.actuator_gear[1, 0] *= share
    actions = np.sin(np.outer(np.arange(ACTIONS), [0.3, 0.2]) + np.array([0.0, 2.0]))
    observed = np.array([env.step(action)[0] for action in actions])
    trial = Trial(observed + NOISE * rng.normal(size=observed.shape), actions)
    effort = FitConfig(alternatives="always", bodies=8, poses=8, descents=2, polished=1, restarts=0)
    found = SWIMMER.infer([trial], config=effort, noise=dict.fromkeys(OBSERVED, NOISE))
    print("\n".join(found.findings))
    return found


if __name__ == "__main__":
    main()
