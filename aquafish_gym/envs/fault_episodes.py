"""The damage of each robot's next episode: drawn as it begins on NumPy, before on a device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from aquafish_gym.damage.damage import UNUSED, Damage
from aquafish_gym.damage.draws import Draws, Parts
from aquafish_gym.envs.channels import Channels
from aquafish_gym.envs.fault_player import FaultPlayer
from aquafish_gym.envs.fault_streams import FaultStreams
from aquafish_gym.utils.array_libraries import ArrayLibrary, NumPyLibrary
from aquafish_gym.utils.array_types import Rows

DRAWN_EPISODES = 4096  # of random damage, at a reset: each robot has one after the other of them


class HostFaults:
    """The faults of B robots on NumPy, whose episodes are drawn as they begin.

    Attributes
    ----------
    player
        Applies them.
    streams
        Draw random damage and noise.
    """

    def __init__(self, channels: Channels, count: int) -> None:
        self._channels = channels
        sensors = channels.sizes["observation"]
        self.streams = FaultStreams(count, sensors)
        # Half precision has too small a range for the numbers of faults.
        double = channels.observation.dtype != np.float32
        precision = {"action": True, "observation": double}
        self.player = FaultPlayer(channels, count, NumPyLibrary(), precision, self.streams.white)
        self._loaded: list[Damage | None] = [None] * count

    def load(self, robots: Rows, damages: Sequence[Damage]) -> None:
        """Let robots (n,) begin their next episode with damages of theirs, given all B."""
        alike: dict[int, list[int]] = {}  # robots by the identity of their damage
        for robot in robots.tolist():
            damage = damages[robot]
            if damage.is_random or damage is not self._loaded[robot]:
                alike.setdefault(id(damage), []).append(robot)
                self._loaded[robot] = damage
        if not alike:
            return
        drawn = []
        for rows in alike.values():
            damage = damages[rows[0]]
            draws_from = self.streams.damage if damage.is_random else lambda _: UNUSED
            drawn.append(damage.draw([draws_from(row) for row in rows], self._channels.parts))
        new = np.concatenate([*alike.values()])
        stages = self._channels.stages(Draws.join(drawn, np.arange(len(new))))
        self.player.load(new, stages)


def device_player(
    channels: Channels,
    damages: Sequence[Damage],
    first_damages: Sequence[Damage],
    observations: Any,
    rng: np.random.Generator,
) -> FaultPlayer:
    """Return a player of robots on a device, whose episodes are drawn now.

    Parameters
    ----------
    channels
        The channels of a robot.
    damages, first_damages
        B of them, which may be random; those of the first episodes may be others.
    observations
        (B, ...) of the library and on the device of all that follow.
    rng
        Draws the episodes of random damage. Noise is drawn on the device.

    Raises
    ------
    InvalidArgumentError
        If the library is unknown.
    """
    library = ArrayLibrary(observations, int(rng.integers(2**31)))
    double = str(observations.dtype).endswith("float64")
    shape = (len(damages), channels.sizes["observation"])
    player = FaultPlayer(
        channels,
        len(damages),
        library,
        {"action": double, "observation": double},
        lambda *_: library.normal(shape),
    )
    episodes = draw_episodes(damages, first_damages, channels.parts, rng)
    stages = channels.stages(episodes.draws)
    player.play(stages, episodes.starts, None if episodes.repeat else episodes.following)
    return player


class Episodes(NamedTuple):
    """The damages of P episodes, and their order for each of B robots."""

    draws: Draws  #: of the P episodes
    starts: Rows  #: (B,) the first episode of each robot
    following: Rows  #: (P,) the episode after each
    repeat: bool  #: whether each robot's episodes are all the same


def draw_episodes(
    damages: Sequence[Damage],
    first_damages: Sequence[Damage],
    parts: Parts,
    rng: np.random.Generator,
) -> Episodes:
    """Draw the episodes of random damages; robots of the same damage begin far apart in them."""
    robots: dict[Damage, list[int]] = {}
    for robot, damage in enumerate(damages):
        robots.setdefault(damage, []).append(robot)
    several = sum(damage.is_random for damage in robots)
    drawn: list[Draws] = []
    following: list[int] = []
    starts = np.zeros(len(damages), int)
    for damage, alike in robots.items():
        size = max(DRAWN_EPISODES // several, len(alike)) if damage.is_random else 1
        begin = len(following)
        starts[alike] = begin + np.arange(len(alike)) * size // len(alike)
        drawn.append(damage.draw([rng] * size, parts))
        following += [*range(begin + 1, begin + size), begin]
    if first_damages is not damages:
        following += starts.tolist()
        starts = len(following) - len(damages) + np.arange(len(damages))
        drawn += [damage.draw([rng], parts) for damage in first_damages]
    draws = Draws.join(drawn, np.arange(len(following)))
    repeat = first_damages is damages and not several
    return Episodes(draws, starts, np.array(following), repeat)
