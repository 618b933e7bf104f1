"""How faults are written, and read."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from aquafish_gym.damage.effect import CHANNELS
from aquafish_gym.damage.fault import Fault
from aquafish_gym.damage.fins import FinEntangled, FinMissing, FinScaled
from aquafish_gym.damage.sensors import ChannelBias, ChannelDropped, ChannelStuck, GyroNoise
from aquafish_gym.damage.servos import ServoDead, ServoGain, ServoSeized
from aquafish_gym.morphology import FINS, SIZES


class Word(NamedTuple):
    """How a fault is made of a part and, if it takes one, a number."""

    make: Callable[..., Fault]
    takes: bool | None = False  #: None is if it is given.


def _scaled(size: str, fin: str, factor: float) -> Fault:
    return FinScaled(fin, size, factor)


_FIN_WORDS = {size: Word(partial(_scaled, size), True) for size in SIZES} | {
    "missing": Word(FinMissing),
    "entangled": Word(FinEntangled, True),
    "weak": Word(ServoGain, True),
    "reversed": Word(lambda fin: ServoGain(fin, -1.0)),
    "seized": Word(ServoSeized, None),
    "dead": Word(ServoDead),
}
_CHANNEL_WORDS = {
    "bias": Word(ChannelBias, True),
    "stuck": Word(ChannelStuck),
    "dropped": Word(ChannelDropped),
}
#: Words that are not said here, and what is.
MEANT = {
    **dict.fromkeys(("shortened", "shorter"), "length=0.5"),
    **dict.fromkeys(("narrowed", "narrower"), "width=0.5"),
    **dict.fromkeys(("thinned", "thinner"), "thickness=0.5"),
    **dict.fromkeys(("oversized", "larger", "wider"), "entangled=0.5"),
    **dict.fromkeys(("lost", "gone", "torn"), "missing"),
    **dict.fromkeys(("slow", "slower"), "weak=0.5"),
    **dict.fromkeys(("jammed", "locked"), "seized"),
    **{word: f"gyro_x:{word}" for word in _CHANNEL_WORDS},
}
#: What can be said of each part.
WORDS: dict[str, dict[str, Word]] = {
    **dict.fromkeys(FINS, _FIN_WORDS),
    "gyro": {"noise": Word(lambda _part, deviation: GyroNoise(deviation), True)},
    **dict.fromkeys(CHANNELS, _CHANNEL_WORDS),
}
