"""Tasks and an engine of somebody else, in a module that other programs can import."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.envs.tasks import Step, SwimForward, Task


class Axis(Enum):
    X = 0
    Z = 2


@dataclass(frozen=True)
class Along(Task):
    """Swim along a vector, which may be given as any numbers."""

    way: tuple[float, ...] = (0.0, 0.0, 1.0)
    seconds: float = 10.0
    axis: Axis = Axis.Z
    length: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "way", tuple(map(float, self.way)))
        object.__setattr__(self, "axis", Axis(self.axis))
        object.__setattr__(self, "length", float(np.linalg.norm(self.way)))

    def reward_terms(self, step: Step) -> Mapping[str, Any]:
        x, y, z = step.velocity
        return {"reward_along": self.way[0] * x + self.way[1] * y + self.way[2] * z}


class Plain(Task):
    """No dataclass, and made with other arguments than it has attributes."""

    def __init__(self, minutes: float, names: list[str] | None = None) -> None:
        self.seconds, self.names = 60.0 * minutes, names or ["a"]

    def reward_terms(self, step: Step) -> Mapping[str, Any]:
        return {"reward_up": step.velocity[2]}


@dataclass(frozen=True)
class Kept(SwimForward):
    """Keeps what it is given: an array would be a list when it is read again."""

    given: Any = None


class Engine(CompiledWorld):
    """An engine."""
