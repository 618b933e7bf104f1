"""The oracle of AquaFishRecovery-v0: in each episode a gait for the very robot that is left."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from aquafish.scores.entries import ENTRIES, Tell, evolve
from aquafish.scores.play import play_one, what_is_left
from aquafish_gym.engines.worlds import WorldConfig
from gait.config import EvolveConfig, Sense
from gait.controller import Controller
from gait.task import Crew

NAME = "AquaFishRecovery-v0"
LIKE = "CMA-ES, fins"  # the entry that is evolved


def oracle(tier: str, episode: int, shorter: int, tell: Tell) -> float:
    """Return how far a gait that was evolved for what is left swims from the onset on, in units.

    It is evolved for the body and the servos as they are once something is broken; where a sensor
    is broken, also one that hears the clock and the fins alone. Up to the onset the robot swims as
    one that was evolved for the whole robot; then whichever takes it farthest, that one included,
    takes over, told how the fins stand at that moment.
    """
    left = what_is_left(NAME, tier, episode)
    hears: list[tuple[Sense, ...]] = [("imu", "clock", "fins")]
    if any(left[f"sensor_{what}"].any() for what in ("noise", "bias", "lost")):
        hears.append(("clock", "fins"))
    left_gain, right, caudal = left["servo_gain"].tolist()
    world = WorldConfig(servo_gain=(left_gain, right, caudal))
    whole = _whole(shorter)
    configs = [replace(_like(), seed=episode, senses=senses) for senses in hears]
    gaits = [
        whole,
        *(evolve(c, shorter, tell, left["morphology"], world).controller for c in configs),
    ]
    return max(
        play_one(NAME, tier, partial(_crew, whole), partial(_crew, gait), episode) for gait in gaits
    )


def _crew(gait: Controller, fins: NDArray[np.float64]) -> Crew:
    return Crew([gait], fins)


@cache
def _whole(shorter: int) -> Controller:
    """Return the gait that all episodes begin with."""
    return evolve(replace(_like(), seed=0), shorter, lambda *_: None).controller


def _like() -> EvolveConfig:
    config = ENTRIES[LIKE].config
    assert isinstance(config, EvolveConfig)
    return config
