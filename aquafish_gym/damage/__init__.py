"""What can break, and what that makes of a robot."""

from aquafish_gym.damage.damage import Damage
from aquafish_gym.damage.effect import CHANNELS, Effect
from aquafish_gym.damage.fault import Fault
from aquafish_gym.damage.fins import FinEntangled, FinMissing, FinScaled
from aquafish_gym.damage.sensors import ChannelBias, ChannelDropped, ChannelStuck, GyroNoise
from aquafish_gym.damage.servos import ServoDead, ServoGain, ServoSeized
from aquafish_gym.damage.tiers import TIERS, RandomFaults

__all__ = [
    "CHANNELS",
    "TIERS",
    "ChannelBias",
    "ChannelDropped",
    "ChannelStuck",
    "Damage",
    "Effect",
    "Fault",
    "FinEntangled",
    "FinMissing",
    "FinScaled",
    "GyroNoise",
    "RandomFaults",
    "ServoDead",
    "ServoGain",
    "ServoSeized",
]
