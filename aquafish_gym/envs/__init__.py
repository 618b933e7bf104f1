"""The robot as Gymnasium environments: one by itself, or many in the lanes of one engine."""

from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.vector import AquaFishVectorEnv

__all__ = ["AquaFishEnv", "AquaFishVectorEnv"]
