"""What a robot was believed to be before an alarm, until its cause is known."""

from __future__ import annotations

from typing import NamedTuple

from aquafish.online.self_model import SelfModel
from aquafish.online.swimming import Gait
from aquafish_gym.damage import Damage


class Trusted(NamedTuple):
    """A belief to which the agent returns where no hypothesis fits."""

    model: SelfModel  #: It goes on beside the agent's.
    broken: Damage
    gait: Gait
