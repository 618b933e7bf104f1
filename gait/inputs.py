"""A controller's inputs for many robots at once, in numpy: what learners are shown.

``network.respond`` states what a controller hears; here are the same numbers in the same order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.envs.conditions import reckon
from aquafish_gym.physics.arithmetic import TAU
from gait.network import GOAL_SCALE, GYRO_SCALE, Senses


def inputs(
    senses: Senses,
    clock: float,
    observations: NDArray[np.float32],
    times: NDArray[np.float64],
    fins: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Return what B controllers hear, (B, I) in the order of ``senses.names``.

    Parameters
    ----------
    senses, clock
        What they feel, and the frequency of their clock in Hz.
    observations
        (B, k) of an environment, which end with the way to the goal where that is felt.
    times
        (B,) s since each one's episode began.
    fins
        (B, 3) where the fins are, in rad, as far as is known.

    Examples
    --------
    >>> inputs(Senses(), 0.7, np.zeros((2, 9), np.float32), np.zeros(2), np.zeros((2, 3))).shape
    (2, 11)
    """
    turns = np.outer(times, TAU * clock * np.arange(1, senses.clock + 1))
    angles = np.hstack([turns, fins]) if senses.fins else turns
    waves = np.stack([np.sin(angles), np.cos(angles)], axis=2).reshape(len(times), -1)
    gyro = np.clip(observations[:, 6:9] / GYRO_SCALE, -1.0, 1.0)
    imu = [observations[:, :6], gyro] if senses.imu else []
    goal = []
    if senses.goal:
        way = observations[:, -3:]
        goal = [way / np.sqrt(np.square(way).sum(axis=1, keepdims=True) + GOAL_SCALE**2)]
    return np.hstack([*imu, waves, *goal], dtype=np.float32, casting="same_kind")


def reckoned(
    fins: NDArray[np.float64], actions: NDArray[np.floating], seconds: float
) -> NDArray[np.float64]:
    """Return where fins (B, 3), in rad, are after actions (B, 3), if the servos do as told."""
    left, right, caudal = fins.T
    told = np.clip(actions, -1.0, 1.0, dtype=np.float64).T
    return np.stack(reckon((left, right, caudal), (told[0], told[1], told[2]), seconds), axis=1)
