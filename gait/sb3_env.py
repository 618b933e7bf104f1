"""Environments for stable-baselines3; the code is in :mod:`gait.learning.sb3_env`."""

from gait.learning.sb3_env import LaneVecEnv, SB3VecEnv

__all__ = ["LaneVecEnv", "SB3VecEnv"]
