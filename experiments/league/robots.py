"""The robots of the learned rivals' training, as a vector environment of stable-baselines3."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from aquafish.online.gaits import load_library
from aquafish_gym.bodies import body_array
from aquafish_gym.utils.array_types import Flags
from experiments.league.policy import CLOCK, INTERVAL, LARGEST, SENSES, drive
from gait.learning.sb3_env import LaneVecEnv

TIERS = ("severe", "moderate", "mild")
DAMAGE = "gyro:noise=0.01; random:{}@15-30"


class ResidualVecEnv(LaneVecEnv):
    """Robots that add actions to those of a gait.

    They observe the policy's inputs and their previous action. Their episodes begin at different
    times: otherwise each horizon would show all of them at the same time of the episode.

    Parameters
    ----------
    count
        Number of robots.
    episode
        Actions of an episode.
    seed
        Of the episodes.
    """

    def __init__(self, count: int, episode: int, seed: int) -> None:
        self._gait = load_library()[0]
        self._episode = episode
        self._previous = np.zeros((count, 3), np.float32)
        damage = [DAMAGE.format(TIERS[i % len(TIERS)]) for i in range(count)]
        super().__init__(count, body_array(None), SENSES, CLOCK, INTERVAL, "recovery", damage)
        self.action_space = Box(-LARGEST, LARGEST, (3,), np.float32)
        self.observation_space = Box(-1.0, 1.0, (len(SENSES.names) + 3,), np.float32)
        self.seed(seed)

    def reset(self) -> NDArray[np.float32]:
        """Begin an episode of every robot, one after another; return what all observe."""
        observations = super().reset()
        robots = np.arange(self.num_envs)
        for k in range(self._episode):
            self.step_async(np.zeros((self.num_envs, 3), np.float32))
            self.step_wait()
            mask = robots * self._episode // self.num_envs == k
            if mask.any():
                observations = self._begin(mask)
        self.earned[:] = np.nan
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Take what the policy adds to the gait's actions."""
        self._previous = np.clip(actions + self._base, -1.0, 1.0, dtype=np.float32)
        super().step_async(self._previous)

    def _begun(self, mask: Flags, info: dict[str, Any]) -> None:
        super()._begun(mask, info)
        self._previous[mask] = 0.0

    def _observe(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        seen = super()._observe(observations)
        self._base = np.clip(drive(self._gait, seen.astype(float)), -1.0, 1.0)
        return np.hstack([seen, self._previous])
