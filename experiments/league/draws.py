"""What may break beyond the tiers of random damage, drawn by an episode's number.

Numbers that are published or held out were drawn once: ``aquafish_gym.held_out`` has them.

Three faults at once the agent can name. A damage of ``OUTSIDE`` it cannot: there it should end no
lower than *blind*, which never looks for damage. And a current may begin while nothing breaks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aquafish_gym.envs.task import Memory
from aquafish_gym.envs.tasks import Recover
from aquafish_gym.physics.arithmetic import Number, Vector, where_less
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import CHANNELS
from aquafish_gym.utils.array_types import Triple

Draw = Callable[[np.random.Generator], str]

ONSETS = (15.0, 30.0)  # s
FASTEST = 0.2  # units/s, of a current


def episode_rng(number: int, tier: str) -> np.random.Generator:
    """Return the generator from which what an episode of a tier alone has is drawn."""
    return np.random.default_rng([number, *tier.encode()])


def _onset(rng: np.random.Generator, latest: float = ONSETS[1]) -> float:
    return round(float(rng.uniform(ONSETS[0], latest)), 1)


def _fins(rng: np.random.Generator) -> list[str]:
    return [str(fin) for fin in rng.permutation(AQUAFISH.names)]


def _number(rng: np.random.Generator, low: float, high: float) -> float:
    return round(float(rng.uniform(low, high)), 2)


def _smaller(rng: np.random.Generator) -> str:
    """Return a word that takes a part of a fin or of its servo."""
    word = rng.choice(["length", "width", "weak"])
    return f"{word}={_number(rng, 0.3, 0.7)}"


def three_faults(rng: np.random.Generator) -> str:
    """Return a fault of each fin, all at once."""
    onset = _onset(rng)
    return "; ".join(f"{fin}:{_smaller(rng)}@{onset}" for fin in AQUAFISH.names)


def four_faults(rng: np.random.Generator) -> str:
    """Return a fault of each fin, and another one of the servo of the first."""
    onset = _onset(rng)
    first, *others = _fins(rng)
    faults = [f"{first}:{rng.choice(['length', 'width'])}={_number(rng, 0.3, 0.7)}"]
    faults += [f"{first}:weak={_number(rng, 0.3, 0.7)}"]
    faults += [f"{fin}:{_smaller(rng)}" for fin in others]
    return "; ".join(f"{fault}@{onset}" for fault in faults)


def thickness(rng: np.random.Generator) -> str:
    """Return a pectoral fin that becomes thicker, and another fin that becomes thinner.

    The caudal fin is nearly as thick as a fin can be.
    """
    onset = _onset(rng)
    one, other = rng.permutation(AQUAFISH.names[:2])
    thinner = rng.choice([other, "caudal"])
    thin, thick = _number(rng, 0.1, 0.3), _number(rng, 2.0, 4.0)
    return f"{thinner}:thickness={thin}@{onset}; {one}:thickness={thick}@{onset}"


def too_strong(rng: np.random.Generator) -> str:
    """Return a servo that turns too fast, and weed on another fin."""
    onset = _onset(rng)
    one, other, _ = _fins(rng)
    fast, weed = _number(rng, 1.3, 1.8), _number(rng, 0.4, 0.9)
    return f"{one}:weak={fast}@{onset}; {other}:entangled={weed}@{onset}"


def two_channels(rng: np.random.Generator) -> str:
    """Return faults of two sensor channels at once."""
    onset = _onset(rng)
    words = ["stuck", "dropped", f"bias={_number(rng, 0.15, 0.4)}"]
    channels = rng.choice(CHANNELS, 2, replace=False)
    return "; ".join(f"{channel}:{rng.choice(words)}@{onset}" for channel in channels)


def growing(rng: np.random.Generator) -> str:
    """Return a fin that loses a share five times, 3 s apart."""
    onset = _onset(rng, 25.0)
    fin = rng.choice(AQUAFISH.names)
    word = rng.choice(["length", "width", "weak"])
    share = _number(rng, 0.8, 0.9)
    return "; ".join(f"{fin}:{word}={share}@{round(onset + 3.0 * k, 1)}" for k in range(5))


def intermittent(rng: np.random.Generator) -> str:
    """Return a servo that fails for 3 s, five times, 6 s apart."""
    onset = _onset(rng, 25.0)
    fin = rng.choice(AQUAFISH.names)
    word = rng.choice(["seized", "reversed", "weak=0.3"])
    return "; ".join(f"{fin}:{word}@{round(onset + 6.0 * k, 1)}+3" for k in range(5))


OUTSIDE: dict[str, Draw] = {
    "thickness": thickness,
    "too strong": too_strong,
    "four faults": four_faults,
    "two channels": two_channels,
    "growing": growing,
    "intermittent": intermittent,
}


@dataclass(frozen=True)
class BeginningCurrent(Recover):
    """Swim forward for a minute in still water, which begins to flow.

    Attributes
    ----------
    onset
        When it begins, s.
    flow
        (3,) its velocity, units/s.
    """

    onset: float = ONSETS[0]
    flow: Triple = (0.0, 0.0, 0.0)

    def current(self, memory: Memory, seconds: Number) -> Vector:  # noqa: ARG002
        """Return the current."""
        x, y, z = self.flow
        flows = where_less(seconds, self.onset, 0.0, 1.0)
        return (x * flows, y * flows, z * flows)


def beginning_current(rng: np.random.Generator) -> BeginningCurrent:
    """Return a task with a current of half the highest speed or more, in any direction."""
    direction = rng.standard_normal(3)
    speed = rng.uniform(FASTEST / 2.0, FASTEST) / np.linalg.norm(direction)
    x, y, z = (speed * direction).tolist()
    return BeginningCurrent(onset=_onset(rng), flow=(x, y, z))
