"""AquaFish: a swimming robot, its water, and Gymnasium environments of it."""

from aquafish_gym.damage import Damage
from aquafish_gym.engines.base import simulate
from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import DIMENSIONS, Dimension, Morphology

__all__ = ["DIMENSIONS", "Damage", "Dimension", "ImuLog", "Morphology", "simulate"]
__version__ = "0.1.0"
