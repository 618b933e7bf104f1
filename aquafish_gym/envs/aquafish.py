"""Where ``AquaFishEnv`` once was: data sets and specifications of then name this module."""

from aquafish_gym.envs.env import AquaFishEnv

__all__ = ["AquaFishEnv"]
