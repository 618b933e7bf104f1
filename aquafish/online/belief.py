"""What an agent believes of its robot and of the water, once it has measured its own error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from aquafish.online import thresholds
from aquafish.online.gaits import Gait
from aquafish.online.monitor import SurpriseMonitor
from aquafish.online.self_model import SelfModel
from aquafish_gym.damage import Damage
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats


class Water(NamedTuple):
    """How well the self-model knows the water."""

    foreign: bool = False  #: Whether it has another law than the model's.
    predicted: bool = True  #: Whether the model predicts the gyroscope in it.
    wandering: bool = False  #: Whether its current depends on the place.


@dataclass
class Belief:
    """What the robot is, and how well that is known."""

    model: SelfModel  #: The robot as it is believed to be, in its present state.
    damage: Damage  #: What is broken of it.
    intact: Scenario  #: The robot without that, in the same water.
    drift: Floats  #: (9,) rms error of the model's own predictions.
    monitor: SurpriseMonitor  #: Of what surprises the model.
    water: Water

    def copy(self) -> Belief:
        """Return a belief whose model goes on by itself."""
        return replace(self, model=self.model.copy())


class Trusted(NamedTuple):
    """What was believed before an alarm, to which the agent returns where no hypothesis fits."""

    belief: Belief  #: Its model goes on beside the agent's.
    gait: Gait


def predicts(drift: Floats, observed: Floats) -> bool:
    """Return whether a self-model predicts the gyroscope.

    ``drift`` (3,) is the rms error of its open-loop predictions, and ``observed`` (K, 3) what the
    gyroscope read, rad/s; NaN where it did not.
    """
    power = np.nanmean(np.square(observed)) if np.isfinite(observed).any() else 0.0
    return bool(np.mean(np.square(drift)) < thresholds.PREDICTED_SHARE**2 * power)
